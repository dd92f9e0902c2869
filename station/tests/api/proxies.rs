//! Clients behind a reverse proxy. The tests' own connections, from the loopback address, are those of the proxy.

use hyper::Method;
use station_core::api::{Access, App, Proxies, RequestLimits, Token, UserRole};

use crate::api::client::{Answer, Station, generous, station_of};

async fn station(proxies: &[&str]) -> Station {
    let proxies = Proxies(proxies.iter().map(|network| network.parse().unwrap()).collect());
    let access = Access::Tokens(vec![Token::new("wall", UserRole::View, "wall-secret")]);
    let limits = RequestLimits { wrong_tokens_per_s: 1e-3, wrong_tokens_at_once: 3.0, ..generous() };
    station_of(|app| App { access, proxies, limits, ..app }).await
}

async fn ask(station: &Station, token: &str, header: &str, client: &str) -> Answer {
    let mut request = station.request(Method::GET, "/api/v1/tags");
    let headers = request.headers_mut();
    headers.insert("authorization", format!("Bearer {token}").parse().unwrap());
    headers.insert(header.parse::<hyper::header::HeaderName>().unwrap(), client.parse().unwrap());
    station.send(request).await
}

#[tokio::test]
async fn wrong_tokens_lock_out_the_client_behind_a_trusted_proxy_and_nobody_else() {
    let station = station(&["127.0.0.0/8"]).await;
    let forwarded = "x-forwarded-for";
    // The client writes another address each time: the proxy adds the true one after it.
    for number in 0..3 {
        ask(&station, "wrong", forwarded, &format!("192.0.2.{number}, 198.51.100.1")).await.is_problem(401);
    }
    ask(&station, "wall-secret", forwarded, "198.51.100.1").await.is_problem(429);
    ask(&station, "wall-secret", "forwarded", "for=198.51.100.1").await.is_problem(429);
    for other in ["198.51.100.2", "192.0.2.1"] {
        assert_eq!(ask(&station, "wall-secret", forwarded, other).await.status, 200, "{other}");
    }
}

#[tokio::test]
async fn an_address_that_nobody_trusts_cannot_choose_another_one() {
    let station = station(&["192.0.2.1"]).await;
    for number in 0..3 {
        ask(&station, "wrong", "x-forwarded-for", &format!("198.51.100.{number}")).await.is_problem(401);
    }
    ask(&station, "wall-secret", "x-forwarded-for", "198.51.100.9").await.is_problem(429);
    ask(&station, "wall-secret", "forwarded", "for=198.51.100.9").await.is_problem(429);
}

#[tokio::test]
async fn the_log_in_of_a_browser_counts_for_the_client_as_well() {
    let station = station(&["127.0.0.1"]).await;
    let log_in = async |token: &str, client: &str| {
        let mut request = station.request(Method::POST, "/login");
        let headers = request.headers_mut();
        headers.insert("content-type", "application/json".parse().unwrap());
        headers.insert("x-forwarded-for", client.parse().unwrap());
        *request.body_mut() = format!(r#"{{"token": "{token}"}}"#).into();
        station.send(request).await.status.as_u16()
    };
    for _ in 0..3 {
        assert_eq!(log_in("wrong", "198.51.100.1").await, 401);
    }
    assert_eq!(log_in("wall-secret", "198.51.100.1").await, 429);
    assert_eq!(log_in("wall-secret", "198.51.100.2").await, 200);
}
