//! The errors of a range: the white noise of one reception, and the error of its link, which lasts.
//!
//! Both grow with the probability that the link is without line of sight, sigma² = sigma_los² + p · sigma_nlos². No
//! range is rejected for that. A link without a known probability has the uncertainty of its kind. Both also grow
//! where a link shows more noise than expected. Where two paths are equally strong, the first one is detected in some
//! frames and missed in others. The mean of such a link is as uncertain as its single ranges. No diagnostics are
//! needed to detect this.

use crate::Real;
use crate::nlos::PowerDifference;

/// How the received power minus that of the first path is converted to an uncertainty of a range; see
/// [`Noise::by_powers`]. It is much less steep than the chip maker's rule, which is for blocked paths: the squared
/// errors of recorded ranges grow about evenly from 3 dB to 16 dB.
pub const POWER_DIFFERENCE_PRIOR: PowerDifference = PowerDifference { middle_db: 10.0, slope: 0.3 };

/// What to do with the probability that a link is without line of sight.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Blocked<T> {
    /// It has no effect: all ranges are treated alike (V. Barral et al. 2019, "no ignore").
    Alike,
    /// Ranges that are probably blocked are left out (Barral et al. 2019, "ignore NLOS"). A minimum number of the
    /// least blocked ranges is kept per round ("at least four anchors"; 0 keeps none).
    Ignore {
        /// A range with at least this probability is left out.
        threshold: T,
        /// The least number of ranges that a round keeps.
        at_least: u8,
    },
    /// Two variances in m², independent of the ranges' own deviations (E. García et al., 0.5 and 3).
    TwoVariances {
        /// A range with at least this probability is blocked.
        threshold: T,
        /// The variance of a direct range, m².
        direct_m2: T,
        /// The variance of a blocked range, m².
        blocked_m2: T,
    },
    /// The variance grows with the probability.
    Weigh,
}

impl<T: Real> Blocked<T> {
    /// The variances of García et al.
    pub fn garcia() -> Self {
        Self::TwoVariances { threshold: T::of(0.5), direct_m2: T::of(0.5), blocked_m2: T::of(3.0) }
    }
}

/// The errors of ranges.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Noise<T> {
    /// Deviation of the error common to all ranges, metres; 0 where it is calibrated.
    pub common_sigma: T,
    /// Deviation of the error of a link in line of sight, metres; 0 makes all errors white.
    pub link_sigma: T,
    /// The additional deviation of the error of a link without line of sight, metres.
    pub blocked_link_sigma: T,
    /// The additional deviation of a link whose probability of being without line of sight is not known, metres.
    pub unasked_link_sigma: T,
    /// The additional deviation of the noise of one range without line of sight, metres.
    pub blocked_noise_sigma: T,
    /// The share of the unexpected variance of a link's ranges that counts as variance of the link's error.
    pub noise_to_link: T,
    /// The weight of a new range in a link's measured noise, 0 to 1. With 0, the deviation given with the range is
    /// used.
    pub learning: T,
    /// The time after which two thirds of a link's error have changed, seconds.
    pub link_seconds: T,
    /// The distance after which two thirds of a link's error have changed, metres.
    pub link_metres: T,
    /// The time after which two thirds of the error of a position by beacons have changed, seconds: people move.
    pub beacon_seconds: T,
    /// The distance after which two thirds of the error of a position by beacons have changed, metres: shadows end.
    pub beacon_metres: T,
    /// The degrees of freedom of the Student's distribution of innovations; 0: a Gaussian distribution.
    pub degrees: T,
}

impl<T: Real> Noise<T> {
    /// The noise of a DW1000 indoors, with a probability that a link is without line of sight. It was tuned on one
    /// recording and checked on others (`docs/performance.md`).
    pub fn indoors() -> Self {
        Self {
            common_sigma: T::of(0.12),
            link_sigma: T::of(0.1),
            blocked_link_sigma: T::of(0.6),
            unasked_link_sigma: T::of(0.1),
            blocked_noise_sigma: T::of(0.3),
            noise_to_link: T::of(5.0),
            learning: T::of(0.03),
            link_seconds: T::of(2.0),
            link_metres: T::of(0.6),
            beacon_seconds: T::of(60.0),
            beacon_metres: T::of(2.0),
            degrees: T::of(10.0),
        }
    }

    /// The same with the probability of [`POWER_DIFFERENCE_PRIOR`], which powers alone give. It is not the
    /// probability that the path is blocked, but that the range has an error. A weak first path before a strong rest
    /// is detected early or late by a decimetre or two.
    pub fn by_powers() -> Self {
        Self {
            link_sigma: T::of(0.055),
            blocked_link_sigma: T::of(0.1),
            unasked_link_sigma: T::of(0.135),
            blocked_noise_sigma: T::of(0.25),
            ..Self::indoors()
        }
    }

    /// The same with the probability of a trained classifier that the link is blocked (`nlos::NlosDetector`). A wall
    /// sometimes adds half a metre. The variance here is smaller, because classifiers err, and a track with few links
    /// left errs more.
    pub fn by_model() -> Self {
        Self { blocked_link_sigma: T::of(0.2), ..Self::by_powers() }
    }

    /// White noise alone, as in the textbook.
    pub fn white() -> Self {
        Self {
            common_sigma: T::ZERO,
            link_sigma: T::ZERO,
            blocked_link_sigma: T::ZERO,
            unasked_link_sigma: T::ZERO,
            blocked_noise_sigma: T::ZERO,
            noise_to_link: T::ZERO,
            learning: T::ZERO,
            link_seconds: T::ONE,
            link_metres: T::ONE,
            beacon_seconds: T::ONE,
            beacon_metres: T::ONE,
            degrees: T::ZERO,
        }
    }
}

impl<T: Real> Noise<T> {
    /// The variance of a link's error, m²; `blocked` is the probability that the link is without line of sight, if it
    /// is known.
    #[inline(always)]
    pub(crate) fn link_variance(&self, blocked: Option<T>) -> T {
        let more = match blocked {
            Some(blocked) => blocked * self.blocked_link_sigma.squared(),
            None => self.unasked_link_sigma.squared(),
        };
        self.link_sigma.squared() + more
    }

    /// The variance of one range's noise, m²; `own` is that in line of sight.
    #[inline(always)]
    pub(crate) fn noise_variance(&self, own: T, blocked: Option<T>) -> T {
        own + blocked.map_or(T::ZERO, |blocked| blocked * self.blocked_noise_sigma.squared())
    }
}

/// The observed noise of a link.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ObservedNoise<T> {
    variance: T,
}

/// The variances of one range.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Variances<T> {
    /// Of the reception's noise, m².
    pub(crate) white: T,
    /// Of the link's error, m².
    pub(crate) link: T,
}

impl<T: Real> ObservedNoise<T> {
    /// No noise observed yet.
    pub(crate) fn nothing() -> Self {
        Self { variance: T::ZERO }
    }

    /// The variances of a range that comes with the variance `own`, blocked with probability `blocked`.
    pub(crate) fn variances(&self, noise: &Noise<T>, own: T, blocked: Option<T>) -> Variances<T> {
        let link = noise.link_variance(blocked);
        let white = noise.noise_variance(own, blocked);
        let more = (self.variance - white).at_least(T::ZERO);
        // Innovations scatter, and have tails: up to twice the expected variance is not a sign of a second path.
        let unlikely = (self.variance - T::of(2.0) * white).at_least(T::ZERO);
        Variances { white: white + more, link: link + noise.noise_to_link * unlikely }
    }

    /// Learns from an innovation of variance `s`; `predicted` is the part of the track's own uncertainty.
    pub(crate) fn learn(&mut self, noise: &Noise<T>, innovation: T, predicted: T, s: T) {
        let seen = innovation.squared().at_most(T::of(9.0) * s) - predicted;
        self.variance += noise.learning * (seen.at_least(T::ZERO) - self.variance);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_blocked_link_is_doubted_in_proportion() {
        let noise =
            Noise::<f64> { link_sigma: 0.1, blocked_link_sigma: 0.4, blocked_noise_sigma: 0.2, ..Noise::white() };
        let shown = ObservedNoise::nothing();
        // Half blocked: 0.03² + 0.5 · 0.2² = 0.0209, and 0.1² + 0.5 · 0.4² = 0.09.
        let half = shown.variances(&noise, 0.0009, Some(0.5));
        assert!((half.white - 0.0209).abs() < 1e-12 && (half.link - 0.09).abs() < 1e-12, "{half:?}");
        // Unknown probability: 0.03², and 0.1² + 0.2² = 0.05.
        let unasked = shown.variances(&Noise { unasked_link_sigma: 0.2, ..noise }, 0.0009, None);
        assert!((unasked.white - 0.0009).abs() < 1e-12 && (unasked.link - 0.05).abs() < 1e-12, "{unasked:?}");
    }

    #[test]
    fn a_link_that_jumps_about_is_found_out() {
        let noise = Noise::<f64>::indoors();
        let mut shown = ObservedNoise::nothing();
        for k in 0..400 {
            let innovation = if k % 2 == 0 { 0.3 } else { -0.3 };
            shown.learn(&noise, innovation, 0.0, 0.09);
        }
        let shown = shown.variances(&noise, 0.0009, Some(0.0));
        // 0.1² plus five times the part of the variance that exceeds twice 0.03².
        assert!((shown.white - 0.09).abs() < 1e-4 && (shown.link - 0.451).abs() < 1e-2, "{shown:?}");
    }
}
