//! Decides how often a tag ranges. Input: its positions, and the movements that a motion sensor reports. Output:
//! changes of the rate.
//!
//! A tag whose positions stay the same for some seconds changes to its still rate. It counts as moving if a position
//! differs from the running mean by more than two standard deviations, or if two rounds in a row give no position. (The
//! errors of links are constant while a tag does not move.)
//!
//! A motion sensor lets a tag wake quickly, but does not replace positions. A tag with a sensor changes to its still
//! rate when both the positions and the sensor show no movement: a trolley at constant speed is not accelerated, and
//! only positions show its movement. Where there are no positions, a quiet sensor is enough.
//!
//! The beginning of a movement wakes the tag at once. A movement that goes on does not wake it again: a sensor may
//! shake with a machine, or its line may be stuck. Such a sensor keeps a tag that does not move awake for two minutes,
//! and is then ignored until it is quiet. If movements begin again and again and the tag never leaves its place, the
//! sensor is ignored for longer each time, for five minutes at most. Positions always count.

//!
//! The states of the tag:
//!
//! ```text
//!              the tag stays
//!  Started ──────────────────────► Still
//!                                  │   ▲
//!      moved, lost, or a movement  │   │  the tag stays: a waking by the sensor after which it has not left its place
//!      of the sensor begins        │   │  was in vain
//!                                  ▼   │
//!                                  Woken
//! ```
//!
//! The states of its sensor, and of its position:
//!
//! ```text
//!           a movement              becomes still while it moves
//!  Absent ──────────────► Trusted ─────────────────────────────► Endless
//!                            ▲          a movement begins            │
//!                            └───────────────────────────────────────┘
//!
//!         two rounds without a position
//!  Known ──────────────────────────────► Lost
//!    ▲               a position            │
//!    └─────────────────────────────────────┘
//! ```

mod sensor;

use firmware_common::protocol;
use positioning_core::Real;
use ranging::native::Rate;

use self::sensor::Movements;
use crate::Position;

/// How long a tag has to stay before it counts as still, microseconds.
const STILL_AFTER_US: u64 = 5_000_000;
/// The same for a tag whose sensor reports movement all the time.
const STILL_AFTER_SHAKEN_US: u64 = 120_000_000;
/// A tag has moved if its position is off by more than this number of standard deviations.
const MOVED_SIGMAS: f32 = 2.0;
/// A tag has certainly left its place if its position is off by more than this number of standard deviations.
const LEFT_SIGMAS: f32 = 4.0;
/// The number of rounds without a position after which the tag tries its full rate.
const FAILURES: u8 = 2;
/// The mean forgets, so that slow creeping is not counted as movement for ever: the newest position has at most the
/// weight 1 / `MEAN_OF`. The first positions have greater weights.
const MEAN_OF: f32 = 32.0;
/// The weight is also at most the time since the last position divided by this time, microseconds. So the mean does not
/// follow a tag that walks and ranges often.
const MEAN_US: f32 = 3_200_000.0;
/// After the first waking in vain the sensor is ignored for this time, microseconds. After each further one it is
/// ignored for twice as long.
const DEAF_US: u64 = 10_000_000;
/// The time of ignoring grows up to the waking of this number.
const MOST_IN_VAIN: u8 = 6;

/// The rates of a tag, and the one that is in use.
#[derive(Clone, Debug)]
pub struct RateControl {
    full: Rate,
    /// The full rate of the record.
    of_record: Rate,
    /// The still rate. `None` means that the tag always has its full rate.
    still: Option<Rate>,
    state: State,
    presence: Presence,
    sensor: Sensor,
    /// The number of wakings by the sensor, in a row, after which the tag had not left its place.
    in_vain: u8,
    /// The sensor is ignored until then.
    deaf_until_us: u64,
}

/// The rate in use, and why.
#[derive(Clone, Copy, Debug)]
enum State {
    /// The full rate, since the start.
    Started,
    /// The full rate, since a waking.
    Woken(Waking),
    /// The still rate.
    Still,
}

/// Whether rounds give positions.
#[derive(Clone, Copy, Debug)]
enum Presence {
    /// They do, apart from the last `failures`.
    Known { place: Option<MeanPosition>, failures: u8 },
    /// There has been no position since then.
    Lost { since_us: u64 },
}

/// The motion sensor.
#[derive(Clone, Copy, Debug)]
enum Sensor {
    /// There is none.
    Absent,
    Trusted(Movements),
    /// It reports movement without end and is ignored.
    Endless(Movements),
}

/// The mean position of a tag that stays.
#[derive(Clone, Copy, Debug)]
struct MeanPosition {
    since_us: u64,
    last_us: u64,
    mean_m: [f32; 3],
    count: u32,
}

/// A change from the still rate to the full one.
#[derive(Clone, Copy, Debug)]
struct Waking {
    from: Option<MeanPosition>,
    by_sensor: bool,
    has_left: bool,
}

impl RateControl {
    /// The rates of a tag with this record.
    pub fn of(tag: &wire::config::Tag) -> Self {
        let still = tag.still_rate_chz.map(|chz| protocol::rate(Some(chz)));
        Self::new(protocol::rate(tag.rate_chz), still)
    }

    /// A tag that ranges at the full rate. While it does not move, it ranges at the still rate, if there is one.
    pub const fn new(full: Rate, still: Option<Rate>) -> Self {
        Self {
            full,
            of_record: full,
            still,
            state: State::Started,
            presence: Presence::Known { place: None, failures: 0 },
            sensor: Sensor::Absent,
            in_vain: 0,
            deaf_until_us: 0,
        }
    }

    /// A host asks for this full rate from now on, rounds in 100 s; 0 is that of the record. Returns the new rate if it
    /// changes.
    pub fn ask(&mut self, chz: u32) -> Option<Rate> {
        let full = if chz == 0 { self.of_record } else { protocol::rate(Some(chz)) };
        let changes = full != core::mem::replace(&mut self.full, full) && !self.is_still();
        changes.then_some(full)
    }

    /// Whether the tag is at its still rate.
    pub const fn is_still(&self) -> bool {
        matches!(self.state, State::Still)
    }

    /// Whether the sensor reports movement without end and is ignored.
    pub const fn is_shaken(&self) -> bool {
        matches!(self.sensor, Sensor::Endless(_))
    }

    /// The sensor works and reports movement at `now_us`. Returns the new rate if it changes.
    pub fn moved(&mut self, now_us: u64) -> Option<Rate> {
        let begins = self.sensor.note(now_us);
        if !self.is_still() || !begins || now_us < self.deaf_until_us {
            return None;
        }
        Some(self.wake(Waking { from: self.presence.place(), by_sensor: true, has_left: false }))
    }

    /// A round is over at `now_us`. Returns the new rate if it changes.
    pub fn after(&mut self, now_us: u64, position: Option<&Position>) -> Option<Rate> {
        let still = self.still?;
        let from = self.presence.place();
        let stays = match position {
            Some(position) => self.stays_at(now_us, position),
            None => self.stays_without_position(now_us)?,
        };
        match (self.state, stays) {
            (State::Still, true) | (State::Started | State::Woken(_), false) => None,
            (State::Still, false) => {
                let has_left = from.zip(position).is_some_and(|(place, position)| place.is_left(position, LEFT_SIGMAS));
                Some(self.wake(Waking { from, by_sensor: false, has_left }))
            }
            (State::Started | State::Woken(_), true) => {
                self.fall_still(now_us);
                Some(still)
            }
        }
    }

    /// Whether the tag has stayed at this position for long enough.
    fn stays_at(&mut self, now_us: u64, position: &Position) -> bool {
        if let State::Woken(waking) = &mut self.state {
            waking.has_left |= waking.from.is_none_or(|place| place.is_left(position, LEFT_SIGMAS));
        }
        let place = match self.presence.place().filter(|place| !place.is_left(position, MOVED_SIGMAS)) {
            Some(place) => place.with(now_us, position),
            None => MeanPosition::new(now_us, position),
        };
        self.presence = Presence::Known { place: Some(place), failures: 0 };
        let is_shaken_now = match &self.sensor {
            Sensor::Trusted(movements) => !movements.is_quiet(now_us),
            Sensor::Absent | Sensor::Endless(_) => false,
        };
        place.stayed_us(now_us) >= if is_shaken_now { STILL_AFTER_SHAKEN_US } else { STILL_AFTER_US }
    }

    /// Whether the sensor alone shows that the tag stays. `None`: a single round without a position shows nothing.
    fn stays_without_position(&mut self, now_us: u64) -> Option<bool> {
        let since_us = match &mut self.presence {
            Presence::Known { failures, .. } if *failures + 1 < FAILURES => {
                *failures += 1;
                return None;
            }
            Presence::Known { .. } => now_us,
            Presence::Lost { since_us } => *since_us,
        };
        self.presence = Presence::Lost { since_us };
        let has_been_lost = now_us.saturating_sub(since_us) >= STILL_AFTER_US;
        Some(self.sensor.is_quiet(now_us) == Some(true) && (self.is_still() || has_been_lost))
    }

    fn wake(&mut self, waking: Waking) -> Rate {
        self.state = State::Woken(waking);
        self.full
    }

    /// Changes to the still rate. Decides whether the tag was woken in vain.
    fn fall_still(&mut self, now_us: u64) {
        if let Sensor::Trusted(movements) = self.sensor
            && !movements.is_quiet(now_us)
        {
            self.sensor = Sensor::Endless(movements);
        }
        let State::Woken(waking) = core::mem::replace(&mut self.state, State::Still) else { return };
        if waking.has_left {
            (self.in_vain, self.deaf_until_us) = (0, now_us);
        } else if waking.by_sensor {
            self.deaf_until_us = now_us + (DEAF_US << self.in_vain);
            self.in_vain = (self.in_vain + 1).min(MOST_IN_VAIN - 1);
        }
    }
}

impl Presence {
    /// The place at which the tag stays.
    const fn place(&self) -> Option<MeanPosition> {
        match self {
            Self::Known { place, .. } => *place,
            Self::Lost { .. } => None,
        }
    }
}

impl Sensor {
    /// Notes a movement. Returns whether it begins with this report.
    fn note(&mut self, now_us: u64) -> bool {
        let begins = match self {
            Self::Absent => true,
            Self::Trusted(movements) | Self::Endless(movements) => movements.note(now_us),
        };
        if begins {
            *self = Self::Trusted(Movements::begin(now_us));
        }
        begins
    }

    /// Whether there is no movement; `None` without a sensor.
    const fn is_quiet(&self, now_us: u64) -> Option<bool> {
        match self {
            Self::Absent => None,
            Self::Trusted(movements) | Self::Endless(movements) => Some(movements.is_quiet(now_us)),
        }
    }
}

impl MeanPosition {
    /// The mean of one position.
    const fn new(now_us: u64, position: &Position) -> Self {
        Self { since_us: now_us, last_us: now_us, mean_m: position.position_m, count: 1 }
    }

    /// With one more position.
    fn with(mut self, now_us: u64, position: &Position) -> Self {
        let passed_us = now_us.saturating_sub(self.last_us) as f32;
        (self.count, self.last_us) = (self.count.saturating_add(1), now_us);
        let weight = (passed_us / MEAN_US).min(1.0 / MEAN_OF).max(1.0 / self.count as f32);
        for (mean, new) in self.mean_m.iter_mut().zip(position.position_m) {
            *mean += weight * (new - *mean);
        }
        self
    }

    /// For how long the tag has stayed.
    const fn stayed_us(&self, now_us: u64) -> u64 {
        now_us.saturating_sub(self.since_us)
    }

    fn is_left(&self, position: &Position, sigmas: f32) -> bool {
        let away = self.mean_m.iter().zip(position.position_m).map(|(a, b)| (a - b) * (a - b)).sum::<f32>();
        let variance: f32 = (0..3).map(|axis| position.covariance_m2[axis][axis]).sum();
        Real::sqrt(away) > sigmas * Real::sqrt(variance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ranging::RadioDuration;
    use std::vec::Vec;

    const SLOW: Rate = Rate::Every(RadioDuration::from_micros(1_000_000));

    /// A position at x, with a standard deviation of 5 cm in the plane.
    fn at(x: f32) -> Position {
        let mut covariance_m2 = [[0.0; 3]; 3];
        // 0.03² + 0.04² = 0.05².
        (covariance_m2[0][0], covariance_m2[1][1]) = (0.0009, 0.0016);
        Position {
            position_m: [x, 1.0, 1.5],
            covariance_m2,
            used: 0b1111,
            quality: 1.0,
            flag: None,
            alternative_m: None,
        }
    }

    fn rates() -> RateControl {
        RateControl::new(Rate::Greedy, Some(SLOW))
    }

    /// Stays at 0 from `from_s` on until the tag counts as still. Returns that time in seconds.
    fn until_still(rates: &mut RateControl, from_s: f64) -> f64 {
        let mut t_s = from_s;
        loop {
            match rates.after((t_s * 1e6) as u64, Some(&at(0.0))) {
                Some(rate) => {
                    assert_eq!(rate, SLOW);
                    return t_s;
                }
                None => t_s += 0.1,
            }
            assert!(t_s < from_s + 60.0, "never still");
        }
    }

    #[test]
    fn a_tag_that_lies_still_ranges_seldom_until_it_moves() {
        let mut rates = rates();
        let still_s = until_still(&mut rates, 1.0);
        assert!((5.9..6.2).contains(&still_s), "{still_s}");
        // 9 cm are less than twice 5 cm, 12 cm are more.
        assert_eq!(rates.after(8_000_000, Some(&at(0.09))), None);
        assert_eq!(rates.after(9_000_000, Some(&at(0.12))), Some(Rate::Greedy));
        let still_s = until_still(&mut rates, 10.0);
        assert!((14.9..16.2).contains(&still_s), "{still_s}");
    }

    #[test]
    fn a_tag_that_walks_is_never_still() {
        let mut rates = rates();
        // 0.3 m/s, with ten rounds a second and with four hundred.
        for (period_us, step_m) in [(100_000, 0.03), (2_500, 0.000_75)] {
            for step in 0..60_000_000 / period_us {
                assert_eq!(rates.after(step * period_us, Some(&at(step_m * step as f32))), None);
            }
        }
    }

    #[test]
    fn a_lost_round_is_nothing_and_two_are() {
        let mut rates = rates();
        until_still(&mut rates, 0.0);
        assert_eq!(rates.after(20_000_000, None), None);
        assert_eq!(rates.after(21_000_000, Some(&at(0.0))), None);
        assert_eq!(rates.after(22_000_000, None), None);
        assert_eq!(rates.after(23_000_000, None), Some(Rate::Greedy));
    }

    #[test]
    fn without_a_still_rate_nothing_changes() {
        let mut rates = RateControl::new(Rate::Greedy, None);
        assert!((0..1000_u64).all(|step| rates.after(step * 100_000, Some(&at(0.0))).is_none()));
    }

    /// Rounds each second with a position at x, and movements each half second, from `from_s` to `to_s`. Returns the
    /// changes of the rate and their times in seconds.
    fn shaken(rates: &mut RateControl, x: f32, from_s: u64, to_s: u64) -> Vec<(u64, Rate)> {
        let mut changes = Vec::new();
        for second in from_s..to_s {
            let mut note = |rate: Option<Rate>| changes.extend(rate.map(|rate| (second, rate)));
            note(rates.moved(second * 1_000_000));
            note(rates.moved(second * 1_000_000 + 500_000));
            note(rates.after(second * 1_000_000 + 600_000, Some(&at(x))));
        }
        changes
    }

    /// A tag with a sensor. The tag has been still since 6 s.
    fn watched() -> RateControl {
        let mut rates = rates();
        assert_eq!(rates.moved(0), None);
        until_still(&mut rates, 1.0);
        rates
    }

    #[test]
    fn a_movement_wakes_at_once_and_both_have_to_be_still() {
        let mut rates = watched();
        assert_eq!(rates.moved(20_000_000), Some(Rate::Greedy));
        // The movement goes on until 23 s, while positions stay: the sensor is quiet five seconds later.
        assert_eq!(rates.moved(23_000_000), None);
        assert_eq!(rates.after(27_900_000, Some(&at(0.0))), None);
        assert_eq!(rates.after(28_000_000, Some(&at(0.0))), Some(SLOW));
    }

    #[test]
    fn a_trolley_at_constant_speed_is_never_still_though_the_sensor_is_quiet() {
        let mut rates = watched();
        // A slow start that the sensor misses: positions show it.
        assert_eq!(rates.after(20_000_000, Some(&at(0.3))), Some(Rate::Greedy));
        for step in 1..600_u64 {
            assert_eq!(rates.after(20_000_000 + step * 100_000, Some(&at(0.3 + 0.03 * step as f32))), None);
        }
    }

    #[test]
    fn what_shakes_without_end_keeps_a_tag_awake_for_two_minutes() {
        let mut rates = watched();
        // It has stayed since 1 s: still again from 121 s on.
        assert_eq!(shaken(&mut rates, 0.0, 100, 200), [(100, Rate::Greedy), (121, SLOW)]);
        assert!(rates.is_shaken());
        // The sensor's continuing movement does not wake the tag, but positions do. The tag then does not wait for two
        // minutes again.
        assert_eq!(shaken(&mut rates, 1.0, 200, 220), [(200, Rate::Greedy), (205, SLOW)]);
        // After a quiet time the sensor counts again.
        assert_eq!(rates.after(230_000_000, Some(&at(1.0))), None);
        assert_eq!(rates.moved(231_000_000), Some(Rate::Greedy));
        assert!(!rates.is_shaken());
    }

    #[test]
    fn who_is_woken_in_vain_is_deaf_for_longer_each_time() {
        let mut rates = watched();
        let mut now_us = 20_000_000;
        let mut deaf_s = Vec::new();
        for _ in 0..8 {
            // A knock each second. It is a new movement if the sensor was quiet for five seconds before.
            let asleep_us = now_us;
            while rates.moved(now_us).is_none() {
                now_us += 6_000_000;
            }
            deaf_s.push((now_us - asleep_us) / 1_000_000);
            now_us += 5_000_000;
            assert_eq!(rates.after(now_us, Some(&at(0.0))), Some(SLOW));
        }
        // 10, 20, 40 … 320 s from the change to the still rate, with knocks every 6 s.
        assert_eq!(deaf_s, [0, 12, 24, 42, 84, 162, 324, 324]);
        // After the tag was carried away and put down elsewhere, the next knock counts.
        assert_eq!(rates.after(now_us + 1_000_000, Some(&at(5.0))), Some(Rate::Greedy));
        assert_eq!(rates.after(now_us + 6_000_000, Some(&at(5.0))), Some(SLOW));
        assert_eq!(rates.moved(now_us + 11_000_000), Some(Rate::Greedy));
    }

    #[test]
    fn without_positions_a_quiet_sensor_is_enough() {
        let mut rates = watched();
        // The tag stays at its still rate.
        assert!((10..60_u64).all(|second| rates.after(second * 1_000_000, None).is_none()));
        assert_eq!(rates.moved(60_000_000), Some(Rate::Greedy));
        let changes: Vec<_> =
            (61..80_u64).filter_map(|second| Some((second, rates.after(second * 1_000_000, None)?))).collect();
        // There was no position since 21 s, and the sensor is quiet five seconds after 60 s.
        assert_eq!(changes, [(65, SLOW)]);
    }
}
