//! Puts what the log and telemetry say into one order, that of the node's own clock.
//!
//! Each channel is in order by itself (almost: a sighting tells when it was heard, not when it was told). What is said on one
//! waits until the other is past it, but not longer than [`Patience`] allows. A time that falls back means that the node has
//! restarted: the order begins anew behind everything said before.

use std::collections::VecDeque;
use std::time::Duration;

use super::source::Channel;

/// How long one channel waits for the other.
#[derive(Clone, Copy, Debug, Default)]
pub struct Patience {
    /// Since it came, by the host's clock; `None`: until the other comes or everything ends.
    pub host: Option<Duration>,
    /// Until something so much later has come, by the node's clock; `None`: the same.
    pub node: Option<Duration>,
}

impl Patience {
    /// While the node speaks.
    pub const LIVE: Self = Self { host: Some(Duration::from_millis(200)), node: Some(Duration::from_millis(200)) };
    /// One file, in which both channels come as they came from the node.
    pub const MIXTURE: Self = Self { host: None, node: Some(Duration::from_millis(200)) };
    /// A file a channel: both are there to the end.
    pub const FILES: Self = Self { host: None, node: None };
}

/// How far times within a life of the node may fall back on a channel, microseconds.
const fn tolerance_us(channel: Channel) -> u64 {
    match channel {
        // Stamped one after the other.
        Channel::Log => 0,
        // Stamped by several tasks, before they queue.
        Channel::Telemetry => 1_000_000,
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
struct Moment {
    /// Counts the node's lives.
    life: u64,
    t_us: u64,
}

struct Waiting<T> {
    moment: Moment,
    came: Duration,
    what: T,
}

struct Lane<T> {
    waiting: VecDeque<Waiting<T>>,
    latest: Moment,
}

impl<T> Default for Lane<T> {
    fn default() -> Self {
        Self { waiting: VecDeque::new(), latest: Moment::default() }
    }
}

/// Merges two channels.
pub struct Merger<T> {
    log: Lane<T>,
    telemetry: Lane<T>,
    patience: Patience,
}

impl<T> Merger<T> {
    /// With nothing in it.
    pub fn new(patience: Patience) -> Self {
        Self { log: Lane::default(), telemetry: Lane::default(), patience }
    }

    /// Takes what was said at `t_us` by the node's clock and came at `now` by the host's. `begins`: it is what a node says first,
    /// so that any time that falls back is a new life. Tells whether a new life has begun.
    pub fn push(&mut self, channel: Channel, t_us: Option<u64>, begins: bool, now: Duration, what: T) -> bool {
        let other = self.lane(opposite(channel)).latest;
        let lane = self.lane(channel);
        let latest = lane.latest;
        // What has no time of its own belongs to what came before it.
        let t_us = t_us.unwrap_or(latest.t_us);
        let tolerance = if begins { 0 } else { tolerance_us(channel) };
        let fell = t_us.saturating_add(tolerance) < latest.t_us;
        // The other channel has seen a restart that this one could not, its former life being too short.
        let joins = other.life > latest.life && t_us.abs_diff(other.t_us) < t_us.abs_diff(latest.t_us);
        let life = if fell || joins { other.life.max(latest.life + 1) } else { latest.life };
        let moment = Moment { life, t_us };
        lane.latest = moment.max(latest);
        let at = lane.waiting.partition_point(|before| before.moment <= moment);
        lane.waiting.insert(at, Waiting { moment, came: now, what });
        life > other.life.max(latest.life)
    }

    /// The node has restarted: what comes from now on is of its next life, on both channels.
    pub fn restart(&mut self) {
        let life = self.log.latest.life.max(self.telemetry.latest.life) + 1;
        for lane in [&mut self.log, &mut self.telemetry] {
            lane.latest = Moment { life, t_us: 0 };
        }
    }

    /// The next in order, where it need not wait any longer.
    pub fn pop(&mut self, now: Duration) -> Option<T> {
        self.take(|merger, first| merger.ripe(first, now))
    }

    /// The next in order, when nothing comes any more.
    pub fn finish(&mut self) -> Option<T> {
        self.take(|_, _| true)
    }

    fn take(&mut self, may: impl Fn(&Self, Channel) -> bool) -> Option<T> {
        let first = match (self.log.waiting.front(), self.telemetry.waiting.front()) {
            (None, None) => return None,
            (Some(_), None) => Channel::Log,
            (None, Some(_)) => Channel::Telemetry,
            // What a node says at one instant: the line of text explains.
            (Some(log), Some(telemetry)) if log.moment <= telemetry.moment => Channel::Log,
            (Some(_), Some(_)) => Channel::Telemetry,
        };
        if !may(self, first) {
            return None;
        }
        self.lane(first).waiting.pop_front().map(|waiting| waiting.what)
    }

    fn ripe(&self, first: Channel, now: Duration) -> bool {
        let (lane, other) = match first {
            Channel::Log => (&self.log, &self.telemetry),
            Channel::Telemetry => (&self.telemetry, &self.log),
        };
        let Some(front) = lane.waiting.front() else { return false };
        // The other is past it already.
        if other.latest > front.moment || !other.waiting.is_empty() {
            return true;
        }
        let waited = self.patience.host.is_some_and(|host| now.saturating_sub(front.came) >= host);
        let passed = self.patience.node.is_some_and(|node| {
            let newest = lane.latest.max(other.latest);
            let span = u64::try_from(node.as_micros()).unwrap_or(u64::MAX);
            newest.life > front.moment.life || newest.t_us.saturating_sub(front.moment.t_us) >= span
        });
        waited || passed
    }

    fn lane(&mut self, channel: Channel) -> &mut Lane<T> {
        match channel {
            Channel::Log => &mut self.log,
            Channel::Telemetry => &mut self.telemetry,
        }
    }
}

fn opposite(channel: Channel) -> Channel {
    match channel {
        Channel::Log => Channel::Telemetry,
        Channel::Telemetry => Channel::Log,
    }
}
