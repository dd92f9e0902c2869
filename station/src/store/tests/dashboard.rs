//! The SQL of the dashboard in `deploy/grafana`.

use serde_json::Value;

use super::*;

on_both! {
    async fn the_statements_of_the_dashboard_find_what_was_written(place) {
        // They are in the SQL of PostgreSQL.
        if place.schema.is_none() {
            return;
        }
        let store = place.open().await;
        let rows = (0..90).map(|s| TagPosition {
            room: Some("lab".to_owned()),
            sigma_x_m: 0.3,
            sigma_y_m: 0.4,
            ..position("a", s * 1000)
        });
        store.write(&rows.collect::<Vec<_>>(), &[event(1, 5, EventKind::Left)]).await.unwrap();
        // The first minute is in `history`, half a minute in `recent`.
        store.compact(at(70_000)).await.unwrap();
        let text = include_str!("../../../../deploy/grafana/postgresql.json");
        let dashboard: Value = serde_json::from_str(text).unwrap();
        let panels = dashboard["panels"].as_array().unwrap();
        assert!(panels.len() >= 6);
        for panel in panels {
            let title = panel["title"].as_str().unwrap();
            let sql = panel["targets"][0]["rawSql"].as_str().unwrap();
            // What Grafana puts in place of its macros: the hour that begins with 2026.
            let sql = sql.replace("$__unixEpochFrom()", "1767225600").replace("$__unixEpochTo()", "1767229200");
            assert!(!sql.contains("$__"), "{sql}");
            // The driver for any database knows no times; as JSON they are texts.
            let sql = format!("SELECT CAST(row_to_json(answer) AS TEXT) FROM ({sql}) AS answer");
            let answers = sqlx::query(sqlx::AssertSqlSafe(sql.clone())).fetch_all(&store.pool).await;
            let answers = answers.unwrap_or_else(|error| panic!("{title}: {error}: {sql}"));
            let answers: Vec<Value> =
                answers.iter().map(|row| serde_json::from_str(&rows::get::<String>(row, 0).unwrap()).unwrap()).collect();
            let values: Vec<_> = answers.iter().map(|answer| answer["value"].as_f64()).collect();
            match title {
                "Positions a minute" | "Rooms, share of the time" => assert_eq!(values, [Some(60.0), Some(30.0)]),
                // hypot(0.3 m, 0.4 m).
                "Standard deviation, mean of a minute" => assert_eq!(values, [Some(0.5), Some(0.5)]),
                // 12.345678 s.
                "Hours in rooms and zones" => {
                    let hours = answers[0]["hours"].as_f64().unwrap();
                    assert!((hours - 12.345_678 / 3600.0).abs() < 1e-9, "{answers:?}");
                }
                "Tags" => assert_eq!((&answers[0]["tag"], answers.len()), (&"a".into(), 1)),
                "Events" => assert_eq!((&answers[0]["alarm"], &answers[0]["kind"]), (&true.into(), &"left".into())),
                other => panic!("{other}: what should it find?"),
            }
        }
    }
}
