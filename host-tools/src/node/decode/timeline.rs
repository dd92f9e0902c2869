//! One time and one numbering of rounds for a whole recording: a node's clock starts anew when it restarts, and its rounds wrap.

use wire::telemetry::Message;

/// Messages of several tasks may pass each other by less than this, microseconds.
const SLACK_US: u64 = 1_000_000;
/// A round that lies further back than this, or ahead by more than half of all numbers, begins a new count.
const LATE: u16 = 8;

/// Where a message stands in its recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stamp {
    /// Seconds; runs on across restarts of the node.
    pub t_s: f64,
    /// The round that it belongs to, or the last one before it: unlike the node's number it never comes again.
    pub epoch: u64,
}

/// Places messages in time.
#[derive(Clone, Copy, Debug, Default)]
pub struct Timeline {
    /// The time at which the node's clock was zero, microseconds.
    zero_us: u64,
    /// The latest time of this run of the node, by its clock.
    latest_us: Option<u64>,
    /// The latest round, by the node's number and by ours.
    round: Option<(u16, u64)>,
    /// The node has restarted since.
    new_run: bool,
    restarts: u64,
    gaps: u64,
    rounds_missed: u64,
}

impl Timeline {
    /// The place of the next message.
    pub fn place(&mut self, message: &Message) -> Stamp {
        let t_us = message.t_us();
        if let Some(latest_us) = self.latest_us {
            let started = matches!(message, Message::Reset(_)) && t_us < latest_us;
            if started || t_us.saturating_add(SLACK_US) < latest_us {
                self.restart();
            }
        }
        self.latest_us = Some(self.latest_us.map_or(t_us, |latest_us| latest_us.max(t_us)));
        let epoch = match message.round() {
            Some(round) => self.epoch(round),
            None => self.round.map_or(0, |(_, epoch)| epoch),
        };
        Stamp { t_s: self.zero_us.saturating_add(t_us) as f64 / 1e6, epoch }
    }

    /// The node has restarted: its clock begins anew with the next message.
    pub fn restart(&mut self) {
        self.restarts += 1;
        self.zero_us = self.zero_us.saturating_add(self.latest_us.take().unwrap_or(0));
        self.new_run = true;
    }

    fn epoch(&mut self, round: u16) -> u64 {
        let Some((latest, epoch)) = self.round else {
            self.round = Some((round, round.into()));
            self.new_run = false;
            return round.into();
        };
        let (ahead, behind) = (round.wrapping_sub(latest), latest.wrapping_sub(round));
        if !self.new_run && behind <= LATE {
            return epoch.saturating_sub(behind.into());
        }
        let missed = if self.new_run || ahead > u16::MAX / 2 { 0 } else { u64::from(ahead) - 1 };
        self.gaps += u64::from(missed > 0);
        self.rounds_missed += missed;
        let epoch = epoch + 1 + missed;
        self.round = Some((round, epoch));
        self.new_run = false;
        epoch
    }

    /// How many times the node started anew.
    pub fn restarts(&self) -> u64 {
        self.restarts
    }

    /// How many times rounds are missing between two that came, and how many rounds.
    pub fn gaps(&self) -> (u64, u64) {
        (self.gaps, self.rounds_missed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wire::telemetry::{Fix, Outcome, Reset, ResetCause, SolveError, Solver};

    fn fix(t_us: u64, round: u16) -> Message {
        let outcome = Outcome::Reason(SolveError::TooFewAnchors);
        Message::Fix(Fix { t_us, round, age_us: 0, asked: 4, outcome, solver: Solver::Track })
    }

    fn reset(t_us: u64) -> Message {
        Message::Reset(Reset { t_us, cause: ResetCause::Watchdog, crash: None })
    }

    fn places(messages: &[Message]) -> (Timeline, Vec<(f64, u64)>) {
        let mut timeline = Timeline::default();
        let stamps = messages.iter().map(|message| timeline.place(message)).map(|stamp| (stamp.t_s, stamp.epoch));
        let stamps = stamps.collect();
        (timeline, stamps)
    }

    #[test]
    fn rounds_go_on_where_their_numbers_wrap() {
        let (timeline, stamps) = places(&[fix(0, 65_534), fix(1, 65_535), fix(2, 0), fix(3, 1)]);
        assert_eq!(stamps.iter().map(|stamp| stamp.1).collect::<Vec<_>>(), [65_534, 65_535, 65_536, 65_537]);
        assert_eq!((timeline.gaps(), timeline.restarts()), ((0, 0), 0));
    }

    #[test]
    fn rounds_that_are_missing_are_counted_and_late_ones_keep_their_number() {
        // 11 and 12 are missing; 12 comes late; 20 leaves out 14 to 19.
        let (timeline, stamps) = places(&[fix(0, 10), fix(1, 13), fix(2, 12), fix(3, 13), fix(4, 20)]);
        assert_eq!(stamps.iter().map(|stamp| stamp.1).collect::<Vec<_>>(), [10, 13, 12, 13, 20]);
        assert_eq!(timeline.gaps(), (2, 8));
    }

    #[test]
    fn a_restart_goes_on_in_time_and_takes_new_epochs() {
        let (timeline, stamps) = places(&[fix(5_000_000, 0), fix(5_100_000, 1), reset(1000), fix(200_000, 0)]);
        assert_eq!(stamps, [(5.0, 0), (5.1, 1), (5.101, 1), (5.3, 2)]);
        assert_eq!((timeline.gaps(), timeline.restarts()), ((0, 0), 1));
    }

    #[test]
    fn a_restart_is_seen_by_the_clock_where_its_report_was_lost() {
        let (timeline, stamps) = places(&[fix(5_000_000, 7), fix(300_000, 9)]);
        assert_eq!(stamps, [(5.0, 7), (5.3, 8)]);
        assert_eq!((timeline.gaps(), timeline.restarts()), ((0, 0), 1));
        // A task that was overtaken is none, nor is the first report.
        let (timeline, _) = places(&[reset(900), fix(5_000_000, 7), fix(4_999_000, 8)]);
        assert_eq!(timeline.restarts(), 0);
    }
}
