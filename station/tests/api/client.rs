//! A station and a client of it.

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use http_body_util::{BodyExt, Full};
use hyper::body::{Bytes, Incoming};
use hyper::{HeaderMap, Method, Request, Response, StatusCode, header};
use hyper_util::rt::TokioIo;
use serde_json::Value;
use station_core::api::{Access, App, Page, RequestLimits, Tls, Token, UserRole, serve};
use station_core::model::{NodeRole, SiteMap};
use station_core::store::Retention;
use station_core::{Hub, LiveState, ReportKind, SolvedFrom, SourceReport, Store, Utc};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::oneshot;
use tokio::task::JoinHandle;

/// The longest wait for anything: who waits longer, waits in vain.
pub const PATIENCE: Duration = Duration::from_secs(60);

/// The site that stations of tests have.
pub const SITE: &str = "lab";

/// A running station.
pub struct Station {
    pub address: SocketAddr,
    pub store: Store,
    pub hub: Hub,
    stop: Option<oneshot::Sender<()>>,
    served: JoinHandle<std::io::Result<()>>,
    _folder: tempfile::TempDir,
}

/// An answer, read to its end.
#[derive(Debug)]
pub struct Answer {
    pub status: StatusCode,
    pub headers: HeaderMap,
    pub body: Bytes,
}

/// Limits that no test reaches by accident.
pub fn generous() -> RequestLimits {
    RequestLimits { writes_per_s: 1e6, writes_at_once: 1e6, ..RequestLimits::default() }
}

/// A station for everyone at the loopback address.
pub async fn open() -> Station {
    station(Access::Open, generous()).await
}

/// A station with a token of each role: `view-secret`, `operate-secret`, `administer-secret`.
pub async fn with_tokens(limits: RequestLimits) -> Station {
    let token = |(name, role)| Token::new(name, role, &format!("{name}-secret"));
    let roles = [("view", UserRole::View), ("operate", UserRole::Operate), ("administer", UserRole::Administer)];
    station(Access::Tokens(roles.map(token).to_vec()), limits).await
}

pub async fn station(access: Access, limits: RequestLimits) -> Station {
    station_with(access, limits, None).await
}

/// A station, with TLS where there is a certificate.
pub async fn station_with(access: Access, limits: RequestLimits, tls: Option<Arc<Tls>>) -> Station {
    station_of(|app| App { access, limits, tls, ..app }).await
}

/// A station whose settings are changed.
pub async fn station_of(set: impl FnOnce(App) -> App) -> Station {
    let folder = tempfile::tempdir().unwrap();
    let store = Store::open(folder.path().join("baliza.db").to_str().unwrap()).await.unwrap();
    store.put_site(&SiteMap::new(SITE)).await.unwrap();
    let live = LiveState::new(station_core::state::StateLimits::default());
    let keep = Retention::default();
    let (hub, _) = Hub::start(live, store.clone(), keep).await.unwrap();
    let page = Page::of([
        (
            "index.html",
            b"<!doctype html><title>Baliza</title><script src=\"/assets/main.js\"></script>".as_slice().into(),
        ),
        ("assets/main.js", b"document.title".as_slice().into()),
    ]);
    let app = set(App { page, limits: generous(), ..App::new(hub.clone(), store.clone()) });
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    let (stop, stopped) = oneshot::channel();
    let served = tokio::spawn(serve(listener, app, stopped));
    Station { address, store, hub, stop: Some(stop), served, _folder: folder }
}

impl Station {
    /// Sends a request without a body, and the header `Host` only.
    pub async fn get(&self, path: &str) -> Answer {
        self.send(self.request(Method::GET, path)).await
    }

    /// Sends JSON.
    pub async fn json(&self, method: Method, path: &str, body: &Value) -> Answer {
        let mut request = self.request(method, path);
        request.headers_mut().insert(header::CONTENT_TYPE, "application/json".parse().unwrap());
        *request.body_mut() = Full::from(body.to_string());
        self.send(request).await
    }

    /// Sends bytes.
    pub async fn put(&self, path: &str, body: Vec<u8>) -> Answer {
        let mut request = self.request(Method::PUT, path);
        *request.body_mut() = Full::from(body);
        self.send(request).await
    }

    /// A request to the station.
    pub fn request(&self, method: Method, path: &str) -> Request<Full<Bytes>> {
        let request = Request::builder().method(method).uri(path).header(header::HOST, self.address.to_string());
        request.body(Full::default()).unwrap()
    }

    /// The whole answer to a request.
    pub async fn send(&self, request: Request<Full<Bytes>>) -> Answer {
        let (parts, body) = self.begin(request).await.into_parts();
        let body = tokio::time::timeout(PATIENCE, body.collect()).await.unwrap().unwrap().to_bytes();
        Answer { status: parts.status, headers: parts.headers, body }
    }

    /// The beginning of the answer to a request.
    pub async fn begin(&self, request: Request<Full<Bytes>>) -> Response<Incoming> {
        let stream = TcpStream::connect(self.address).await.unwrap();
        let (mut sender, connection) = hyper::client::conn::http1::handshake(TokioIo::new(stream)).await.unwrap();
        tokio::spawn(connection);
        sender.send_request(request).await.unwrap()
    }

    /// Reports something of the site of tests, now.
    pub async fn report(&self, what: ReportKind) {
        self.hub.reports().send(SourceReport { t: Utc::now(), site: SITE.to_owned(), what }).await.unwrap();
    }

    /// Reports a position with a standard deviation of 10 cm.
    pub async fn report_position(&self, tag: &str, x_m: f64, y_m: f64) {
        let what = ReportKind::Position {
            tag: tag.to_owned(),
            round: None,
            position_m: [x_m, y_m],
            z_m: None,
            sigma_m: [0.1; 2],
            sigma_z_m: None,
            cov_xy_m2: 0.0,
            used: 4,
            solved_from: SolvedFrom::Ranges,
            doubt: None,
        };
        self.report(what).await;
    }

    /// Reports four beacons at the corners of a square of 10 m.
    pub async fn report_beacons(&self) {
        for (number, [x_m, y_m]) in [[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]].into_iter().enumerate() {
            let position_m = Some([x_m, y_m, 1.0]);
            self.report(ReportKind::Node {
                node: format!("1-{number}"),
                name: None,
                role: NodeRole::Beacon,
                position_m,
            })
            .await;
        }
    }

    /// Asks until the answer's JSON is as wanted.
    pub async fn until(&self, path: &str, is_wanted: impl Fn(&Value) -> bool) -> Value {
        let begun = std::time::Instant::now();
        loop {
            let json = self.get(path).await.json();
            if is_wanted(&json) {
                return json;
            }
            assert!(begun.elapsed() < PATIENCE, "{path}: {json}");
            tokio::time::sleep(Duration::from_millis(25)).await;
        }
    }

    /// Stops the station; the time that this took.
    pub async fn stop(mut self) -> Duration {
        let start = std::time::Instant::now();
        self.stop.take().unwrap().send(()).unwrap();
        self.served.await.unwrap().unwrap();
        start.elapsed()
    }
}

impl Answer {
    /// The body as JSON.
    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|error| panic!("{error}: {self:?}"))
    }

    /// A header's value.
    pub fn header(&self, name: impl header::AsHeaderName) -> &str {
        self.headers.get(name).map_or("", |value| value.to_str().unwrap())
    }

    /// Checks that this is a problem document of this status (RFC 9457).
    pub fn is_problem(&self, status: u16) {
        assert_eq!(self.status, status, "{self:?}");
        assert_eq!(self.header(header::CONTENT_TYPE), "application/problem+json", "{self:?}");
        let problem = self.json();
        assert_eq!(problem["status"], status);
        assert_eq!(problem["type"], "about:blank");
        assert!(problem["title"].is_string() && !problem["detail"].as_str().unwrap().is_empty(), "{problem}");
    }
}

/// The head of a PNG: its signature and IHDR, as in the specification, sections 5.2 and 11.2.2.
pub fn png(width_px: u32, height_px: u32) -> Vec<u8> {
    let size = [width_px.to_be_bytes(), height_px.to_be_bytes()].concat();
    [b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR".as_slice(), &size, &[8, 2, 0, 0, 0], &[0; 4]].concat()
}

/// The keys of an object, in their order.
pub fn keys(value: &Value) -> Vec<&str> {
    value.as_object().unwrap_or_else(|| panic!("{value}")).keys().map(String::as_str).collect()
}
