//! From a score to a calibrated probability, and from the probability to a variance.

use super::sigmoid;
use crate::Real;

/// Platt's scaling: p ↦ σ(slope·logit(p) + offset) (J. Platt, *Probabilistic outputs for support vector machines*,
/// 1999). Its two numbers are fitted on held-out placements, on which the classifier was not trained.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Platt {
    /// The slope. It is positive, so the order of two scores is kept.
    pub slope: f32,
    /// The offset.
    pub offset: f32,
}

impl Platt {
    /// The scaling that leaves a probability unchanged.
    pub const NONE: Self = Self { slope: 1.0, offset: 0.0 };

    /// The calibrated probability.
    pub fn apply(self, probability: f32) -> f32 {
        sigmoid(self.slope * Self::logit(probability) + self.offset)
    }

    /// ln(p/(1 − p)), with p limited to 10⁻⁶ from 0 and 1.
    pub fn logit(probability: f32) -> f32 {
        let p = probability.at_least(1.0e-6).at_most(1.0 - 1.0e-6);
        Real::ln(p / (1.0 - p))
    }

    #[cfg(feature = "serde")]
    pub(crate) fn is_sane(self) -> bool {
        self.slope.is_finite() && self.slope > 0.0 && self.offset.is_finite()
    }
}

/// The increase of the variance of a range that may be blocked.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Inflation {
    /// Root mean square of the additional error of a blocked range over a direct one, metres. García et al. take
    /// variances of 0.5 and 3 for their ranges. Over sixteen blocked placements in a furnished flat it is 0.8 m with
    /// the placement behind several walls, and 0.4 m without it.
    pub nlos_sigma_m: f32,
}

impl Default for Inflation {
    fn default() -> Self {
        Self { nlos_sigma_m: 0.5 }
    }
}

impl Inflation {
    /// The variance of a range, m²: σ² + p·σₙ². It is that in line of sight, σ², plus the additional variance of a
    /// blocked range, weighted by its probability. An unknown probability counts as zero.
    pub fn variance_m2(self, los_sigma_m: f32, nlos_probability: Option<f32>) -> f32 {
        let p = nlos_probability.unwrap_or(0.0).at_least(0.0).at_most(1.0);
        let p = if p.is_nan() { 0.0 } else { p };
        los_sigma_m * los_sigma_m + p * self.nlos_sigma_m * self.nlos_sigma_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scaling_is_that_of_a_hand_calculation() {
        // logit(0.8) = ln 4 = 1.386294; 2·1.386294 − 1 = 1.772589; σ = 1/(1 + 0.169893) = 0.854779.
        let p = Platt { slope: 2.0, offset: -1.0 }.apply(0.8);
        assert!((p - 0.854_779).abs() < 1.0e-5, "{p}");
        for p in [0.1, 0.5, 0.9] {
            assert!((Platt::NONE.apply(p) - p).abs() < 1.0e-6);
        }
        assert!(Platt::NONE.apply(0.0) < 2.0e-6 && Platt::NONE.apply(1.0) > 1.0 - 2.0e-6);
    }

    #[test]
    fn variance_grows_with_the_probability() {
        // 0.1² + 0.25·2² = 1.01.
        let inflation = Inflation { nlos_sigma_m: 2.0 };
        assert!((inflation.variance_m2(0.1, Some(0.25)) - 1.01).abs() < 1.0e-6);
        for unknown in [None, Some(f32::NAN), Some(-1.0)] {
            assert!((inflation.variance_m2(0.1, unknown) - 0.01).abs() < 1.0e-8);
        }
        assert!((inflation.variance_m2(0.1, Some(7.0)) - 4.01).abs() < 1.0e-5);
    }
}
