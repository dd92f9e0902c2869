//! A station at a broker, fed with reports.

use std::sync::{Mutex, OnceLock};
use std::time::{Duration, Instant};

use station_core::model::{NodeRole, SiteMap, TagPosition, Zone, ZoneKind};
use station_core::mqtt::{Broker, Mqtt, MqttSettings, Topics};
use station_core::store::Retention;
use station_core::{Hub, LiveState, ReportKind, SolvedFrom, SourceReport, Store, Utc};

use crate::mqtt::mosquitto::PATIENCE;

/// The site of tests. Its name is not one of topics.
pub const SITE: &str = "my house";
/// As topics have it.
pub const LEVEL: &str = "my%20house";

/// A running station.
pub struct Station {
    pub hub: Hub,
    pub mqtt: Mqtt,
    _folder: tempfile::TempDir,
}

/// Settings for a broker at a port.
pub fn settings(port: u16) -> MqttSettings {
    let broker = Broker::new(&format!("mqtt://127.0.0.1:{port}"), None, None).expect("an address");
    at(broker)
}

/// Settings for a broker.
pub fn at(broker: Broker) -> MqttSettings {
    let topics = |prefix| Topics::new(prefix).expect("a prefix");
    MqttSettings {
        broker,
        topics: topics("baliza"),
        every: Duration::from_secs(1),
        discovery: Some(topics("homeassistant")),
        espresense: None,
    }
}

impl Station {
    /// A station with a room of 6 m by 4 m.
    pub async fn start(settings: MqttSettings) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let store = Store::open(folder.path().join("baliza.db").to_str().expect("UTF-8")).await.expect("a store");
        store.put_site(&SiteMap::new(SITE)).await.expect("written");
        let mut live = LiveState::new(station_core::state::StateLimits::default());
        let mut zones = settings.zones();
        zones.push(Zone {
            site: SITE.to_owned(),
            name: "kitchen".to_owned(),
            kind: ZoneKind::Room,
            corners_m: vec![[0.0, 0.0], [6.0, 0.0], [6.0, 4.0], [0.0, 4.0]],
            alarm: false,
        });
        live.set_zones(zones);
        let receivers = settings.receivers(Utc::now());
        let keep = Retention::default();
        let (hub, _) = Hub::start(live, store, keep).await.expect("a hub");
        for report in receivers {
            hub.reports().send(report).await.expect("taken");
        }
        let mqtt = Mqtt::start(&hub, settings, Vec::new(), [SITE.to_owned()]);
        Self { hub, mqtt, _folder: folder }
    }

    /// Sends a report of now.
    pub async fn report(&self, what: ReportKind) {
        let report = SourceReport { t: Utc::now(), site: SITE.to_owned(), what };
        self.hub.reports().send(report).await.expect("taken");
    }

    /// A tag's position.
    pub async fn position(&self, tag: &str, position_m: [f64; 2]) {
        self.report(ReportKind::Position {
            tag: tag.to_owned(),
            round: None,
            position_m,
            z_m: Some(1.2),
            sigma_m: [0.1, 0.2],
            sigma_z_m: Some(0.3),
            cov_xy_m2: 0.01,
            used: 4,
            solved_from: SolvedFrom::Ranges,
            doubt: None,
        })
        .await;
    }

    /// An anchor.
    pub async fn anchor(&self, node: &str) {
        let position_m = Some([0.0, 0.0, 2.5]);
        self.report(ReportKind::Node {
            node: node.to_owned(),
            name: Some("corner".to_owned()),
            role: NodeRole::Anchor,
            position_m,
        })
        .await;
    }

    /// The last position of a tag, as soon as there is one.
    pub async fn wait_for_position(&self, tag: &str, is_right: impl Fn(&TagPosition) -> bool) -> TagPosition {
        let begun = Instant::now();
        loop {
            let position = self.hub.read(|live| live.tag(SITE, tag)).and_then(|tag| tag.last_position);
            match position {
                Some(position) if is_right(&position) => return position,
                other => assert!(begun.elapsed() < PATIENCE, "{tag}: {other:?}"),
            }
            tokio::time::sleep(Duration::from_millis(20)).await;
        }
    }
}

/// What this process has logged.
static LOGGED: OnceLock<Mutex<Vec<String>>> = OnceLock::new();

struct Logger;

impl log::Log for Logger {
    fn enabled(&self, metadata: &log::Metadata<'_>) -> bool {
        metadata.target().starts_with("station_core")
    }

    fn log(&self, record: &log::Record<'_>) {
        if self.enabled(record.metadata())
            && let Some(lines) = LOGGED.get()
        {
            lines.lock().expect("no panic").push(record.args().to_string());
        }
    }

    fn flush(&self) {}
}

/// From now on, the log is kept.
pub fn keep_log() {
    LOGGED.get_or_init(|| {
        // There is no other logger.
        let _ = log::set_logger(&Logger);
        log::set_max_level(log::LevelFilter::Info);
        Mutex::default()
    });
}

/// The lines of the log with a text.
pub fn logged(text: &str) -> Vec<String> {
    let lines = LOGGED.get().expect("it is kept").lock().expect("no panic");
    lines.iter().filter(|line| line.contains(text)).cloned().collect()
}

/// Waits for a line of the log with a text.
pub async fn wait_for_log(text: &str) -> String {
    let begun = Instant::now();
    loop {
        if let Some(line) = logged(text).pop() {
            return line;
        }
        assert!(begun.elapsed() < PATIENCE, "{text} is not logged");
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
}
