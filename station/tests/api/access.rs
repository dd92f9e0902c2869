//! Who may do what.

use hyper::{Method, header};
use serde_json::json;
use station_core::api::{Access, App, RequestLimits, openapi, serve};

use crate::api::client::{Answer, PATIENCE, Station, generous, open, with_tokens};
use crate::api::document::operations;

const ROLES: [&str; 3] = ["view", "operate", "administer"];

async fn as_role(station: &Station, method: &str, path: &str, role: Option<&str>) -> u16 {
    let path = path.replace("{scenario}", "x").replace("{name}", "x").replace("{id}", "x").replace("{site}", "x");
    let method = Method::from_bytes(method.to_uppercase().as_bytes()).unwrap();
    let mut request =
        station.request(method, &path.replace("{tag}", "x").replace("{node}", "x").replace("{receiver}", "x"));
    if let Some(role) = role {
        let value = format!("Bearer {role}-secret").parse().unwrap();
        request.headers_mut().insert(header::AUTHORIZATION, value);
    }
    station.begin(request).await.status().as_u16()
}

#[tokio::test]
async fn no_route_answers_a_role_that_is_too_low() {
    let station = with_tokens(generous()).await;
    let document = serde_json::to_value(openapi()).unwrap();
    let mut refused = 0;
    for (method, path, operation) in operations(&document) {
        let Some(least) = operation["security"][0]["token"][0].as_str() else { continue };
        let least = ROLES.iter().position(|role| *role == least).unwrap();
        assert_eq!(as_role(&station, &method, &path, None).await, 401, "{method} {path}");
        for (index, role) in ROLES.into_iter().enumerate() {
            let status = as_role(&station, &method, &path, Some(role)).await;
            assert_eq!(status == 403, index < least, "{method} {path} as {role}: {status}");
            assert_ne!(status, 401, "{method} {path} as {role}");
            refused += usize::from(status == 403);
        }
        if method == "get" {
            assert_eq!(as_role(&station, "head", &path, None).await, 401, "head {path}");
        }
    }
    // Ten routes for `operate` refuse one role, seven for `administer` two.
    assert_eq!(refused, 10 + 7 * 2);
}

#[tokio::test]
async fn open_routes_answer_without_a_token() {
    let station = with_tokens(generous()).await;
    for path in ["/", "/assets/main.js", "/healthz", "/openapi.json"] {
        assert_eq!(station.get(path).await.status, 200, "{path}");
    }
    let me = station.get("/api/v1/me").await.json();
    assert_eq!(me, json!({"name": null, "role": null, "tokens": true, "sign_in": null}));
    assert_eq!(
        open().await.get("/api/v1/me").await.json(),
        json!({"name": null, "role": "administer", "tokens": false, "sign_in": null})
    );
}

/// Logs in; the cookie.
async fn cookie(station: &Station, role: &str) -> String {
    let answer = station.json(Method::POST, "/login", &json!({"token": format!("{role}-secret")})).await;
    assert_eq!(answer.json(), json!({"name": role, "role": role, "tokens": true, "sign_in": null}));
    let cookie = answer.header(header::SET_COOKIE);
    assert!(cookie.contains("; HttpOnly; SameSite=Strict") && !cookie.contains("Secure"), "{cookie}");
    // 32 random bytes in hexadecimal.
    let (pair, _) = cookie.split_once(';').unwrap();
    assert_eq!(pair.strip_prefix("baliza_session=").unwrap().len(), 64);
    pair.to_owned()
}

async fn with_cookie(station: &Station, method: Method, path: &str, cookie: &str, origin: Option<&str>) -> Answer {
    let mut request = station.request(method, path);
    request.headers_mut().insert(header::COOKIE, cookie.parse().unwrap());
    if let Some(origin) = origin {
        request.headers_mut().insert(header::ORIGIN, origin.parse().unwrap());
    }
    station.send(request).await
}

#[tokio::test]
async fn a_cookie_stands_for_its_token_until_the_session_ends() {
    let station = with_tokens(generous()).await;
    let here = format!("http://{}", station.address);
    let cookie = cookie(&station, "view").await;
    assert_eq!(with_cookie(&station, Method::GET, "/api/v1/tags", &cookie, None).await.status, 200);
    let me = with_cookie(&station, Method::GET, "/api/v1/me", &cookie, None).await.json();
    assert_eq!(me["role"], "view");
    with_cookie(&station, Method::DELETE, "/campaigns/x", &cookie, Some(&here)).await.is_problem(403);
    let out = with_cookie(&station, Method::POST, "/logout", &cookie, Some(&here)).await;
    assert!(out.status == 200 && out.json() == json!({"end_session": null}));
    assert!(out.header(header::SET_COOKIE).starts_with("baliza_session=; Path=/; Max-Age=0;"));
    with_cookie(&station, Method::GET, "/api/v1/tags", &cookie, None).await.is_problem(401);
    with_cookie(&station, Method::GET, "/api/v1/tags", "baliza_session=0", None).await.is_problem(401);
}

#[tokio::test]
async fn pages_of_other_hosts_cannot_use_a_session() {
    let station = with_tokens(generous()).await;
    let cookie = cookie(&station, "operate").await;
    let here = format!("http://{}", station.address);
    let other_port = "http://127.0.0.1:1";
    for origin in [None, Some("http://example.org"), Some("null"), Some(other_port), Some("http://127.0.0.1:1\u{7f}")] {
        let Some(origin) = origin.filter(|origin| origin.parse::<header::HeaderValue>().is_ok()) else {
            with_cookie(&station, Method::DELETE, "/campaigns/x", &cookie, None).await.is_problem(403);
            continue;
        };
        let answer = with_cookie(&station, Method::DELETE, "/campaigns/x", &cookie, Some(origin)).await;
        answer.is_problem(403);
        assert!(!answer.headers.contains_key(header::ACCESS_CONTROL_ALLOW_ORIGIN));
    }
    with_cookie(&station, Method::DELETE, "/campaigns/x", &cookie, Some(&here)).await.is_problem(404);
    // A WebSocket is no change, but it has no protection of browsers either.
    let mut request = station.request(Method::GET, "/api/v1/live");
    for (name, value) in [("cookie", cookie.as_str()), ("origin", "http://example.org"), ("upgrade", "websocket")] {
        request.headers_mut().insert(header::HeaderName::from_static(name), value.parse().unwrap());
    }
    station.send(request).await.is_problem(403);
    // Preflight requests are answered without permission.
    let mut preflight = station.request(Method::OPTIONS, "/campaigns");
    preflight.headers_mut().insert(header::ORIGIN, "http://example.org".parse().unwrap());
    let answer = station.send(preflight).await;
    assert!(!answer.headers.keys().any(|name| name.as_str().starts_with("access-control")), "{answer:?}");
}

#[tokio::test]
async fn without_tokens_only_loopback_names_are_answered() {
    let station = open().await;
    let port = station.address.port();
    for (host, status) in [
        (format!("localhost:{port}"), 200),
        (format!("127.0.0.1:{port}"), 200),
        (format!("[::1]:{port}"), 200),
        (format!("rebound.example.org:{port}"), 421),
        (format!("10.0.0.1:{port}"), 421),
        (String::new(), 421),
    ] {
        let mut request = station.request(Method::GET, "/api/v1/tags");
        request.headers_mut().insert(header::HOST, host.parse().unwrap());
        assert_eq!(station.send(request).await.status, status, "{host}");
    }
    let mut request = station.request(Method::GET, "http://example.org/api/v1/tags");
    request.headers_mut().insert(header::HOST, "localhost".parse().unwrap());
    station.send(request).await.is_problem(421);
    let mut request = station.request(Method::GET, "/api/v1/tags");
    request.headers_mut().remove(header::HOST);
    station.send(request).await.is_problem(421);
}

#[tokio::test]
async fn a_station_that_others_can_reach_is_not_started_without_tokens() {
    let station = open().await;
    let app = App::new(station.hub.clone(), station.store.clone());
    assert_eq!(app.access, Access::Open);
    let listener = tokio::net::TcpListener::bind("0.0.0.0:0").await.unwrap();
    let error = serve(listener, app, std::future::pending::<()>()).await.unwrap_err();
    assert_eq!(error.kind(), std::io::ErrorKind::InvalidInput);
}

#[tokio::test]
async fn wrong_tokens_are_refused_and_then_have_to_wait() {
    let wrong_at = async |station: &Station, value: &str| {
        let mut request = station.request(Method::GET, "/api/v1/tags");
        request.headers_mut().insert(header::AUTHORIZATION, value.parse().unwrap());
        station.send(request).await
    };
    // The next one is allowed a quarter of an hour later.
    let station =
        with_tokens(RequestLimits { wrong_tokens_per_s: 1e-3, wrong_tokens_at_once: 4.0, ..generous() }).await;
    let wrong = async |value: &str| wrong_at(&station, value).await;
    for value in ["Bearer wrong", "Bearer", "Basic dmlldy1zZWNyZXQ="] {
        let answer = wrong(value).await;
        answer.is_problem(401);
        assert_eq!(answer.header(header::WWW_AUTHENTICATE), "Bearer");
    }
    station.json(Method::POST, "/login", &json!({"token": "' OR 1=1 --"})).await.is_problem(401);
    let late = wrong("Bearer wrong").await;
    late.is_problem(429);
    let wait_s: u32 = late.header(header::RETRY_AFTER).parse().unwrap();
    assert!((900..=1000).contains(&wait_s), "{late:?}");
    let login = async |station: &Station| {
        station.json(Method::POST, "/login", &json!({"token": "view-secret"})).await.status.as_u16()
    };
    assert_eq!(login(&station).await, 429);
    // The next one is allowed a second later.
    let station = with_tokens(RequestLimits { wrong_tokens_per_s: 1.0, wrong_tokens_at_once: 1.0, ..generous() }).await;
    while wrong_at(&station, "Bearer wrong").await.status != 429 {}
    let allowed = async {
        while login(&station).await == 429 {
            tokio::time::sleep(std::time::Duration::from_millis(100)).await;
        }
    };
    tokio::time::timeout(PATIENCE, allowed).await.unwrap();
    cookie(&station, "view").await;
}

#[tokio::test]
async fn a_flood_of_changes_has_to_wait_and_readers_do_not_notice() {
    let station =
        with_tokens(RequestLimits { writes_per_s: 1e-3, writes_at_once: 5.0, ..RequestLimits::default() }).await;
    let mut statuses = Vec::new();
    for _ in 0..8 {
        statuses.push(as_role(&station, "delete", "/campaigns/x", Some("operate")).await);
    }
    assert_eq!(statuses, [404, 404, 404, 404, 404, 429, 429, 429]);
    assert_eq!(as_role(&station, "get", "/api/v1/tags", Some("view")).await, 200);
}
