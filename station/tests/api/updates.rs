//! Live updates.

use std::time::Duration;

use futures_util::{SinkExt, StreamExt};
use http_body_util::BodyExt;
use hyper::{Method, header};
use serde_json::{Value, json};
use station_core::api::{Access, RequestLimits};
use tokio::net::TcpStream;
use tokio::time::timeout;
use tokio_tungstenite::WebSocketStream;
use tokio_tungstenite::tungstenite::Message;

use crate::api::client::{PATIENCE, Station, generous, open, station};

async fn listen(station: &Station, query: &str) -> WebSocketStream<TcpStream> {
    let stream = TcpStream::connect(station.address).await.unwrap();
    let address = format!("ws://{}/api/v1/live{query}", station.address);
    let socket = tokio_tungstenite::client_async(address, stream).await.unwrap().0;
    // The listener listens from the moment at which the upgrade was answered.
    socket
}

async fn next(socket: &mut WebSocketStream<TcpStream>) -> Value {
    loop {
        match timeout(PATIENCE, socket.next()).await.unwrap().unwrap().unwrap() {
            Message::Text(text) => return serde_json::from_str(&text).unwrap(),
            Message::Ping(_) | Message::Pong(_) => {}
            other => panic!("{other:?}"),
        }
    }
}

#[tokio::test]
async fn a_websocket_gets_one_position_a_message_of_its_site_and_tag() {
    let station = open().await;
    let (mut all, mut one) = (listen(&station, "").await, listen(&station, "?site=lab&tag=0x1002").await);
    let mut none = listen(&station, "?site=other").await;
    station.report_position("0x1001", 1.0, 2.0).await;
    station.report_position("0x1002", 3.0, 4.0).await;
    let first = next(&mut all).await;
    assert_eq!((&first["tag"], &first["x_m"], &first["y_m"]), (&json!("0x1001"), &json!(1.0), &json!(2.0)));
    let stored = station.until("/api/v1/tags/0x1001/positions", |rows| rows[0].is_object()).await;
    assert_eq!(crate::api::client::keys(&first), crate::api::client::keys(&stored[0]));
    assert_eq!(next(&mut all).await["tag"], "0x1002");
    assert_eq!(next(&mut one).await["tag"], "0x1002");
    assert!(timeout(Duration::from_millis(300), none.next()).await.is_err());
}

#[tokio::test]
async fn what_a_listener_sends_is_ignored_and_what_is_too_long_ends_it() {
    let station = open().await;
    let mut socket = listen(&station, "").await;
    socket.send(Message::text("{}")).await.unwrap();
    station.report_position("0x1001", 1.0, 2.0).await;
    assert_eq!(next(&mut socket).await["tag"], "0x1001");
    socket.send(Message::text("x".repeat(100_000))).await.unwrap();
    let ended = timeout(PATIENCE, async { while let Some(Ok(_)) = socket.next().await {} }).await;
    assert!(ended.is_ok());
    assert_eq!(station.get("/healthz").await.status, 200);
}

#[tokio::test]
async fn a_listener_that_answers_no_ping_is_disconnected() {
    let station = station(Access::Open, RequestLimits { ping: Duration::from_secs(2), ..generous() }).await;
    let silent = listen(&station, "").await;
    let mut answering = listen(&station, "").await;
    tokio::spawn(async move { while let Some(Ok(_)) = answering.next().await {} });
    let gauge = |text: &str| {
        let line = text.lines().find(|line| line.starts_with("baliza_listeners ")).unwrap();
        line.rsplit_once(' ').unwrap().1.parse::<f64>().unwrap()
    };
    let listeners = async || gauge(std::str::from_utf8(&station.get("/metrics").await.body).unwrap());
    assert_eq!(listeners().await, 2.0);
    let until_gone = async {
        while listeners().await > 1.0 {
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    };
    timeout(PATIENCE, until_gone).await.unwrap();
    // The one that answers stays for one more ping.
    tokio::time::sleep(Duration::from_secs(2)).await;
    assert_eq!(listeners().await, 1.0);
    drop(silent);
}

/// The events of a stream, as they come.
struct Events {
    body: hyper::body::Incoming,
    text: String,
}

impl Events {
    async fn open(station: &Station, query: &str) -> Self {
        let answer = station.begin(station.request(Method::GET, &format!("/api/v1/updates{query}"))).await;
        assert_eq!(answer.headers()[header::CONTENT_TYPE], "text/event-stream");
        Self { body: answer.into_body(), text: String::new() }
    }

    /// Name and data of the next event; None: the stream has ended.
    async fn next(&mut self) -> Option<(String, Value)> {
        loop {
            // Events end with an empty line; those without data are comments (WHATWG HTML, 9.2.6).
            while let Some((event, rest)) = self.text.split_once("\n\n") {
                let field = |name: &str| event.lines().find_map(|line| line.strip_prefix(name)).map(str::trim);
                let found = field("event:").zip(field("data:"));
                let found = found.map(|(name, data)| (name.to_owned(), serde_json::from_str(data).unwrap()));
                self.text = rest.to_owned();
                if found.is_some() {
                    return found;
                }
            }
            let frame = timeout(PATIENCE, self.body.frame()).await.unwrap()?.ok()?;
            self.text.push_str(std::str::from_utf8(frame.data_ref()?).unwrap());
        }
    }
}

#[tokio::test]
async fn an_event_stream_gets_positions_events_and_changes() {
    let station = open().await;
    let mut events = Events::open(&station, "?site=lab").await;
    let room = json!({"kind": "room", "corners_m": [[0, 0], [10, 0], [10, 10], [0, 10]]});
    station.json(Method::PUT, "/api/v1/rooms/lab/kitchen", &room).await;
    assert_eq!(events.next().await.unwrap(), ("changed".to_owned(), json!({})));
    station.report_position("0x1001", 5.0, 5.0).await;
    let mut seen = std::collections::BTreeMap::new();
    while !(seen.contains_key("position") && seen.contains_key("event")) {
        let (name, data) = events.next().await.unwrap();
        seen.insert(name, data);
    }
    assert_eq!((&seen["position"]["tag"], &seen["position"]["x_m"]), (&json!("0x1001"), &json!(5.0)));
    assert_eq!((&seen["event"]["kind"], &seen["event"]["zone"]), (&json!("entered"), &json!("kitchen")));
}

#[tokio::test]
async fn a_listener_that_is_too_slow_is_told_how_many_it_missed_and_goes_on() {
    let station = open().await;
    let mut events = Events::open(&station, "").await;
    // More than the buffers of both ends of the connection and of the hub hold: 60,000 of about 250 bytes.
    for number in 0..60_000 {
        station.report_position("0x1001", f64::from(number) / 1_000.0, 0.0).await;
    }
    station.until("/api/v1/tags", |tags| tags[0]["last_position"]["x_m"] == 59.999).await;
    let (mut received, mut missed) = (0, 0);
    while received + missed < 60_000 {
        let (name, data) = events.next().await.unwrap();
        match name.as_str() {
            "position" => received += 1,
            "missed" => missed += data["missed"].as_u64().unwrap(),
            // These count among the missed ones, where there are any.
            _ => {}
        }
    }
    assert!(missed > 0, "{received} received");
    station.report_position("0x1001", 7.0, 7.0).await;
    loop {
        let (name, data) = events.next().await.unwrap();
        if name == "position" && data["y_m"] == 7.0 {
            break;
        }
    }
}

#[tokio::test]
async fn listeners_are_told_to_go_when_the_station_stops() {
    let station = open().await;
    let (mut socket, mut events) = (listen(&station, "").await, Events::open(&station, "").await);
    let stopped = tokio::spawn(station.stop());
    loop {
        match timeout(PATIENCE, socket.next()).await.unwrap() {
            // 1001: going away (RFC 6455, 7.4.1).
            Some(Ok(Message::Close(Some(frame)))) => break assert_eq!(u16::from(frame.code), 1001),
            Some(Ok(Message::Ping(_))) => {}
            other => panic!("{other:?}"),
        }
    }
    assert_eq!(events.next().await, None);
    drop((socket, events));
    assert!(stopped.await.unwrap() < Duration::from_secs(5));
}
