//! The hub, with a store in memory that can fail.

use crate::model::RangeMeasurement;
use std::sync::Mutex;

use tokio::sync::broadcast::error::RecvError;
use tokio::time::sleep;

use super::*;
use crate::input::{ReportKind, SolvedFrom};
use crate::model::{EventKind, MeasuredValue, NodeRole, Zone, ZoneKind};
use crate::state::StateLimits;
use crate::store::StoreError;

const SITE: &str = "hall";
const FOREVER: Retention = Retention { thin_after: None, delete_after: None, measurements: None };

/// A store in memory.
#[derive(Clone, Debug, Default)]
struct Memory(Arc<Mutex<Content>>);

#[derive(Debug, Default)]
struct Content {
    /// Rows of each write that succeeded.
    writes: Vec<usize>,
    positions: Vec<TagPosition>,
    events: Vec<StationEvent>,
    measurements: Vec<NodeMeasurement>,
    /// The nodes of each write.
    peers: Vec<Vec<String>>,
    health: Vec<NodeHealth>,
    last_event: i64,
    tries: usize,
    is_failing: bool,
    is_stuck: bool,
    /// A tag that this store never takes.
    no_room_for: String,
    compacted: usize,
    retained: usize,
}

impl Memory {
    fn content<T>(&self, with: impl FnOnce(&mut Content) -> T) -> T {
        with(&mut self.0.lock().expect("no test has panicked"))
    }
}

fn broken() -> StoreError {
    StoreError::Missing("disk".to_owned())
}

impl HubStore for Memory {
    async fn write(&self, positions: &[TagPosition], events: &[StationEvent]) -> store::Result<u64> {
        if self.content(|content| content.is_stuck) {
            std::future::pending::<()>().await;
        }
        self.content(|content| {
            content.tries += 1;
            if content.is_failing {
                return Err(broken());
            }
            content.writes.push(positions.len() + events.len());
            let taken: Vec<_> = positions.iter().filter(|row| content.no_room_for != row.tag).cloned().collect();
            content.events.extend_from_slice(events);
            let left_out = positions.len() - taken.len();
            content.positions.extend(taken);
            Ok(left_out as u64)
        })
    }

    async fn write_measurements(&self, measurements: &[NodeMeasurement]) -> store::Result<u64> {
        self.content(|content| {
            if content.is_failing {
                return Err(broken());
            }
            content.measurements.extend_from_slice(measurements);
            Ok(0)
        })
    }

    async fn write_peers(&self, nodes: &[NodeStatus]) -> store::Result<()> {
        self.content(|content| {
            if content.is_failing {
                return Err(broken());
            }
            content.peers.push(nodes.iter().map(|node| node.node.clone()).collect());
            Ok(())
        })
    }

    async fn write_health(&self, rows: &[NodeHealth]) -> store::Result<()> {
        self.content(|content| {
            if content.is_failing {
                return Err(broken());
            }
            content.health.extend_from_slice(rows);
            Ok(())
        })
    }

    async fn last_event(&self) -> store::Result<i64> {
        self.content(|content| if content.is_failing { Err(broken()) } else { Ok(content.last_event) })
    }

    async fn compact(&self, _: Utc) -> store::Result<()> {
        self.content(|content| {
            content.compacted += 1;
            if content.is_failing { Err(broken()) } else { Ok(()) }
        })
    }

    async fn retain(&self, retention: Retention, _: Utc) -> store::Result<()> {
        assert_eq!((retention.thin_after, retention.delete_after), (None, None));
        self.content(|content| content.retained += 1);
        Ok(())
    }
}

fn report(tag: &str, x_m: f64) -> SourceReport {
    let what = ReportKind::Position {
        tag: tag.to_owned(),
        round: None,
        position_m: [x_m, 1.0],
        z_m: None,
        sigma_m: [0.1; 2],
        sigma_z_m: None,
        cov_xy_m2: 0.0,
        used: 4,
        solved_from: SolvedFrom::Ranges,
        doubt: None,
    };
    SourceReport { t: Utc::now(), site: SITE.to_owned(), what }
}

fn kitchen() -> Zone {
    Zone {
        site: SITE.to_owned(),
        name: "kitchen".to_owned(),
        kind: ZoneKind::Room,
        corners_m: vec![[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]],
        alarm: false,
    }
}

async fn start(store: &Memory) -> (Hub, JoinHandle<()>) {
    Hub::start(LiveState::new(StateLimits::default()), store.clone(), FOREVER).await.expect("the store answers")
}

async fn next_position(listener: &mut broadcast::Receiver<Update>) -> f64 {
    loop {
        if let Update::Position(position) = listener.recv().await.expect("the hub runs") {
            return position.x_m;
        }
    }
}

#[tokio::test(start_paused = true)]
async fn a_position_reaches_listeners_at_once_and_the_store_within_half_a_second() {
    let store = Memory::default();
    let (hub, _task) = start(&store).await;
    let mut listener = hub.listen();
    let begin = Instant::now();
    hub.reports().send(report("0x1001", 2.5)).await.expect("the hub runs");
    assert_eq!(next_position(&mut listener).await, 2.5);
    assert_eq!(begin.elapsed(), Duration::ZERO);
    assert_eq!(hub.read(LiveState::tags)[0].tag, "0x1001");
    tokio::time::sleep(WRITE_EVERY + Duration::from_millis(1)).await;
    assert_eq!(store.content(|content| content.positions[0].x_m), 2.5);
    let counts = hub.counts();
    assert_eq!((counts.reports, counts.positions, counts.rows_written, counts.backlog), (1, 1, 1, 0));
}

#[tokio::test(start_paused = true)]
async fn a_full_batch_is_written_without_waiting() {
    let store = Memory::default();
    let (hub, _task) = start(&store).await;
    let begin = Instant::now();
    for k in 0..=writer::BATCH {
        hub.reports().send(report("0x1001", k as f64)).await.expect("the hub runs");
    }
    while store.content(|content| content.writes.is_empty()) {
        sleep(REST).await;
    }
    // One rest, and one of this loop: nothing waits for the time after which rows are written anyway.
    assert!(begin.elapsed() <= 2 * REST && 2 * REST < WRITE_EVERY, "{:?}", begin.elapsed());
    assert_eq!(store.content(|content| content.writes.clone()), [writer::BATCH]);
}

#[tokio::test(start_paused = true)]
async fn a_stop_applies_and_writes_everything_that_was_sent() {
    let store = Memory::default();
    let (hub, task) = start(&store).await;
    let reports = hub.reports();
    for k in 0..1000 {
        reports.send(report("0x1001", f64::from(k))).await.expect("the hub runs");
    }
    hub.stop();
    task.await.expect("no panic");
    let written: Vec<f64> = store.content(|content| content.positions.iter().map(|row| row.x_m).collect());
    assert_eq!(written, (0..1000).map(f64::from).collect::<Vec<_>>());
    assert!(reports.send(report("0x1001", 0.0)).await.is_err(), "it takes no more");
}

#[tokio::test(start_paused = true)]
async fn the_hub_ends_when_nobody_can_send_any_more() {
    let store = Memory::default();
    let (hub, task) = start(&store).await;
    let reports = hub.reports();
    drop(hub);
    reports.send(report("0x1001", 7.0)).await.expect("a sender is left");
    drop(reports);
    task.await.expect("no panic");
    assert_eq!(store.content(|content| content.positions.len()), 1);
}

#[tokio::test(start_paused = true)]
async fn a_store_that_fails_is_tried_again_ever_less_often_and_loses_nothing() {
    let store = Memory::default();
    let (hub, task) = start(&store).await;
    store.content(|content| content.is_failing = true);
    for k in 0..100 {
        hub.reports().send(report("0x1001", f64::from(k))).await.expect("the hub runs");
    }
    // Tries at 0.5 s, and then after 0.25, 0.5, 1, 2 and 4 s: six until 8.25 s; the next one is 8 s later.
    tokio::time::sleep(Duration::from_secs(10)).await;
    assert_eq!(store.content(|content| content.tries), 6);
    let counts = hub.counts();
    assert_eq!((counts.backlog, counts.rows_written, counts.store_failures, counts.dropped), (100, 0, 6, 0));
    assert!(!hub.is_storing());
    // Positions still reach the listeners.
    let mut listener = hub.listen();
    hub.reports().send(report("0x1001", 100.0)).await.expect("the hub runs");
    assert_eq!(next_position(&mut listener).await, 100.0);
    store.content(|content| content.is_failing = false);
    tokio::time::sleep(Duration::from_secs(10)).await;
    assert_eq!((hub.counts().rows_written, hub.counts().backlog, hub.is_storing()), (101, 0, true));
    hub.stop();
    task.await.expect("no panic");
    let written: Vec<f64> = store.content(|content| content.positions.iter().map(|row| row.x_m).collect());
    assert_eq!(written, (0..=100).map(f64::from).collect::<Vec<_>>());
}

#[tokio::test(start_paused = true)]
async fn positions_that_the_store_never_takes_are_counted_and_hold_up_no_others() {
    let store = Memory::default();
    let (hub, task) = start(&store).await;
    store.content(|content| content.no_room_for = "0x2002".to_owned());
    for k in 0..100 {
        let tag = if k % 4 == 0 { "0x2002" } else { "0x1001" };
        hub.reports().send(report(tag, f64::from(k))).await.expect("the hub runs");
    }
    tokio::time::sleep(Duration::from_secs(2)).await;
    let counts = hub.counts();
    assert_eq!((counts.rows_written, counts.dropped, counts.backlog, counts.store_failures), (75, 25, 0, 0));
    hub.stop();
    task.await.expect("no panic");
}

#[tokio::test]
async fn a_device_that_receivers_hear_is_a_tag_with_positions_in_the_store() {
    let store = Memory::default();
    let (hub, task) = start(&store).await;
    let send = async |what| {
        let report = SourceReport { t: Utc::now(), site: SITE.to_owned(), what };
        hub.reports().send(report).await.expect("the hub runs");
    };
    for (k, [x, y]) in [[0.0, 0.0], [4.0, 0.0], [0.0, 4.0], [4.0, 4.0]].into_iter().enumerate() {
        let (node, position_m) = (format!("r{k}"), Some([x, y, 2.0]));
        send(ReportKind::Node { node, name: None, role: NodeRole::Receiver, position_m }).await;
    }
    let mut listener = hub.listen();
    for k in 0..4 {
        let (receiver, device) = (format!("r{k}"), "phone".to_owned());
        send(ReportKind::ReceiverSighting { receiver, device, rssi_dbm: -65.0, rssi_1m_dbm: None }).await;
    }
    // What came after the first position waits for the next one, a second later.
    let mut x_m = next_position(&mut listener).await;
    if (x_m - 2.0).abs() > 0.1 {
        x_m = next_position(&mut listener).await;
    }
    assert!((x_m - 2.0).abs() < 0.1, "{x_m}");
    hub.stop();
    task.await.expect("no panic");
    assert!(store.content(|content| content.positions.iter().any(|row| row.tag == "phone" && row.used == 4)));
}

/// Ranges of a round at 1 m and 2 m, and a sighting at -60 dBm, all before its position.
fn round(tag: &str, t: Utc) -> Vec<SourceReport> {
    let range = |anchor: &str, range_m| ReportKind::Range {
        tag: tag.to_owned(),
        anchor: anchor.to_owned(),
        round: None,
        range: RangeMeasurement {
            rx_power_dbm: Some(-80.25),
            clock_offset_ppm: Some(1.5),
            ..RangeMeasurement::of(range_m)
        },
    };
    let sighting = ReportKind::Sighting { tag: tag.to_owned(), beacon: "1-7".to_owned(), rssi_dbm: -60.0 };
    let whats = [range("0x0101", 1.0), range("0x0102", 2.0), range("0x0103", -3.0), sighting];
    let at = |(k, what)| SourceReport { t: t + Duration::from_millis(k), site: SITE.to_owned(), what };
    let mut reports: Vec<_> = (0..).zip(whats).map(at).collect();
    reports.push(SourceReport { t: t + Duration::from_millis(10), ..report(tag, 1.0) });
    reports
}

#[tokio::test(start_paused = true)]
async fn measurements_have_the_time_of_their_position_and_are_kept_where_asked_for() {
    for is_kept in [false, true] {
        let (store, keep) = (Memory::default(), is_kept.then_some(Duration::from_secs(86_400)));
        let retention = Retention { measurements: keep, ..FOREVER };
        let live = LiveState::new(StateLimits::default());
        let (hub, task) = Hub::start(live, store.clone(), retention).await.expect("the store answers");
        let what = ReportKind::Node {
            node: "0x0101".to_owned(),
            name: None,
            role: NodeRole::Anchor,
            position_m: Some([0.0, 0.0, 2.0]),
        };
        let t = Utc::now();
        let place = SourceReport { t, site: SITE.to_owned(), what };
        let (a, b) = (round("0x1001", t), round("0x1002", t + Duration::from_millis(1)));
        // The rounds of two tags, report by report.
        let reports = a.into_iter().zip(b).flat_map(|(a, b)| [a, b]);
        for report in std::iter::once(place).chain(reports) {
            hub.reports().send(report).await.expect("the hub runs");
        }
        // A device that is never located.
        let (receiver, device) = ("hall".to_owned(), "phone".to_owned());
        let what = ReportKind::ReceiverSighting { receiver, device, rssi_dbm: -65.0, rssi_1m_dbm: None };
        let late = SourceReport { t: t + Duration::from_millis(20), site: SITE.to_owned(), what };
        hub.reports().send(late).await.expect("the hub runs");
        sleep(Duration::from_secs(8)).await;
        let ms = |later: Utc| later.since(t).as_millis();
        let mut rows: Vec<_> = store.content(|content| {
            let row = |row: &NodeMeasurement| (row.tag.clone(), row.node.clone(), ms(row.round), ms(row.t));
            content.measurements.iter().map(row).collect()
        });
        rows.sort();
        let row = |tag: &str, node: &str, round, at| (tag.to_owned(), node.to_owned(), round, at);
        let expected = [
            row("0x1001", "0x0101", 10, 0),
            row("0x1001", "0x0102", 10, 1),
            row("0x1001", "1-7", 10, 3),
            row("0x1002", "0x0101", 11, 1),
            row("0x1002", "0x0102", 11, 2),
            row("0x1002", "1-7", 11, 4),
            row("phone", "hall", 20, 20),
        ];
        assert_eq!(rows, if is_kept { &expected[..] } else { &[] }, "a range below zero is refused");
        let is_range = |row: &NodeMeasurement| match row.what {
            MeasuredValue::Range(RangeMeasurement { range_m, rx_power_dbm, .. }) => {
                (range_m, rx_power_dbm) == (2.0, Some(-80.25))
            }
            MeasuredValue::Rssi(rssi_dbm) => rssi_dbm == -60.0 || rssi_dbm == -65.0,
        };
        store.content(|content| assert!(content.measurements.iter().all(|row| row.node == "0x0101" || is_range(row))));
        assert_eq!(store.content(|content| content.peers.concat()), if is_kept { vec!["0x0101"] } else { vec![] });
        assert_eq!(hub.counts().backlog, 0);
        hub.stop();
        task.await.expect("no panic");
    }
}

#[tokio::test(start_paused = true)]
async fn measurements_outlast_a_store_that_fails() {
    let store = Memory::default();
    let retention = Retention { measurements: Some(Duration::from_secs(86_400)), ..FOREVER };
    let (hub, task) =
        Hub::start(LiveState::new(StateLimits::default()), store.clone(), retention).await.expect("it answers");
    store.content(|content| content.is_failing = true);
    for report in round("0x1001", Utc::now()) {
        hub.reports().send(report).await.expect("the hub runs");
    }
    sleep(Duration::from_secs(10)).await;
    assert_eq!((hub.counts().backlog, hub.counts().rows_written), (4, 0));
    store.content(|content| content.is_failing = false);
    sleep(Duration::from_secs(5)).await;
    assert_eq!(store.content(|content| content.measurements.len()), 3);
    assert_eq!((hub.counts().backlog, hub.counts().rows_written), (0, 4));
    hub.stop();
    task.await.expect("no panic");
}

#[tokio::test(start_paused = true)]
async fn a_stop_does_not_wait_for_ever_for_a_store_that_fails() {
    let store = Memory::default();
    let (hub, task) = start(&store).await;
    store.content(|content| content.is_failing = true);
    hub.reports().send(report("0x1001", 1.0)).await.expect("the hub runs");
    tokio::time::sleep(Duration::from_secs(5)).await;
    let begin = Instant::now();
    hub.stop();
    task.await.expect("no panic");
    assert!((writer::LAST_TRIES..2 * writer::LAST_TRIES).contains(&begin.elapsed()), "{:?}", begin.elapsed());
    assert_eq!((hub.counts().dropped, hub.counts().backlog), (1, 0), "what is lost is counted");
}

#[tokio::test(start_paused = true)]
async fn a_store_that_hangs_is_not_well_and_is_tried_again() {
    let store = Memory::default();
    let (hub, task) = start(&store).await;
    store.content(|content| content.is_stuck = true);
    hub.reports().send(report("0x1001", 1.0)).await.expect("the hub runs");
    // Written after half a second; four seconds are late.
    sleep(Duration::from_secs(4)).await;
    assert!(hub.is_storing());
    sleep(Duration::from_secs(1)).await;
    assert!(!hub.is_storing());
    store.content(|content| content.is_stuck = false);
    sleep(writer::GIVEN_UP).await;
    let counts = hub.counts();
    assert_eq!((counts.rows_written, counts.store_failures, counts.dropped, hub.is_storing()), (1, 1, 0, true));
    store.content(|content| content.is_stuck = true);
    hub.reports().send(report("0x1001", 2.0)).await.expect("the hub runs");
    sleep(Duration::from_secs(2)).await;
    let begin = Instant::now();
    hub.stop();
    task.await.expect("no panic");
    assert!(begin.elapsed() < 3 * writer::LAST_TRIES, "{:?}", begin.elapsed());
    assert_eq!((hub.counts().dropped, hub.counts().backlog), (1, 0));
}

#[tokio::test(start_paused = true)]
async fn a_store_that_hangs_holds_up_no_report() {
    let store = Memory::default();
    let (hub, _task) = start(&store).await;
    store.content(|content| content.is_stuck = true);
    let mut listener = hub.listen();
    for k in 0..20_000 {
        hub.reports().send(report("0x1001", f64::from(k))).await.expect("the hub runs");
        if k % 1000 == 0 {
            while next_position(&mut listener).await < f64::from(k) {}
        }
    }
    while hub.counts().positions < 20_000 {
        sleep(REST).await;
    }
    assert_eq!(hub.counts().backlog, 20_000);
}

#[test]
fn a_full_queue_drops_the_oldest_positions_and_keeps_events() {
    let queue = Queue::new(3);
    let mut live = LiveState::new(StateLimits::default());
    let position = |live: &mut LiveState, x_m| live.apply(&report("0x1001", x_m));
    let event = StationEvent {
        id: 1,
        t: Utc::now(),
        site: SITE.to_owned(),
        kind: EventKind::Silent,
        node: "0x1001".to_owned(),
        zone: None,
        dwell_s: None,
        alarm: true,
    };
    assert_eq!(queue.push(&[Update::Event(event.clone()), Update::Changed]), (0, 1));
    for x_m in [1.0, 2.0, 3.0, 4.0] {
        assert_eq!(queue.push(&position(&mut live, x_m)), (1, 0));
    }
    assert_eq!(queue.backlog_and_dropped(), (3, 2));
    // Without positions, the oldest events go.
    let events: Vec<Update> = (2..=5).map(|id| Update::Event(StationEvent { id, ..event.clone() })).collect();
    queue.push(&events);
    assert_eq!(queue.backlog_and_dropped(), (3, 6));
}

#[tokio::test(start_paused = true)]
async fn numbers_of_events_go_on_after_those_of_the_store() {
    let store = Memory::default();
    store.content(|content| content.last_event = 41);
    let mut live = LiveState::new(StateLimits::default());
    live.set_zones(vec![kitchen()]);
    let (hub, task) = Hub::start(live, store.clone(), FOREVER).await.expect("the store answers");
    hub.reports().send(report("0x1001", 2.0)).await.expect("the hub runs");
    hub.stop();
    task.await.expect("no panic");
    let events = store.content(|content| content.events.clone());
    assert_eq!(events.iter().map(|event| (event.id, event.kind)).collect::<Vec<_>>(), [(42, EventKind::Entered)]);
    assert_eq!(store.content(|content| content.positions[0].room.clone()).as_deref(), Some("kitchen"));
}

#[tokio::test(start_paused = true)]
async fn a_store_that_does_not_answer_at_the_start_is_an_error() {
    let store = Memory::default();
    store.content(|content| content.is_failing = true);
    let started = Hub::start(LiveState::new(StateLimits::default()), store, FOREVER).await;
    assert!(matches!(started, Err(StoreError::Missing(_))));
}

#[tokio::test(start_paused = true)]
async fn the_store_is_compacted_each_minute_and_cleared_each_hour() {
    let store = Memory::default();
    let (hub, task) = start(&store).await;
    // Minutes 1 to 61; what is old goes with the first of them and with the 61st.
    tokio::time::sleep(Duration::from_secs(61 * 60 + 1)).await;
    assert_eq!(store.content(|content| (content.compacted, content.retained)), (61, 2));
    // A failure ends nothing.
    store.content(|content| content.is_failing = true);
    tokio::time::sleep(Duration::from_secs(60)).await;
    store.content(|content| content.is_failing = false);
    tokio::time::sleep(Duration::from_secs(60)).await;
    assert_eq!(store.content(|content| content.compacted), 63);
    assert_eq!(hub.counts().store_failures, 1);
    hub.stop();
    task.await.expect("no panic");
}

#[tokio::test(start_paused = true)]
async fn the_health_of_the_nodes_that_were_seen_is_written_each_minute() {
    let store = Memory::default();
    let (hub, task) = start(&store).await;
    let range = async |anchor: &str, clock_offset_ppm| {
        let (tag, anchor) = ("0x1001".to_owned(), anchor.to_owned());
        let what = ReportKind::Range {
            tag,
            anchor,
            round: None,
            range: RangeMeasurement { clock_offset_ppm, ..RangeMeasurement::of(3.0) },
        };
        let report = SourceReport { t: Utc::now(), site: SITE.to_owned(), what };
        hub.reports().send(report).await.expect("the hub runs");
    };
    let written = || -> Vec<(String, Option<f64>)> {
        let rows = store.content(|content| std::mem::take(&mut content.health));
        rows.into_iter().map(|row| (row.node, row.health.clock_offset_ppm)).collect()
    };
    let a_minute = Duration::from_secs(60);
    range("0x0101", Some(2.5)).await;
    sleep(a_minute + Duration::from_secs(1)).await;
    assert_eq!(written(), [("0x0101".to_owned(), Some(2.5))]);
    // Nothing is known of a minute without a range.
    sleep(a_minute).await;
    assert_eq!(written(), []);
    range("0x0101", None).await;
    store.content(|content| content.is_failing = true);
    sleep(a_minute).await;
    store.content(|content| content.is_failing = false);
    range("0x0102", None).await;
    sleep(a_minute).await;
    // What the store did not take comes with the next minute's.
    assert_eq!(written(), [("0x0101".to_owned(), Some(2.5)), ("0x0102".to_owned(), None)]);
    assert_eq!(hub.counts().store_failures, 1);
    range("0x0103", None).await;
    store.content(|content| content.is_failing = true);
    sleep(a_minute).await;
    hub.stop();
    task.await.expect("no panic");
    assert_eq!(hub.counts().dropped, 1, "what is lost at the end is counted");
}

#[tokio::test(start_paused = true)]
async fn who_takes_events_misses_none_however_slow_and_learns_the_end() {
    let store = Memory::default();
    let (hub, ended) = start(&store).await;
    hub.change(|live| live.set_zones(vec![kitchen()]));
    let mut events = hub.events();
    drop(hub.events());
    // Each tag enters the kitchen: more events than a listener may be behind.
    let count = UPDATES + 1_000;
    for tag in 0..count {
        hub.reports().send(report(&format!("0x{tag:04x}"), 1.0)).await.unwrap();
    }
    hub.stop();
    ended.await.unwrap();
    let mut taken = Vec::new();
    while let Some(event) = events.recv().await {
        taken.push(event.id);
    }
    assert_eq!(taken, (1..=count as i64).collect::<Vec<_>>());
    assert!(hub.events().recv().await.is_none());
}

#[tokio::test(start_paused = true)]
async fn a_slow_listener_misses_updates_and_is_told_how_many() {
    let store = Memory::default();
    let (hub, task) = start(&store).await;
    let mut listener = hub.listen();
    for k in 0..10_000 {
        hub.reports().send(report("0x1001", f64::from(k))).await.expect("the hub runs");
    }
    hub.stop();
    task.await.expect("no panic");
    let Err(RecvError::Lagged(missed)) = listener.recv().await else { panic!("10,000 are more than are kept") };
    hub.note_missed(missed);
    assert_eq!(hub.counts().missed, missed);
    let mut left = 0;
    while let Ok(_update) = listener.try_recv() {
        left += 1;
    }
    assert!(missed + left >= 10_000 && left <= UPDATES as u64, "{missed} {left}");
}

#[tokio::test]
async fn positions_and_events_of_a_run_are_in_the_store_and_the_next_run_goes_on() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("baliza.db");
    for (run, x_m) in [(1, 2.0), (2, 3.0)] {
        let store = Store::open(file.to_str().expect("UTF-8")).await.expect("a store");
        let mut live = LiveState::new(StateLimits::default());
        live.set_zones(vec![kitchen()]);
        let (hub, task) = Hub::start(live, store.clone(), FOREVER).await.expect("the store answers");
        hub.reports().send(report("0x1001", x_m)).await.expect("the hub runs");
        hub.stop();
        task.await.expect("no panic");
        let all = store::Span { from: Utc::default(), to: Utc::clamped(i64::MAX) };
        let events = store.events(None, all, &[], None, 10).await.expect("events");
        assert_eq!(events.iter().map(|event| event.id).collect::<Vec<_>>(), (1..=run).rev().collect::<Vec<_>>());
        let newest = store.positions(SITE, "0x1001", all, 1).await.expect("positions").remove(0);
        assert_eq!((newest.x_m, newest.room.as_deref()), (x_m, Some("kitchen")));
        store.close().await;
    }
}
