//! HTTP: REST, live updates, the page.
//!
//! `station/openapi.json` lists the routes, with what each does and the least role that may use it; it is made of their
//! own descriptions, and served at `/openapi.json`.
//!
//! A request passes through these, from outside to inside: `serve` (connections), `net::tls` where there is a certificate,
//! the layers of `router` (problem documents, headers, compression, `admit`: who may), `extract` (its values are
//! checked), the handler in the file of its subject, `answer`.

pub mod access;
mod answer;
mod campaigns;
mod events;
mod extract;
mod findings;
mod health;
mod messages;
mod metrics;
mod nodes;
mod openapi;
mod page;
mod problem;
mod receivers;
mod rtls;
mod serve;
mod sign_in;
mod sites;
mod tags;
mod updates;
mod zones;

use std::collections::HashMap;
use std::sync::Arc;

use axum::extract::{DefaultBodyLimit, MatchedPath, Request, State};
use axum::http::{HeaderValue, Method, StatusCode, header};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use tokio::sync::watch;
use tower_http::catch_panic::CatchPanicLayer;
use tower_http::compression::CompressionLayer;
use utoipa_axum::router::OpenApiRouter;

pub use crate::net::limits::RequestLimits;
pub use crate::net::proxies::{IpNetwork, NoNetwork, Proxies};
pub use crate::net::tls::{Tls, TlsCause, TlsError};
pub use access::{Access, Token, UserRole};
pub use openapi::openapi;
pub use page::Page;
pub use serve::serve;

use crate::net::limits::Connections;
use access::{AccessControl, Client, Peer, RequiredRole};
use metrics::RequestCounts;
use problem::Problem;

use crate::model::TagStatus;
use crate::oidc::Oidc;
use crate::{Hub, SourceReport, Store, webhooks};

/// The greatest body of a request, bytes, but for samples and pictures.
const BODY: usize = 256_000;
/// The greatest body with samples, bytes: 10,000 of them, with names of 100 letters.
const SAMPLES_BODY: usize = 2_000_000;

/// What the routes need.
#[derive(Clone, Debug)]
pub struct App {
    /// Live state and updates.
    pub hub: Hub,
    /// History and configuration.
    pub store: Store,
    /// Who may use the station.
    pub access: Access,
    /// Where people sign in, besides tokens. None: nowhere.
    pub oidc: Option<Arc<Oidc>>,
    /// Proxies that say whose requests they pass on.
    pub proxies: Proxies,
    /// Connections are encrypted with this certificate; cookies are marked so. None: plain HTTP.
    pub tls: Option<Arc<Tls>>,
    /// What one client may use.
    pub limits: RequestLimits,
    /// The hooks that get events, for the metrics.
    pub webhooks: webhooks::Watch,
    /// The files of the page.
    pub page: Page,
    /// The tags that the store had when the station started.
    pub earlier: Vec<TagStatus>,
}

impl App {
    /// For loopback: without tokens, with the page that is part of the program.
    pub fn new(hub: Hub, store: Store) -> Self {
        Self {
            hub,
            store,
            access: Access::Open,
            oidc: None,
            proxies: Proxies::default(),
            tls: None,
            limits: RequestLimits::default(),
            webhooks: webhooks::Watch::default(),
            page: Page::built(),
            earlier: Vec::new(),
        }
    }
}

/// What the handlers share.
#[derive(Debug)]
struct Station {
    app: App,
    access: AccessControl,
    /// What each route asks for, by method and path.
    needs: HashMap<(Method, String), RequiredRole>,
    connections: Connections,
    counts: RequestCounts,
    /// True when the station stops.
    stop: watch::Sender<bool>,
    /// Held while the configuration is changed: what is checked first is still true then.
    configuring: tokio::sync::Mutex<()>,
}

type Shared = Arc<Station>;

impl Station {
    fn new(app: App) -> Self {
        Self {
            access: AccessControl::new(
                app.access.clone(),
                app.tls.is_some() || app.oidc.as_ref().is_some_and(|oidc| oidc.is_encrypted()),
                &app.limits,
            ),
            needs: openapi::needs(),
            connections: Connections::new(&app.limits),
            counts: RequestCounts::default(),
            stop: watch::Sender::new(false),
            configuring: tokio::sync::Mutex::default(),
            app,
        }
    }

    /// Sends reports to the hub.
    async fn report(&self, reports: impl IntoIterator<Item = SourceReport>) -> Result<(), Problem> {
        let hub = self.app.hub.reports();
        for report in reports {
            let stops = |_| Problem::new(StatusCode::SERVICE_UNAVAILABLE, "the station stops");
            hub.send(report).await.map_err(stops)?;
        }
        Ok(())
    }

    /// Changes the configuration: one change at a time, and to its end even if the client is gone.
    async fn configure<T, F>(self: &Arc<Self>, change: impl FnOnce(Shared) -> F) -> Result<T, Problem>
    where
        T: Send + 'static,
        F: Future<Output = Result<T, Problem>> + Send + 'static,
    {
        let (station, change) = (self.clone(), change(self.clone()));
        let changed = tokio::spawn(async move {
            let _one = station.configuring.lock().await;
            change.await
        });
        changed.await.unwrap_or_else(|panic| std::panic::resume_unwind(panic.into_panic()))
    }
}

/// Waits until the station stops.
async fn stopped(stop: &mut watch::Receiver<bool>) {
    // An error: the station is gone, which is the same.
    let _ = stop.wait_for(|stop| *stop).await;
}

/// The routes with their descriptions.
fn routes() -> OpenApiRouter<Shared> {
    [
        page::routes(),
        openapi::routes(),
        health::routes(),
        sign_in::routes(),
        metrics::routes(),
        sites::routes(),
        campaigns::routes(),
        rtls::routes(),
        receivers::routes(),
        tags::routes(),
        messages::routes(),
        nodes::routes(),
        findings::routes(),
        zones::routes(),
        events::routes(),
        updates::routes(),
    ]
    .into_iter()
    .fold(OpenApiRouter::new(), OpenApiRouter::merge)
}

/// All routes.
fn router(station: Shared) -> axum::Router {
    let (router, _) = routes().split_for_parts();
    router
        .fallback(page::file)
        .layer(CatchPanicLayer::custom(problem::panicked))
        .layer(DefaultBodyLimit::max(BODY))
        .layer(middleware::from_fn_with_state(station.clone(), admit))
        .layer(CompressionLayer::new().gzip(true))
        .layer(middleware::map_response(problem::complete))
        .layer(middleware::map_response_with_state(station.clone(), finish))
        .with_state(station)
}

/// Lets a request through to its handler, or refuses it; tells the audit log of changes.
async fn admit(State(station): State<Shared>, mut request: Request, next: Next) -> Result<Response, Problem> {
    let peer = request.extensions().get::<Peer>().copied();
    let peer = peer.map_or(std::net::Ipv4Addr::UNSPECIFIED.into(), |Peer(peer)| peer.ip());
    let client = station.app.proxies.client(peer, request.headers());
    request.extensions_mut().insert(Client(client));
    let (method, uri) = (request.method().clone(), request.uri().clone());
    station.access.check_origin(&method, &uri, request.headers())?;
    let path = request.extensions().get::<MatchedPath>().map(|path| path.as_str().to_owned());
    let is_position = path.as_deref().is_some_and(|path| path.starts_with("/rtls") || path.ends_with("/sightings"));
    let known = if method == Method::HEAD { Method::GET } else { method.clone() };
    // Without a path: a file of the page. Without a need: a method that the path does not have.
    let need = path.and_then(|path| station.needs.get(&(known, path)).copied()).unwrap_or(RequiredRole::Nothing);
    let who = match need {
        RequiredRole::Nothing => None,
        RequiredRole::Known | RequiredRole::Role(_) => station.access.who(request.headers(), client)?,
    };
    if let RequiredRole::Role(least) = need {
        let role = who.as_ref().map(|who| who.role);
        let role = role.ok_or_else(|| Problem::new(StatusCode::UNAUTHORIZED, "a token is needed"))?;
        if role < least {
            return Err(Problem::new(StatusCode::FORBIDDEN, "the token's role does not allow this"));
        }
    }
    if !method.is_safe() {
        station.access.check_rate(client)?;
    }
    let name = who.as_ref().map(|who| who.name.clone().unwrap_or_else(|| "anyone".to_owned()));
    if let Some(who) = who {
        request.extensions_mut().insert(who);
    }
    let limit = station.app.limits.request;
    let late =
        |_| Problem::new(StatusCode::REQUEST_TIMEOUT, format!("the request took more than {} s", limit.as_secs()));
    let response = tokio::time::timeout(limit, next.run(request)).await.map_err(late)?;
    // The path is still encoded: it has no line breaks.
    if let (false, false, Some(name)) = (method.is_safe(), is_position, name) {
        log::info!(target: "audit", "{client} {name:?} {method} {} {}", uri.path(), response.status().as_u16());
    }
    Ok(response)
}

/// Counts an answer, and gives it the headers that all have.
async fn finish(State(station): State<Shared>, mut response: Response) -> Response {
    station.counts.answer(response.status());
    let headers = response.headers_mut();
    headers.insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.insert(header::REFERRER_POLICY, HeaderValue::from_static("no-referrer"));
    let none = HeaderValue::from_static("default-src 'none'; frame-ancestors 'none'");
    headers.entry(header::CONTENT_SECURITY_POLICY).or_insert(none);
    headers.entry(header::CACHE_CONTROL).or_insert(HeaderValue::from_static("private, no-cache"));
    response.into_response()
}
