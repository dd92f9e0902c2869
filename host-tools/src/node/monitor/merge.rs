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
        let latest = self.lane(channel).latest;
        // What has no time of its own belongs to what came before it.
        let t_us = t_us.unwrap_or(latest.t_us);
        let tolerance = if begins { 0 } else { tolerance_us(channel) };
        let fell = t_us.saturating_add(tolerance) < latest.t_us;
        // In files of their own, one channel is read lives ahead of the other, and each counts for itself. Else both are in step,
        // and a channel may follow the other into a life whose beginning it could not see, its former life being too short.
        let behind = self.patience.node.is_some() && other.life > latest.life;
        let joins = behind && t_us.abs_diff(other.t_us) < t_us.abs_diff(latest.t_us);
        let life = match (fell, behind) {
            (true, false) => latest.life + 1,
            (true, true) => other.life,
            (false, _) if joins => other.life,
            (false, _) => latest.life,
        };
        let moment = Moment { life, t_us };
        let lane = self.lane(channel);
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

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::super::source::Channel::{self, Log, Telemetry};
    use super::{Merger, Patience};

    const fn ms(milliseconds: u64) -> Duration {
        Duration::from_millis(milliseconds)
    }

    fn popped(merger: &mut Merger<&'static str>, now: Duration) -> Vec<&'static str> {
        std::iter::from_fn(|| merger.pop(now)).collect()
    }

    fn finished(merger: &mut Merger<&'static str>) -> Vec<&'static str> {
        std::iter::from_fn(|| merger.finish()).collect()
    }

    /// All pushed at once, in the order of the host; out in the node's.
    fn merged(said: &[(Channel, u64, &'static str)]) -> Vec<&'static str> {
        let mut merger = Merger::new(Patience::FILES);
        for (channel, t_us, what) in said {
            merger.push(*channel, Some(*t_us), false, ms(0), *what);
        }
        finished(&mut merger)
    }

    #[test]
    fn the_nodes_clock_orders_what_came_otherwise() {
        let said = [(Telemetry, 10, "b"), (Telemetry, 30, "d"), (Log, 5, "a"), (Log, 20, "c"), (Log, 40, "e")];
        assert_eq!(merged(&said), ["a", "b", "c", "d", "e"]);
    }

    #[test]
    fn a_sighting_told_late_goes_to_its_place() {
        assert_eq!(
            merged(&[(Telemetry, 300_000, "fix"), (Telemetry, 200_000, "heard before")]),
            ["heard before", "fix"]
        );
    }

    #[test]
    fn the_other_channel_is_waited_for_but_not_for_ever() {
        let mut merger = Merger::new(Patience::LIVE);
        merger.push(Telemetry, Some(1000), false, ms(0), "fix");
        assert!(popped(&mut merger, ms(199)).is_empty());
        assert_eq!(popped(&mut merger, ms(200)), ["fix"]);

        // The log is past it.
        merger.push(Telemetry, Some(2000), false, ms(300), "fix");
        merger.push(Log, Some(1500), false, ms(301), "line");
        merger.push(Log, Some(2500), false, ms(301), "later");
        assert_eq!(popped(&mut merger, ms(301)), ["line", "fix"]);
        assert_eq!(popped(&mut merger, ms(501)), ["later"]);
    }

    #[test]
    fn in_one_file_the_nodes_clock_ends_the_wait() {
        let mut merger = Merger::new(Patience::MIXTURE);
        merger.push(Telemetry, Some(0), false, ms(0), "first");
        merger.push(Telemetry, Some(199_999), false, ms(0), "second");
        assert!(popped(&mut merger, ms(0)).is_empty());
        merger.push(Telemetry, Some(200_000), false, ms(0), "third");
        assert_eq!(popped(&mut merger, ms(0)), ["first"]);
        assert_eq!(finished(&mut merger), ["second", "third"]);
    }

    #[test]
    fn a_restart_begins_the_order_anew() {
        let mut merger = Merger::new(Patience::FILES);
        let mut push = |channel, t_us, what| merger.push(channel, Some(t_us), false, ms(0), what);
        assert!(!push(Log, 60_000_000, "a"));
        assert!(!push(Telemetry, 60_000_001, "b"));
        // Seen first by the log, then by telemetry: one restart.
        assert!(push(Log, 1000, "c"));
        assert!(!push(Telemetry, 1001, "d"));
        assert!(!push(Log, 2000, "e"));
        assert_eq!(finished(&mut merger), ["a", "b", "c", "d", "e"]);
    }

    #[test]
    fn a_restart_after_a_short_life_is_seen_by_its_greeting() {
        let mut merger = Merger::new(Patience::FILES);
        merger.push(Telemetry, Some(500_000), false, ms(0), "before");
        assert!(merger.push(Telemetry, Some(100), true, ms(0), "greeting"));
        assert_eq!(finished(&mut merger), ["before", "greeting"]);
    }

    #[test]
    fn a_channel_that_cannot_see_a_restart_follows_the_other() {
        let mut merger = Merger::new(Patience::LIVE);
        merger.push(Log, Some(50_000_000), false, ms(0), "a");
        merger.push(Telemetry, Some(100), true, ms(0), "b");
        // The log's clock fell; telemetry was at 100 µs in the former life.
        merger.push(Log, Some(7_000_000), false, ms(0), "c");
        merger.push(Telemetry, Some(7_000_100), false, ms(0), "d");
        assert_eq!(finished(&mut merger), ["b", "a", "c", "d"]);
    }

    #[test]
    fn in_files_one_channel_may_be_lives_ahead() {
        let mut merger = Merger::new(Patience::FILES);
        let mut restarts = 0;
        let lives = [["a", "d"], ["b", "e"], ["c", "f"]];
        for [log, _] in lives {
            restarts += u32::from(merger.push(Log, Some(1000), false, ms(0), log));
            merger.push(Log, Some(9_000_000), false, ms(0), "");
        }
        for [_, telemetry] in lives {
            restarts += u32::from(merger.push(Telemetry, Some(1001), true, ms(0), telemetry));
            merger.push(Telemetry, Some(9_000_001), false, ms(0), "");
        }
        assert_eq!(finished(&mut merger), ["a", "d", "", "", "b", "e", "", "", "c", "f", "", ""]);
        assert_eq!(restarts, 2);
    }

    #[test]
    fn what_has_no_time_stays_behind_what_came_before_it() {
        let mut merger = Merger::new(Patience::FILES);
        merger.push(Telemetry, Some(10), false, ms(0), "a");
        merger.push(Telemetry, None, false, ms(0), "boot");
        merger.push(Log, Some(11), false, ms(0), "b");
        assert_eq!(finished(&mut merger), ["a", "boot", "b"]);
        merger.restart();
        merger.push(Log, Some(5), false, ms(0), "c");
        assert_eq!(finished(&mut merger), ["c"]);
    }
}
