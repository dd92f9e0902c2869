//! The charge that tags draw from their supplies, by consumer.

use serde::Serialize;

use crate::board::BoardProfile;
use crate::{Consumption, Currents, ProcessorTimes, TrueTime};

/// The charge that a node has drawn up to an instant.
#[derive(Clone, Copy, Debug)]
pub(super) struct Draw {
    at_s: f64,
    charges: Charges,
}

/// Charges by consumer. For mean currents the unit is milliamperes, otherwise microcoulombs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Charges {
    /// The DW1000 received, or searched for a preamble.
    pub receiving: f64,
    /// It sent.
    pub sending: f64,
    /// It was idle on its PLL's clock.
    pub idle: f64,
    /// It started: its crystal started, or it ran on the crystal's clock.
    pub waking: f64,
    /// It slept.
    pub sleeping: f64,
    /// The rest of the board while its processor runs.
    pub processor: f64,
    /// The motion sensor.
    pub motion_sensor: f64,
    /// The chip's own radio advertised positions.
    pub advertising: f64,
    /// The rest of the board while its processor waits or sleeps.
    pub board: f64,
}

impl Charges {
    /// The sum of all.
    pub fn sum(&self) -> f64 {
        let radio = self.receiving + self.sending + self.idle + self.waking + self.sleeping;
        radio + self.processor + self.motion_sensor + self.advertising + self.board
    }

    fn each(self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        Self {
            receiving: f(self.receiving, other.receiving),
            sending: f(self.sending, other.sending),
            idle: f(self.idle, other.idle),
            waking: f(self.waking, other.waking),
            sleeping: f(self.sleeping, other.sleeping),
            processor: f(self.processor, other.processor),
            motion_sensor: f(self.motion_sensor, other.motion_sensor),
            advertising: f(self.advertising, other.advertising),
            board: f(self.board, other.board),
        }
    }
}

impl Draw {
    /// From the node's start up to `now`.
    pub(super) fn new(now: TrueTime, times: ProcessorTimes, board: &BoardProfile, chip: &Consumption) -> Self {
        let Currents { deep_sleep_ma, sleep_ma, wake_up_ma, init_ma, idle_ma, .. } = Currents::TYPICAL;
        let running = ProcessorTimes { running: times.running, ..ProcessorTimes::default() }.charge_uc(board);
        // A milliampere for a second is a millicoulomb.
        let charges = Charges {
            receiving: chip.receive_uc,
            sending: chip.transmit_uc,
            idle: 1e3 * idle_ma * chip.idle_s,
            waking: 1e3 * (wake_up_ma * chip.wake_up_s + init_ma * chip.init_s),
            sleeping: 1e3 * (sleep_ma * chip.sleep_s + deep_sleep_ma * chip.deep_sleep_s),
            processor: running,
            motion_sensor: 0.0,
            advertising: 0.0,
            board: times.charge_uc(board) - running,
        };
        Self { at_s: now.as_secs_f64(), charges }
    }

    /// The same with the charges that the motion sensor and the chip's own radio have drawn, microcoulombs.
    pub(super) fn with(self, motion_sensor: f64, advertising: f64) -> Self {
        Self { charges: Charges { motion_sensor, advertising, ..self.charges }, ..self }
    }

    /// The charge drawn since an earlier instant, and the seconds since then.
    pub(super) fn since(self, earlier: Option<Self>) -> (Charges, f64) {
        match earlier {
            Some(earlier) => (self.charges.each(earlier.charges, |a, b| a - b), self.at_s - earlier.at_s),
            None => (self.charges, self.at_s),
        }
    }
}

/// The charge that all tags together drew, and the time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Drawn {
    pub(super) charges: Charges,
    /// The sum of all tags' seconds.
    pub(super) seconds: f64,
    /// Positions found in this time.
    pub(super) fixes: usize,
}

impl Drawn {
    /// Adds one tag.
    pub(super) fn plus(self, (charges, seconds): (Charges, f64), fixes: usize) -> Self {
        Self {
            charges: self.charges.each(charges, |a, b| a + b),
            seconds: self.seconds + seconds,
            fixes: self.fixes + fixes,
        }
    }

    /// Mean currents per tag, milliamperes.
    pub(super) fn currents_ma(&self) -> Option<Charges> {
        let scale = 1e-3 / self.seconds;
        (self.seconds > 0.0).then(|| self.charges.each(self.charges, |charge, _| charge * scale))
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn charge_is_told_apart_by_what_it_went_for_and_counted_from_an_instant() {
        let times = |s| ProcessorTimes {
            running: Duration::from_secs(s),
            waiting: Duration::from_secs(2 * s),
            asleep: Duration::from_secs(4 * s),
        };
        let board = BoardProfile { run_ma: 4.0, wait_ma: 1.0, sleep_ma: 0.5, ..BoardProfile::INSTANT };
        let chip = |s| Consumption { receive_uc: 7.0 * s, idle_s: s, deep_sleep_s: 6.0 * s, ..Consumption::default() };
        let at = |s: u64| {
            let draw = Draw::new(TrueTime::from_micros(7_000_000 * s), times(s), &board, &chip(s as f64));
            draw.with(3.0 * s as f64, 0.5 * s as f64)
        };
        let (charges, seconds) = at(3).since(Some(at(1)));
        // Twice: 4 mA · 1 s; 1 mA · 2 s + 0.5 mA · 4 s; 18 mA · 1 s; 50 nA · 6 s.
        assert_eq!((charges.processor, charges.board, charges.receiving), (8_000.0, 8_000.0, 14.0));
        assert_eq!((charges.idle, charges.motion_sensor, seconds), (36_000.0, 6.0, 14.0));
        assert!((charges.sleeping - 0.6).abs() < 1e-9 && charges.advertising == 1.0);
        let drawn = Drawn::default().plus((charges, seconds), 5);
        // 36 mC in 14 s.
        assert!((drawn.currents_ma().unwrap().idle - 36.0 / 14.0).abs() < 1e-9);
        assert_eq!(Drawn::default().currents_ma(), None);
    }
}
