//! Every route, used as intended.

use hyper::{Method, header};
use serde_json::{Value, json};
use station_core::model::{HealthFigures, NodeHealth, NodeRole, SiteFinding};
use station_core::{ReportKind, Utc};

use crate::api::client::{SITE, keys, open, png};

const POSITION: [&str; 13] = [
    "site",
    "tag",
    "t",
    "x_m",
    "y_m",
    "z_m",
    "sigma_x_m",
    "sigma_y_m",
    "sigma_z_m",
    "cov_xy_m2",
    "room",
    "used",
    "doubt",
];

#[tokio::test]
async fn page_has_its_files_with_a_strict_policy_and_entity_tags() {
    let station = open().await;
    for (path, media_type) in [("/", "text/html; charset=utf-8"), ("/assets/main.js", "text/javascript; charset=utf-8")]
    {
        let answer = station.get(path).await;
        assert_eq!((answer.status.as_u16(), answer.header(header::CONTENT_TYPE)), (200, media_type));
        let policy = answer.header(header::CONTENT_SECURITY_POLICY);
        assert!(policy.starts_with("default-src 'none'; script-src 'self';") && !policy.contains("unsafe"), "{policy}");
        assert_eq!(answer.header(header::X_CONTENT_TYPE_OPTIONS), "nosniff");
        let mut again = station.request(Method::GET, path);
        again.headers_mut().insert(header::IF_NONE_MATCH, answer.headers[header::ETAG].clone());
        assert_eq!(station.send(again).await.status, 304);
    }
    let head = station.send(station.request(Method::HEAD, "/assets/main.js")).await;
    assert_eq!((head.status.as_u16(), head.body.len()), (200, 0));
}

#[tokio::test]
async fn health_and_metrics_tell_what_runs() {
    let station = open().await;
    let health = station.get("/healthz").await;
    assert_eq!(health.status, 200);
    assert_eq!(keys(&health.json()), ["title", "status", "store", "hub", "version"]);
    assert_eq!((&health.json()["store"], &health.json()["hub"]), (&json!(true), &json!(true)));
    station.report_position("0x1001", 1.0, 2.0).await;
    station.until("/api/v1/tags", |tags| tags[0].is_object()).await;
    let metrics = station.get("/metrics").await;
    assert!(metrics.header(header::CONTENT_TYPE).starts_with("text/plain; version=0.0.4"));
    let text = String::from_utf8(metrics.body.to_vec()).unwrap();
    assert!(text.contains("# TYPE baliza_tags gauge\n"), "{text}");
    assert!(text.contains("\nbaliza_tags{state=\"reporting\"} 1\n"), "{text}");
    // Each line is a comment, or a name with a number (exposition format 0.0.4).
    assert!(text.lines().all(|line| line.starts_with("# ") || line.rsplit_once(' ').unwrap().1.parse::<f64>().is_ok()));
}

#[tokio::test]
async fn the_dashboard_asks_for_metrics_that_are_there() {
    let station = open().await;
    let metrics = station.get("/metrics").await;
    let metrics = String::from_utf8(metrics.body.to_vec()).unwrap();
    let dashboard: Value = serde_json::from_str(include_str!("../../../deploy/grafana/prometheus.json")).unwrap();
    let targets = dashboard["panels"].as_array().unwrap().iter().flat_map(|panel| panel["targets"].as_array().unwrap());
    let mut asked = 0;
    for expression in targets.map(|target| target["expr"].as_str().unwrap()) {
        let is_of_name = |c: char| c.is_ascii_alphanumeric() || c == '_';
        for name in expression.split(|c| !is_of_name(c)).filter(|word| word.starts_with("baliza_")) {
            asked += 1;
            assert!(metrics.contains(&format!("# TYPE {name} ")), "{expression}");
        }
    }
    assert!(asked >= 10, "{asked}");
}

#[tokio::test]
async fn tags_have_their_last_position_and_their_history_newest_first_in_pages() {
    let station = open().await;
    for x_m in [1.0, 2.0, 3.0] {
        station.report_position("0x1001", x_m, 5.0).await;
        tokio::time::sleep(std::time::Duration::from_millis(5)).await;
    }
    let tags = station.until("/api/v1/tags?site=lab", |tags| tags[0]["last_position"]["x_m"] == 3.0).await;
    let expected = [
        "tag",
        "site",
        "name",
        "first_seen",
        "last_seen",
        "last_position",
        "rate_hz",
        "silent",
        "reason",
        "zones",
        "supply_v",
    ];
    assert_eq!(keys(&tags[0]), expected);
    assert_eq!(keys(&tags[0]["last_position"]), POSITION);
    assert_eq!(station.get("/api/v1/tags?site=other").await.json(), json!([]));

    let path = "/api/v1/tags/0x1001/positions?limit=2";
    station.until("/api/v1/tags/0x1001/positions?site=lab", |rows| rows.as_array().map(Vec::len) == Some(3)).await;
    let first = station.get(path).await;
    let xs = |answer: &crate::api::client::Answer| -> Vec<f64> {
        answer.json().as_array().unwrap().iter().map(|row| row["x_m"].as_f64().unwrap()).collect()
    };
    assert_eq!(xs(&first), [3.0, 2.0]);
    assert_eq!(keys(&first.json()[0]), POSITION);
    let link = first.header(header::LINK).to_owned();
    let next = link.strip_prefix('<').unwrap().strip_suffix(">; rel=\"next\"").unwrap();
    let second = station.get(next).await;
    assert_eq!((xs(&second), second.header(header::LINK)), (vec![1.0], ""));
}

#[tokio::test]
async fn a_message_to_a_tag_is_taken_listed_and_withdrawn() {
    let station = open().await;
    let path = "/api/v1/tags/0x1001/messages";
    let sent = station.json(Method::POST, path, &json!({"content": {"rate_hz": 2.5}, "lasts_s": 3600})).await;
    assert_eq!((sent.status.as_u16(), sent.header(header::LOCATION)), (201, "/api/v1/tags/0x1001/messages/0"));
    assert_eq!(keys(&sent.json()), ["id", "tag", "content", "asked", "state", "settled"]);
    let listed = station.get(path).await.json();
    assert_eq!((&listed[0], &listed[0]["state"]), (&sent.json(), &json!("waiting")));
    for (path, body, status) in [
        ("/api/v1/tags/somebody/messages", json!({"content": {"identify_s": 1}}), 404),
        (path, json!({"content": {"identify_s": 0}}), 422),
        (path, json!({"content": {"identify_s": 1, "rate_hz": 1}}), 400),
        (path, json!({"content": {"data": "5"}}), 422),
        (path, json!({"content": {"data": "55"}, "lasts_s": 0}), 422),
        (path, json!({"content": {"open": "door"}}), 422),
    ] {
        station.json(Method::POST, path, &body).await.is_problem(status);
    }
    // Sixteen wait for a tag at most.
    for _ in 1..16 {
        assert_eq!(station.json(Method::POST, path, &json!({"content": {"data": "55"}})).await.status, 201);
    }
    station.json(Method::POST, path, &json!({"content": {"data": "55"}})).await.is_problem(409);
    let withdraw = |path: String| station.send(station.request(Method::DELETE, &path));
    assert_eq!(withdraw(format!("{path}/0")).await.status, 204);
    withdraw(format!("{path}/0")).await.is_problem(404);
    withdraw("/api/v1/tags/0x1002/messages/1".into()).await.is_problem(404);
    assert_eq!(station.get(path).await.json()[15]["state"], "withdrawn");
}

#[tokio::test]
async fn a_history_is_a_track_on_the_earth_where_the_site_has_a_geographic_origin() {
    let station = open().await;
    for y_m in [0.0, 500.0, 1000.0] {
        station.report_position("0x1001", 0.0, y_m).await;
        tokio::time::sleep(std::time::Duration::from_millis(5)).await;
    }
    station.until("/api/v1/tags/0x1001/positions", |rows| rows.as_array().map(Vec::len) == Some(3)).await;
    let path = "/api/v1/tags/0x1001/positions.gpx?limit=2";
    station.get(path).await.is_problem(404);
    let origin = json!({"latitude_deg": 40.332, "longitude_deg": -3.766, "y_azimuth_deg": 0, "height_m": 700});
    assert_eq!(station.json(Method::PUT, "/api/v1/sites/lab/geographic-origin", &origin).await.status, 200);
    let newest = station.get(path).await;
    assert_eq!(newest.header(header::CONTENT_TYPE), "application/gpx+xml");
    let points = |answer: &crate::api::client::Answer| {
        let track = gpx::read(&answer.body[..]).unwrap().tracks.remove(0);
        assert_eq!(track.name.as_deref(), Some("0x1001"));
        track.segments.into_iter().flat_map(|segment| segment.points).collect::<Vec<_>>()
    };
    // A kilometre to the north, by PROJ: see the tests of `positioning_core::geodesy`. The tag has no height.
    let last = points(&newest).pop().unwrap();
    assert!((last.point().y() - 40.341_004_683).abs() < 2e-9 && (last.point().x() + 3.766).abs() < 2e-9, "{last:?}");
    assert_eq!((points(&newest).len(), last.elevation), (2, None));
    // In the order of time, and what is older is on the next page.
    assert!(points(&newest)[0].point().y() < last.point().y());
    let link = newest.header(header::LINK).to_owned();
    let next = link.strip_prefix('<').unwrap().strip_suffix(">; rel=\"next\"").unwrap();
    let oldest = points(&station.get(next).await);
    assert!(oldest.len() == 1 && (oldest[0].point().y() - 40.332).abs() < 2e-9, "{oldest:?}");
    station.get("/api/v1/tags/0x1002/positions.gpx").await.is_problem(404);
}

#[tokio::test]
async fn replay_has_all_tags_oldest_first_in_pages() {
    let station = open().await;
    for (tag, x_m) in [("0x1001", 1.0), ("0x1002", 2.0), ("0x1001", 3.0)] {
        station.report_position(tag, x_m, 5.0).await;
        tokio::time::sleep(std::time::Duration::from_millis(5)).await;
    }
    let all = station.until("/api/v1/positions?site=lab&step_s=0", |rows| rows.as_array().unwrap().len() == 3).await;
    let mut path = "/api/v1/positions?site=lab&step_s=0&limit=1".to_owned();
    let mut rows = Vec::new();
    for _ in 0..3 {
        let page = station.get(&path).await;
        rows.extend(page.json().as_array().unwrap().clone());
        let link = page.header(header::LINK);
        let Some(next) = link.strip_prefix('<').and_then(|link| link.strip_suffix(">; rel=\"next\"")) else { break };
        path = next.to_owned();
    }
    assert_eq!(&rows, all.as_array().unwrap());
    assert_eq!(rows.iter().map(|row| row["x_m"].as_f64().unwrap()).collect::<Vec<_>>(), [1.0, 2.0, 3.0]);
}

#[tokio::test]
async fn nodes_are_listed_with_their_health() {
    let station = open().await;
    let position_m = Some([1.0, 2.0, 3.0]);
    station
        .report(ReportKind::Node { node: "0x0101".into(), name: Some("A".into()), role: NodeRole::Anchor, position_m })
        .await;
    let nodes = station.until("/api/v1/nodes?site=lab", |nodes| nodes[0].is_object()).await;
    assert_eq!(nodes[0]["node"], "0x0101");
    assert_eq!(nodes[0]["position_m"], json!([1.0, 2.0, 3.0]));
    let health = [
        "success_rate",
        "residual_mean_m",
        "residual_sigma_m",
        "first_path_minus_received_db",
        "clock_offset_ppm",
        "moved",
    ];
    for key in health {
        assert!(nodes[0].get(key).is_some(), "{key}");
    }
}

#[tokio::test]
async fn findings_are_listed_counted_and_gone_when_the_site_is_right() {
    let station = open().await;
    assert_eq!(station.get("/api/v1/findings").await.json(), json!([]));
    let found = SiteFinding {
        site: SITE.to_owned(),
        since: Utc::default(),
        code: "anchors-exchanged".to_owned(),
        message: "the anchors a and b look exchanged: exchange their places".to_owned(),
        subjects: vec!["0x0101".to_owned(), "0x0102".to_owned()],
        evidence: [("residual_m".to_owned(), 2.9)].into(),
    };
    station.hub.change(|live| {
        live.tick("2026-01-01T10:00:00Z".parse().unwrap());
        live.set_findings(vec![found.clone()]);
    });
    // Its numbers change, its time stays.
    let later = SiteFinding { evidence: [("residual_m".to_owned(), 3.1)].into(), ..found };
    station.hub.change(|live| {
        live.tick("2026-01-01T10:00:30Z".parse().unwrap());
        live.set_findings(vec![later]);
    });
    let expected = json!([{"site": SITE, "since": "2026-01-01T10:00:00Z", "code": "anchors-exchanged",
        "message": "the anchors a and b look exchanged: exchange their places", "subjects": ["0x0101", "0x0102"],
        "evidence": {"residual_m": 3.1}}]);
    assert_eq!(station.get("/api/v1/findings?site=lab").await.json(), expected);
    assert_eq!(station.get("/api/v1/findings?site=other").await.json(), json!([]));
    station.get("/api/v1/findings?sites=lab").await.is_problem(400);
    let metrics = String::from_utf8(station.get("/metrics").await.body.to_vec()).unwrap();
    assert!(metrics.contains("\nbaliza_findings 1\n"), "{metrics}");
    station.hub.change(|live| live.set_findings(Vec::new()));
    assert_eq!(station.get("/api/v1/findings").await.json(), json!([]));
}

#[tokio::test]
async fn the_health_of_a_node_has_its_history_newest_first_in_pages() {
    let station = open().await;
    let at = |minute: u8| NodeHealth {
        site: SITE.to_owned(),
        node: "north west".to_owned(),
        t: format!("2026-01-01T10:{minute:02}:00Z").parse().unwrap(),
        health: HealthFigures {
            rate_hz: 10.0,
            success_rate: Some(f64::from(minute) / 10.0),
            moved: minute == 3,
            ..HealthFigures::default()
        },
    };
    station.store.write_health(&[1, 2, 3].map(at)).await.unwrap();
    let path = "/api/v1/nodes/lab/north%20west/health";
    let first = station.get(&format!("{path}?limit=2&from=2026-01-01T10:01:00Z")).await;
    let expected = json!([at(3), at(2)]);
    assert_eq!((first.status.as_u16(), first.json()), (200, expected));
    let next = first.header(header::LINK).strip_prefix('<').unwrap().strip_suffix(">; rel=\"next\"").unwrap();
    let second = station.get(next).await;
    assert_eq!((second.json(), second.header(header::LINK)), (json!([at(1)]), ""));
    let middle = format!("{path}?from=2026-01-01T10:02:00Z&to=2026-01-01T10:03:00Z");
    assert_eq!(station.get(&middle).await.json(), json!([at(2)]));
    assert_eq!(station.get("/api/v1/nodes/lab/none/health").await.json(), json!([]));
    station.get(&format!("{path}?to=yesterday")).await.is_problem(400);
    station.get(&format!("{path}?from=2026-01-02T00:00:00Z&to=2026-01-01T00:00:00Z")).await.is_problem(400);
    station.get(&format!("{path}?limit=0")).await.is_problem(400);
}

#[tokio::test]
async fn a_receiver_is_placed_hears_a_device_and_is_forgotten() {
    let station = open().await;
    let corners = [("north%20west", [0, 8]), ("ne", [8, 8]), ("sw", [0, 0]), ("se", [8, 0])];
    for (name, [x, y]) in corners {
        let place = json!({"role": "receiver", "position_m": [x, y, 2], "rssi_1m_dbm": -60, "path_loss_exponent": 2});
        let path = format!("/api/v1/nodes/lab/{name}");
        let made = station.json(Method::PUT, &path, &place).await;
        assert_eq!(made.status, 201, "{made:?}");
        assert_eq!(station.json(Method::PUT, &path, &made.json()).await.status, 200);
    }
    let nodes = station.get("/api/v1/nodes?site=lab").await.json();
    assert_eq!(nodes.as_array().unwrap().len(), 4);
    assert_eq!(nodes[1]["node"], "north west");
    assert_eq!((&nodes[1]["role"], &nodes[1]["rssi_1m_dbm"]), (&json!("receiver"), &json!(-60.0)));
    // What all receive equally well is in the middle; what is of a minute ago does not count.
    for (name, _) in corners {
        let sample = |rssi_dbm, t_s| json!({"device": "Ana's watch", "rssi_dbm": rssi_dbm, "t_s": t_s});
        let old = if name == "ne" { -40 } else { -90 };
        let body = json!({"scenario": SITE, "samples": [sample(old, 40.0), sample(-75, 99.5), sample(-75, 100.0)]});
        let taken = station.json(Method::POST, &format!("/api/v1/receivers/{name}/sightings"), &body).await;
        assert_eq!((taken.status.as_u16(), taken.json()), (200, json!({"taken": 3})));
    }
    let is_there = |tags: &serde_json::Value| tags[0]["last_position"]["used"] == 4;
    let tags = station.until("/api/v1/tags?site=lab", is_there).await;
    assert_eq!(tags[0]["tag"], "Ana's watch");
    for key in ["x_m", "y_m"] {
        assert!((tags[0]["last_position"][key].as_f64().unwrap() - 4.0).abs() < 0.1, "{tags}");
    }
    let gone = station.send(station.request(Method::DELETE, "/api/v1/nodes/lab/ne")).await;
    assert_eq!(gone.status, 204);
    assert_eq!(station.get("/api/v1/nodes").await.json().as_array().unwrap().len(), 3);
    assert_eq!(station.store.nodes().await.unwrap().len(), 3);
    station.send(station.request(Method::DELETE, "/api/v1/nodes/lab/ne")).await.is_problem(404);
}

#[tokio::test]
async fn ten_thousand_samples_with_long_names_are_one_request() {
    let station = open().await;
    let place = json!({"role": "receiver", "position_m": [0, 0, 2]});
    station.json(Method::PUT, "/api/v1/nodes/lab/r", &place).await;
    let name = "n".repeat(64);
    let samples = |key: &str, count: usize| -> Vec<_> {
        (0..count)
            .map(|k| json!({key: name, "rssi_dbm": -61.123_456_789, "t_s": 1_790_000_000.123_4 + k as f64}))
            .collect()
    };
    for (count, status) in [(10_000, 200), (10_001, 422)] {
        let body = json!({"terminal": "phone", "scenario": SITE, "samples": samples("beacon", count)});
        assert_eq!(station.json(Method::POST, "/rtls", &body).await.status, status);
        let body = json!({"scenario": SITE, "samples": samples("device", count)});
        assert_eq!(station.json(Method::POST, "/api/v1/receivers/r/sightings", &body).await.status, status);
    }
    let body = json!({"scenario": SITE, "samples": samples("device", 20_000)});
    station.json(Method::POST, "/api/v1/receivers/r/sightings", &body).await.is_problem(413);
}

#[tokio::test]
async fn a_room_is_drawn_a_tag_enters_it_and_it_is_deleted() {
    let station = open().await;
    let room = json!({"kind": "room", "corners_m": [[0, 0], [10, 0], [10, 10], [0, 10]], "alarm": true});
    let path = "/api/v1/rooms/lab/Sala%20de%20m%C3%A1quinas";
    let made = station.json(Method::PUT, path, &room).await;
    assert_eq!(made.status, 201, "{made:?}");
    assert_eq!(made.json()["name"], "Sala de máquinas");
    assert_eq!(station.json(Method::PUT, path, &made.json()).await.status, 200);
    station.report_position("0x1001", 5.0, 5.0).await;
    let rooms = station.until("/api/v1/rooms?site=lab", |rooms| rooms[0]["tags"] == json!(["0x1001"])).await;
    assert_eq!(keys(&rooms[0]), ["site", "name", "kind", "corners_m", "alarm", "tags"]);
    let events = station.until("/api/v1/events?site=lab&kind=entered,left", |events| events[0].is_object()).await;
    assert_eq!(keys(&events[0]), ["id", "t", "site", "kind", "node", "zone", "dwell_s", "alarm"]);
    assert_eq!((&events[0]["kind"], &events[0]["zone"]), (&json!("entered"), &json!("Sala de máquinas")));
    let before = format!("/api/v1/events?before={}", events[0]["id"]);
    assert_eq!(station.get(&before).await.json(), json!([]));
    assert_eq!(station.send(station.request(Method::DELETE, path)).await.status, 204);
    assert_eq!(station.get("/api/v1/rooms").await.json(), json!([]));
    station.send(station.request(Method::DELETE, path)).await.is_problem(404);
}

#[tokio::test]
async fn a_site_gets_walls_and_a_plan_whose_scale_is_changed() {
    let station = open().await;
    let walls = json!([[[0, 0], [10, 0]], [[10, 0], [10, 5]]]);
    let site = station.json(Method::PUT, "/api/v1/sites/hall/walls", &walls).await.json();
    assert_eq!(site["walls_m"], json!([[[0.0, 0.0], [10.0, 0.0]], [[10.0, 0.0], [10.0, 5.0]]]));
    let picture = png(640, 480);
    let path = "/api/v1/sites/hall/plan?origin_x_m=-1&origin_y_m=8.5&metres_per_pixel=0.02";
    let plan = station.put(path, picture.clone()).await;
    assert_eq!(plan.status, 200, "{plan:?}");
    let expected = json!({"origin_m": [-1.0, 8.5], "metres_per_pixel": 0.02, "rotation_rad": 0.0, "width_px": 640,
        "height_px": 480, "media_type": "image/png"});
    assert_eq!(plan.json(), expected);
    let blueprint = station.get("/blueprints/hall").await;
    assert_eq!((blueprint.header(header::CONTENT_TYPE), &blueprint.body[..]), ("image/png", &picture[..]));
    let mut again = station.request(Method::GET, "/blueprints/hall");
    again.headers_mut().insert(header::IF_NONE_MATCH, blueprint.headers[header::ETAG].clone());
    assert_eq!(station.send(again).await.status, 304);
    let scale = json!({"origin_m": [0, 0], "metres_per_pixel": 0.05, "rotation_rad": 1.5});
    let plan = station.json(Method::PUT, "/api/v1/sites/hall/plan/scale", &scale).await.json();
    assert_eq!((&plan["metres_per_pixel"], &plan["width_px"]), (&json!(0.05), &json!(640)));
    let sites = station.get("/scenarios").await;
    let hall = sites.json().as_array().unwrap().iter().find(|site| site["name"] == "hall").cloned().unwrap();
    assert_eq!(keys(&hall), ["name", "walls_m", "plan", "geographic_origin"]);
    assert_eq!((&hall["plan"], &hall["walls_m"]), (&plan, &site["walls_m"]));
    // The picture is still there, and so are the walls.
    assert_eq!(&station.get("/blueprints/hall").await.body[..], &picture[..]);
}

#[tokio::test]
async fn a_site_gets_a_geographic_origin_which_is_replaced_and_forgotten() {
    let station = open().await;
    let path = "/api/v1/sites/yard/geographic-origin";
    let origin = json!({"latitude_deg": 40.332, "longitude_deg": -3.766, "y_azimuth_deg": 12.5, "height_m": 650.0});
    let answer = station.json(Method::PUT, path, &origin).await;
    assert_eq!((answer.status.as_u16(), &answer.json()["geographic_origin"]), (200, &origin));
    let other = json!({"latitude_deg": -90.0, "longitude_deg": 180.0, "y_azimuth_deg": 0.0});
    assert_eq!(station.json(Method::PUT, path, &other).await.status, 200);
    assert_eq!(station.get("/scenarios").await.json()[1]["geographic_origin"], other);
    for wrong in [
        json!({"latitude_deg": 151.2, "longitude_deg": 0.0, "y_azimuth_deg": 0.0}),
        json!({"latitude_deg": 0.0, "longitude_deg": 0.0}),
        json!({"latitude_deg": 0.0, "longitude_deg": 0.0, "y_azimuth_deg": 0.0, "x_azimuth_deg": 0.0}),
        json!({"latitude_deg": "0", "longitude_deg": 0.0, "y_azimuth_deg": 0.0}),
    ] {
        station.json(Method::PUT, path, &wrong).await.is_problem(422);
    }
    let beyond = json!({"latitude_deg": 99, "longitude_deg": 0, "y_azimuth_deg": 0});
    let detail = station.json(Method::PUT, path, &beyond).await.json()["detail"].as_str().unwrap().to_owned();
    assert!(detail.contains("latitude_deg = 99 is not between -90 and 90"), "{detail}");
    assert_eq!(station.get("/scenarios").await.json()[1]["geographic_origin"], other);
    assert_eq!(station.send(station.request(Method::DELETE, path)).await.status, 204);
    assert_eq!(station.get("/scenarios").await.json()[1]["geographic_origin"], json!(null));
    station.send(station.request(Method::DELETE, path)).await.is_problem(404);
}

#[tokio::test]
async fn a_campaign_is_made_surveyed_read_in_pages_and_deleted() {
    let station = open().await;
    let new = json!({"name": "spring survey", "scenario": SITE,
        "points": [{"id": "p1", "x_m": 1, "y_m": 2, "room": "kitchen"}, {"id": "p2", "x_m": 3, "y_m": 4, "z_m": 1.5}]});
    let made = station.json(Method::POST, "/campaigns", &new).await;
    assert_eq!((made.status.as_u16(), made.header(header::LOCATION)), (201, "/campaigns/spring%20survey"));
    station.json(Method::POST, "/campaigns", &new).await.is_problem(409);
    let campaign = station.get(made.header(header::LOCATION)).await.json();
    assert_eq!(keys(&campaign), ["name", "scenario", "created", "points"]);
    assert_eq!(station.get("/campaigns").await.json(), json!([campaign]));
    let points = station.get("/campaigns/spring%20survey/points").await.json();
    assert_eq!(keys(&points[0]), ["id", "x_m", "y_m", "z_m", "room", "samples"]);
    let path = "/campaigns/spring%20survey/points/p1/samples";
    let samples = json!([{"beacon": "1-7", "rssi_dbm": -60.5, "t_s": 0.1}, {"beacon": "1-8", "rssi_dbm": -71, "t_s": 0.2},
        {"beacon": "1-7", "rssi_dbm": -61, "t_s": 1.1}]);
    let added = station.json(Method::POST, path, &samples).await;
    assert_eq!((added.status.as_u16(), added.json()), (201, json!({"added": 3, "samples": 3})));
    assert_eq!(station.get("/campaigns/spring%20survey/points/p1").await.json()["samples"], 3);
    let first = station.get(&format!("{path}?limit=2")).await;
    assert_eq!(first.header(header::LINK), format!("<{path}?limit=2&skip=2>; rel=\"next\""));
    assert_eq!(
        first.json(),
        json!([{"beacon": "1-7", "rssi_dbm": -60.5, "t_s": 0.1}, {"beacon": "1-8", "rssi_dbm": -71.0, "t_s": 0.2}])
    );
    assert_eq!(station.get(&format!("{path}?limit=2&skip=2")).await.json().as_array().unwrap().len(), 1);
    assert_eq!(station.send(station.request(Method::DELETE, "/campaigns/spring%20survey")).await.status, 204);
    station.get("/campaigns/spring%20survey").await.is_problem(404);
    station.get(path).await.is_problem(404);
}

#[tokio::test]
async fn a_terminal_gets_its_position_and_room_and_appears_on_the_map() {
    let station = open().await;
    let room = json!({"kind": "room", "corners_m": [[-20, -20], [30, -20], [30, 30], [-20, 30]]});
    station.json(Method::PUT, "/api/v1/rooms/lab/hall", &room).await;
    station.report_beacons().await;
    station.until("/api/v1/nodes", |nodes| nodes.as_array().unwrap().len() == 4).await;
    // The same RSSI from the four corners of a square: the middle is where each distance is the same.
    let sample = |beacon: &str| json!({"beacon": beacon, "rssi_dbm": -75.0, "t_s": 0.0});
    let samples: Vec<_> = ["1-0", "1-1", "1-2", "1-3"].into_iter().map(sample).collect();
    let body = json!({"terminal": "phone of Ana", "scenario": SITE, "samples": samples});
    let located = station.json(Method::POST, "/rtls", &body).await;
    assert_eq!(located.status, 200, "{located:?}");
    let located = located.json();
    assert_eq!(keys(&located), ["x_m", "y_m", "sigma_x_m", "sigma_y_m", "room", "reason"]);
    for key in ["x_m", "y_m"] {
        assert!((located[key].as_f64().unwrap() - 5.0).abs() < 0.1, "{located}");
    }
    assert_eq!((&located["room"], &located["reason"]), (&json!("hall"), &json!(null)));
    let is_there = |tags: &serde_json::Value| tags[0]["last_position"].is_object();
    let tags = station.until("/api/v1/tags", is_there).await;
    assert_eq!(tags[0]["tag"], "phone of Ana");
    let here = json!({"terminal": "phone of Ana", "samples": samples});
    assert_eq!(station.json(Method::POST, "/rtls/lab", &here).await.json()["room"], "hall");

    let none = json!({"terminal": "phone of Ana", "scenario": SITE, "samples": []});
    let nowhere = station.json(Method::POST, "/rtls", &none).await.json();
    assert!(nowhere["x_m"].is_null() && nowhere["sigma_y_m"].is_null() && nowhere["room"].is_null(), "{nowhere}");
    assert!(!nowhere["reason"].as_str().unwrap().is_empty());
}
