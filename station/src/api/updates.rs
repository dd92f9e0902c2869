//! Live updates: the hub's updates to the listeners at WebSockets and event streams.

use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use axum::Extension;
use axum::extract::State;
use axum::extract::ws::{CloseFrame, Message, Utf8Bytes, WebSocket, WebSocketUpgrade, close_code, rejection};
use axum::response::sse::{KeepAlive, Sse};
use axum::response::{IntoResponse, Response, sse};
use futures_util::{SinkExt, Stream, StreamExt, stream};
use serde::{Deserialize, Serialize};
use tokio::sync::{broadcast, watch};
use utoipa::{IntoParams, ToSchema};
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::access::Principal;
use super::extract::{Name, Query};
use super::problem::Problem;
use super::{Shared, Station, stopped};
use crate::Update;
use crate::model::TagPosition;
use crate::net::limits::Connection;

/// What a listener may send in a message; nothing of it is read.
const INCOMING: usize = 4_096;

/// The routes.
pub fn routes() -> OpenApiRouter<Shared> {
    OpenApiRouter::new().routes(routes!(socket)).routes(routes!(events))
}

/// What a listener wants.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
struct Wanted {
    /// Only of this site.
    #[param(inline)]
    site: Option<Name>,
    /// Only of this tag.
    #[param(inline)]
    tag: Option<Name>,
}

/// The listener was too slow.
#[derive(Debug, Serialize, ToSchema)]
struct Missed {
    /// How many updates it missed.
    missed: u64,
}

/// What a listener gets next.
enum Next {
    Update(Update),
    Missed(u64),
    /// The station stops, or the session is over.
    End(&'static str),
}

/// A listener: its place in the updates, and what it wants of them.
struct Listener {
    updates: broadcast::Receiver<Update>,
    stop: watch::Receiver<bool>,
    wanted: Wanted,
    station: Arc<Station>,
    /// The end of the session, where it has one.
    until: Option<tokio::time::Instant>,
}

impl Listener {
    fn new(station: Arc<Station>, wanted: Wanted, who: Option<Extension<Principal>>) -> Self {
        station.counts.listener(1);
        let until = who.and_then(|Extension(who)| who.until).map(tokio::time::Instant::from_std);
        Self { updates: station.app.hub.listen(), stop: station.stop.subscribe(), wanted, station, until }
    }

    async fn next(&mut self) -> Next {
        loop {
            let update = tokio::select! {
                () = stopped(&mut self.stop) => return Next::End("the station stops"),
                () = over(self.until) => return Next::End("the session has ended"),
                update = self.updates.recv() => update,
            };
            match update {
                Ok(update) if self.wanted.includes(&update) => return Next::Update(update),
                Ok(_) => {}
                Err(broadcast::error::RecvError::Lagged(missed)) => {
                    self.station.app.hub.note_missed(missed);
                    return Next::Missed(missed);
                }
                Err(broadcast::error::RecvError::Closed) => return Next::End("the station stops"),
            }
        }
    }
}

/// Waits for the end of a session; for ever where it has none.
async fn over(until: Option<tokio::time::Instant>) {
    match until {
        Some(until) => tokio::time::sleep_until(until).await,
        None => std::future::pending().await,
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        self.station.counts.listener(-1);
    }
}

impl Wanted {
    fn includes(&self, update: &Update) -> bool {
        let is = |wanted: &Option<Name>, given: &str| wanted.as_ref().is_none_or(|wanted| wanted.as_str() == given);
        match update {
            Update::Position(position) => is(&self.site, &position.site) && is(&self.tag, &position.tag),
            Update::Event(event) => is(&self.site, &event.site) && is(&self.tag, &event.node),
            Update::Data(data) => is(&self.site, &data.site) && is(&self.tag, &data.tag),
            Update::Changed => true,
        }
    }
}

/// Positions as they come, at a WebSocket: one JSON object a message. A listener that is too slow gets
/// `{"missed": 12}` and goes on.
#[utoipa::path(get, path = "/api/v1/live", tag = "live", security(("token" = ["view"])), params(Wanted),
    responses((status = 101, description = "a WebSocket: each message is a `TagPosition` or a `Missed`"),
        (status = 200, description = "never: the schema of the messages", body = inline(SocketMessage)),
        (status = 426, description = "the request asks for no WebSocket", body = Problem,
            content_type = "application/problem+json")))]
async fn socket(
    State(station): State<Shared>,
    Query(wanted): Query<Wanted>,
    who: Option<Extension<Principal>>,
    connection: Option<Extension<Connection>>,
    upgrade: Result<WebSocketUpgrade, rejection::WebSocketUpgradeRejection>,
) -> Result<Response, Problem> {
    let upgrade = upgrade.map_err(|error| Problem::new(axum::http::StatusCode::UPGRADE_REQUIRED, error.body_text()))?;
    let upgrade = upgrade.max_message_size(INCOMING).max_frame_size(INCOMING);
    let listener = Listener::new(station, wanted, who);
    Ok(upgrade.on_upgrade(move |socket| async move {
        // The connection counts as long as the WebSocket is open.
        let _connection = connection;
        talk(socket, listener).await;
    }))
}

/// What a WebSocket gets.
#[derive(Serialize, ToSchema)]
#[serde(untagged)]
enum SocketMessage {
    Position(TagPosition),
    Missed(Missed),
}

/// Sends until the listener is gone, or takes nothing, or the station stops.
async fn talk(socket: WebSocket, mut listener: Listener) {
    let limits = listener.station.app.limits;
    let (mut to, mut from) = socket.split();
    let mut ping = tokio::time::interval_at(tokio::time::Instant::now() + limits.ping, limits.ping);
    ping.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
    let mut unanswered = 0;
    loop {
        let message = tokio::select! {
            next = listener.next() => match next {
                Next::Update(Update::Position(position)) => text(&SocketMessage::Position(position)),
                Next::Update(Update::Event(_) | Update::Data(_) | Update::Changed) => continue,
                Next::Missed(missed) => text(&SocketMessage::Missed(Missed { missed })),
                Next::End(reason) => {
                    let reason = Utf8Bytes::from_static(reason);
                    let close = Message::Close(Some(CloseFrame { code: close_code::AWAY, reason }));
                    let _ = tokio::time::timeout(Duration::from_secs(1), to.send(close)).await;
                    return;
                }
            },
            message = from.next() => match message {
                Some(Ok(Message::Close(_)) | Err(_)) | None => return,
                Some(Ok(Message::Text(_) | Message::Binary(_) | Message::Ping(_) | Message::Pong(_))) => {
                    unanswered = 0;
                    continue;
                }
            },
            _ = ping.tick() => {
                if unanswered >= 2 {
                    return;
                }
                unanswered += 1;
                Message::Ping(axum::body::Bytes::new())
            },
        };
        match tokio::time::timeout(limits.write, to.send(message)).await {
            Ok(Ok(())) => {}
            Ok(Err(_)) | Err(_) => return,
        }
    }
}

fn text(value: &impl Serialize) -> Message {
    Message::Text(serde_json::to_string(value).unwrap_or_default().into())
}

/// Updates as they come, as server-sent events: `position` (a `TagPosition`), `event` (an `Event`), `data` (of a tag's
/// user: `{"site": "site", "tag": "0x1001", "t": "2026-06-01T12:00:00Z", "number": 7, "data": "6F70656E"}`), `changed`
/// (tags, nodes, zones or sites are to be read again), `missed` (the listener was too slow: `{"missed": 12}`).
#[utoipa::path(get, path = "/api/v1/updates", tag = "live", security(("token" = ["view"])), params(Wanted),
    responses((status = 200, description = "a stream of events", content_type = "text/event-stream", body = String)))]
async fn events(
    State(station): State<Shared>,
    who: Option<Extension<Principal>>,
    Query(wanted): Query<Wanted>,
) -> Response {
    let ping = station.app.limits.ping;
    let stream = stream::unfold(Listener::new(station, wanted, who), |mut listener| async move {
        let event = match listener.next().await {
            Next::Update(Update::Position(position)) => event("position", &position),
            Next::Update(Update::Event(happened)) => event("event", &happened),
            Next::Update(Update::Data(data)) => event("data", &data),
            Next::Update(Update::Changed) => event("changed", &serde_json::json!({})),
            Next::Missed(missed) => event("missed", &Missed { missed }),
            Next::End(_) => return None,
        };
        Some((event, listener))
    });
    endless(stream).keep_alive(KeepAlive::new().interval(ping)).into_response()
}

fn endless<S>(stream: S) -> Sse<S>
where
    S: Stream<Item = Result<sse::Event, Infallible>> + Send + 'static,
{
    Sse::new(stream)
}

fn event(name: &str, value: &impl Serialize) -> Result<sse::Event, Infallible> {
    // JSON has no line breaks.
    Ok(sse::Event::default().event(name).data(serde_json::to_string(value).unwrap_or_default()))
}
