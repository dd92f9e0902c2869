//! A port of the air: one antenna with its receiver and its client.

use super::lasting::{Antenna, Posture};
use super::phy::{Prf, Rate, Sfd};
use super::propagation::{End, Link};
use crate::random::Stream;
use crate::time::{PS_PER_US, TrueTime};
use std::rc::Rc;

/// A port's number.
pub type PortId = u32;

/// The position of a node.
#[derive(Clone)]
pub enum Path {
    /// A fixed position, metres.
    Fixed([f64; 3]),
    /// Straight lines between way-points (seconds, metres); before the first, the first point, and after the last, the
    /// last point.
    Ways(Rc<[(f64, [f64; 3])]>),
    /// A function of the time in seconds.
    Function(Rc<dyn Fn(f64) -> [f64; 3]>),
}

impl Path {
    /// The position at `time`, metres.
    pub fn at(&self, time: TrueTime) -> [f64; 3] {
        match self {
            Self::Fixed(position) => *position,
            Self::Ways(ways) => between(ways, time.as_secs_f64()),
            Self::Function(f) => f(time.as_secs_f64()),
        }
    }
}

fn between(ways: &[(f64, [f64; 3])], seconds: f64) -> [f64; 3] {
    let next = ways.partition_point(|w| w.0 <= seconds);
    match (next.checked_sub(1).and_then(|i| ways.get(i)), ways.get(next)) {
        (Some(a), Some(b)) => {
            let part = (seconds - a.0) / (b.0 - a.0);
            std::array::from_fn(|i| a.1[i] + part * (b.1[i] - a.1[i]))
        }
        (Some(only), None) | (None, Some(only)) => only.1,
        (None, None) => [0.0; 3],
    }
}

/// The settings of a receiver.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RxSettings {
    /// Channel.
    pub channel: u8,
    /// Preamble code.
    pub code: u8,
    /// Pulse repetition frequency.
    pub prf: Prf,
    /// The delimiter that it waits for.
    pub sfd: Sfd,
    /// Whether it is set to 110 kbit/s. The PHY header distinguishes the other two rates.
    pub slow: bool,
    /// Whether it reads the PHY header in Decawave's long-frame mode.
    pub long_frames: bool,
    /// Preamble acquisition chunk, symbols.
    pub pac: u16,
    /// Symbols from the found preamble until it stops waiting for the delimiter; 0: never.
    pub sfd_timeout: u16,
}

impl RxSettings {
    /// Symbols from the start of a preamble until it is found: two chunks minus two symbols. A preamble of 128 symbols
    /// then leaves 114 for the accumulator, as in recordings (RXPACC = 119 with the delimiter's part).
    pub const fn detection_symbols(&self) -> u16 {
        2 * self.pac - 2
    }

    /// The time at which it stops waiting for the delimiter of a preamble that it found at `found`.
    pub(super) fn sfd_timeout_at(&self, found: TrueTime, prf: Prf) -> Option<TrueTime> {
        let symbols = u64::from(self.sfd_timeout);
        (symbols > 0).then(|| found.plus_ps(symbols * super::receiver::symbol_ps(prf)))
    }

    pub(super) fn finds_sfd(&self, sfd: Sfd, rate: Rate) -> bool {
        self.sfd == sfd && self.slow == matches!(rate, Rate::Kbps110)
    }
}

/// Channel, preamble code and PRF together, which must agree for a preamble to be found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Tuning(u16);

impl Tuning {
    pub(super) const fn of(channel: u8, code: u8, prf: Prf) -> Self {
        Self((channel as u16) << 8 | (code as u16 & 0x1F) << 1 | matches!(prf, Prf::Mhz64) as u16)
    }
}

/// The frame that a receiver follows.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lock {
    pub(super) frame: u32,
    pub(super) link: Link,
    /// The time at which the preamble was found.
    pub(super) found: TrueTime,
    /// Preamble symbols accumulated until the delimiter.
    pub(super) symbols: u16,
    /// Whether the delimiter cannot be found: lost under another frame, or never sent.
    pub(super) lost: bool,
}

pub(super) struct Port {
    pub(super) path: Path,
    pub(super) listening: Option<(RxSettings, TrueTime)>,
    /// Its index in the list of listening ports.
    pub(super) place_in_list: usize,
    /// Counts how often the receiver was switched on or off. Events with an earlier count are stale.
    pub(super) session: u32,
    /// Frames whose preambles it may find, and their links.
    pub(super) offers: Vec<(u32, Link)>,
    pub(super) lock: Option<Lock>,
    pub(super) random: Stream,
    /// Its antenna, where antennas have errors.
    pub(super) antenna: Option<Antenna>,
    /// Where its front points, radians from the x axis: along its last movement.
    pub(super) heading: f64,
    /// Whether a person carries it.
    pub(super) worn: bool,
}

/// A port turns with the movement of the last half second, if it moved so far.
const TURN_PS: u64 = 500_000 * PS_PER_US;
const MOVED_M: f64 = 0.01;

impl Port {
    /// Turns it to the direction in which it moved up to `at`.
    pub(super) fn turn(&mut self, at: [f64; 3], now: TrueTime) {
        if let Path::Fixed(_) = self.path {
            return;
        }
        let before = self.path.at(TrueTime::from_ps(now.as_ps().saturating_sub(TURN_PS)));
        let moved = [at[0] - before[0], at[1] - before[1]];
        if moved[0].hypot(moved[1]) > MOVED_M {
            self.heading = moved[1].atan2(moved[0]);
        }
    }

    /// How its node stands at a position; `None` where antennas have no errors.
    pub(super) fn posture(&self, end: End) -> Option<Posture> {
        let Self { antenna, heading, worn, .. } = *self;
        antenna.map(|antenna| Posture { end, antenna, heading, worn })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn way_points_are_joined_straight() {
        let path = Path::Ways(Rc::from([(1.0, [0.0, 0.0, 1.0]), (3.0, [4.0, -2.0, 1.0])]));
        let at = |s| path.at(TrueTime::from_secs_f64(s));
        assert_eq!(at(0.0), [0.0, 0.0, 1.0]);
        assert_eq!(at(1.5), [1.0, -0.5, 1.0]);
        assert_eq!(at(9.0), [4.0, -2.0, 1.0]);
    }
}
