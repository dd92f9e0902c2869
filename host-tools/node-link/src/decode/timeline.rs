//! One time line and one numbering of rounds for a whole recording, although a node's clock begins again at a restart,
//! and its round numbers wrap.

use wire::serial_number::SerialNumber;
use wire::telemetry::Message;

/// Messages of several tasks may be out of order by less than this, microseconds.
const SLACK_US: u64 = 1_000_000;
/// A round farther back than this begins a new count, as does a round that is ahead by more than half of all numbers.
const LATE: u16 = 8;

/// The time and the round of a message in its recording.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stamp {
    /// Seconds. The time continues across restarts of the node.
    pub t_s: f64,
    /// The round of the message, or else the last round before it. Unlike the node's round number, it does not wrap.
    pub epoch: u64,
}

/// Assigns times and rounds to messages.
#[derive(Clone, Copy, Debug, Default)]
pub struct Timeline {
    /// The time at which the node's clock was zero, microseconds.
    zero_us: u64,
    /// The latest time since the node's last restart, by its clock.
    latest_us: Option<u64>,
    /// The latest round: the node's number and the recording's number.
    round: Option<(u16, u64)>,
    /// The node has restarted since the latest round.
    new_run: bool,
    restarts: u64,
    gaps: u64,
    rounds_missed: u64,
}

impl Timeline {
    /// The time and the round of the next message.
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

    /// The node has restarted: its clock begins again with the next message.
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
        if !self.new_run && SerialNumber(round).is_within(LATE, latest) {
            return epoch.saturating_sub(SerialNumber(latest).steps_from(round).into());
        }
        let ahead = SerialNumber(round).minus(latest);
        let missed = if self.new_run || ahead < 0 { 0 } else { ahead.unsigned_abs().saturating_sub(1).into() };
        self.gaps += u64::from(missed > 0);
        self.rounds_missed += missed;
        let epoch = epoch + 1 + missed;
        self.round = Some((round, epoch));
        self.new_run = false;
        epoch
    }

    /// The number of restarts of the node.
    pub fn restarts(&self) -> u64 {
        self.restarts
    }

    /// How many times rounds are missing between two received rounds, and the number of missing rounds.
    pub fn gaps(&self) -> (u64, u64) {
        (self.gaps, self.rounds_missed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wire::telemetry::{Doubt, Fix, Outcome, Reset, ResetCause, SolveError, Solver};

    fn fix(t_us: u64, round: u16) -> Message {
        let outcome = Outcome::Reason(SolveError::TooFewAnchors);
        Message::Fix(Fix { t_us, round, age_us: 0, asked: 4, outcome, solver: Solver::Track, doubt: Doubt::None })
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
        // Rounds 11 and 12 are missing; 12 arrives late; 14 to 19 are missing before 20.
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
        // An overtaken message of another task is not a restart, and neither is the first reset report.
        let (timeline, _) = places(&[reset(900), fix(5_000_000, 7), fix(4_999_000, 8)]);
        assert_eq!(timeline.restarts(), 0);
    }
}
