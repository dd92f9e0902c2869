//! The hub: one task that takes reports, and everything that must see them.
//!
//! Input: [`SourceReport`]s by a channel. They are applied to the [`LiveState`] state; its updates go to the listeners at once and
//! into a queue for the store. Reports of receivers also go to the `devices`, which makes positions of them. A second
//! task writes the queue's rows in batches, a third one writes the health of nodes once a minute, compacts the store and
//! deletes what is old. So nothing that the store does holds up a report: while it fails, rows wait in the queue, which
//! is bounded; the health of a minute in which it fails is not written.

mod counts;
mod devices;
mod writer;

use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, PoisonError, RwLock};
use std::time::Duration;

use tokio::sync::{broadcast, mpsc, watch};
use tokio::task::JoinHandle;
use tokio::time::{Instant, MissedTickBehavior, interval, interval_at, timeout};

pub use self::counts::HubCounts;
use self::counts::{Counters, add};
use self::devices::DeviceLocator;
use self::writer::Queue;
use crate::messages::Messages;
use crate::model::{NodeHealth, NodeMeasurement, NodeRole, NodeStatus, StationEvent, TagPosition};
use crate::store::{self, Retention, Store};
use crate::{LiveState, ReportKind, SourceReport, Update, Utc};

/// Reports that wait for the hub. A source that is faster waits.
const REPORTS: usize = 4096;
/// Reports that are applied together, while readers of the state wait.
const TOGETHER: usize = 256;
/// Under load, reports wait for others this long: to wake the hub for each would cost more than to apply it.
const REST: Duration = Duration::from_millis(2);
/// Updates that a listener may be behind. A slower one misses some, and gets their number.
const UPDATES: usize = 4096;
/// How often the state learns the time.
const TICK: Duration = Duration::from_secs(1);
/// How often the health of nodes is written, and minutes that are over are compacted.
const MAINTAIN_EVERY: Duration = Duration::from_secs(60);
/// The number of these after which old rows are thinned and deleted.
const RETAIN_EVERY: u64 = 60;
/// Rows of the health of nodes that wait while the store fails.
const MOST_HEALTH: usize = 20_000;

/// How long rows wait for others before they are written together.
pub const WRITE_EVERY: Duration = Duration::from_millis(500);

/// Where the hub writes to.
pub trait HubStore: Clone + Send + Sync + 'static {
    /// Writes positions and events together. Returns the number of positions that it never will take.
    fn write(
        &self,
        positions: &[TagPosition],
        events: &[StationEvent],
    ) -> impl Future<Output = store::Result<u64>> + Send;

    /// Writes measurements. Returns the number of those that it never will take.
    fn write_measurements(&self, measurements: &[NodeMeasurement]) -> impl Future<Output = store::Result<u64>> + Send;

    /// Writes where nodes are.
    fn write_peers(&self, nodes: &[NodeStatus]) -> impl Future<Output = store::Result<()>> + Send;

    /// Writes how nodes are in this minute.
    fn write_health(&self, rows: &[NodeHealth]) -> impl Future<Output = store::Result<()>> + Send;

    /// The greatest id of an event.
    fn last_event(&self) -> impl Future<Output = store::Result<i64>> + Send;

    /// Brings what was written until `now` into the order in which it is read.
    fn compact(&self, now: Utc) -> impl Future<Output = store::Result<()>> + Send;

    /// Thins and deletes what is old.
    fn retain(&self, retention: Retention, now: Utc) -> impl Future<Output = store::Result<()>> + Send;
}

impl HubStore for Store {
    async fn write(&self, positions: &[TagPosition], events: &[StationEvent]) -> store::Result<u64> {
        Store::write(self, positions, events).await
    }

    async fn write_measurements(&self, measurements: &[NodeMeasurement]) -> store::Result<u64> {
        Store::write_measurements(self, measurements).await
    }

    async fn write_peers(&self, nodes: &[NodeStatus]) -> store::Result<()> {
        Store::write_peers(self, nodes).await
    }

    async fn write_health(&self, rows: &[NodeHealth]) -> store::Result<()> {
        Store::write_health(self, rows).await
    }

    async fn last_event(&self) -> store::Result<i64> {
        Store::last_event(self).await
    }

    async fn compact(&self, now: Utc) -> store::Result<()> {
        Store::compact(self, now).await
    }

    async fn retain(&self, retention: Retention, now: Utc) -> store::Result<()> {
        Store::retain(self, retention, now).await
    }
}

/// Keeps nothing: for a station that is only looked at.
#[derive(Clone, Copy, Debug, Default)]
pub struct NullStore;

impl HubStore for NullStore {
    async fn write(&self, _: &[TagPosition], _: &[StationEvent]) -> store::Result<u64> {
        Ok(0)
    }

    async fn write_measurements(&self, _: &[NodeMeasurement]) -> store::Result<u64> {
        Ok(0)
    }

    async fn write_peers(&self, _: &[NodeStatus]) -> store::Result<()> {
        Ok(())
    }

    async fn write_health(&self, _: &[NodeHealth]) -> store::Result<()> {
        Ok(())
    }

    async fn last_event(&self) -> store::Result<i64> {
        Ok(0)
    }

    async fn compact(&self, _: Utc) -> store::Result<()> {
        Ok(())
    }

    async fn retain(&self, _: Retention, _: Utc) -> store::Result<()> {
        Ok(())
    }
}

/// The way into the station, for sources, and the way out, for listeners.
#[derive(Clone, Debug)]
pub struct Hub {
    reports: mpsc::Sender<SourceReport>,
    updates: broadcast::Sender<Update>,
    live: Arc<RwLock<LiveState>>,
    queue: Arc<Queue>,
    counters: Arc<Counters>,
    /// Those that take all events; None after the end.
    subscribers: Arc<Mutex<EventSubscribers>>,
    messages: Messages,
    stop: watch::Sender<bool>,
}

/// Where all events go. None: there are no more.
type EventSubscribers = Option<Vec<mpsc::UnboundedSender<StationEvent>>>;

impl Hub {
    /// Starts the hub's tasks on the current runtime. Numbers of events go on after those of the store. The task that
    /// is returned ends, with everything written, when `stop` is called, or when the hub and all senders of reports are
    /// dropped.
    ///
    /// # Errors
    /// The store does not answer.
    pub async fn start(
        mut live: LiveState,
        store: impl HubStore,
        retention: Retention,
    ) -> store::Result<(Self, JoinHandle<()>)> {
        live.continue_events(store.last_event().await?);
        if retention.measurements.is_some() {
            live.keep_measurements();
        }
        let (reports, receiver) = mpsc::channel(REPORTS);
        let (updates, _) = broadcast::channel(UPDATES);
        let (stop, stopped) = watch::channel(false);
        let (live, queue, counters) = (Arc::new(RwLock::new(live)), Arc::new(Queue::default()), Arc::default());
        let applier = Applier {
            updates: updates.clone(),
            live: Arc::clone(&live),
            queue: Arc::clone(&queue),
            counters: Arc::clone(&counters),
            locator: DeviceLocator::default(),
            keeps_measurements: retention.measurements.is_some(),
            surveys: 0,
            subscribers: Arc::new(Mutex::new(Some(Vec::new()))),
            messages: Messages::new(),
        };
        let subscribers = Arc::clone(&applier.subscribers);
        let messages = applier.messages.clone();
        let hub = Self { reports, updates, live, queue, counters, subscribers, messages, stop };
        Ok((hub, tokio::spawn(applier.run(receiver, stopped, store, retention))))
    }

    /// Where sources send their reports.
    pub fn reports(&self) -> mpsc::Sender<SourceReport> {
        self.reports.clone()
    }

    /// Messages to tags.
    pub const fn messages(&self) -> &Messages {
        &self.messages
    }

    /// Updates from now on.
    pub fn listen(&self) -> broadcast::Receiver<Update> {
        self.updates.subscribe()
    }

    /// Every event from now on until the hub's end: unlike those of [`Hub::listen`], none is missed. Who takes them
    /// must keep up.
    pub fn events(&self) -> mpsc::UnboundedReceiver<StationEvent> {
        let (sender, receiver) = mpsc::unbounded_channel();
        if let Some(subscribers) = &mut *self.subscribers.lock().unwrap_or_else(PoisonError::into_inner) {
            subscribers.push(sender);
        }
        receiver
    }

    /// Counts updates that a listener has missed, as its receiver says.
    pub fn note_missed(&self, updates: u64) {
        self.counters.missed.fetch_add(updates, Ordering::Relaxed);
    }

    /// Reads the current state.
    pub fn read<T>(&self, read: impl FnOnce(&LiveState) -> T) -> T {
        read(&self.live.read().unwrap_or_else(PoisonError::into_inner))
    }

    /// Changes the current state, where a person has configured something.
    pub fn change<T>(&self, change: impl FnOnce(&mut LiveState) -> T) -> T {
        change(&mut self.live.write().unwrap_or_else(PoisonError::into_inner))
    }

    /// What was done since the start.
    pub fn counts(&self) -> HubCounts {
        let counters = &self.counters;
        let [reports, positions, events, rows_written, store_failures, missed] = [
            &counters.reports,
            &counters.positions,
            &counters.events,
            &counters.rows_written,
            &counters.store_failures,
            &counters.missed,
        ]
        .map(|counter| counter.load(Ordering::Relaxed));
        let refused = self.read(LiveState::refused);
        let (backlog, dropped) = self.queue.backlog_and_dropped();
        HubCounts { reports, refused, positions, events, rows_written, backlog, dropped, store_failures, missed }
    }

    /// Whether the store took the rows that were last given to it, and is not late with others.
    pub fn is_storing(&self) -> bool {
        !self.counters.is_failing.load(Ordering::Relaxed)
    }

    /// Ends the hub: it takes no more reports, and applies and writes those that it has.
    pub fn stop(&self) {
        self.stop.send_replace(true);
    }
}

/// The hub's task.
struct Applier {
    updates: broadcast::Sender<Update>,
    live: Arc<RwLock<LiveState>>,
    queue: Arc<Queue>,
    counters: Arc<Counters>,
    locator: DeviceLocator,
    /// Measurements are kept.
    keeps_measurements: bool,
    /// What the state said when places of nodes were last written.
    surveys: u64,
    subscribers: Arc<Mutex<EventSubscribers>>,
    messages: Messages,
}

impl Applier {
    async fn run(
        mut self,
        mut reports: mpsc::Receiver<SourceReport>,
        mut stopped: watch::Receiver<bool>,
        store: impl HubStore,
        retention: Retention,
    ) {
        let (end, ended) = watch::channel(false);
        let counters = Arc::clone(&self.counters);
        let (live, queue, counted) = (Arc::clone(&self.live), Arc::clone(&self.queue), Arc::clone(&counters));
        let maintenance = tokio::spawn(maintain(live, store.clone(), retention, queue, counted, ended.clone()));
        let writer = tokio::spawn(writer::write(store, Arc::clone(&self.queue), counters, ended));
        let sender = tokio::spawn(self.messages.clone().run());
        let mut ticks = interval(TICK);
        ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut rests = interval(REST);
        rests.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut batch = Vec::with_capacity(TOGETHER);
        let (mut can_stop, mut is_full) = (true, false);
        loop {
            tokio::select! {
                stop = stopped.wait_for(|stop| *stop), if can_stop => {
                    // Without hubs, senders of reports may be left.
                    if stop.is_ok() {
                        reports.close();
                    }
                    can_stop = false;
                }
                _ = ticks.tick() => {
                    let now = Utc::now();
                    let forgotten = self.locator.forget(now);
                    self.publish(|live, updates| {
                        updates.extend(live.tick(now));
                        updates.extend(forgotten.iter().flat_map(|(site, tag)| live.forget(site, tag)));
                    });
                    self.locate(now, Vec::new());
                    self.keep_peers();
                }
                count = async {
                    if !is_full {
                        rests.tick().await;
                    }
                    reports.recv_many(&mut batch, TOGETHER).await
                } => {
                    if count == 0 {
                        break;
                    }
                    // More wait already. A tick, even of now, would come with the next millisecond.
                    is_full = count == TOGETHER;
                    add(&self.counters.reports, count);
                    let sightings = self.apply(batch.drain(..));
                    self.locate(Utc::now(), sightings);
                }
            }
        }
        sender.abort();
        self.publish(|live, _| live.end_rounds());
        self.keep_peers();
        *self.subscribers.lock().unwrap_or_else(PoisonError::into_inner) = None;
        end.send_replace(true);
        for task in [maintenance, writer] {
            if let Err(error) = task.await {
                log::error!("a task of the hub ended: {error}");
            }
        }
    }

    /// Solves for the devices that receivers receive, while readers of the state do not wait.
    fn locate(&mut self, now: Utc, sightings: Vec<SourceReport>) {
        for report in sightings {
            self.locator.take(now, report);
        }
        if self.locator.is_idle() {
            return;
        }
        self.locator.survey(&self.live.read().unwrap_or_else(PoisonError::into_inner));
        let reports = self.locator.solve(now);
        if !reports.is_empty() {
            self.apply(reports);
        }
    }

    /// Applies reports. Returns those of receivers that were not refused.
    fn apply(&mut self, reports: impl IntoIterator<Item = SourceReport>) -> Vec<SourceReport> {
        let mut sightings = Vec::new();
        self.publish(|live, updates| {
            for report in reports {
                if let ReportKind::Answer { tag, number, answer } = report.what {
                    self.messages.answered(tag, number, answer);
                }
                let refused = live.refused();
                updates.extend(live.apply(&report));
                if live.refused() == refused && matches!(report.what, ReportKind::ReceiverSighting { .. }) {
                    sightings.push(report);
                }
            }
        });
        sightings
    }

    /// Keeps the places of nodes, where measurements are kept.
    fn keep_peers(&mut self) {
        if !self.keeps_measurements {
            return;
        }
        let live = self.live.read().unwrap_or_else(PoisonError::into_inner);
        if self.surveys != live.surveys() {
            self.surveys = live.surveys();
            let nodes = live.nodes().into_iter().filter(|node| node.role != NodeRole::Tag && node.position_m.is_some());
            self.queue.set_peers(nodes.collect());
        }
    }

    /// Changes the state, and passes its updates on to the listeners and the store.
    fn publish(&self, change: impl FnOnce(&mut LiveState, &mut Vec<Update>)) {
        let mut updates = Vec::new();
        let (late, measurements) = {
            let mut live = self.live.write().unwrap_or_else(PoisonError::into_inner);
            change(&mut live, &mut updates);
            (live.take_late(), live.take_measurements())
        };
        add(&self.counters.positions, late.len());
        self.queue.push_unshown(late, measurements);
        let (positions, events) = self.queue.push(&updates);
        add(&self.counters.positions, positions);
        add(&self.counters.events, events);
        if events > 0
            && let Some(subscribers) = &mut *self.subscribers.lock().unwrap_or_else(PoisonError::into_inner)
        {
            let events = updates.iter().filter_map(|update| match update {
                Update::Event(event) => Some(event),
                Update::Position(_) | Update::Data(_) | Update::Changed => None,
            });
            subscribers.retain(|subscriber| events.clone().all(|event| subscriber.send(event.clone()).is_ok()));
        }
        for update in updates {
            // An error: nobody listens.
            let _ = self.updates.send(update);
        }
    }
}

/// Writes the health of nodes, compacts the store, and thins and deletes what is old, until the end. What the store does
/// not take waits for the next minute.
async fn maintain(
    live: Arc<RwLock<LiveState>>,
    store: impl HubStore,
    retention: Retention,
    queue: Arc<Queue>,
    counters: Arc<Counters>,
    mut ended: watch::Receiver<bool>,
) {
    let mut minutes = interval_at(Instant::now() + MAINTAIN_EVERY, MAINTAIN_EVERY);
    minutes.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut is_failing = false;
    let mut health = Vec::new();
    let work = async {
        for minute in 0_u64.. {
            minutes.tick().await;
            health.append(&mut live.write().unwrap_or_else(PoisonError::into_inner).take_health());
            let too_many = health.len().saturating_sub(MOST_HEALTH);
            health.drain(..too_many);
            queue.count_lost(too_many);
            let mut done = if health.is_empty() { Ok(()) } else { store.write_health(&health).await };
            if done.is_ok() {
                health.clear();
                done = store.compact(Utc::now()).await;
            }
            if minute % RETAIN_EVERY == 0 && done.is_ok() {
                done = store.retain(retention, Utc::now()).await;
            }
            if let Err(error) = &done {
                add(&counters.store_failures, 1);
                if !is_failing {
                    log::error!(
                        "the store cannot be tidied or takes no health of nodes, and is tried each minute: {error}"
                    );
                }
            }
            is_failing = done.is_err();
        }
    };
    // What the end interrupts is done after the next start, but for the health that waits.
    tokio::select! {
        () = work => {}
        _ = ended.wait_for(|ended| *ended) => {}
    }
    if !health.is_empty() && !matches!(timeout(writer::LAST_TRIES, store.write_health(&health)).await, Ok(Ok(()))) {
        queue.count_lost(health.len());
    }
}

#[cfg(test)]
mod tests;
