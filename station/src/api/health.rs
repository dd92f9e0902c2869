//! Whether the station works, and who one is.

use axum::extract::State;
use axum::http::{HeaderMap, StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::{Extension, Json as Answer};
use serde::{Deserialize, Serialize};
use utoipa::ToSchema;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::Shared;
use super::access::{Client, Principal, UserRole};
use super::extract::Json;
use super::problem::{self, Problem};

/// The routes.
pub fn routes() -> OpenApiRouter<Shared> {
    OpenApiRouter::new().routes(routes!(health)).routes(routes!(log_in)).routes(routes!(log_out)).routes(routes!(me))
}

/// Whether the station works.
#[derive(Debug, Serialize, ToSchema)]
struct Health {
    /// `OK` or `Service Unavailable`.
    title: &'static str,
    /// As in the answer's head.
    status: u16,
    /// The store answers, and takes rows.
    store: bool,
    /// The hub takes reports.
    hub: bool,
    version: &'static str,
}

/// Whether the station works: 200, or 503 with what does not.
#[utoipa::path(get, path = "/healthz", tag = "health", security(()),
    responses((status = 200, body = Health),
        (status = 503, description = "something does not work", body = Health,
            content_type = "application/problem+json")))]
async fn health(State(station): State<Shared>) -> Response {
    let hub = &station.app.hub;
    let (store, hub) = (hub.is_storing() && station.app.store.is_well().await, !hub.reports().is_closed());
    let (status, title, media_type) = if store && hub {
        (StatusCode::OK, "OK", "application/json")
    } else {
        (StatusCode::SERVICE_UNAVAILABLE, "Service Unavailable", problem::MEDIA_TYPE)
    };
    let health = Health { title, status: status.as_u16(), store, hub, version: env!("CARGO_PKG_VERSION") };
    (status, [(header::CONTENT_TYPE, media_type)], serde_json::to_vec(&health).unwrap_or_default()).into_response()
}

/// Who one is.
#[derive(Debug, Serialize, ToSchema)]
struct Me {
    /// The token's name, or `oidc:` and the name that the provider of sign-ins tells.
    name: Option<String>,
    /// What one may do; null: nothing, before `POST /login` or a sign-in.
    role: Option<UserRole>,
    /// Whether the station asks for a token or a sign-in.
    tokens: bool,
    /// Where a browser signs in at a provider; null: tokens only.
    sign_in: Option<String>,
}

impl Me {
    fn of(station: &Shared, name: Option<String>, role: Option<UserRole>) -> Answer<Self> {
        let sign_in = station.app.oidc.as_ref().map(|oidc| oidc.login_url());
        Answer(Self { name, role, tokens: station.access.asks_for_tokens(), sign_in })
    }
}

/// A token.
#[derive(Deserialize, ToSchema)]
struct Login {
    token: String,
}

/// Turns a token into a cookie, for browsers.
#[utoipa::path(post, path = "/login", tag = "access", security(()), request_body = Login,
    responses((status = 200, body = Me, headers(("Set-Cookie" = String, description = "the session")))))]
async fn log_in(
    State(station): State<Shared>,
    Extension(Client(client)): Extension<Client>,
    Json(login): Json<Login>,
) -> Result<Response, Problem> {
    let who = station.access.who_has(&login.token, client)?;
    let me = Me::of(&station, who.name.clone(), Some(who.role));
    if !station.access.asks_for_tokens() {
        return Ok(me.into_response());
    }
    log::info!(target: "audit", "{client} {:?} logs in", who.name.as_deref().unwrap_or_default());
    Ok(([(header::SET_COOKIE, station.access.log_in(who, None)?)], me).into_response())
}

/// The end of a session.
#[derive(Debug, Serialize, ToSchema)]
struct LoggedOut {
    /// Where a browser ends the session of the provider of sign-ins too; null: that one goes on, or there is none.
    end_session: Option<String>,
}

/// Ends the session of the cookie.
#[utoipa::path(post, path = "/logout", tag = "access", security(()), responses((status = 200, body = LoggedOut)))]
async fn log_out(State(station): State<Shared>, headers: HeaderMap) -> Response {
    let (cookie, end_session) = station.access.log_out(&headers);
    ([(header::SET_COOKIE, cookie)], Answer(LoggedOut { end_session: end_session.map(Into::into) })).into_response()
}

/// Who one is, and how to get a role.
#[utoipa::path(get, path = "/api/v1/me", tag = "access", security((), ("token" = ["view"])),
    responses((status = 200, body = Me)))]
async fn me(State(station): State<Shared>, who: Option<Extension<Principal>>) -> Answer<Me> {
    let (name, role) = who.map(|Extension(who)| (who.name, who.role)).unzip();
    Me::of(&station, name.flatten(), role)
}
