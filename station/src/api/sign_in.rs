//! Sign-in by OpenID Connect: a browser to the provider and back, and a session from what comes of it.
//!
//! The state of a sign-in is in a cookie meanwhile, so that nobody can make another person's browser end a sign-in that
//! they have begun themselves. A browser is sent back to the page, which tells what has failed; other programs get a
//! problem document.

use std::time::Instant;

use axum::Extension;
use axum::extract::State;
use axum::http::{HeaderMap, HeaderValue, StatusCode, header};
use axum::response::{AppendHeaders, IntoResponse, Response};
use serde::Deserialize;
use utoipa::IntoParams;
use utoipa_axum::router::OpenApiRouter;
use utoipa_axum::routes;

use super::Shared;
use super::access::{Client, Principal, cookie};
use super::extract::Query;
use super::problem::Problem;
use crate::net::same;
use crate::oidc::{Oidc, Refusal, SignedIn};

/// The name of the cookie with the state of a sign-in.
const COOKIE: &str = "baliza_sign_in";

/// The routes.
pub fn routes() -> OpenApiRouter<Shared> {
    OpenApiRouter::new().routes(routes!(begin)).routes(routes!(end))
}

/// Sends a browser to the provider of sign-ins.
#[utoipa::path(get, path = "/oidc/login", tag = "access", security(()),
    responses(
        (status = 303, description = "to the provider; or, for a browser, to the page with what has failed",
            headers(("Location" = String), ("Set-Cookie" = String, description = "the state of the sign-in"))),
        (status = 404, description = "the station has no provider of sign-ins", body = Problem,
            content_type = "application/problem+json"),
        (status = 429, description = "too many sign-ins from this address", body = Problem,
            content_type = "application/problem+json")))]
async fn begin(
    State(station): State<Shared>,
    Extension(Client(client)): Extension<Client>,
    headers: HeaderMap,
) -> Result<Response, Problem> {
    let oidc = provider(&station)?;
    if let Err(problem) = station.access.check_sign_in(client) {
        return Ok(refused(&station, &headers, "too-many", problem));
    }
    match oidc.begin().await {
        Ok(begin) => {
            let age = oidc.sign_in_time().as_secs();
            Ok(to(begin.url.as_str(), [keep(&station, &begin.state, age)]))
        }
        Err(refusal) => Ok(refuse(&station, &headers, refusal)),
    }
}

/// What a provider sends back, after OpenID Connect Core 1.0, sections 3.1.2.5 and 3.1.2.6, and RFC 9207.
#[derive(Deserialize, IntoParams)]
#[into_params(parameter_in = Query)]
struct Callback {
    /// Stands for the ID token.
    code: Option<String>,
    /// The sign-in.
    state: Option<String>,
    /// Why there is no code.
    error: Option<String>,
    /// The provider.
    iss: Option<String>,
}

/// Where the provider sends a browser back to: begins a session.
#[utoipa::path(get, path = "/oidc/callback", tag = "access", security(()), params(Callback),
    responses(
        (status = 303, description = "to the page: with a session; or, for a browser, with what has failed",
            headers(("Location" = String), ("Set-Cookie" = String, description = "the session"))),
        (status = 400, description = "the sign-in has ended, or was not begun by this browser", body = Problem,
            content_type = "application/problem+json"),
        (status = 403, description = "the provider has refused, or the person has no role", body = Problem,
            content_type = "application/problem+json"),
        (status = 404, description = "the station has no provider of sign-ins", body = Problem,
            content_type = "application/problem+json"),
        (status = 429, description = "too many wrong states from this address", body = Problem,
            content_type = "application/problem+json"),
        (status = 502, description = "the provider's answer cannot be trusted", body = Problem,
            content_type = "application/problem+json")))]
async fn end(
    State(station): State<Shared>,
    Extension(Client(client)): Extension<Client>,
    headers: HeaderMap,
    Query(callback): Query<Callback>,
) -> Result<Response, Problem> {
    let oidc = provider(&station)?;
    let SignedIn { user, end_session } = match finish(oidc, &headers, callback).await {
        Ok(signed_in) => signed_in,
        Err(refusal) => {
            log::warn!(target: "audit", "{client} a sign-in is refused: {refusal}");
            if refusal == Refusal::Unknown
                && let Err(problem) = station.access.wrong(client)
            {
                return Ok(refused(&station, &headers, "too-many", problem));
            }
            return Ok(refuse(&station, &headers, refusal));
        }
    };
    // As it is in the log from now on. A token's name cannot be mistaken for it.
    let name = format!("oidc:{}", user.name);
    log::info!(target: "audit", "{client} {name:?} signs in as {:?}, subject {:?}", user.role, user.subject);
    let until = Instant::now().checked_add(oidc.session());
    let session = station.access.log_in(Principal { name: Some(name), role: user.role, until }, end_session)?;
    Ok(to("/", [session, keep(&station, "", 0)]))
}

/// The person whose sign-in ends.
async fn finish(oidc: &Oidc, headers: &HeaderMap, callback: Callback) -> Result<SignedIn, Refusal> {
    let Callback { code, state, error, iss } = callback;
    let state = state.ok_or(Refusal::Unknown)?;
    let own = cookie(headers, COOKIE).ok_or(Refusal::Unknown)?;
    if !same(own.as_bytes(), state.as_bytes()) {
        return Err(Refusal::Unknown);
    }
    let sign_in = oidc.take(&state).ok_or(Refusal::Unknown)?;
    if iss.is_some_and(|iss| iss != oidc.issuer()) {
        log::error!("sign-in: an answer of another provider than {}", oidc.issuer());
        return Err(Refusal::Distrusted);
    }
    match (error.as_deref(), code) {
        (None, Some(code)) => oidc.finish(sign_in, code).await,
        (Some("temporarily_unavailable" | "server_error"), _) => Err(Refusal::Away),
        (Some(error), _) => {
            log::warn!("sign-in: {} answers {error:?}", oidc.issuer());
            Err(Refusal::Denied)
        }
        (None, None) => Err(Refusal::Distrusted),
    }
}

fn provider(station: &Shared) -> Result<&Oidc, Problem> {
    station.app.oidc.as_deref().ok_or_else(|| Problem::missing("provider of sign-ins: see `baliza serve --oidc`"))
}

/// The cookie of a sign-in. Browsers must send it when the provider sends them back: `Lax`, not `Strict`.
fn keep(station: &Shared, state: &str, age_s: u64) -> String {
    let secure = station.access.secure();
    format!("{COOKIE}={state}; Path=/oidc/; Max-Age={age_s}; HttpOnly; SameSite=Lax{secure}")
}

fn to<const N: usize>(place: &str, cookies: [String; N]) -> Response {
    let cookies = AppendHeaders(cookies.map(|cookie| (header::SET_COOKIE, cookie)));
    let kept = [(header::LOCATION, place), (header::CACHE_CONTROL, "no-store")];
    (StatusCode::SEE_OTHER, kept, cookies).into_response()
}

fn refuse(station: &Shared, headers: &HeaderMap, refusal: Refusal) -> Response {
    let (code, status) = match refusal {
        Refusal::Away => ("away", StatusCode::SERVICE_UNAVAILABLE),
        Refusal::Unknown => ("unknown", StatusCode::BAD_REQUEST),
        Refusal::Denied => ("denied", StatusCode::FORBIDDEN),
        Refusal::Distrusted => ("distrusted", StatusCode::BAD_GATEWAY),
        Refusal::NoRole => ("no-role", StatusCode::FORBIDDEN),
    };
    refused(station, headers, code, Problem::new(status, refusal.to_string()))
}

/// A browser goes to the page, which knows the codes.
fn refused(station: &Shared, headers: &HeaderMap, code: &str, problem: Problem) -> Response {
    let is_browser = |accept: &HeaderValue| accept.to_str().is_ok_and(|accept| accept.contains("text/html"));
    let forget = keep(station, "", 0);
    if headers.get_all(header::ACCEPT).iter().any(is_browser) {
        return to(&format!("/#sign-in={code}"), [forget]);
    }
    (AppendHeaders([(header::SET_COOKIE, forget)]), problem).into_response()
}
