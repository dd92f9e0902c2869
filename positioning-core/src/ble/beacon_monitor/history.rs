//! Tests whether a beacon is at its listed position. The test is E. S. Page's cumulative sum (*Continuous inspection
//! schemes*, Biometrika 41, 1954) of how far the beacon's RSSI values contradict the position from other sources.

use crate::Real;

/// The expected squared error of an RSSI, in units of its variance. A larger error adds the difference to the sum. A
/// smaller error subtracts the difference.
const EXPECTED: f64 = 1.6;
/// The greatest squared error that one RSSI can count for, in units of its variance.
const MOST: f64 = 6.0;
/// A beacon whose sum exceeds this is excluded. Two RSSI values at two positions that are off by 2.5 deviations
/// suffice, or more values that are off by less. In simulation, a walk of minutes among shadows of 5 dB, which are
/// expected, reaches this sum now and then. Among shadows of 3 dB it never does.
const DOUBTED: f64 = 8.0;
/// An excluded beacon whose sum falls below this is accepted again.
const BELIEVED: f64 = 1.0;
/// The greatest sum. It limits the time after which an excluded beacon can be accepted again.
const FULL: f64 = 10.0;

/// The state of a listed beacon.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum BeaconHealth {
    /// The beacon is at its listed position.
    #[default]
    Agrees,
    /// The beacon's RSSI values fit another position or another transmit power.
    Elsewhere,
    /// The beacon's RSSI values jump between those of two positions: two senders have its identity.
    TwoPlaces,
}

/// The test record of one beacon.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct History<T> {
    sum: T,
    /// When the current run of contradictions or agreements began, seconds.
    since_s: u32,
    pub(super) health: BeaconHealth,
}

impl<T: Real> History<T> {
    /// Takes an RSSI whose squared error is `variances` times its variance, or an RSSI from two senders (`is_torn`).
    /// The RSSI counts `weight` times as much as one at a new position. Returns the new state, if it has changed, and
    /// for how many seconds the RSSI values have supported the new state.
    pub(super) fn take(&mut self, now_us: u64, variances: T, is_torn: bool, weight: T) -> Option<(BeaconHealth, u32)> {
        let now_s = u32::try_from(now_us / 1_000_000).unwrap_or(u32::MAX);
        let off = if is_torn { T::of(MOST) } else { variances.at_most(T::of(MOST)) };
        let more = weight * (off - T::of(EXPECTED));
        if !more.is_finite() {
            return None;
        }
        let contradicts = more > T::ZERO;
        let turns = match self.health {
            BeaconHealth::Agrees => self.sum <= T::ZERO && contradicts,
            BeaconHealth::Elsewhere | BeaconHealth::TwoPlaces => self.sum >= T::of(FULL) && !contradicts,
        };
        if turns {
            self.since_s = now_s;
        }
        self.sum = (self.sum + more).at_least(T::ZERO).at_most(T::of(FULL));
        let standing = match self.health {
            BeaconHealth::Agrees if self.sum > T::of(DOUBTED) && is_torn => BeaconHealth::TwoPlaces,
            BeaconHealth::Agrees if self.sum > T::of(DOUBTED) => BeaconHealth::Elsewhere,
            BeaconHealth::Elsewhere | BeaconHealth::TwoPlaces if self.sum < T::of(BELIEVED) => BeaconHealth::Agrees,
            same => same,
        };
        let changed = standing != self.health;
        self.health = standing;
        changed.then(|| (standing, now_s.saturating_sub(self.since_s)))
    }

    /// Clears the sum of a beacon that is not excluded: another beacon was the cause of its errors.
    pub(super) fn clear_suspicion(&mut self) {
        if self.health == BeaconHealth::Agrees {
            self.sum = T::ZERO;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{BeaconHealth, History};

    #[test]
    fn contradictions_at_several_places_are_a_word_and_agreement_takes_it_back() {
        let mut record = History::<f64>::default();
        let mut take =
            |second: u64, variances, is_torn, weight| record.take(second * 1_000_000, variances, is_torn, weight);
        // 6 − 1.6 = 4.4, and 4 − 1.6 = 2.4 more are 6.8; 4.4 more are beyond 8, and held at 10.
        assert_eq!((take(10, 30.0, false, 1.0), take(15, 4.0, false, 1.0)), (None, None));
        assert_eq!(take(22, 9.0, false, 1.0), Some((BeaconHealth::Elsewhere, 12)));
        assert_eq!(take(30, 9.0, false, 1.0), None);
        // Down by 1.6 each: 8.4, 6.8, 5.2, 3.6, 2, 0.4.
        for second in [40, 44, 48, 52, 56] {
            assert_eq!(take(second, 0.0, false, 1.0), None, "{second}");
        }
        assert_eq!(take(60, 0.0, false, 1.0), Some((BeaconHealth::Agrees, 20)));
    }

    #[test]
    fn one_place_counts_once_and_agreement_between_forgets() {
        let mut record = History::<f32>::default();
        // Ten RSSI values at one position, a tenth each, count as one: 4.4.
        for _ in 0..10 {
            assert_eq!(record.take(0, 9.0, false, 0.1), None);
        }
        // An error of two deviations adds 2.4. Agreement, twice, subtracts 3.2. The sum never reaches 8.
        for _ in 0..100 {
            assert_eq!(record.take(0, 0.0, false, 1.0), None);
            assert_eq!(record.take(0, 0.0, false, 1.0), None);
            assert_eq!(record.take(0, 4.0, false, 1.0), None);
        }
        assert_eq!(record.take(0, f32::NAN, false, 1.0), None);
    }

    #[test]
    fn two_senders_are_told_as_such() {
        let mut record = History::<f32>::default();
        // 4.4 each.
        let told = (0..3).find_map(|k| record.take(k * 4_000_000, 0.0, true, 1.0));
        assert_eq!(told, Some((BeaconHealth::TwoPlaces, 4)));
    }
}
