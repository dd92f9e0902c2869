//! The likelihood of a position by the RSSI values received there: the path loss (1) with normal shadowing. The
//! receiver's own offset is integrated out.
//!
//! It is computed for every particle. It is therefore a sum of squares over the beacons, with one approximate
//! logarithm each.

use heapless::Vec;

use super::RssiObservation;
use crate::ble::path_loss::{Wall, attenuation};
use crate::{MAX_ANCHORS, Real};

/// Smaller distances count as this, metres.
const NEAREST_M: f64 = 0.3;

/// One beacon. Its RSSI differs from the expected one by `base + slope · log₂ d²`, dB.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Term<T> {
    beacon_m: [T; 2],
    above: T,
    base: T,
    slope: T,
    weight: T,
}

/// The likelihood of positions by the RSSI values of one scan.
#[derive(Clone, Debug)]
pub struct RssiLikelihood<'a, T> {
    terms: Vec<Term<T>, MAX_ANCHORS>,
    /// Σ w.
    weights: T,
    /// 1 ⁄ (Σ w + 1 ⁄ (t σₒ²)) for a trust t, of the offset that is integrated out.
    share: T,
    /// −½ times the `trust` in the RSSI values.
    factor: T,
    /// The walls between beacons and tag.
    walls: &'a [Wall<T>],
}

impl<'a, T: Real> RssiLikelihood<'a, T> {
    /// Takes received RSSI values, at most [`MAX_ANCHORS`] of them. Values that are not sane are left out.
    ///
    /// `offset_deviation` is the standard deviation of the receiver's own offset, dB. `trust`, up to 1, is the share
    /// of the information that is new, on the position and on the offset. The shadows at a position are the same in the
    /// next scan. They count once in the time it takes to leave the position (a second or two), not once per scan.
    pub fn of(heard: &[RssiObservation<T, 2>], offset_deviation: T, trust: T) -> Self {
        let (mut terms, mut weights) = (Vec::new(), T::ZERO);
        for heard in heard.iter().filter(|heard| heard.is_sane()) {
            let term = Term::of(heard);
            if terms.push(term).is_err() {
                break;
            }
            weights += term.weight;
        }
        let variance = trust * offset_deviation.squared();
        let share = variance / (weights * variance + T::ONE);
        Self { terms, weights, share, factor: T::of(-0.5) * trust, walls: &[] }
    }

    /// The same with walls that attenuate signals (2). Every wall is checked for every beacon and position.
    pub fn through(self, walls: &'a [Wall<T>]) -> Self {
        Self { walls, ..self }
    }

    /// The logarithm of the likelihood of a position, and the most likely offset of the receiver there, dB.
    #[inline(always)]
    pub(crate) fn seen_from(&self, position: [T; 2]) -> (T, T) {
        self.seen_with(position, T::ZERO)
    }

    /// The same where the receiver's offset is expected to be `before`, dB.
    #[inline(always)]
    pub(crate) fn seen_with(&self, position: [T; 2], before: T) -> (T, T) {
        let (mut squares, mut sum) = (T::ZERO, T::ZERO);
        for term in &self.terms {
            let residual = self.residual(term, position);
            squares += term.weight * residual.squared();
            sum += term.weight * residual;
        }
        let left = sum - self.weights * before;
        let squares = squares - before * (sum + left);
        let more = self.share * left;
        (self.factor * (squares - more * left), before + more)
    }

    /// The estimate of the receiver's offset at a known position: mean, dB, and variance, dB².
    #[inline(never)]
    pub fn offset_at(&self, position: [T; 2]) -> (T, T) {
        (self.seen_from(position).1, self.offset_variance())
    }

    /// The variance of the receiver's offset where the position is known, dB². It is the same at all positions.
    pub fn offset_variance(&self) -> T {
        self.share / (self.factor + self.factor).abs()
    }

    /// By how much an RSSI is too strong for a position, dB. Near the beacon, where the model ends, the distance has
    /// a smooth lower bound.
    #[inline(always)]
    pub(crate) fn residual(&self, term: &Term<T>, position: [T; 2]) -> T {
        let (x, y) = (position[0] - term.beacon_m[0], position[1] - term.beacon_m[1]);
        let residual = term.base + term.slope * (x.squared() + y.squared() + term.above).log2_about();
        if self.walls.is_empty() { residual } else { residual + attenuation(self.walls, term.beacon_m, position) }
    }

    /// The number of RSSI values.
    pub fn len(&self) -> usize {
        self.terms.len()
    }

    /// How far the RSSI values agree with a position, 0 to 1, as the quality of a [`Fix`](crate::Fix).
    #[inline(never)]
    pub(crate) fn agreement(&self, position: [T; 2]) -> T {
        let mut weights = T::ZERO;
        for term in &self.terms {
            weights += term.weight * self.residual(term, position).squared();
        }
        let count = T::count(self.terms.len());
        count / (count + weights)
    }

    /// Whether there are no RSSI values, and so no information.
    pub fn is_empty(&self) -> bool {
        self.terms.is_empty()
    }
}

impl<T: Real> Term<T> {
    /// The term of an RSSI that is sane.
    #[inline(never)]
    pub(crate) fn of(heard: &RssiObservation<T, 2>) -> Self {
        let path_loss = &heard.path_loss;
        Self {
            beacon_m: heard.beacon_m,
            above: heard.above_m.squared().at_least(T::of(NEAREST_M * NEAREST_M)),
            base: heard.rssi_dbm - path_loss.level_1m,
            // 10 n log₁₀ d = 5 n log₁₀ 2 · log₂ d².
            slope: path_loss.exponent * T::of(5.0 * core::f64::consts::LOG10_2),
            weight: T::ONE / path_loss.deviation.squared(),
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::ble::path_loss::{PathLoss, Wall};
    use crate::ble::rssi::{RssiLikelihood, RssiObservation};

    fn heard(place: [f64; 2], rssi: f64) -> RssiObservation<f64, 2> {
        RssiObservation {
            beacon_m: place,
            above_m: 0.0,
            rssi_dbm: rssi,
            path_loss: PathLoss { level_1m: -50.0, exponent: 2.0, deviation: 4.0 },
        }
    }

    #[test]
    fn the_likelihood_is_that_of_a_hand_calculation() {
        // At 5 m, d² = 25 + 0.09: residual −66 + 50 + 10 log₁₀ 25.09 = −2.004993, squared 4.019998, −½ · 4.019998 ⁄
        // 16 = −0.125625.
        let one = RssiLikelihood::of(&[heard([0.0, 0.0], -66.0)], 0.0, 1.0).seen_from([3.0, 4.0]).0;
        assert!((one + 0.125_625).abs() < 1e-6, "{one}");
        // From (0, 4) d² is 25.09 and 52.09; the second residual −62 + 50 + 10 log₁₀ 52.09 = 5.167544, squared
        // 26.703507: −0.960110.
        let both = [heard([3.0, 0.0], -66.0), heard([6.0, 0.0], -62.0)];
        let at = |offset_deviation, trust| RssiLikelihood::of(&both, offset_deviation, trust).seen_from([0.0, 4.0]).0;
        assert!((at(0.0, 1.0) + 0.960_110).abs() < 1e-6, "{}", at(0.0, 1.0));
        assert!((at(0.0, 0.25) + 0.25 * 0.960_110).abs() < 1e-6);
        // An offset of any size explains their mean, 1.581275; left are ∓3.586268: −½ · 25.722643 ⁄ 16 = −0.803833.
        assert!((at(1.0e6, 1.0) + 0.803_833).abs() < 1e-6, "{}", at(1.0e6, 1.0));
        // An offset of 2 ± 2 dB before: the residuals are −4.004993 and 3.167544 from (0, 4) with 2 dB less: −½ ⁄ 16 ·
        // (16.039965 + 10.033335 − 0.837449² ⁄ (2 + 16 ⁄ 4)) = −0.811138, and the offset 2 − 0.837449 ⁄ 6 = 1.860425.
        let (ln, offset) = RssiLikelihood::of(&both, 2.0, 1.0).seen_with([0.0, 4.0], 2.0);
        assert!((ln + 0.811_138).abs() < 1e-5 && (offset - 1.860_425).abs() < 1e-5, "{ln} {offset}");
    }

    #[test]
    fn a_wall_makes_the_places_behind_it_as_much_louder_as_it_takes() {
        // Without: residual -2.004993 at (3, 4). A wall of 5 dB between: 2.995007, squared 8.970067, −½ · 8.970067 ⁄
        // 16 = −0.280315.
        let walls = [Wall { ends: [[1.0, 0.0], [1.0, 9.0]], attenuation: 5.0 }];
        let rssis = RssiLikelihood::of(&[heard([0.0, 0.0], -66.0)], 0.0, 1.0).through(&walls);
        assert!((rssis.seen_from([3.0, 4.0]).0 + 0.280_315).abs() < 1e-6, "{}", rssis.seen_from([3.0, 4.0]).0);
        assert!((rssis.seen_from([-3.0, 4.0]).0 + 0.125_625).abs() < 1e-6, "not behind the wall");
    }

    #[test]
    fn what_is_not_sane_is_left_out() {
        let bad = [heard([f64::NAN, 0.0], -60.0), heard([0.0, 0.0], f64::INFINITY), heard([0.0, 0.0], -60.0)];
        assert_eq!(RssiLikelihood::of(&bad, 0.0, 1.0).len(), 1);
        assert_eq!(RssiLikelihood::of(&[bad[2]; 20], 0.0, 1.0).len(), 16);
        assert!(RssiLikelihood::<f64>::of(&bad[..1], 0.0, 1.0).is_empty());
    }
}
