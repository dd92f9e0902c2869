//! What a client should not send.

use std::time::Duration;

use hyper::{Method, header};
use serde_json::{Value, json};
use station_core::api::{Access, RequestLimits};
use station_core::model::NodeRole;
use station_core::{ReportKind, SolvedFrom, SourceReport, Utc};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;

use crate::api::client::{PATIENCE, SITE, generous, open, png, station};

#[tokio::test]
async fn refusals_are_problem_documents() {
    let station = open().await;
    station.get("/nowhere").await.is_problem(404);
    station.get("/api/v1/tags/0x1001/positions").await.is_problem(404);
    station.get("/blueprints/lab").await.is_problem(404);
    let wrong_method = station.json(Method::PUT, "/rtls", &json!({})).await;
    wrong_method.is_problem(405);
    assert_eq!(wrong_method.header(header::ALLOW), "POST");
    station.json(Method::POST, "/", &json!({})).await.is_problem(405);
    station.json(Method::POST, "/assets/main.js", &json!({})).await.is_problem(405);
    station.get("/api/v1/live").await.is_problem(426);

    let mut text = station.request(Method::POST, "/campaigns");
    *text.body_mut() = b"{}".as_slice().into();
    station.send(text).await.is_problem(415);
    let mut broken = station.request(Method::POST, "/campaigns");
    broken.headers_mut().insert(header::CONTENT_TYPE, "application/json".parse().unwrap());
    *broken.body_mut() = b"{\"name\": \"a".as_slice().into();
    station.send(broken).await.is_problem(400);
    station.json(Method::POST, "/campaigns", &json!({"name": "a"})).await.is_problem(422);
    // 257 kB.
    let long = json!({"name": "a", "scenario": SITE, "points": "x".repeat(257_000)});
    station.json(Method::POST, "/campaigns", &long).await.is_problem(413);
}

#[tokio::test]
async fn wrong_parameters_are_refused() {
    let station = open().await;
    for path in [
        "/api/v1/events?limit=0",
        "/api/v1/events?limit=10001",
        "/api/v1/events?limit=many",
        "/api/v1/events?before=9223372036854775808",
        "/api/v1/events?kind=exploded",
        "/api/v1/events?form=2026-11-22T21:27:01Z",
        "/api/v1/events?from=yesterday",
        "/api/v1/events?from=2026-11-22T21:27:02Z&to=2026-11-22T21:27:01Z",
        "/api/v1/tags?site=",
        "/api/v1/tags?site=a%00b",
        "/api/v1/tags/a%0Ab/positions",
        "/api/v1/tags/%ff/positions",
        "/api/v1/positions",
        "/api/v1/positions?site=lab&step_s=-1",
        "/api/v1/positions?site=lab&step_s=NaN",
        "/api/v1/positions?site=lab&step_s=1e300",
        "/campaigns?skip=-1",
    ] {
        let answer = station.get(path).await;
        answer.is_problem(400);
    }
}

#[tokio::test]
async fn values_out_of_bounds_are_refused_and_nothing_is_stored() {
    let station = open().await;
    let corners = |number: usize| (0..number).map(|index| json!([index, index * index])).collect::<Vec<_>>();
    for wrong in [
        json!({"kind": "room", "corners_m": corners(2)}),
        json!({"kind": "room", "corners_m": corners(1001)}),
        json!({"kind": "room", "corners_m": [[0, 0], [1, 0], [1e8, 1]]}),
        json!({"kind": "cellar", "corners_m": corners(3)}),
        json!({"kind": "room", "corners_m": corners(3), "name": "other"}),
        json!({"kind": "room", "corners_m": corners(3), "site": "other"}),
    ] {
        station.json(Method::PUT, "/api/v1/rooms/lab/a", &wrong).await.is_problem(422);
    }
    let room = json!({"kind": "room", "corners_m": corners(3)});
    station.json(Method::PUT, &format!("/api/v1/rooms/lab/{}", "a".repeat(101)), &room).await.is_problem(400);
    station.json(Method::PUT, "/api/v1/rooms/other/a", &room).await.is_problem(404);
    assert_eq!(station.get("/api/v1/rooms").await.json(), json!([]));

    let point = |id: &str| json!({"id": id, "x_m": 0, "y_m": 0});
    let many: Vec<Value> = (0..1001).map(|id| point(&id.to_string())).collect();
    for points in [vec![point("a"), point("a")], many, vec![json!({"id": "a", "x_m": null, "y_m": 0})]] {
        let campaign = json!({"name": "a", "scenario": SITE, "points": points});
        station.json(Method::POST, "/campaigns", &campaign).await.is_problem(422);
    }
    let elsewhere = json!({"name": "a", "scenario": "nowhere", "points": []});
    station.json(Method::POST, "/campaigns", &elsewhere).await.is_problem(404);
    assert_eq!(station.get("/campaigns").await.json(), json!([]));

    let sample = |rssi_dbm: f64, t_s: f64| json!({"beacon": "1-7", "rssi_dbm": rssi_dbm, "t_s": t_s});
    let many: Vec<Value> = vec![json!({"beacon": "1", "rssi_dbm": 0, "t_s": 0}); 5_000];
    for (samples, status) in [
        (vec![sample(-201.0, 0.0)], 422),
        (vec![sample(-60.0, 1e300)], 422),
        (vec![json!({"beacon": "", "rssi_dbm": -60, "t_s": 0})], 422),
        (many, 200),
    ] {
        let body = json!({"terminal": "phone", "scenario": SITE, "samples": samples});
        assert_eq!(station.json(Method::POST, "/rtls", &body).await.status, status);
    }
    // A terminal cannot pass for a tag.
    let tag = json!({"terminal": "0x1001", "scenario": SITE, "samples": []});
    station.json(Method::POST, "/rtls", &tag).await.is_problem(422);
    station
        .json(Method::POST, "/rtls/lab", &json!({"terminal": "a", "scenario": "b", "samples": []}))
        .await
        .is_problem(422);
    station.json(Method::POST, "/rtls/nowhere", &json!({"terminal": "a", "samples": []})).await.is_problem(404);
}

#[tokio::test]
async fn names_are_only_names() {
    let station = open().await;
    // Percent-encoded `'; DROP TABLE zones; --`, `<script>alert(1)</script>`, `../../etc/passwd`, `%2f`, `💥`.
    for (encoded, name) in [
        ("%27%3B%20DROP%20TABLE%20zones%3B%20--", "'; DROP TABLE zones; --"),
        ("%3Cscript%3Ealert(1)%3C%2Fscript%3E", "<script>alert(1)</script>"),
        ("..%2F..%2Fetc%2Fpasswd", "../../etc/passwd"),
        ("%252f", "%2f"),
        ("%F0%9F%92%A5", "💥"),
    ] {
        let walls = json!([[[0, 0], [1, 1]]]);
        let path = format!("/api/v1/sites/{encoded}/walls");
        assert_eq!(station.json(Method::PUT, &path, &walls).await.json()["name"], name);
        let room = json!({"kind": "zone", "corners_m": [[0, 0], [1, 0], [1, 1]]});
        let path = format!("/api/v1/rooms/{encoded}/{encoded}");
        assert_eq!(station.json(Method::PUT, &path, &room).await.status, 201);
        let rooms = station.get(&format!("/api/v1/rooms?site={encoded}")).await;
        assert_eq!((&rooms.json()[0]["name"], &rooms.json()[0]["site"]), (&json!(name), &json!(name)));
        assert_eq!(
            (rooms.header(header::CONTENT_TYPE), rooms.header("x-content-type-options")),
            ("application/json", "nosniff")
        );
        let campaign = json!({"name": name, "scenario": name, "points": [{"id": name, "x_m": 0, "y_m": 0}]});
        let made = station.json(Method::POST, "/campaigns", &campaign).await;
        assert_eq!(station.get(made.header(header::LOCATION)).await.json()["name"], name);
        assert_eq!(station.send(station.request(Method::DELETE, &path)).await.status, 204);
    }
    assert_eq!(station.get("/scenarios").await.json().as_array().unwrap().len(), 6);
}

#[tokio::test]
async fn paths_do_not_leave_the_page_and_the_store() {
    let station = open().await;
    for path in [
        "/blueprints/..%2f..%2fbaliza.db",
        "/blueprints/..%2f..",
        "/../Cargo.toml",
        "/assets/../../Cargo.toml",
        "/assets/..%2f..%2fCargo.toml",
        "/assets/%2e%2e/Cargo.toml",
        "//etc/passwd",
        "/assets/",
        "/assets/main.js%00.html",
    ] {
        station.get(path).await.is_problem(404);
    }
}

#[tokio::test]
async fn a_plan_that_is_no_picture_or_too_large_is_refused_and_the_old_one_stays() {
    let station = open().await;
    let path = "/api/v1/sites/lab/plan?origin_x_m=0&origin_y_m=0&metres_per_pixel=0.1";
    let kept = png(100, 50);
    assert_eq!(station.put(path, kept.clone()).await.status, 200);
    let svg = b"<svg xmlns=\"http://www.w3.org/2000/svg\"><script>alert(1)</script></svg>".to_vec();
    for no_picture in [Vec::new(), b"MZ".to_vec(), svg, b"GIF89a\x01\0\x01\0".to_vec(), png(1, 1)[..20].to_vec()] {
        station.put(path, no_picture).await.is_problem(415);
    }
    // 100 megapixels and no more.
    assert_eq!(
        station
            .put("/api/v1/sites/large/plan?origin_x_m=0&origin_y_m=0&metres_per_pixel=0.1", png(10_000, 10_000))
            .await
            .status,
        200
    );
    station.put(path, png(10_001, 10_000)).await.is_problem(422);
    station.put(path, png(0, 10)).await.is_problem(422);
    let mut long = png(10, 10);
    long.resize(20_000_001, 0);
    station.put(path, long).await.is_problem(413);
    for wrong in
        ["metres_per_pixel=0", "metres_per_pixel=-1", "metres_per_pixel=NaN", "metres_per_pixel=0.1&rotation_rad=8"]
    {
        let path = format!("/api/v1/sites/lab/plan?origin_x_m=0&origin_y_m=0&{wrong}");
        station.put(&path, kept.clone()).await.is_problem(400);
    }
    assert_eq!(&station.get("/blueprints/lab").await.body[..], &kept[..]);
    let scale = json!({"origin_m": [0, 0], "metres_per_pixel": 1});
    station.json(Method::PUT, "/api/v1/sites/none/plan/scale", &scale).await.is_problem(404);
}

#[tokio::test]
async fn clocks_that_jump_do_not_stop_the_station() {
    let station = open().await;
    let position = |x_m| ReportKind::Position {
        tag: "0x1001".into(),
        round: None,
        position_m: [x_m, 0.0],
        z_m: None,
        sigma_m: [0.1; 2],
        sigma_z_m: None,
        cov_xy_m2: 0.0,
        used: 4,
        solved_from: SolvedFrom::Ranges,
        doubt: None,
    };
    let now = Utc::now();
    let times = [now, Utc::clamped(i64::MAX), Utc::clamped(0), now + Duration::from_secs(1)];
    for (x_m, t) in [1.0, 2.0, 3.0, 4.0].into_iter().zip(times) {
        station.hub.reports().send(SourceReport { t, site: SITE.into(), what: position(x_m) }).await.unwrap();
    }
    station.until("/api/v1/tags", |tags| tags[0]["last_position"]["x_m"] == 4.0).await;
    assert_eq!(station.get("/healthz").await.status, 200);
    for path in ["/api/v1/tags/0x1001/positions", "/api/v1/events", "/api/v1/positions?site=lab", "/metrics"] {
        assert_eq!(station.get(path).await.status, 200, "{path}");
    }
}

#[tokio::test]
async fn slow_clients_are_disconnected() {
    let limits = RequestLimits { head: Duration::from_millis(300), request: Duration::from_millis(600), ..generous() };
    let station = station(Access::Open, limits).await;
    // A head that never ends, one byte at a time.
    let mut stream = TcpStream::connect(station.address).await.unwrap();
    let drip = async {
        while stream.write_all(b"G").await.is_ok() {
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    };
    tokio::time::timeout(PATIENCE, drip).await.unwrap();
    // A body that never ends.
    let mut stream = TcpStream::connect(station.address).await.unwrap();
    let head =
        "POST /rtls HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: 100\r\n\r\n{";
    stream.write_all(head.as_bytes()).await.unwrap();
    let mut answer = String::new();
    tokio::time::timeout(PATIENCE, stream.read_to_string(&mut answer)).await.unwrap().unwrap();
    assert!(answer.starts_with("HTTP/1.1 408 ") && answer.contains("application/problem+json"), "{answer}");
}

#[tokio::test]
async fn a_head_that_is_no_http_or_too_long_is_refused() {
    let station = open().await;
    for head in ["\0\0\0\0\r\n\r\n".to_owned(), format!("GET / HTTP/1.1\r\nX: {}\r\n\r\n", "x".repeat(100_000))] {
        let mut stream = TcpStream::connect(station.address).await.unwrap();
        // The station may close before all is written.
        let _ = stream.write_all(head.as_bytes()).await;
        let mut answer = Vec::new();
        let read = tokio::time::timeout(PATIENCE, stream.read_to_end(&mut answer)).await.unwrap();
        assert!(read.is_err() || answer.is_empty() || answer.starts_with(b"HTTP/1.1 4"), "{answer:?}");
    }
    assert_eq!(station.get("/healthz").await.status, 200);
}

#[tokio::test]
async fn connections_of_one_address_are_bounded() {
    let station = station(Access::Open, RequestLimits { connections_per_address: 3, ..generous() }).await;
    let mut held = Vec::new();
    for _ in 0..3 {
        held.push(station.begin(station.request(Method::GET, "/api/v1/updates")).await);
    }
    let mut fourth = TcpStream::connect(station.address).await.unwrap();
    let _ = fourth.write_all(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\n\r\n").await;
    let mut answer = Vec::new();
    let read = tokio::time::timeout(PATIENCE, fourth.read_to_end(&mut answer)).await.unwrap();
    assert!(read.is_err() || answer.is_empty(), "{answer:?}");
    drop(held);
    let is_answered = async || {
        let mut stream = TcpStream::connect(station.address).await.unwrap();
        let mut answer = Vec::new();
        // An error: the connection was refused.
        let _ = stream.write_all(b"GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n").await;
        let _ = stream.read_to_end(&mut answer).await;
        answer.starts_with(b"HTTP/1.1 200 ")
    };
    let until_answered = async { while !is_answered().await {} };
    tokio::time::timeout(PATIENCE, until_answered).await.unwrap();
}

#[tokio::test]
async fn wrong_sightings_and_places_are_refused() {
    let station = open().await;
    let put = |place: Value| {
        let station = &station;
        async move { station.json(Method::PUT, "/api/v1/nodes/lab/r", &place).await }
    };
    for wrong in [
        json!({"role": "anchor", "position_m": [0, 0, 2]}),
        json!({"role": "receiver", "position_m": [0, 0]}),
        json!({"role": "receiver", "position_m": [0, 2e6, 0]}),
        json!({"role": "receiver", "position_m": [0, 0, 2], "rssi_1m_dbm": 20}),
        json!({"role": "receiver", "position_m": [0, 0, 2], "path_loss_exponent": 0}),
        json!({"role": "receiver", "position_m": [0, 0, 2], "name": "x".repeat(65)}),
    ] {
        put(wrong).await.is_problem(422);
    }
    let at_origin = json!({"role": "receiver", "position_m": [0, 0, 2]});
    station.json(Method::PUT, "/api/v1/nodes/nowhere/r", &at_origin).await.is_problem(404);
    let long = format!("/api/v1/nodes/lab/{}", "x".repeat(65));
    station.json(Method::PUT, &long, &at_origin).await.is_problem(422);
    let post = |samples: Value| {
        let station = &station;
        async move {
            let body = json!({"scenario": SITE, "samples": samples});
            station.json(Method::POST, "/api/v1/receivers/r/sightings", &body).await
        }
    };
    let sample = json!({"device": "phone", "rssi_dbm": -60, "t_s": 0});
    post(json!([sample])).await.is_problem(404);
    // A receiver without a place.
    station.report(ReportKind::Node { node: "r".into(), name: None, role: NodeRole::Receiver, position_m: None }).await;
    station.until("/api/v1/nodes", |nodes| nodes[0].is_object()).await;
    let refused = post(json!([sample])).await;
    refused.is_problem(404);
    assert!(refused.json()["detail"].as_str().unwrap().contains("PUT /api/v1/nodes"), "{refused:?}");
    assert_eq!(put(at_origin).await.status, 201);
    for wrong in [
        json!([{"device": "phone", "rssi_dbm": 200, "t_s": 0}]),
        json!([{"device": "phone", "rssi_dbm": -60, "t_s": 1e300}]),
        json!([{"device": "phone", "rssi_dbm": -60, "rssi_1m_dbm": -300, "t_s": 0}]),
        json!([{"device": "", "rssi_dbm": -60, "t_s": 0}]),
        json!([{"device": "0x1001", "rssi_dbm": -60, "t_s": 0}]),
        json!([{"device": "é".repeat(33), "rssi_dbm": -60, "t_s": 0}]),
        json!([{"device": "a\u{0}", "rssi_dbm": -60, "t_s": 0}]),
    ] {
        post(wrong).await.is_problem(422);
    }
    // 0 dBm is what drivers report for an RSSI that they did not measure: the live state refuses it.
    let unmeasured =
        json!([{"device": "phone", "rssi_dbm": 0, "t_s": -1e12}, {"device": "phone", "rssi_dbm": 0, "t_s": 1e12}]);
    assert_eq!(post(unmeasured).await.status, 200);
    assert_eq!(station.get("/api/v1/tags").await.json(), json!([]));
    assert_eq!(post(json!([sample, sample])).await.status, 200);
    station.until("/api/v1/tags", |tags| tags[0]["tag"] == "phone").await;
    assert_eq!(station.hub.counts().refused, 2);
}
