//! Hooks with a real hub, and receivers behind real connections.

use std::sync::Mutex;

use http_body_util::{BodyExt, Full};
use hyper::body::{Bytes, Incoming};
use hyper::service::service_fn;
use hyper::{HeaderMap, Request, Response};
use hyper_util::rt::TokioIo;
use serde_json::Value;
use tokio::net::TcpListener;
use tokio::task::JoinHandle;
use tokio::time::Instant;
use tokio_rustls::TlsAcceptor;
use tokio_rustls::rustls::ServerConfig;
use tokio_rustls::rustls::crypto::ring;
use tokio_rustls::rustls::pki_types::PrivateKeyDer;

use self::port::Port;
use super::*;
use crate::model::{Zone, ZoneKind};
use crate::store::Retention;
use crate::{LiveState, ReportKind, SolvedFrom, SourceReport, Store, state};

#[path = "../../tests/shared/port.rs"]
mod port;

const SITE: &str = "lab";
/// 24 bytes.
const SECRET: &str = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw";
/// The longest wait for anything.
const HANGS: Duration = Duration::from_secs(60);
/// Short, so that tests are.
const PATIENCE: Patience = Patience {
    events: 100,
    oldest: Duration::from_secs(60),
    request: Duration::from_secs(2),
    pauses: [Duration::from_millis(20), Duration::from_millis(100)],
    end: HANGS,
};

/// What a receiver does with a request.
#[derive(Clone, Debug)]
enum Behaviour {
    /// It answers this status …
    Status(u16),
    /// … and this header.
    With(u16, &'static str, String),
    /// It never answers.
    Silence,
}

/// A request that came, and whether it was answered with success.
#[derive(Clone, Debug)]
struct Got {
    headers: HeaderMap,
    body: Bytes,
    is_accepted: bool,
    at: Instant,
}

impl Got {
    fn event(&self) -> i64 {
        let event: Value = serde_json::from_slice(&self.body).unwrap();
        event["id"].as_i64().unwrap()
    }
}

/// A receiver of events.
struct Receiver {
    port: Port,
    behaviour: Arc<Mutex<Behaviour>>,
    got: Arc<Mutex<Vec<Got>>>,
    serves: Option<JoinHandle<()>>,
    tls: Option<TlsAcceptor>,
}

impl Receiver {
    async fn new(behaviour: Behaviour) -> Self {
        Self::with(behaviour, None).await
    }

    async fn with(behaviour: Behaviour, tls: Option<TlsAcceptor>) -> Self {
        let mut receiver = Self {
            port: Port::free(),
            behaviour: Arc::new(Mutex::new(behaviour)),
            got: Arc::default(),
            serves: None,
            tls,
        };
        receiver.come().await;
        receiver
    }

    /// Listens.
    async fn come(&mut self) {
        let listener = TcpListener::bind(self.port.address).await.unwrap();
        let (behaviour, got, tls) = (self.behaviour.clone(), self.got.clone(), self.tls.clone());
        self.serves = Some(tokio::spawn(async move {
            let mut connections = JoinSet::new();
            while let Ok((stream, _)) = listener.accept().await {
                let (behaviour, got, tls) = (behaviour.clone(), got.clone(), tls.clone());
                connections.spawn(async move {
                    let service = service_fn(|request| take(behaviour.clone(), got.clone(), request));
                    let http = hyper::server::conn::http1::Builder::new();
                    // An error: the client is gone.
                    let _ = match tls {
                        None => http.serve_connection(TokioIo::new(stream), service).await,
                        Some(tls) => match tls.accept(stream).await {
                            Ok(stream) => http.serve_connection(TokioIo::new(stream), service).await,
                            Err(_) => Ok(()),
                        },
                    };
                });
            }
        }));
    }

    /// Closes the port and all connections.
    async fn go(&mut self) {
        let serves = self.serves.take().unwrap();
        serves.abort();
        assert!(serves.await.unwrap_err().is_cancelled());
    }

    fn behave(&self, behaviour: Behaviour) {
        *self.behaviour.lock().unwrap() = behaviour;
    }

    fn got(&self) -> Vec<Got> {
        self.got.lock().unwrap().clone()
    }

    /// The numbers of the events that were accepted, in the order in which they came.
    fn accepted(&self) -> Vec<i64> {
        self.got().iter().filter(|got| got.is_accepted).map(Got::event).collect()
    }

    /// Waits until this is true of what came.
    async fn until(&self, is_right: impl Fn(&Self) -> bool) {
        let start = Instant::now();
        while !is_right(self) {
            assert!(start.elapsed() < HANGS, "{:?}: {:?}", self.accepted(), self.got());
            sleep(Duration::from_millis(10)).await;
        }
    }

    fn settings(&self) -> WebhookSettings {
        WebhookSettings {
            name: "house".to_owned(),
            url: format!("http://{}/hook/private-path?key=1", self.port.address),
            secret: Some(SECRET.to_owned()),
            ca: None,
            kinds: None,
            sites: None,
            zones: None,
            alarms_only: false,
        }
    }

    fn webhook(&self) -> Webhook {
        Webhook::new(self.settings()).unwrap()
    }
}

async fn take(
    behaviour: Arc<Mutex<Behaviour>>,
    got: Arc<Mutex<Vec<Got>>>,
    request: Request<Incoming>,
) -> Result<Response<Full<Bytes>>, hyper::Error> {
    assert_eq!((request.method().as_str(), request.uri().to_string().as_str()), ("POST", "/hook/private-path?key=1"));
    let (parts, body) = request.into_parts();
    let body = body.collect().await?.to_bytes();
    let behaviour = behaviour.lock().unwrap().clone();
    let is_accepted = matches!(behaviour, Behaviour::Status(200..300));
    got.lock().unwrap().push(Got { headers: parts.headers, body, is_accepted, at: Instant::now() });
    let answer = Response::builder();
    let answer = match behaviour {
        Behaviour::Status(status) => answer.status(status),
        Behaviour::With(status, name, value) => answer.status(status).header(name, value),
        Behaviour::Silence => std::future::pending().await,
    };
    Ok(answer.body(Full::from("thank you")).unwrap())
}

/// Waits until this is true.
async fn until(is_right: impl Fn() -> bool) {
    let right = async {
        while !is_right() {
            sleep(Duration::from_millis(10)).await;
        }
    };
    timeout(HANGS, right).await.expect("it comes true");
}

/// A hub with a zone, into and out of which a tag walks.
struct Walk {
    hub: Hub,
    ended: JoinHandle<()>,
    is_inside: bool,
    _folder: tempfile::TempDir,
}

impl Walk {
    async fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let store = Store::open(folder.path().join("baliza.db").to_str().unwrap()).await.unwrap();
        let mut live = LiveState::new(state::StateLimits::default());
        live.set_zones(vec![Zone {
            site: SITE.to_owned(),
            name: "dock".to_owned(),
            kind: ZoneKind::Zone,
            corners_m: vec![[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]],
            alarm: true,
        }]);
        let (hub, ended) = Hub::start(live, store, Retention::default()).await.unwrap();
        Self { hub, ended, is_inside: false, _folder: folder }
    }

    /// Enters and leaves in turn: this number of events.
    async fn make(&mut self, events: usize) {
        for _ in 0..events {
            self.is_inside = !self.is_inside;
            let what = ReportKind::Position {
                tag: "0x1001".to_owned(),
                round: None,
                position_m: if self.is_inside { [2.0, 2.0] } else { [9.0, 9.0] },
                z_m: None,
                sigma_m: [0.1; 2],
                sigma_z_m: None,
                cov_xy_m2: 0.0,
                used: 4,
                solved_from: SolvedFrom::Ranges,
                doubt: None,
            };
            self.hub.reports().send(SourceReport { t: Utc::now(), site: SITE.to_owned(), what }).await.unwrap();
        }
    }

    async fn end(self) {
        self.hub.stop();
        self.ended.await.unwrap();
    }
}

#[tokio::test]
async fn every_event_arrives_in_order_although_the_receiver_fails_is_slow_and_goes_away() {
    let mut receiver = Receiver::new(Behaviour::Status(204)).await;
    let mut walk = Walk::new().await;
    let hooks = Webhooks::start(vec![receiver.webhook()], PATIENCE, &walk.hub);
    walk.make(4).await;
    receiver.until(|receiver| receiver.accepted().len() == 4).await;
    for behaviour in [Behaviour::Status(500), Behaviour::Status(404), Behaviour::Silence] {
        receiver.behave(behaviour);
        let before = receiver.got().len();
        walk.make(4).await;
        receiver.until(|receiver| receiver.got().len() >= before + 2).await;
    }
    let failed = |hooks: &Webhooks| hooks.watch().counts().map(|(_, counts)| counts.failures).sum::<u64>();
    receiver.go().await;
    let before = failed(&hooks);
    walk.make(4).await;
    // The first of them may be a request that was under way.
    until(|| failed(&hooks) >= before + 2).await;
    receiver.behave(Behaviour::Status(200));
    receiver.come().await;
    walk.make(4).await;
    receiver.until(|receiver| receiver.accepted().len() >= 24).await;
    assert_eq!(receiver.accepted(), (1..=24).collect::<Vec<_>>());

    let secret = base64::Engine::decode(&base64::engine::general_purpose::STANDARD, &SECRET["whsec_".len()..]).unwrap();
    let mut ids = std::collections::BTreeMap::new();
    for got in receiver.got() {
        let header = |name: &str| got.headers[name].to_str().unwrap().to_owned();
        assert_eq!(header("content-type"), "application/json");
        let (id, timestamp) = (header("webhook-id"), header("webhook-timestamp"));
        // Tries of one event have one id, and other events have others.
        assert_eq!(ids.entry(id.clone()).or_insert(got.event()), &got.event());
        assert!((Utc::now().us() / 1_000_000 - timestamp.parse::<i64>().unwrap()).abs() < 60);
        // The receiver's own computation.
        let mut code = <hmac::Hmac<sha2::Sha256> as hmac::KeyInit>::new_from_slice(&secret).unwrap();
        hmac::Mac::update(&mut code, format!("{id}.{timestamp}.").as_bytes());
        hmac::Mac::update(&mut code, &got.body);
        let code = hmac::Mac::finalize(code).into_bytes();
        let signature = base64::Engine::encode(&base64::engine::general_purpose::STANDARD, code);
        assert_eq!(header("webhook-signature"), format!("v1,{signature}"));
    }
    assert_eq!(ids.len(), 24);
    // The receiver has the last event before the sender has its answer.
    let watch = hooks.watch();
    until(|| watch.counts().all(|(_, counts)| counts.waiting == 0)).await;
    let all: Vec<_> = watch.counts().collect();
    let [(name, counts)] = all[..] else { panic!("{all:?}") };
    let failures = receiver.got().len() as u64 - 24;
    assert_eq!((name, counts.waiting, counts.sent, counts.lost), ("house", 0, 24, 0));
    // Those that met nobody are failures too.
    assert!(counts.failures > failures && failures >= 6, "{counts:?}");
    let first: StationEvent = serde_json::from_slice(&receiver.got()[0].body).unwrap();
    assert_eq!((first.kind, first.zone.as_deref(), first.alarm), (EventKind::Entered, Some("dock"), true));
    walk.end().await;
    hooks.finish().await;
}

#[tokio::test]
async fn the_oldest_events_are_lost_when_too_many_wait() {
    let mut receiver = Receiver::new(Behaviour::Status(200)).await;
    receiver.go().await;
    let mut walk = Walk::new().await;
    let hooks = Webhooks::start(vec![receiver.webhook()], Patience { events: 5, ..PATIENCE }, &walk.hub);
    walk.make(12).await;
    let lost = |hooks: &Webhooks| hooks.watch().counts().map(|(_, counts)| counts.lost).collect::<Vec<_>>();
    until(|| lost(&hooks) == [7]).await;
    receiver.come().await;
    receiver.until(|receiver| receiver.accepted().len() == 5).await;
    walk.make(1).await;
    receiver.until(|receiver| receiver.accepted().len() == 6).await;
    assert_eq!(receiver.accepted(), [8, 9, 10, 11, 12, 13]);
    assert_eq!(lost(&hooks), [7]);
    walk.end().await;
    hooks.finish().await;
}

#[tokio::test]
async fn events_that_wait_for_too_long_are_given_up() {
    let mut receiver = Receiver::new(Behaviour::Status(200)).await;
    receiver.go().await;
    let mut walk = Walk::new().await;
    let patience = Patience { oldest: Duration::from_secs(3), ..PATIENCE };
    let hooks = Webhooks::start(vec![receiver.webhook()], patience, &walk.hub);
    walk.make(3).await;
    until(|| hooks.watch().counts().all(|(_, counts)| counts.lost == 3)).await;
    receiver.come().await;
    walk.make(2).await;
    receiver.until(|receiver| receiver.accepted().len() == 2).await;
    assert_eq!(receiver.accepted(), [4, 5]);
    walk.end().await;
    hooks.finish().await;
}

#[tokio::test]
async fn a_receiver_that_never_answers_holds_up_neither_the_hub_nor_other_hooks() {
    let [silent, other] = [Receiver::new(Behaviour::Silence).await, Receiver::new(Behaviour::Status(200)).await];
    let mut walk = Walk::new().await;
    let patience = Patience { events: 10_000, request: Duration::from_secs(3600), ..PATIENCE };
    let hooks = Webhooks::start(vec![silent.webhook(), other.webhook()], patience, &walk.hub);
    walk.make(500).await;
    // The first request to the silent one takes an hour.
    other.until(|other| other.accepted().len() == 500).await;
    assert_eq!((other.accepted(), walk.hub.counts().events), ((1..=500).collect(), 500));
    assert_eq!(silent.got().len(), 1);
    walk.end().await;
    // The silent one is given up.
    let finished = Webhooks { end: Duration::from_millis(300), ..hooks }.finish();
    timeout(HANGS, finished).await.expect("the silent one is given up");
}

#[tokio::test]
async fn what_waits_is_sent_when_the_station_ends() {
    let receiver = Receiver::new(Behaviour::Status(503)).await;
    let mut walk = Walk::new().await;
    // The pauses would last for longer than the test.
    let patience = Patience { pauses: [Duration::from_millis(50), Duration::from_secs(600)], ..PATIENCE };
    receiver.behave(Behaviour::With(503, "retry-after", "600".to_owned()));
    let hooks = Webhooks::start(vec![receiver.webhook()], patience, &walk.hub);
    walk.make(6).await;
    receiver.until(|receiver| !receiver.got().is_empty()).await;
    receiver.behave(Behaviour::Status(200));
    walk.end().await;
    hooks.finish().await;
    assert_eq!(receiver.accepted(), [1, 2, 3, 4, 5, 6]);
}

#[tokio::test]
async fn a_receiver_may_ask_for_a_longer_pause() {
    let receiver = Receiver::new(Behaviour::With(429, "retry-after", "1".to_owned())).await;
    let mut walk = Walk::new().await;
    let patience = Patience { pauses: [Duration::from_millis(20), Duration::from_secs(5)], ..PATIENCE };
    let hooks = Webhooks::start(vec![receiver.webhook()], patience, &walk.hub);
    walk.make(1).await;
    receiver.until(|receiver| receiver.got().len() == 1).await;
    receiver.behave(Behaviour::Status(200));
    receiver.until(|receiver| receiver.accepted() == [1]).await;
    let got = receiver.got();
    assert!(got[1].at - got[0].at >= Duration::from_secs(1), "{:?}", got[1].at - got[0].at);
    walk.end().await;
    hooks.finish().await;
}

#[tokio::test]
async fn redirects_are_not_followed() {
    let other = Receiver::new(Behaviour::Status(200)).await;
    let location = other.settings().url;
    let receiver = Receiver::new(Behaviour::With(307, "location", location)).await;
    let mut walk = Walk::new().await;
    let hooks = Webhooks::start(vec![receiver.webhook()], PATIENCE, &walk.hub);
    walk.make(1).await;
    receiver.until(|receiver| receiver.got().len() >= 3).await;
    assert!(other.got().is_empty());
    receiver.behave(Behaviour::Status(200));
    receiver.until(|receiver| receiver.accepted() == [1]).await;
    walk.end().await;
    hooks.finish().await;
}

#[tokio::test]
async fn a_receiver_with_tls_must_have_a_certificate_of_a_known_authority() {
    let made = rcgen::generate_simple_self_signed(["localhost".to_owned()]).unwrap();
    let key = PrivateKeyDer::try_from(made.signing_key.serialize_der()).unwrap();
    let config = ServerConfig::builder_with_provider(Arc::new(ring::default_provider()))
        .with_safe_default_protocol_versions()
        .unwrap()
        .with_no_client_auth()
        .with_single_cert(vec![made.cert.der().clone()], key)
        .unwrap();
    let receiver = Receiver::with(Behaviour::Status(200), Some(TlsAcceptor::from(Arc::new(config)))).await;
    let folder = tempfile::tempdir().unwrap();
    let [own, other] = ["own.pem", "other.pem"].map(|name| folder.path().join(name));
    std::fs::write(&own, made.cert.pem()).unwrap();
    let stranger = rcgen::generate_simple_self_signed(["localhost".to_owned()]).unwrap();
    std::fs::write(&other, stranger.cert.pem()).unwrap();
    let url = format!("https://localhost:{}/hook/private-path?key=1", receiver.port.address.port());
    let trusting = |ca| WebhookSettings { url: url.clone(), ca: Some(ca), ..receiver.settings() };
    let mut walk = Walk::new().await;
    let hooks = vec![
        Webhook::new(trusting(own)).unwrap(),
        Webhook::new(WebhookSettings { secret: None, ..trusting(other) }).unwrap(),
    ];
    let hooks = Webhooks::start(hooks, PATIENCE, &walk.hub);
    walk.make(3).await;
    receiver.until(|receiver| receiver.accepted().len() == 3).await;
    sleep(Duration::from_millis(300)).await;
    // The stranger's hook has sent nothing.
    assert_eq!(receiver.accepted(), [1, 2, 3]);
    assert!(receiver.got().iter().all(|got| got.headers.contains_key("webhook-signature")));
    walk.end().await;
    Webhooks { end: Duration::from_millis(100), ..hooks }.finish().await;

    let wrong = WebhookSettings { ca: Some(folder.path().join("missing.pem")), ..trusting(folder.path().into()) };
    assert!(Webhook::new(wrong).unwrap_err().to_string().contains("missing.pem: cannot read it"));
}

#[tokio::test]
async fn a_hook_gets_what_it_asks_for() {
    let receiver = Receiver::new(Behaviour::Status(200)).await;
    let all = receiver.settings();
    let event = |kind, site: &str, zone: Option<&str>, alarm| StationEvent {
        id: 1,
        t: Utc::now(),
        site: site.to_owned(),
        kind,
        node: "0x1001".to_owned(),
        zone: zone.map(str::to_owned),
        dwell_s: None,
        alarm,
    };
    let entered = event(EventKind::Entered, "lab", Some("dock"), false);
    let silent = event(EventKind::Silent, "home", None, true);
    let some = |names: [&str; 1]| Some(names.map(str::to_owned).to_vec());
    for (settings, wanted) in [
        (all.clone(), [true, true]),
        (WebhookSettings { alarms_only: true, ..all.clone() }, [false, true]),
        (WebhookSettings { kinds: Some(vec![EventKind::Entered, EventKind::Left]), ..all.clone() }, [true, false]),
        (WebhookSettings { sites: some(["home"]), ..all.clone() }, [false, true]),
        (WebhookSettings { zones: some(["dock"]), ..all.clone() }, [true, false]),
        (WebhookSettings { zones: some(["attic"]), ..all.clone() }, [false, false]),
        (WebhookSettings { zones: some(["dock"]), alarms_only: true, ..all.clone() }, [false, false]),
    ] {
        assert_eq!([settings.wants(&entered), settings.wants(&silent)], wanted);
    }
}

#[tokio::test]
async fn secrets_are_in_no_debug_text() {
    let receiver = Receiver::new(Behaviour::Status(200)).await;
    let text = format!("{:?} {:?}", receiver.settings(), receiver.webhook());
    assert!(text.contains("house") && !text.contains("private-path") && !text.contains("MfKQ9"), "{text}");
}
