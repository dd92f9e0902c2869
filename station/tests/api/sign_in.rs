//! Sign-in by OpenID Connect, at a provider that can forge.

use std::sync::Arc;
use std::time::Duration;

use base64::Engine;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use hyper::{Method, StatusCode, header};
use serde_json::json;
use station_core::api::{Access, App, RequestLimits, Token, UserRole};
use station_core::oidc::{Oidc, OidcError, OidcSettings, Patience, Roles};
use tokio::net::TcpListener;
use url::Url;

use crate::api::client::{Answer, PATIENCE, Station, generous, station_of};
use crate::api::port::Port;
use crate::api::provider::{CLIENT, FORGERIES, Provider};

const PUBLIC: &str = "http://station.localhost";

fn settings(issuer: &str) -> OidcSettings {
    let list = |value: &str| vec![value.to_owned()];
    OidcSettings {
        issuer: issuer.to_owned(),
        client_id: CLIENT.0.to_owned(),
        client_secret: Some(CLIENT.1.to_owned()),
        public_url: PUBLIC.to_owned(),
        scopes: list("profile"),
        claim: "groups".to_owned(),
        roles: Roles { view: list("staff"), operate: list("leads"), administer: list("admins") },
        ca: None,
        session: Duration::from_secs(3600),
        end_session: false,
    }
}

/// Waits for nothing that a test does not want to wait for.
fn hasty() -> Patience {
    Patience { request: Duration::from_secs(5), pause: Duration::ZERO, ..Patience::default() }
}

async fn station_with(settings: OidcSettings, patience: Patience, limits: RequestLimits) -> Station {
    let oidc = Some(Arc::new(Oidc::new(settings, patience).unwrap()));
    let access = Access::Tokens(vec![Token::new("wall", UserRole::View, "wall-secret")]);
    station_of(|app| App { access, oidc, limits, ..app }).await
}

async fn station(provider: &Provider) -> Station {
    station_with(settings(&provider.issuer), hasty(), generous()).await
}

/// A request with headers.
async fn get(station: &Station, path: &str, headers: &[(header::HeaderName, &str)]) -> Answer {
    let mut request = station.request(Method::GET, path);
    for (name, value) in headers {
        request.headers_mut().append(name, value.parse().unwrap());
    }
    station.send(request).await
}

/// Begins a sign-in, and signs in at the provider; the cookie, and the path to which the provider sends the browser.
async fn begin(station: &Station, provider: &Provider) -> (String, String) {
    let answer = station.get("/oidc/login").await;
    assert_eq!(answer.status, 303, "{answer:?}");
    assert_eq!(answer.header(header::CACHE_CONTROL), "no-store");
    let state = provider.visit(answer.header(header::LOCATION));
    let cookie = answer.header(header::SET_COOKIE);
    assert_eq!(cookie, format!("baliza_sign_in={state}; Path=/oidc/; Max-Age=600; HttpOnly; SameSite=Lax"));
    (format!("baliza_sign_in={state}"), format!("/oidc/callback?code=a-code&state={state}"))
}

/// A whole sign-in; the answer at its end.
async fn sign_in(station: &Station, provider: &Provider) -> Answer {
    let (cookie, path) = begin(station, provider).await;
    get(station, &path, &[(header::COOKIE, &cookie)]).await
}

/// The session's cookie of a sign-in that went well.
fn session(answer: &Answer) -> String {
    assert_eq!((answer.status, answer.header(header::LOCATION)), (StatusCode::SEE_OTHER, "/"), "{answer:?}");
    let cookies: Vec<_> =
        answer.headers.get_all(header::SET_COOKIE).iter().map(|value| value.to_str().unwrap()).collect();
    assert_eq!(cookies.len(), 2);
    // An hour, less the time that the answer takes.
    assert!(cookies[0].ends_with("; Path=/; Max-Age=3599; HttpOnly; SameSite=Strict"), "{cookies:?}");
    assert!(cookies[1].starts_with("baliza_sign_in=; Path=/oidc/; Max-Age=0"), "{cookies:?}");
    cookies[0].split(';').next().unwrap().to_owned()
}

#[tokio::test]
async fn a_person_signs_in_has_the_role_of_their_groups_and_logs_out() {
    let provider = Provider::start().await;
    let station = station(&provider).await;
    let me = station.get("/api/v1/me").await.json();
    let url = format!("{PUBLIC}/oidc/login");
    assert_eq!(me, json!({"name": null, "role": null, "tokens": true, "sign_in": url}));
    for (groups, role, put, walls) in [
        (json!(["staff", "others"]), "view", 403, 403),
        // The first one makes the room, the second one changes it.
        (json!(["staff", "leads"]), "operate", 201, 403),
        (json!("admins"), "administer", 200, 200),
    ] {
        provider.claim(json!({"preferred_username": "ana", "groups": groups}));
        let cookie = session(&sign_in(&station, &provider).await);
        let cookie = [(header::COOKIE, cookie.as_str())];
        let me = get(&station, "/api/v1/me", &cookie).await.json();
        assert_eq!(me, json!({"name": "oidc:ana", "role": role, "tokens": true, "sign_in": url}));
        let here = format!("http://{}", station.address);
        let change = async |path: &str, body: serde_json::Value| {
            let mut request = station.request(Method::PUT, path);
            let headers = request.headers_mut();
            headers.insert(header::COOKIE, cookie[0].1.parse().unwrap());
            headers.insert(header::ORIGIN, here.parse().unwrap());
            headers.insert(header::CONTENT_TYPE, "application/json".parse().unwrap());
            *request.body_mut() = body.to_string().into();
            station.send(request).await.status.as_u16()
        };
        let zone = json!({"site": "lab", "name": "hall", "kind": "room", "corners_m": [[0, 0], [4, 0], [4, 3]]});
        assert_eq!(change("/api/v1/rooms/lab/hall", zone).await, put, "{role}");
        assert_eq!(change("/api/v1/sites/lab/walls", json!([])).await, walls, "{role}");
        assert_eq!(log_out(&station, cookie[0].1).await.json(), json!({"end_session": null}));
        get(&station, "/api/v1/tags", &cookie).await.is_problem(401);
    }
    // Tokens count as before.
    assert_eq!(get(&station, "/api/v1/tags", &[(header::AUTHORIZATION, "Bearer wall-secret")]).await.status, 200);
}

async fn log_out(station: &Station, cookie: &str) -> Answer {
    let mut request = station.request(Method::POST, "/logout");
    request.headers_mut().insert(header::COOKIE, cookie.parse().unwrap());
    request.headers_mut().insert(header::ORIGIN, format!("http://{}", station.address).parse().unwrap());
    let answer = station.send(request).await;
    assert_eq!(answer.status, 200);
    answer
}

#[tokio::test]
async fn logging_out_ends_the_session_of_the_provider_where_that_is_wanted_and_possible() {
    let provider = Provider::start().await;
    let settings = OidcSettings { end_session: true, ..settings(&provider.issuer) };
    let station = station_with(settings, hasty(), generous()).await;
    provider.claim(json!({"groups": ["staff"]}));
    let cookie = session(&sign_in(&station, &provider).await);
    let answer = log_out(&station, &cookie).await.json();
    let url: Url = answer["end_session"].as_str().unwrap().parse().unwrap();
    assert!(url.as_str().starts_with(&format!("{}/end?", provider.issuer)), "{url}");
    // OpenID Connect RP-Initiated Logout 1.0, section 2.
    let query: Vec<_> = url.query_pairs().into_owned().collect();
    let [(hint, token), rest @ ..] = query.as_slice() else { panic!("{url}") };
    let pair = |name: &str, value: &str| (name.to_owned(), value.to_owned());
    assert_eq!(rest, [pair("client_id", CLIENT.0), pair("post_logout_redirect_uri", &format!("{PUBLIC}/"))]);
    let claims = URL_SAFE_NO_PAD.decode(token.split('.').nth(1).unwrap()).unwrap();
    let claims: serde_json::Value = serde_json::from_slice(&claims).unwrap();
    assert_eq!((hint.as_str(), &claims["aud"]), ("id_token_hint", &json!(CLIENT.0)));
    // The session is over, whether the browser goes there or not.
    get(&station, "/api/v1/tags", &[(header::COOKIE, &cookie)]).await.is_problem(401);
    assert_eq!(log_out(&station, &cookie).await.json(), json!({"end_session": null}));
}

#[tokio::test]
async fn a_token_that_is_forged_in_any_way_signs_nobody_in() {
    let provider = Provider::start().await;
    let station = station(&provider).await;
    for forgery in FORGERIES {
        provider.forge(Some(forgery));
        let answer = sign_in(&station, &provider).await;
        answer.is_problem(502);
        assert!(!answer.header(header::SET_COOKIE).contains("baliza_session"), "{forgery:?}");
    }
    provider.forge(None);
    session(&sign_in(&station, &provider).await);
}

#[tokio::test]
async fn a_person_without_a_mapped_group_is_refused_and_told_so() {
    let provider = Provider::start().await;
    let station = station(&provider).await;
    for claims in [json!({}), json!({"groups": []}), json!({"groups": ["Staff", "visitors"]}), json!({"groups": 1})] {
        provider.claim(claims);
        let answer = sign_in(&station, &provider).await;
        answer.is_problem(403);
        assert!(answer.json()["detail"].as_str().unwrap().contains("no role"), "{answer:?}");
    }
    // A browser is sent to the page, which says it in the person's language.
    let (cookie, path) = begin(&station, &provider).await;
    let html = "text/html,application/xhtml+xml;q=0.9,*/*;q=0.8";
    let answer = get(&station, &path, &[(header::COOKIE, &cookie), (header::ACCEPT, html)]).await;
    assert_eq!((answer.status.as_u16(), answer.header(header::LOCATION)), (303, "/#sign-in=no-role"));
    assert!(answer.header(header::SET_COOKIE).starts_with("baliza_sign_in=;"));
}

#[tokio::test]
async fn groups_are_asked_for_where_the_token_does_not_name_them() {
    let provider = Provider::start().await;
    let station = station(&provider).await;
    provider.claim(json!({}));
    provider.tell(json!({"sub": "248289761001", "preferred_username": "ana", "groups": ["leads"]}));
    let cookie = session(&sign_in(&station, &provider).await);
    let me = get(&station, "/api/v1/me", &[(header::COOKIE, &cookie)]).await.json();
    assert_eq!((me["name"].as_str(), me["role"].as_str()), (Some("oidc:ana"), Some("operate")));
    // UserInfo of another person is ignored.
    provider.tell(json!({"sub": "another", "groups": ["admins"]}));
    sign_in(&station, &provider).await.is_problem(403);
    // The token counts where it names groups.
    provider.claim(json!({"groups": ["visitors"]}));
    provider.tell(json!({"sub": "248289761001", "groups": ["admins"]}));
    sign_in(&station, &provider).await.is_problem(403);
}

#[tokio::test]
async fn a_state_counts_once_and_only_in_the_browser_that_has_it() {
    let provider = Provider::start().await;
    let limits = RequestLimits { wrong_tokens_per_s: 1e-3, wrong_tokens_at_once: 5.0, ..generous() };
    let station = station_with(settings(&provider.issuer), hasty(), limits).await;
    let (cookie, path) = begin(&station, &provider).await;
    // Another browser; one with another sign-in; a changed state; none at all.
    get(&station, &path, &[]).await.is_problem(400);
    get(&station, &path, &[(header::COOKIE, "baliza_sign_in=other")]).await.is_problem(400);
    get(&station, &format!("{path}x"), &[(header::COOKIE, &cookie)]).await.is_problem(400);
    session(&get(&station, &path, &[(header::COOKIE, &cookie)]).await);
    // Replayed.
    get(&station, &path, &[(header::COOKIE, &cookie)]).await.is_problem(400);
    // A browser and a provider that know a state which the station has not given.
    let forged = [(header::COOKIE, "baliza_sign_in=forged")];
    get(&station, "/oidc/callback?code=a-code&state=forged", &forged).await.is_problem(400);
    // Those were five wrong ones: the address waits.
    get(&station, "/oidc/callback?code=a-code&state=forged", &forged).await.is_problem(429);
    get(&station, "/oidc/callback", &[]).await.is_problem(429);
}

#[tokio::test]
async fn a_sign_in_that_takes_too_long_is_over() {
    let provider = Provider::start().await;
    let patience = Patience { sign_in: Duration::from_secs(1), ..hasty() };
    let station = station_with(settings(&provider.issuer), patience, generous()).await;
    let state = provider.visit(station.get("/oidc/login").await.header(header::LOCATION));
    tokio::time::sleep(Duration::from_millis(1_100)).await;
    let cookie = format!("baliza_sign_in={state}");
    let path = format!("/oidc/callback?code=a-code&state={state}");
    get(&station, &path, &[(header::COOKIE, &cookie)]).await.is_problem(400);
}

#[tokio::test]
async fn refusals_of_the_provider_are_told() {
    let provider = Provider::start().await;
    let station = station(&provider).await;
    for (query, status) in [
        ("error=access_denied&error_description=%3Cscript%3E", 403),
        ("error=invalid_scope", 403),
        ("error=temporarily_unavailable", 503),
        ("", 502),
        ("code=a-code&iss=https%3A%2F%2Fid.example.org", 502),
        ("code=another-code", 502),
    ] {
        let (cookie, path) = begin(&station, &provider).await;
        let path = path.replace("code=a-code", query);
        let answer = get(&station, &path, &[(header::COOKIE, &cookie)]).await;
        answer.is_problem(status);
        assert!(!String::from_utf8_lossy(&answer.body).contains("script"), "{answer:?}");
        // The state is over with it.
        get(&station, &path, &[(header::COOKIE, &cookie)]).await.is_problem(400);
    }
    // The issuer as it should be.
    let (cookie, path) = begin(&station, &provider).await;
    session(&get(&station, &format!("{path}&iss={}", provider.issuer), &[(header::COOKIE, &cookie)]).await);
    // The provider fails when it is asked for the token, and then is slow.
    provider.fail(StatusCode::INTERNAL_SERVER_ERROR);
    sign_in(&station, &provider).await.is_problem(502);
    provider.fail(StatusCode::OK);
    provider.wait(Duration::from_secs(3600));
    sign_in(&station, &provider).await.is_problem(503);
}

#[tokio::test]
async fn a_new_key_of_the_provider_is_found() {
    let provider = Provider::start().await;
    let station = station(&provider).await;
    session(&sign_in(&station, &provider).await);
    let read = provider.rotate();
    session(&sign_in(&station, &provider).await);
    assert_eq!(provider.keys_read(), read + 1);
    // It is known then.
    session(&sign_in(&station, &provider).await);
    assert_eq!(provider.keys_read(), read + 1);
    // A new key with the old one's name is found as well.
    provider.rotate();
    session(&sign_in(&station, &provider).await);
}

#[tokio::test]
async fn a_station_starts_without_its_provider_and_finds_it_later() {
    let port = Port::free();
    let provider = Provider::at(port.address);
    let station = station(&provider).await;
    station.get("/oidc/login").await.is_problem(503);
    let browser = [(header::ACCEPT, "text/html")];
    assert_eq!(get(&station, "/oidc/login", &browser).await.header(header::LOCATION), "/#sign-in=away");
    assert_eq!(get(&station, "/api/v1/tags", &[(header::AUTHORIZATION, "Bearer wall-secret")]).await.status, 200);
    let serving = provider.serve(TcpListener::bind(port.address).await.unwrap());
    session(&sign_in(&station, &provider).await);
    // Gone again, in the middle of a sign-in.
    let (cookie, path) = begin(&station, &provider).await;
    serving.abort();
    let _ = serving.await;
    let answer = get(&station, &path, &[(header::COOKIE, &cookie)]).await;
    assert!([502, 503].contains(&answer.status.as_u16()), "{answer:?}");
    assert!(station.stop().await < Duration::from_secs(5));
}

#[tokio::test]
async fn a_station_asks_its_provider_at_the_start_again_and_again() {
    let port = Port::free();
    let provider = Provider::at(port.address);
    let patience = Patience { again: Duration::from_millis(50), ..hasty() };
    let _station = station_with(settings(&provider.issuer), patience, generous()).await;
    tokio::time::sleep(Duration::from_millis(200)).await;
    provider.serve(TcpListener::bind(port.address).await.unwrap());
    let asked = async {
        while provider.keys_read() == 0 {
            tokio::time::sleep(Duration::from_millis(25)).await;
        }
    };
    tokio::time::timeout(PATIENCE, asked).await.expect("the provider is asked");
}

#[tokio::test]
async fn a_provider_that_calls_itself_otherwise_is_not_used() {
    let provider = Provider::start().await;
    provider.rename("https://id.example.org");
    let station = station(&provider).await;
    station.get("/oidc/login").await.is_problem(503);
}

#[tokio::test]
async fn a_session_ends_after_its_time_and_live_updates_with_it() {
    const SESSION: Duration = Duration::from_secs(4);
    let provider = Provider::start().await;
    let settings = OidcSettings { session: SESSION, ..settings(&provider.issuer) };
    let station = station_with(settings, hasty(), generous()).await;
    let begun = std::time::Instant::now();
    let answer = sign_in(&station, &provider).await;
    let cookie = answer.header(header::SET_COOKIE).split(';').next().unwrap().to_owned();
    let cookie = [(header::COOKIE, cookie.as_str())];
    assert_eq!(get(&station, "/api/v1/tags", &cookie).await.status, 200);
    // An event stream, read to its end.
    assert_eq!(get(&station, "/api/v1/updates", &cookie).await.status, 200);
    assert!(begun.elapsed() >= SESSION, "{:?}", begun.elapsed());
    get(&station, "/api/v1/updates", &cookie).await.is_problem(401);
}

#[tokio::test]
async fn a_flood_of_sign_ins_has_to_wait() {
    let provider = Provider::start().await;
    let limits = RequestLimits { sign_ins_per_s: 1e-3, sign_ins_at_once: 3.0, ..generous() };
    let station = station_with(settings(&provider.issuer), hasty(), limits).await;
    let mut statuses = Vec::new();
    for _ in 0..5 {
        statuses.push(station.get("/oidc/login").await.status.as_u16());
    }
    assert_eq!(statuses, [303, 303, 303, 429, 429]);
    let browser = [(header::ACCEPT, "text/html")];
    assert_eq!(get(&station, "/oidc/login", &browser).await.header(header::LOCATION), "/#sign-in=too-many");
}

#[tokio::test]
async fn cookies_are_for_tls_where_browsers_reach_the_station_by_it() {
    let provider = Provider::start().await;
    let settings = OidcSettings { public_url: "https://station.localhost/".to_owned(), ..settings(&provider.issuer) };
    let station = station_with(settings, hasty(), generous()).await;
    let me = station.get("/api/v1/me").await.json();
    assert_eq!(me["sign_in"], "https://station.localhost/oidc/login");
    let answer = station.get("/oidc/login").await;
    assert!(answer.header(header::SET_COOKIE).ends_with("; HttpOnly; SameSite=Lax; Secure"), "{answer:?}");
    assert!(answer.header(header::LOCATION).contains("redirect_uri=https%3A%2F%2Fstation.localhost%2Foidc%2Fcallback"));
}

#[tokio::test]
async fn a_wrong_secret_of_the_client_is_a_refusal_and_without_a_provider_there_is_no_route() {
    let provider = Provider::start().await;
    let wrong = OidcSettings { client_secret: Some("another".to_owned()), ..settings(&provider.issuer) };
    let station = station_with(wrong, hasty(), generous()).await;
    sign_in(&station, &provider).await.is_problem(502);
    let plain = crate::api::client::with_tokens(generous()).await;
    plain.get("/oidc/login").await.is_problem(404);
    plain.get("/oidc/callback?code=a&state=b").await.is_problem(404);
}

#[test]
fn settings_that_cannot_be_used_are_refused() {
    let new = |settings| Oidc::new(settings, Patience::default()).map(|_| ());
    let of = |issuer: &str| new(settings(issuer));
    for issuer in ["", "id.example.org", "ftp://id.example.org", "https://me:secret@id.example.org", "https://a/?b"] {
        assert!(matches!(of(issuer), Err(OidcError::Issuer(_))), "{issuer}");
    }
    // Without TLS on this computer only.
    assert!(matches!(of("http://id.example.org"), Err(OidcError::Issuer(_))));
    assert!(matches!(of("http://localhost.example.org"), Err(OidcError::Issuer(_))));
    for issuer in ["http://localhost:5556/dex", "http://127.0.0.1:1", "http://[::1]:1", "https://id.example.org/a/b/"] {
        assert!(of(issuer).is_ok(), "{issuer}");
    }
    for public_url in ["", "station", "https://station.example.org/map", "https://station.example.org/?a=b"] {
        let settings = OidcSettings { public_url: public_url.to_owned(), ..settings("https://id.example.org") };
        assert!(matches!(new(settings), Err(OidcError::PublicUrl(_))), "{public_url}");
    }
}
