//! The errors of a range: the white noise of one reception, and the error of its link, which lasts
//! ([`LinkPrior`]).
//!
//! The noise of a link grows with the probability that the link is blocked, and where the link shows more noise than
//! expected. Where two paths are equally strong, the first one is detected in some frames and missed in others. No
//! diagnostics are needed to detect this.

use crate::Real;
use crate::link_error::{COMMON_SIGMA_M, DIRECT_SIGMA_M, LinkPrior, prior_blocked};
use crate::nlos::PowerDifference;

/// How the received power minus that of the first path is converted to a probability that a link is blocked. It is much
/// less steep than the chip maker's rule, which is for blocked paths: the squared errors of recorded ranges grow about
/// evenly from 3 dB to 16 dB.
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
    /// The variance of a range with this probability of a blocked link, m², where it is independent of the range's own.
    pub(crate) fn variance(&self, p_nlos: T) -> Option<T> {
        match *self {
            Self::TwoVariances { threshold, direct_m2, blocked_m2 } => {
                Some(if p_nlos >= threshold { blocked_m2 } else { direct_m2 })
            }
            Self::Alike | Self::Ignore { .. } | Self::Weigh => None,
        }
    }
}

/// The errors of ranges.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Noise<T> {
    /// Deviation of the error common to all ranges, metres; 0 where it is calibrated.
    pub common_sigma: T,
    /// Deviation of the error of a direct link, metres; 0 makes all errors white, and no link is ever blocked.
    pub direct_sigma: T,
    /// The additional deviation of the noise of one range of a blocked link, metres.
    pub blocked_noise_sigma: T,
    /// How fast a link's measured noise follows its ranges, per second. With 0, the deviation given with the range is
    /// used.
    pub learning_per_s: T,
    /// The time after which two thirds of a link's error have changed, seconds.
    pub link_seconds: T,
    /// The distance after which two thirds of a link's error have changed, metres.
    pub link_metres: T,
    /// How often a link gets another error, per second: somebody steps between.
    pub renewals_per_s: T,
    /// The time after which two thirds of the error of a position by beacons have changed, seconds: people move.
    pub beacon_seconds: T,
    /// The distance after which two thirds of the error of a position by beacons have changed, metres: shadows end.
    pub beacon_metres: T,
    /// The degrees of freedom of the Student's distribution of innovations; 0: a Gaussian distribution.
    pub degrees: T,
}

impl<T: Real> Noise<T> {
    /// The noise of a DW1000 indoors (`positioning-core/README.md` has the reasons, `qa/accuracy/README.md`
    /// the checks).
    pub fn indoors() -> Self {
        Self {
            common_sigma: T::of(COMMON_SIGMA_M),
            direct_sigma: T::of(DIRECT_SIGMA_M),
            blocked_noise_sigma: T::of(0.3),
            learning_per_s: T::of(0.3),
            link_seconds: T::of(1.0),
            link_metres: T::of(0.4),
            renewals_per_s: T::of(0.2),
            beacon_seconds: T::of(60.0),
            beacon_metres: T::of(2.0),
            degrees: T::of(10.0),
        }
    }

    /// White noise alone, as in the textbook.
    pub fn white() -> Self {
        Self {
            common_sigma: T::ZERO,
            direct_sigma: T::ZERO,
            blocked_noise_sigma: T::ZERO,
            learning_per_s: T::ZERO,
            link_seconds: T::ONE,
            link_metres: T::ONE,
            renewals_per_s: T::ZERO,
            beacon_seconds: T::ONE,
            beacon_metres: T::ONE,
            degrees: T::ZERO,
        }
    }
}

impl<T: Real> Noise<T> {
    /// Whether links have errors that last.
    #[inline(always)]
    pub(crate) fn lasts(&self) -> bool {
        self.direct_sigma > T::ZERO
    }

    /// The prior of a link's error; `p_nlos` is the probability of being without line of sight by the diagnostics, if
    /// it is known.
    #[inline(always)]
    pub(crate) fn link_prior(&self, p_nlos: Option<T>) -> LinkPrior<T> {
        LinkPrior { direct_m2: self.direct_sigma.squared(), blocked: prior_blocked(p_nlos) }
    }

    /// The variance of one range's noise, m²; `own` is that in line of sight, `blocked` the probability that its link
    /// is blocked.
    #[inline(always)]
    pub(crate) fn noise_variance(&self, own: T, blocked: T) -> T {
        own + blocked * self.blocked_noise_sigma.squared()
    }
}

/// The observed noise of a link.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ObservedNoise<T> {
    variance: T,
}

impl<T: Real> ObservedNoise<T> {
    /// No noise observed yet.
    pub(crate) fn nothing() -> Self {
        Self { variance: T::ZERO }
    }

    /// The variance of a range's noise, m², where `expected` is expected.
    pub(crate) fn variance(&self, expected: T) -> T {
        expected.at_least(self.variance)
    }

    /// Learns with a weight, 0 to 1, from an innovation of variance `s`; `predicted` is the part of the track's own
    /// uncertainty.
    pub(crate) fn learn(&mut self, weight: T, innovation: T, predicted: T, s: T) {
        let seen = innovation.squared().at_most(T::of(9.0) * s) - predicted;
        self.variance += weight * (seen.at_least(T::ZERO) - self.variance);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_link_that_jumps_about_is_found_out() {
        let mut shown = ObservedNoise::<f64>::nothing();
        assert_eq!(shown.variance(0.0009), 0.0009);
        for k in 0..400 {
            let innovation = if k % 2 == 0 { 0.3 } else { -0.3 };
            shown.learn(0.03, innovation, 0.0, 0.09);
        }
        // 0.3² whatever is expected.
        assert!((shown.variance(0.0009) - 0.09).abs() < 1e-4, "{shown:?}");
    }
}
