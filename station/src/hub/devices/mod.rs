//! Devices that fixed receivers receive, to reports of their positions.
//!
//! The input is [`ReportKind::ReceiverSighting`] and the receivers at known places. For each device, the RSSI values of the
//! last five seconds are kept; their mean for each receiver gives a position ([`crate::rssi`]), at most one a second.
//! The outputs are reports like those of any other source.
//!
//! **Who is a tag.** Receivers receive the devices of everyone who walks by, and the addresses of most of these change
//! each quarter of an hour. A device becomes a tag when two receivers at known places receive it, or one receives it so
//! well that it is in the same room. A tag that only one receiver receives weakly has no position, with a reason.
//!
//! **Bounds.** 2,048 devices are known, with 256 values each (those of one receiver within half a second make one). A
//! device that never was a tag is forgotten after a minute of silence, or when there is no room for a new one. A tag
//! that was silent for ten minutes is forgotten when there is no room; else it stays, and is silent like any tag. Where
//! all are tags that are not silent, a new device is ignored.
//!
//! **Times** are those of the host: a value from the future counts as one of now, and one that is older than five
//! seconds does not count.

use std::collections::{BTreeMap, HashMap, VecDeque};
use std::time::Duration;

use crate::input::{ReportKind, SourceReport};
use crate::model::NodeRole;
use crate::rssi::{KnownNode, solve};
use crate::{LiveState, Utc};

/// RSSI values count for this time. A person walks five metres meanwhile; receivers report every one or two seconds.
const WINDOW: Duration = Duration::from_secs(5);
/// Values of one receiver within this time are one value: their mean.
const TOGETHER: Duration = Duration::from_millis(500);
/// The time between two positions of a device.
const EVERY: Duration = Duration::from_secs(1);
/// One receiver alone gives a position from this RSSI on, dBm: three metres with the usual path loss.
const NEAR_DBM: f64 = -70.0;
/// A device that is no tag is forgotten after this silence.
const PASSED: Duration = Duration::from_secs(60);
/// A tag can be forgotten after this silence.
const GONE: Duration = Duration::from_secs(600);
/// Devices.
const DEVICES: usize = 2_048;
/// Values of a device.
const VALUES: usize = 256;

/// Site and name.
type Key = (String, String);

/// RSSI values of one receiver.
#[derive(Debug)]
struct Value {
    receiver: String,
    t: Utc,
    sum_dbm: f64,
    count: f64,
}

#[derive(Debug)]
struct Device {
    values: VecDeque<Value>,
    rssi_1m_dbm: Option<f64>,
    received: Utc,
    solved: Option<Utc>,
    /// There are values since it was solved.
    is_waiting: bool,
    is_tag: bool,
}

impl Device {
    fn new(now: Utc) -> Self {
        Self {
            values: VecDeque::new(),
            rssi_1m_dbm: None,
            received: now,
            solved: None,
            is_waiting: false,
            is_tag: false,
        }
    }

    /// Whether it can be forgotten for another one.
    fn can_go(&self, now: Utc) -> bool {
        !self.is_tag || now.since(self.received) > GONE
    }

    fn take(&mut self, now: Utc, t: Utc, receiver: String, rssi_dbm: f64) {
        // Of the future: the host's clock was set back.
        self.values.retain(|value| value.t <= now && now.since(value.t) <= WINDOW);
        let last = self.values.iter_mut().rev().find(|value| value.receiver == receiver);
        match last.filter(|value| t.since(value.t) < TOGETHER && value.t.since(t) < TOGETHER) {
            Some(value) => {
                value.sum_dbm += rssi_dbm;
                value.count += 1.0;
            }
            None => {
                if self.values.len() >= VALUES {
                    self.values.pop_front();
                }
                self.values.push_back(Value { receiver, t, sum_dbm: rssi_dbm, count: 1.0 });
            }
        }
        self.received = now;
    }

    /// The mean RSSI of each known receiver, and the time of the last value.
    fn means(&self, now: Utc, receivers: &BTreeMap<String, KnownNode>) -> (BTreeMap<&str, f64>, Utc) {
        let mut sums: BTreeMap<&str, (f64, f64)> = BTreeMap::new();
        let mut last = Utc::default();
        for value in &self.values {
            if value.t <= now && now.since(value.t) <= WINDOW && receivers.contains_key(&value.receiver) {
                let (sum_dbm, count) = sums.entry(&value.receiver).or_default();
                *sum_dbm += value.sum_dbm;
                *count += value.count;
                last = last.max(value.t);
            }
        }
        (sums.into_iter().map(|(receiver, (sum_dbm, count))| (receiver, sum_dbm / count)).collect(), last)
    }

    /// What its values say.
    fn report(&mut self, now: Utc, tag: &str, receivers: &BTreeMap<String, KnownNode>) -> Option<(Utc, ReportKind)> {
        let (means, t) = self.means(now, receivers);
        let is_near = means.values().any(|mean_dbm| *mean_dbm >= NEAR_DBM);
        let found = if means.len() >= 2 || is_near {
            solve(receivers, means, self.rssi_1m_dbm)
        } else {
            Err("too-few-receivers")
        };
        match found {
            Ok(position) => {
                self.is_tag = true;
                Some((t, position.of(tag.to_owned())))
            }
            Err(reason) if self.is_tag => {
                Some((now, ReportKind::NoPosition { tag: tag.to_owned(), round: None, reason: reason.to_owned() }))
            }
            Err(_) => None,
        }
    }
}

/// The devices that receivers receive.
#[derive(Debug, Default)]
pub(super) struct DeviceLocator {
    devices: HashMap<Key, Device>,
    /// The devices that are waiting.
    waiting: Vec<Key>,
    /// Tags that were forgotten.
    forgotten: Vec<Key>,
    /// The receivers of each site, as they were at this number of surveys.
    receivers: HashMap<String, BTreeMap<String, KnownNode>>,
    surveys: u64,
}

impl DeviceLocator {
    /// Takes a report that the state did not refuse. What is no [`ReportKind::ReceiverSighting`] changes nothing.
    pub(super) fn take(&mut self, now: Utc, report: SourceReport) {
        let ReportKind::ReceiverSighting { receiver, device, rssi_dbm, rssi_1m_dbm } = report.what else { return };
        let t = report.t.min(now);
        let key = (report.site, device);
        if now.since(t) > WINDOW || !(self.devices.contains_key(&key) || self.has_room(now)) {
            return;
        }
        let device = self.devices.entry(key.clone()).or_insert_with(|| Device::new(now));
        device.rssi_1m_dbm = rssi_1m_dbm.or(device.rssi_1m_dbm);
        device.take(now, t, receiver, rssi_dbm);
        if !std::mem::replace(&mut device.is_waiting, true) {
            self.waiting.push(key);
        }
    }

    /// Makes room for a device where there is none.
    fn has_room(&mut self, now: Utc) -> bool {
        if self.devices.len() < DEVICES {
            return true;
        }
        let can_go = self.devices.iter().filter(|(_, device)| device.can_go(now));
        let first = can_go.min_by_key(|(_, device)| (device.is_tag, device.received)).map(|(key, _)| key.clone());
        let Some(key) = first else { return false };
        let was_tag = self.devices.remove(&key).is_some_and(|device| device.is_tag);
        self.waiting.retain(|waiting| *waiting != key);
        if was_tag {
            self.forgotten.push(key);
        }
        true
    }

    /// Whether no device waits for a solution.
    pub(super) fn is_idle(&self) -> bool {
        self.waiting.is_empty()
    }

    /// The receivers that solutions use are those of `live` from now on.
    pub(super) fn survey(&mut self, live: &LiveState) {
        if self.surveys != live.surveys() {
            self.surveys = live.surveys();
            self.receivers.clear();
        }
        for (site, _) in &self.waiting {
            if !self.receivers.contains_key(site) {
                self.receivers.insert(site.clone(), live.known(site, NodeRole::Receiver));
            }
        }
    }

    /// The reports of the devices that have new values and were not solved for a second.
    pub(super) fn solve(&mut self, now: Utc) -> Vec<SourceReport> {
        let Self { devices, waiting, receivers, .. } = self;
        let mut reports = Vec::new();
        waiting.retain(|key| {
            let (Some(device), Some(receivers)) = (devices.get_mut(key), receivers.get(&key.0)) else { return false };
            if device.solved.is_some_and(|solved| solved <= now && now.since(solved) < EVERY) {
                return true;
            }
            (device.solved, device.is_waiting) = (Some(now), false);
            let report = device.report(now, &key.1, receivers);
            reports.extend(report.map(|(t, what)| SourceReport { t, site: key.0.clone(), what }));
            false
        });
        reports
    }

    /// Forgets devices that passed by. Returns the tags that were forgotten since the last call.
    pub(super) fn forget(&mut self, now: Utc) -> Vec<(String, String)> {
        self.devices.retain(|_, device| {
            // The clock may have been set back.
            device.received = device.received.min(now);
            device.is_tag || device.is_waiting || now.since(device.received) <= PASSED
        });
        std::mem::take(&mut self.forgotten)
    }
}

#[cfg(test)]
mod tests;
