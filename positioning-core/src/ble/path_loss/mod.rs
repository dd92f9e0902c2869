//! RSSI values and distances: the log-distance path loss (1), with walls (2).
//!
//! Input: metres; output: dBm; and the reverse. A beacon's parameters come from a calibration, or from its adverts
//! (the RSSI at one metre), or are estimated while positions are known from another source: [`OnlinePathLoss`].

mod online;

pub use online::OnlinePathLoss;

use crate::Real;

/// Smaller distances count as this, metres: the model fails within arm's length.
const NEAREST_M: f64 = 0.1;
/// Greater distances count as this, metres: it is beyond a beacon's reach.
const FARTHEST_M: f64 = 300.0;
/// 10 ⁄ ln 10: dB per unit of the natural logarithm of power.
const DB: f64 = 10.0 / core::f64::consts::LN_10;

/// The parameters of one beacon.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct PathLoss<T> {
    /// RSSI₀, the RSSI at one metre, dBm.
    pub level_1m: T,
    /// n, the path loss exponent: 2 in free space, 1 to 5 indoors.
    pub exponent: T,
    /// Standard deviation of an RSSI about the model, dB: X_σ. It comes mostly from shadows and reflections at a
    /// position.
    pub deviation: T,
}

impl<T: Real> Default for PathLoss<T> {
    /// The expected values for a beacon of which nothing is known: −59 dBm at one metre, the usual setting of
    /// iBeacons of 0 dBm; about the mean exponent of tables 4.3 and 5.4; and the deviation of a furnished flat.
    fn default() -> Self {
        Self { level_1m: T::of(-59.0), exponent: T::of(2.4), deviation: T::of(6.0) }
    }
}

impl<T: Real> PathLoss<T> {
    /// Whether all numbers are plausible: finite, with an exponent and a deviation above zero.
    pub fn is_sane(&self) -> bool {
        self.level_1m.abs() <= T::of(200.0)
            && self.exponent >= T::of(0.1)
            && self.exponent <= T::of(20.0)
            && self.deviation >= T::of(0.01)
            && self.deviation <= T::of(100.0)
    }

    /// The RSSI at a distance in metres, dBm (1). Distances are limited to 0.1 m to 300 m.
    pub fn rssi(&self, distance: T) -> T {
        let distance = distance.at_least(T::of(NEAREST_M)).at_most(T::of(FARTHEST_M));
        self.level_1m - self.exponent * T::of(DB) * distance.ln()
    }

    /// The RSSI behind walls that attenuate by `attenuation` dB together, dBm (2).
    pub fn level_through(&self, distance: T, attenuation: T) -> T {
        self.rssi(distance) - attenuation
    }

    /// The distance of an RSSI in dBm, metres: the inverse of (1), limited to 0.1 m to 300 m.
    pub fn distance(&self, rssi: T) -> T {
        let nepers = (self.level_1m - rssi) / (self.exponent * T::of(DB));
        nepers.exp().at_least(T::of(NEAREST_M)).at_most(T::of(FARTHEST_M))
    }

    /// The distance of an RSSI through walls that attenuate by `attenuation` dB together, metres.
    pub fn distance_through(&self, rssi: T, attenuation: T) -> T {
        self.distance(rssi + attenuation)
    }

    /// The deviation of a distance's natural logarithm: σ ln 10 ⁄ (10 n).
    pub fn relative_deviation(&self) -> T {
        self.deviation / (self.exponent * T::of(DB))
    }
}

/// A wall, seen from above.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Wall<T> {
    /// Its ends, metres.
    pub ends: [[T; 2]; 2],
    /// The attenuation of a signal through it, dB: the aᵢ of (2).
    pub attenuation: T,
}

impl<T: Real> Wall<T> {
    /// Whether the straight line between two points passes through the wall. A line that only touches the wall does
    /// not pass through it.
    #[inline]
    pub fn is_crossed(&self, from: [T; 2], to: [T; 2]) -> bool {
        let [a, b] = self.ends;
        side(a, b, from) * side(a, b, to) < T::ZERO && side(from, to, a) * side(from, to, b) < T::ZERO
    }

    /// Whether the two points are on different sides of the wall. A point on the wall is on one of its sides, and the
    /// end of a wall belongs to one of the sides of a line past it. So nothing passes through by steps of which one
    /// ends on the wall, or where two walls meet.
    pub fn parts(&self, from: [T; 2], to: [T; 2]) -> bool {
        let is_left = |a, b, p| side(a, b, p) >= T::ZERO;
        let [a, b] = self.ends;
        is_left(a, b, from) != is_left(a, b, to) && is_left(from, to, a) != is_left(from, to, b)
    }
}

/// On which side of the line through `a` and `b` the point `p` is: positive on its left.
#[inline(always)]
fn side<T: Real>(a: [T; 2], b: [T; 2], p: [T; 2]) -> T {
    (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0])
}

/// The attenuation of the walls between two points together, dB: the sum of (2).
pub fn attenuation<T: Real>(walls: &[Wall<T>], from: [T; 2], to: [T; 2]) -> T {
    walls.iter().filter(|wall| wall.is_crossed(from, to)).fold(T::ZERO, |sum, wall| sum + wall.attenuation)
}

#[cfg(test)]
mod tests {
    use super::{PathLoss, Wall, attenuation};

    const BEACON_6: PathLoss<f64> = PathLoss { level_1m: -33.7, exponent: 2.12, deviation: 4.0 };

    #[test]
    fn levels_are_those_of_a_hand_calculation() {
        // Beacon 6 of table 4.3: −33.7 − 21.2 · log₁₀ 5 = −33.7 − 21.2 · 0.698970 = −48.518164.
        assert!((BEACON_6.rssi(5.0) + 48.518_164).abs() < 1e-6);
        assert_eq!(BEACON_6.rssi(1.0), -33.7);
        assert!((BEACON_6.level_through(5.0, 7.5) + 56.018_164).abs() < 1e-6);
        assert!((BEACON_6.distance(-48.518_164) - 5.0).abs() < 1e-6);
        assert!((BEACON_6.distance_through(-56.018_164, 7.5) - 5.0).abs() < 1e-6);
        // 4 · ln 10 ⁄ 21.2 = 0.434450.
        assert!((BEACON_6.relative_deviation() - 0.434_450).abs() < 1e-6);
    }

    #[test]
    fn impossible_levels_and_distances_stay_within_bounds() {
        assert_eq!((BEACON_6.distance(500.0), BEACON_6.distance(-500.0)), (0.1, 300.0));
        assert_eq!(BEACON_6.rssi(0.0), BEACON_6.rssi(0.1));
        assert_eq!(BEACON_6.rssi(1e30), BEACON_6.rssi(300.0));
    }

    #[test]
    fn only_sane_parameters_are_sane() {
        assert!(BEACON_6.is_sane() && PathLoss::<f32>::default().is_sane());
        for wrong in [f64::NAN, f64::INFINITY, 0.0, -1.0] {
            assert!(!PathLoss { exponent: wrong, ..BEACON_6 }.is_sane());
            assert!(!PathLoss { deviation: wrong, ..BEACON_6 }.is_sane());
        }
        assert!(!PathLoss { level_1m: f64::NAN, ..BEACON_6 }.is_sane());
    }

    #[test]
    fn a_barrier_has_no_hole_on_it_nor_where_walls_meet() {
        let barrier = |ends| Wall { ends, attenuation: 0.0 };
        let wall = barrier([[1.0, 0.0], [1.0, 2.0]]);
        // Two steps, of which the first ends on the wall: one of them passes through, in both directions.
        for way in [[0.5, 1.0, 1.5], [1.5, 1.0, 0.5]] {
            let passed = way.windows(2).filter(|step| wall.parts([step[0], 1.0], [step[1], 1.0])).count();
            assert_eq!(passed, 1, "{way:?}");
        }
        // Past the joint of two walls, and around their ends.
        let both = [wall, barrier([[1.0, 2.0], [1.0, 4.0]])];
        let passed = |y: f64| both.iter().filter(|wall| wall.parts([0.5, y], [1.5, y])).count();
        assert_eq!((passed(1.0), passed(2.0), passed(3.0), passed(-0.1), passed(4.1)), (1, 1, 1, 0, 0));
        assert!(!wall.parts([f64::NAN, 1.0], [1.5, 1.0]));
    }

    #[test]
    fn walls_between_take_their_part_and_others_nothing() {
        let wall = |ends, attenuation| Wall { ends, attenuation };
        let walls = [
            wall([[1.0, -1.0], [1.0, 1.0]], 3.0),
            wall([[2.0, -1.0], [2.0, 1.0]], 5.0),
            wall([[4.0, -1.0], [4.0, 1.0]], 7.0),
            wall([[0.0, 0.5], [3.0, 0.5]], 9.0),
            wall([[1.0, 0.0], [1.0, 2.0]], 11.0),
        ];
        // The line from (0, 0) to (3, 0) passes through the first two walls, ends before the third, passes beside the
        // fourth, and touches the end of the last.
        assert_eq!(attenuation(&walls, [0.0, 0.0], [3.0, 0.0]), 8.0);
        assert_eq!(attenuation(&walls, [f64::NAN, 0.0], [3.0, 0.0]), 0.0);
    }
}
