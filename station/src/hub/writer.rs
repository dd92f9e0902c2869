//! The queue of rows for the store, and the task that writes them.
//!
//! Rows wait for half a second, or until there are enough for a batch. A batch that the store does not take, or not in
//! time, is tried again, after pauses that grow. Meanwhile rows wait in the queue; beyond its bound, the oldest measurements are
//! dropped; where there are none, the oldest positions; then the oldest events. What the store leaves out for good is
//! counted with them, and does not hold up the others.

use std::collections::VecDeque;
use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::{Notify, watch};
use tokio::time::{Instant, timeout};

use super::{Counters, HubStore, WRITE_EVERY, add};
use crate::Update;
use crate::model::{NodeMeasurement, NodeStatus, StationEvent, TagPosition};
use crate::store;

/// Rows of a batch.
pub(super) const BATCH: usize = 4096;
/// Rows that wait while the store fails.
const MOST_ROWS: usize = 1_000_000;
/// The pause after the first failure, and the longest one: rows are written again within five seconds after a database
/// is back.
const PAUSES: [Duration; 2] = [Duration::from_millis(250), Duration::from_secs(3)];
/// A store that has not answered for this time counts as failing: it is locked, or the connection is cut, …
const LATE: Duration = Duration::from_secs(4);
/// … and after this time it is tried again, by another connection.
pub(super) const GIVEN_UP: Duration = Duration::from_secs(60);
/// At the end, a store that fails is tried for this time.
pub(super) const LAST_TRIES: Duration = Duration::from_secs(10);

/// Rows for the store.
#[derive(Debug)]
pub(super) struct Queue {
    rows: Mutex<Rows>,
    /// There are enough rows for a batch.
    is_full: Notify,
    most: usize,
}

#[derive(Debug, Default)]
struct Rows {
    positions: VecDeque<TagPosition>,
    events: VecDeque<StationEvent>,
    measurements: VecDeque<NodeMeasurement>,
    /// All nodes, where one has a new place.
    peers: Option<Vec<NodeStatus>>,
    /// Taken, and not yet written.
    taken: usize,
    dropped: u64,
}

impl Rows {
    fn count(&self) -> usize {
        self.positions.len() + self.events.len() + self.measurements.len()
    }

    fn drop_oldest(&mut self, most: usize) {
        while self.count() + self.taken > most {
            let is_dropped = self.measurements.pop_front().is_some()
                || self.positions.pop_front().is_some()
                || self.events.pop_front().is_some();
            if !is_dropped {
                break;
            }
            self.dropped += 1;
        }
    }
}

/// Rows that are written together.
#[derive(Debug, Default)]
struct Batch {
    positions: Vec<TagPosition>,
    events: Vec<StationEvent>,
    measurements: Vec<NodeMeasurement>,
    peers: Vec<NodeStatus>,
}

impl Default for Queue {
    fn default() -> Self {
        Self::new(MOST_ROWS)
    }
}

impl Queue {
    /// A queue for this number of rows.
    pub(super) fn new(most: usize) -> Self {
        Self { rows: Mutex::default(), is_full: Notify::new(), most }
    }

    fn rows(&self) -> MutexGuard<'_, Rows> {
        self.rows.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds the rows among updates. Returns the numbers of positions and events.
    pub(super) fn push(&self, updates: &[Update]) -> (usize, usize) {
        let mut rows = self.rows();
        let (positions, events) = (rows.positions.len(), rows.events.len());
        for update in updates {
            match update {
                Update::Position(position) => rows.positions.push_back(position.clone()),
                Update::Event(event) => rows.events.push_back(event.clone()),
                Update::Data(_) | Update::Changed => {}
            }
        }
        let added = (rows.positions.len() - positions, rows.events.len() - events);
        self.added(rows);
        added
    }

    /// Adds what is for the store alone: positions that came late, and measurements.
    pub(super) fn push_unshown(&self, late: Vec<TagPosition>, measurements: Vec<NodeMeasurement>) {
        if !(late.is_empty() && measurements.is_empty()) {
            let mut rows = self.rows();
            rows.positions.extend(late);
            rows.measurements.extend(measurements);
            self.added(rows);
        }
    }

    /// Replaces the places of nodes that wait.
    pub(super) fn set_peers(&self, nodes: Vec<NodeStatus>) {
        self.rows().peers = Some(nodes);
    }

    fn added(&self, mut rows: MutexGuard<'_, Rows>) {
        rows.drop_oldest(self.most);
        if rows.count() >= BATCH {
            self.is_full.notify_one();
        }
    }

    /// The rows that wait, those that are being written among them, and those that were dropped.
    pub(super) fn backlog_and_dropped(&self) -> (u64, u64) {
        let rows = self.rows();
        (u64::try_from(rows.count() + rows.taken).unwrap_or(u64::MAX), rows.dropped)
    }

    /// Takes the oldest rows; `None` where there are none.
    fn take(&self) -> Option<Batch> {
        let mut rows = self.rows();
        let events = rows.events.len().min(BATCH);
        let positions = rows.positions.len().min(BATCH - events);
        let measurements = rows.measurements.len().min(BATCH - events - positions);
        rows.taken = events + positions + measurements;
        let batch = Batch {
            positions: rows.positions.drain(..positions).collect(),
            events: rows.events.drain(..events).collect(),
            measurements: rows.measurements.drain(..measurements).collect(),
            peers: rows.peers.take().unwrap_or_default(),
        };
        (rows.taken > 0 || !batch.peers.is_empty()).then_some(batch)
    }

    /// Counts rows that are lost elsewhere.
    pub(super) fn count_lost(&self, rows: usize) {
        self.rows().dropped += u64::try_from(rows).unwrap_or(u64::MAX);
    }

    /// The rows that were taken are written, but for those that the store left out. Returns the number of the former.
    fn written(&self, left_out: u64) -> usize {
        let mut rows = self.rows();
        rows.dropped += left_out;
        std::mem::take(&mut rows.taken).saturating_sub(usize::try_from(left_out).unwrap_or(usize::MAX))
    }

    /// Gives up what is left.
    fn give_up(&self) -> u64 {
        let mut rows = self.rows();
        let lost = std::mem::take(&mut rows.taken) + rows.count();
        (rows.positions, rows.events, rows.measurements) = Default::default();
        let lost = u64::try_from(lost).unwrap_or(u64::MAX);
        rows.dropped += lost;
        lost
    }
}

/// Writes rows until the end, and then those that are left.
pub(super) async fn write(
    store: impl HubStore,
    queue: Arc<Queue>,
    counters: Arc<Counters>,
    mut ended: watch::Receiver<bool>,
) {
    let mut writer = Writer { store, queue, counters, is_full: false };
    loop {
        let is_last = tokio::select! {
            () = writer.queue.is_full.notified() => false,
            () = tokio::time::sleep(WRITE_EVERY) => false,
            _ = ended.wait_for(|ended| *ended) => true,
        };
        while let Some(batch) = writer.queue.take() {
            if !writer.write(&batch, &mut ended).await {
                let lost = writer.queue.give_up();
                log::error!("the store fails: {lost} rows are lost");
                return;
            }
            // The others wait for more.
            if !is_last && writer.queue.backlog_and_dropped().0 < BATCH as u64 {
                break;
            }
        }
        if is_last {
            return;
        }
    }
}

struct Writer<S> {
    store: S,
    queue: Arc<Queue>,
    counters: Arc<Counters>,
    /// The store left rows out.
    is_full: bool,
}

impl<S: HubStore> Writer<S> {
    /// Writes a batch. Returns the number of rows that were left out. After an error, it can be written again.
    async fn try_once(&self, batch: &Batch) -> store::Result<u64> {
        let mut left_out = self.store.write(&batch.positions, &batch.events).await?;
        if !batch.peers.is_empty() {
            self.store.write_peers(&batch.peers).await?;
        }
        if !batch.measurements.is_empty() {
            left_out += self.store.write_measurements(&batch.measurements).await?;
        }
        Ok(left_out)
    }

    /// The same within the time that a store has for an answer, which is shorter at the end.
    async fn try_in_time(&self, batch: &Batch, mut ended: watch::Receiver<bool>) -> Result<u64, String> {
        let end = async {
            let _ = ended.wait_for(|ended| *ended).await;
            tokio::time::sleep(LAST_TRIES).await;
        };
        let late = async {
            tokio::time::sleep(LATE).await;
            self.fails(&format!("no answer for {} s", LATE.as_secs()));
            tokio::time::sleep(GIVEN_UP - LATE).await;
        };
        tokio::select! {
            done = self.try_once(batch) => done.map_err(|error| error.to_string()),
            () = late => Err(format!("no answer for {} s", GIVEN_UP.as_secs())),
            () = end => Err("no answer".to_owned()),
        }
    }

    fn fails(&self, why: &str) {
        if !self.counters.is_failing.swap(true, Ordering::Relaxed) {
            log::error!("the store fails, and is tried again: {why}");
        }
    }

    /// Writes a batch, by many tries where necessary. Returns false where the end came and the store still failed.
    async fn write(&mut self, batch: &Batch, ended: &mut watch::Receiver<bool>) -> bool {
        let [mut pause, longest] = PAUSES;
        let mut last = None;
        loop {
            match self.try_in_time(batch, ended.clone()).await {
                Ok(left_out) => {
                    add(&self.counters.rows_written, self.queue.written(left_out));
                    if left_out > 0 && !self.is_full {
                        log::error!(
                            "the store left out {left_out} rows, and counts more of them: it has no room for another \
                             tag; --keep-days deletes old tags"
                        );
                    }
                    self.is_full = left_out > 0;
                    if self.counters.is_failing.swap(false, Ordering::Relaxed) {
                        let (backlog, dropped) = self.queue.backlog_and_dropped();
                        log::info!("the store takes rows again: {backlog} wait, {dropped} were dropped");
                    }
                    return true;
                }
                Err(error) => {
                    add(&self.counters.store_failures, 1);
                    self.fails(&error);
                }
            }
            // An error: the sender is gone.
            if *ended.borrow() || ended.has_changed().is_err() {
                let last = *last.get_or_insert_with(|| Instant::now() + LAST_TRIES);
                if Instant::now() >= last {
                    return false;
                }
                tokio::time::sleep(PAUSES[0]).await;
            } else {
                // At the end, there is no time for a pause.
                let _ = timeout(pause, ended.wait_for(|ended| *ended)).await;
                pause = (2 * pause).min(longest);
            }
        }
    }
}
