//! Opening and retention.

use super::*;

const DAY: i64 = 24 * 3600 * 1000;

fn days(days: u64) -> Option<Duration> {
    Some(Duration::from_secs(days * 24 * 3600))
}

on_both! {
    async fn a_store_is_well_and_keeps_what_it_has_when_opened_again(place) {
        let store = place.open().await;
        assert!(store.is_well().await);
        store.write(&[position("a", 1)], &[]).await.unwrap();
        store.close().await;
        assert!(!store.is_well().await);
        assert_eq!(times(&place.open().await.positions("hall", "a", EVER(), 10).await.unwrap()), [1]);
    }

    async fn a_store_of_a_newer_version_is_refused_and_left_alone(place) {
        let store = place.open().await;
        store.write(&[position("a", 1)], &[]).await.unwrap();
        let newer = "INSERT INTO _sqlx_migrations (version, description, success, checksum, execution_time) \
                     SELECT version + 1000, 'later', success, checksum, 0 FROM _sqlx_migrations";
        sqlx::query(newer).execute(&store.pool).await.unwrap();
        assert!(matches!(Store::open(&place.url).await, Err(StoreError::Newer(_))));
        sqlx::query("DELETE FROM _sqlx_migrations WHERE version > 1000").execute(&store.pool).await.unwrap();
        assert_eq!(times(&place.open().await.positions("hall", "a", EVER(), 10).await.unwrap()), [1]);
    }

    async fn old_positions_are_thinned_to_the_first_of_each_second_and_tag(place) {
        let store = place.open().await;
        // 10 Hz over three minutes, of two tags; b is 50 ms behind.
        let rows: Vec<_> = (0..1800).flat_map(|i| [position("a", i * 100), position("b", i * 100 + 50)]).collect();
        store.write(&rows, &[]).await.unwrap();
        store.compact(at(DAY)).await.unwrap();
        let retention = Retention { thin_after: days(1), ..Retention::default() };
        // The second minute's end is not yet a day ago.
        store.retain(retention, at(DAY + 119_000)).await.unwrap();
        let expect = |offset: i64, thin_to: i64| -> Vec<i64> {
            let thin = (0..thin_to / 1000).map(|s| s * 1000 + offset);
            thin.chain((thin_to / 100..1800).map(|i| i * 100 + offset)).rev().collect()
        };
        for (tag, offset) in [("a", 0), ("b", 50)] {
            let read = store.positions("hall", tag, EVER(), 10_000).await.unwrap();
            assert_eq!(times(&read), expect(offset, 60_000));
        }
        // A late row makes its minute be thinned again.
        store.write(&[position("a", 1_250), position("c", 1_250)], &[]).await.unwrap();
        store.compact(at(2 * DAY)).await.unwrap();
        store.retain(retention, at(2 * DAY)).await.unwrap();
        let read = store.positions("hall", "a", EVER(), 10_000).await.unwrap();
        assert_eq!(times(&read), expect(0, 180_000));
        assert_eq!(times(&store.positions("hall", "c", EVER(), 10).await.unwrap()), [1_250]);
    }

    async fn what_is_older_than_the_retention_is_deleted_with_tags_events_and_health(place) {
        let store = place.open().await;
        let rows: Vec<_> = (0..30).map(|minute| position("old", minute * 60_000)).collect();
        let events = [event(1, 0, EventKind::Entered), event(2, DAY, EventKind::Left)];
        store.write(&rows, &events).await.unwrap();
        store.write(&[position("kept", 0), position("kept", DAY)], &[]).await.unwrap();
        store.write_health(&[health("0x0101", 3_540_000), health("0x0101", 3_600_000)]).await.unwrap();
        store.compact(at(DAY / 2)).await.unwrap();
        // One that is old when it comes.
        store.write(&[position("old", 10)], &[]).await.unwrap();
        let retention = Retention { delete_after: days(1), ..Retention::default() };
        store.retain(retention, at(DAY + 3_600_000)).await.unwrap();
        let tags = store.tags().await.unwrap();
        assert_eq!(tags.iter().map(|tag| tag.tag.as_str()).collect::<Vec<_>>(), ["kept"]);
        assert_eq!(times(&store.positions("hall", "kept", EVER(), 10).await.unwrap()), [DAY]);
        let left = store.events(None, EVER(), &[], None, 10).await.unwrap();
        assert_eq!(left.iter().map(|event| event.id).collect::<Vec<_>>(), [2]);
        assert_eq!(store.health("hall", "0x0101", EVER(), 10).await.unwrap(), [health("0x0101", 3_600_000)]);
        // The tag comes back, and has nothing of what it had.
        store.write(&[position("old", DAY)], &[]).await.unwrap();
        assert_eq!(times(&store.positions("hall", "old", EVER(), 100).await.unwrap()), [DAY]);
        assert_eq!(store.last_event().await.unwrap(), 2);
    }

    async fn a_store_of_the_first_version_is_upgraded_with_what_is_in_it(place) {
        let engine = if place.schema.is_some() { Engine::Postgres } else { Engine::Sqlite };
        sqlx::any::install_default_drivers();
        let url = match engine {
            Engine::Postgres => place.url.clone(),
            Engine::Sqlite => format!("sqlite://{}?mode=rwc", place.folder.path().join("old.db").display()),
        };
        let old = sqlx::AnyPool::connect(&url).await.unwrap();
        let first = super::migrations::migrations(engine).into_iter().take(1).collect();
        sqlx::migrate::Migrator::with_migrations(first).run(&old).await.unwrap();
        let insert = "INSERT INTO sites (name, walls) VALUES ('hall', '[[[0.0,0.0],[4.0,0.0]]]')";
        sqlx::query(insert).execute(&old).await.unwrap();
        assert!(sqlx::query("SELECT * FROM nodes").execute(&old).await.is_err(), "the first version has no nodes");
        old.close().await;
        let name = url.trim_start_matches("sqlite://").trim_end_matches("?mode=rwc");
        // Twice: what is new need not be upgraded.
        for _ in 0..2 {
            let store = Store::open(name).await.unwrap();
            let sites = store.sites().await.unwrap();
            assert_eq!((sites[0].name.as_str(), sites[0].walls_m.len()), ("hall", 1));
            assert!(store.nodes().await.unwrap().is_empty());
            store.write(&[position("a", 1)], &[]).await.unwrap();
            store.close().await;
        }
    }

    async fn positions_of_tags_for_which_there_is_no_number_hold_up_no_others(place) {
        let store = place.open().await;
        store.write(&[position("a", 1)], &[]).await.unwrap();
        // 2^20 - 1 is the greatest number that the key of a position has room for.
        let last = "INSERT INTO tags (id, site, tag, first_ms, last_ms) VALUES (1048575, 'hall', 'last', 0, 0)";
        sqlx::query(last).execute(&store.pool).await.unwrap();
        let rows = [position("a", 2), position("new", 2), position("last", 2), position("new", 3)];
        let left_out = store.write(&rows, &[event(1, 2, EventKind::Moved)]).await.unwrap();
        assert_eq!(left_out, 2);
        assert_eq!(times(&store.positions("hall", "a", EVER(), 10).await.unwrap()), [2, 1]);
        assert_eq!(times(&store.positions("hall", "last", EVER(), 10).await.unwrap()), [2]);
        assert_eq!(store.tags().await.unwrap().len(), 2);
        assert_eq!(store.last_event().await.unwrap(), 1);
    }
}

#[tokio::test]
async fn a_file_that_is_no_store_is_refused_by_name_and_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let text = folder.path().join("notes.txt");
    std::fs::write(&text, "not a database, but long enough to be read as the head of one: ".repeat(20)).unwrap();
    let before = std::fs::read(&text).unwrap();
    let error = Store::open(text.to_str().unwrap()).await.unwrap_err().to_string();
    assert!(error.contains("notes.txt"), "{error}");
    assert_eq!(std::fs::read(&text).unwrap(), before);

    let other = folder.path().join("other.db");
    let url = format!("sqlite://{}?mode=rwc", other.display());
    execute(&url, "CREATE TABLE birds (name TEXT)".to_owned()).await;
    let before = std::fs::read(&other).unwrap();
    assert!(matches!(Store::open(other.to_str().unwrap()).await, Err(StoreError::Foreign(_))));
    assert_eq!(std::fs::read(&other).unwrap(), before);

    let error = Store::open(folder.path().join("none/a.db").to_str().unwrap()).await.unwrap_err().to_string();
    assert!(error.contains("none/a.db"), "{error}");
}

#[tokio::test]
async fn an_error_does_not_show_the_password_of_the_database() {
    let error = Store::open("postgres://me:secret@127.0.0.1:1/none?password=secret").await.unwrap_err();
    let text = error.to_string();
    assert!(text.contains("postgres://127.0.0.1:1/none") && !text.contains("secret"), "{text}");
    assert!(text.contains("refused"), "{text}");
}
