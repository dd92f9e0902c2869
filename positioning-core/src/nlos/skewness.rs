//! The skewness test: the likelihood ratio of García et al., equations 3 and 4.
//!
//! Both conditional densities are normal with the same deviation, so they cross once and the ratio is a sigmoid. A
//! larger skewness never makes the direct path less likely. Their threshold λ is the skewness at which the
//! probability is ½.

use super::{Classifier, Feature, Features, sigmoid};

/// The skewness of direct and of blocked paths.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Skewness {
    /// [`Feature::SkewnessNear`] or [`Feature::Skewness`].
    pub feature: Feature,
    /// Mean of direct paths.
    pub los_mean: f32,
    /// Mean of blocked paths.
    pub nlos_mean: f32,
    /// The deviation of both.
    pub deviation: f32,
}

impl Default for Skewness {
    /// Fitted to 22 placements in a furnished flat (`docs/use/nlos.md`), including its calibration by held-out
    /// placements: λ = 1.29. `baliza nlos train` finds there the means 1.497 and 0.909 and the deviation 0.322, then
    /// the slope 0.648 and the offset 0.308. The slope divides the variance, and the offset moves λ.
    fn default() -> Self {
        Self { feature: Feature::SkewnessNear, los_mean: 1.58, nlos_mean: 0.993, deviation: 0.4 }
    }
}

impl Skewness {
    /// λ: the densities cross where both are equally likely, between the means.
    pub fn threshold(&self) -> f32 {
        (self.los_mean + self.nlos_mean) / 2.0
    }
}

impl Classifier for Skewness {
    fn name(&self) -> &'static str {
        "skewness"
    }

    fn for_each_feature(&self, visit: &mut dyn FnMut(Feature)) {
        visit(self.feature);
    }

    fn nlos_probability(&self, features: &Features) -> Option<f32> {
        // ln of the ratio of two normal densities of one deviation: (µ₁ − µ₀)(γ − λ)/s².
        let away = (features.get(self.feature)? - self.threshold()) / self.deviation;
        Some(sigmoid((self.nlos_mean - self.los_mean) / self.deviation * away))
    }

    fn is_sane(&self) -> bool {
        [self.los_mean, self.nlos_mean, self.deviation].iter().all(|number| number.is_finite()) && self.deviation > 0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_is_what_was_trained_and_calibrated() {
        // λ = (1.497 + 0.909)/2 = 1.203, slope 0.648·(0.909 − 1.497)/0.322² = −3.675: at γ = 1.0 −3.675·(−0.203) +
        // 0.308 = 1.054, σ = 0.742; at γ = 1.6 −3.675·0.397 + 0.308 = −1.151, σ = 0.240.
        let mut features = Features::default();
        for (skewness, expected) in [(1.0, 0.742), (1.6, 0.240)] {
            features.set(Feature::SkewnessNear, skewness);
            let p = Skewness::default().nlos_probability(&features).expect("known");
            assert!((p - expected).abs() < 0.005, "{p}");
        }
    }

    #[test]
    fn the_ratio_is_that_of_a_hand_calculation() {
        let skewness = Skewness { feature: Feature::SkewnessNear, los_mean: 1.5, nlos_mean: 0.9, deviation: 0.3 };
        assert!((skewness.threshold() - 1.2).abs() < 1.0e-6);
        let mut features = Features::default();
        assert_eq!(skewness.nlos_probability(&features), None);
        // At γ = 1.35: z of LOS −0.5, of NLOS 1.5; densities e^−0.125 and e^−1.125; 1/(1 + e) = 0.268941.
        features.set(Feature::SkewnessNear, 1.35);
        let p = skewness.nlos_probability(&features).expect("known");
        assert!((p - 0.268_941).abs() < 1.0e-5, "{p}");
        features.set(Feature::SkewnessNear, 1.2);
        assert!((skewness.nlos_probability(&features).expect("known") - 0.5).abs() < 1.0e-5);
    }
}
