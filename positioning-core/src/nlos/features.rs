//! The features of one reception, by name.

use super::Shape;
use crate::Real;

/// A feature. The order is that of stored models: add new ones at the end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Feature {
    /// [`Shape::skewness`].
    Skewness,
    /// [`Shape::kurtosis`].
    Kurtosis,
    /// [`Shape::skewness_near`].
    SkewnessNear,
    /// [`Shape::kurtosis_near`].
    KurtosisNear,
    /// [`Shape::first_path_to_peak_ns`].
    FirstPathToPeak,
    /// [`Shape::first_path_ratio`].
    FirstPathRatio,
    /// [`Shape::rise_time_ns`].
    RiseTime,
    /// [`Shape::mean_excess_delay_ns`].
    MeanExcessDelay,
    /// [`Shape::rms_delay_spread_ns`].
    RmsDelaySpread,
    /// Received power minus that of the first path, dB ([`power_difference_db`]).
    PowerDifference,
    /// The first path above the noise, dB ([`first_path_to_noise_db`]).
    FirstPathToNoise,
    /// Mean of the last five ranges to the anchor, metres ([`MovingMean`](super::MovingMean)).
    RangeMean,
    /// Mean of the last five received powers from the anchor, dBm.
    PowerMean,
    /// The range minus the distance from the anchor to the tag's position by the track, metres.
    TrackResidual,
}

impl Feature {
    /// All, in order.
    pub const ALL: [Self; 14] = [
        Self::Skewness,
        Self::Kurtosis,
        Self::SkewnessNear,
        Self::KurtosisNear,
        Self::FirstPathToPeak,
        Self::FirstPathRatio,
        Self::RiseTime,
        Self::MeanExcessDelay,
        Self::RmsDelaySpread,
        Self::PowerDifference,
        Self::FirstPathToNoise,
        Self::RangeMean,
        Self::PowerMean,
        Self::TrackResidual,
    ];

    /// Whether the feature is computed from the impulse response.
    pub const fn is_of_response(self) -> bool {
        match self {
            Self::Skewness
            | Self::Kurtosis
            | Self::SkewnessNear
            | Self::KurtosisNear
            | Self::FirstPathToPeak
            | Self::FirstPathRatio
            | Self::RiseTime
            | Self::MeanExcessDelay
            | Self::RmsDelaySpread => true,
            Self::PowerDifference
            | Self::FirstPathToNoise
            | Self::RangeMean
            | Self::PowerMean
            | Self::TrackResidual => false,
        }
    }

    /// Whether the feature depends on earlier receptions and not on one reception alone.
    pub const fn is_of_time(self) -> bool {
        matches!(self, Self::RangeMean | Self::PowerMean | Self::TrackResidual)
    }

    /// Its name in tables and commands, with its unit where it has one.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Skewness => "skewness",
            Self::Kurtosis => "kurtosis",
            Self::SkewnessNear => "skewness_near",
            Self::KurtosisNear => "kurtosis_near",
            Self::FirstPathToPeak => "first_path_to_peak_ns",
            Self::FirstPathRatio => "first_path_ratio",
            Self::RiseTime => "rise_time_ns",
            Self::MeanExcessDelay => "mean_excess_delay_ns",
            Self::RmsDelaySpread => "rms_delay_spread_ns",
            Self::PowerDifference => "power_difference_db",
            Self::FirstPathToNoise => "first_path_to_noise_db",
            Self::RangeMean => "range_mean_m",
            Self::PowerMean => "power_mean_dbm",
            Self::TrackResidual => "track_residual_m",
        }
    }
}

/// The features of one reception.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Features {
    /// NaN means unknown.
    values: [f32; Feature::ALL.len()],
}

impl Default for Features {
    fn default() -> Self {
        Self { values: [f32::NAN; Feature::ALL.len()] }
    }
}

impl Features {
    /// Sets one feature; a value that is not finite means unknown.
    pub fn set(&mut self, feature: Feature, value: f32) {
        if let Some(place) = self.values.get_mut(feature as usize) {
            *place = value;
        }
    }

    /// Sets one feature; `None` means unknown.
    pub fn set_known(&mut self, feature: Feature, value: Option<f32>) {
        self.set(feature, value.unwrap_or(f32::NAN));
    }

    /// Sets all features of the shape.
    pub fn set_shape(&mut self, shape: &Shape) {
        for (feature, value) in [
            (Feature::Skewness, shape.skewness),
            (Feature::Kurtosis, shape.kurtosis),
            (Feature::SkewnessNear, shape.skewness_near),
            (Feature::KurtosisNear, shape.kurtosis_near),
            (Feature::FirstPathToPeak, shape.first_path_to_peak_ns),
            (Feature::FirstPathRatio, shape.first_path_ratio),
            (Feature::RiseTime, shape.rise_time_ns),
            (Feature::MeanExcessDelay, shape.mean_excess_delay_ns),
            (Feature::RmsDelaySpread, shape.rms_delay_spread_ns),
        ] {
            self.set(feature, value);
        }
    }

    /// The value, if it is known and finite.
    pub fn get(&self, feature: Feature) -> Option<f32> {
        self.values.get(feature as usize).copied().filter(|value| value.is_finite())
    }
}

/// Received power minus that of the first path, dB: 10·log₁₀(C·2¹⁷/(F₁² + F₂² + F₃²)) (DW1000 user manual, 4.7.1 and
/// 4.7.2: the count of symbols and the constant A are in both powers and cancel, so neither a saturated count nor a
/// zero count matters). `None` where either power is zero.
pub fn power_difference_db(cir_power: f32, first_path_amplitudes: [f32; 3]) -> Option<f32> {
    let first_path: f32 = first_path_amplitudes.iter().map(|amplitude| amplitude * amplitude).sum();
    decibels(cir_power * 131_072.0 / first_path)
}

/// The largest of the first path's three amplitudes above the deviation of the noise, dB. `None` where either is
/// zero.
pub fn first_path_to_noise_db(first_path_amplitudes: [f32; 3], noise_deviation: f32) -> Option<f32> {
    let [a, b, c] = first_path_amplitudes;
    let ratio = a.at_least(b).at_least(c) / noise_deviation;
    decibels(ratio * ratio)
}

/// 10·log₁₀ of a ratio; `None` where the ratio is not positive or not finite.
fn decibels(ratio: f32) -> Option<f32> {
    // 10/ln 10.
    (ratio > 0.0 && ratio.is_finite()).then(|| 4.342_945 * Real::ln(ratio))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_follow_the_manual() {
        // 20000·2¹⁷ = 2.62144e9; 12000² + 11000² + 9000² = 3.46e8; ratio 7.576416; 10·log₁₀ = 8.79464.
        let db = power_difference_db(20_000.0, [12_000.0, 11_000.0, 9_000.0]).expect("known");
        assert!((db - 8.794_64).abs() < 1.0e-4, "{db}");
        // 12000/60 = 200; 20·log₁₀ 200 = 46.0206.
        let db = first_path_to_noise_db([12_000.0, 11_000.0, 9_000.0], 60.0).expect("known");
        assert!((db - 46.020_6).abs() < 1.0e-4, "{db}");
    }

    #[test]
    fn what_is_nothing_is_not_known() {
        assert_eq!(power_difference_db(0.0, [1.0; 3]), None);
        assert_eq!(power_difference_db(1.0, [0.0; 3]), None);
        assert_eq!(power_difference_db(f32::NAN, [1.0; 3]), None);
        assert_eq!(power_difference_db(1.0, [f32::NAN, 1.0, 1.0]), None);
        assert_eq!(first_path_to_noise_db([5.0, 6.0, 7.0], 0.0), None);
        assert_eq!(first_path_to_noise_db([0.0; 3], 5.0), None);
        assert_eq!(first_path_to_noise_db([0.0; 3], 0.0), None);
    }

    #[test]
    fn features_are_known_or_not() {
        let mut features = Features::default();
        assert!(Feature::ALL.iter().all(|&feature| features.get(feature).is_none()));
        for (at, feature) in Feature::ALL.into_iter().enumerate() {
            assert_eq!(feature as usize, at, "the order of stored models");
            features.set(feature, at as f32);
        }
        features.set(Feature::Kurtosis, f32::INFINITY);
        features.set_known(Feature::RiseTime, None);
        assert_eq!(features.get(Feature::Kurtosis), None);
        assert_eq!(features.get(Feature::RiseTime), None);
        assert_eq!(features.get(Feature::PowerMean), Some(12.0));
    }

    #[test]
    fn a_shape_sets_its_nine() {
        let shape = Shape::of(&[0, 0, 0, 100, 0, 200, 10, 0, 0, 0], 2.5).expect("a shape");
        let mut features = Features::default();
        features.set_shape(&shape);
        assert_eq!(Feature::ALL.iter().filter(|&&feature| features.get(feature).is_some()).count(), 9);
        assert_eq!(features.get(Feature::SkewnessNear), Some(shape.skewness_near));
        assert_eq!(features.get(Feature::RmsDelaySpread), Some(shape.rms_delay_spread_ns));
    }
}
