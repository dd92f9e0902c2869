//! A beacon's parameters, estimated while the tag's position is known from another source (ES 2397388, step b of the
//! claim: the parameters of every channel are estimated dynamically, without a calibration before).
//!
//! Input: pairs of RSSI and distance. Output: RSSI at one metre and exponent. The method is recursive least squares
//! (a Kalman filter of two constant states) with a prior and bounds.

use super::{DB, NEAREST_M, PathLoss};
use crate::Real;

/// The range of an exponent indoors: below (1) the thesis has 1 to 5.
const EXPONENTS: (f64, f64) = (1.0, 5.0);
/// The range of the RSSI at one metre, dBm. Even a sender of 20 dBm, the most that Bluetooth allows, has less than
/// −20.
const LEVELS_DBM: (f64, f64) = (-100.0, -20.0);
/// An innovation of more deviations than this counts as this.
const SURPRISE: f64 = 3.0;

/// The estimate of one beacon's parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct OnlinePathLoss<T> {
    model: PathLoss<T>,
    /// Variances of RSSI and exponent, and their covariance.
    variances: [T; 2],
    covariance: T,
}

impl<T: Real> OnlinePathLoss<T> {
    /// Starts from `model` with the standard deviations of its RSSI at one metre, dB, and of its exponent. Use 8 dB
    /// and 0.7 where nothing is known.
    pub fn new(model: PathLoss<T>, level_deviation: T, exponent_deviation: T) -> Self {
        let model = if model.is_sane() { model } else { PathLoss::default() };
        Self { model, variances: [level_deviation.squared(), exponent_deviation.squared()], covariance: T::ZERO }
    }

    /// The current estimate of the parameters.
    pub fn model(&self) -> &PathLoss<T> {
        &self.model
    }

    /// Standard deviations of the RSSI at one metre, dB, and of the exponent.
    pub fn deviations(&self) -> [T; 2] {
        self.variances.map(|variance| variance.at_least(T::ZERO).sqrt())
    }

    /// Adds `drift` dB² to the variance of the RSSI and `drift` ⁄ 100 to that of the exponent: a beacon's battery
    /// fades, and furniture moves.
    pub fn forget(&mut self, drift: T) {
        if drift > T::ZERO && drift.is_finite() {
            self.variances[0] += drift;
            self.variances[1] += drift * T::of(0.01);
        }
    }

    /// Takes an RSSI in dBm that was received at a distance known to `distance_deviation`, metres. Returns false
    /// where the numbers are invalid and nothing was learnt.
    ///
    /// The shadow at a position lasts: several RSSI values received without moving count little more than one. Give
    /// one per metre of movement.
    pub fn learn(&mut self, rssi: T, distance: T, distance_deviation: T) -> bool {
        let sum = rssi.abs() + distance + distance_deviation;
        if !(sum.is_finite() && distance > T::ZERO && distance_deviation >= T::ZERO) {
            return false;
        }
        let distance = distance.at_least(T::of(NEAREST_M));
        // z = level₁ − n x with x = 10 log₁₀ d; the error of the distance is added to the noise.
        let x = T::of(DB) * distance.ln();
        let of_distance = self.model.exponent * T::of(DB) * distance_deviation / distance;
        let [level_variance, exponent_variance] = self.variances;
        let to_level = level_variance - x * self.covariance;
        let to_exponent = self.covariance - x * exponent_variance;
        let noise = self.model.deviation.squared() + of_distance.squared();
        let variance = to_level - x * to_exponent + noise;
        let most = T::of(SURPRISE) * variance.sqrt();
        let innovation = (rssi - (self.model.level_1m - self.model.exponent * x)).at_least(-most).at_most(most);
        let (level_gain, exponent_gain) = (to_level / variance, to_exponent / variance);
        self.model.level_1m = within(self.model.level_1m + level_gain * innovation, LEVELS_DBM);
        self.model.exponent = within(self.model.exponent + exponent_gain * innovation, EXPONENTS);
        // Joseph's form for one number: P − g gᵀ s, kept positive.
        self.variances[0] = (level_variance - level_gain * to_level).at_least(T::EPSILON * level_variance);
        self.variances[1] = (exponent_variance - exponent_gain * to_exponent).at_least(T::EPSILON * exponent_variance);
        let most = (self.variances[0] * self.variances[1]).sqrt();
        self.covariance = (self.covariance - level_gain * to_exponent).at_least(-most).at_most(most);
        true
    }
}

fn within<T: Real>(value: T, bounds: (f64, f64)) -> T {
    value.at_least(T::of(bounds.0)).at_most(T::of(bounds.1))
}

#[cfg(test)]
mod tests {
    use super::super::PathLoss;
    use super::OnlinePathLoss;

    #[test]
    fn one_pair_moves_the_estimate_as_calculated_by_hand() {
        // At one metre x = 0: only the RSSI learns. Variance 64 + 36 = 100, gain 0.64; −59 + 0.64 · (−54 + 59) = −55.8,
        // 64 − 0.64 · 64 = 23.04 = 4.8².
        let mut online = OnlinePathLoss::<f64>::new(PathLoss::default(), 8.0, 0.7);
        assert!(online.learn(-54.0, 1.0, 0.0));
        assert!((online.model().level_1m + 55.8).abs() < 1e-9 && online.model().exponent == 2.4, "{online:?}");
        assert!((online.deviations()[0] - 4.8).abs() < 1e-9, "{online:?}");
    }

    #[test]
    fn the_beacons_of_table_5_4_are_found_on_the_way() {
        for (exponent, level_1m) in [(2.62, -55.01), (3.17, -47.78), (3.46, -33.31)] {
            let truth = PathLoss { level_1m, exponent, deviation: 1.0 };
            let start = PathLoss { deviation: 1.0, ..PathLoss::default() };
            let mut online = OnlinePathLoss::<f32>::new(start, 20.0, 1.0);
            for step in 0..400_i16 {
                // From one metre to eleven and back, with an RSSI whose error alternates between +1 dB and −1 dB.
                let distance = 1.0 + 0.05 * f32::from(if step < 200 { step } else { 400 - step });
                let noise = if step % 2 == 0 { 1.0 } else { -1.0 };
                online.learn(truth.rssi(distance) + noise, distance, 0.2);
            }
            let found = online.model();
            assert!((found.exponent - exponent).abs() < 0.1 && (found.level_1m - level_1m).abs() < 0.8, "{found:?}");
        }
    }

    #[test]
    fn what_is_learnt_level_by_level_is_what_least_squares_make_of_all() {
        // Batch: (XᵀX ⁄ R + P⁻¹) θ = Xᵀz ⁄ R + P⁻¹ θ₀ with rows (1, −10 log₁₀ d), R = 4², P = diag(8², 0.7²), θ₀ =
        // (−59, 2.4). RSSI values of −52 dBm and 2.9, off by ±3 dB in turn: no errors so large that they would be
        // clipped.
        let start = PathLoss { level_1m: -59.0, exponent: 2.4, deviation: 4.0 };
        let mut online = OnlinePathLoss::<f64>::new(start, 8.0, 0.7);
        let (mut a, mut b, mut d) = (1.0 / 64.0, 0.0, 1.0 / 0.49);
        let (mut u, mut v) = (-59.0 / 64.0, 2.4 / 0.49);
        for step in 0..60_i32 {
            let distance = 1.0 + 0.2 * f64::from(step % 37);
            let rssi = -52.0 - 29.0 * distance.log10() + f64::from(step % 3 - 1) * 3.0;
            assert!(online.learn(rssi, distance, 0.0));
            let x = -10.0 * distance.log10();
            (a, b, d) = (a + 1.0 / 16.0, b + x / 16.0, d + x * x / 16.0);
            (u, v) = (u + rssi / 16.0, v + x * rssi / 16.0);
        }
        let determinant = a * d - b * b;
        let (rssi, exponent) = ((d * u - b * v) / determinant, (a * v - b * u) / determinant);
        let found = online.model();
        assert!((found.level_1m - rssi).abs() < 1e-6 && (found.exponent - exponent).abs() < 1e-6, "{found:?}");
        let deviations = [(d / determinant).sqrt(), (a / determinant).sqrt()];
        let off = online.deviations().into_iter().zip(deviations).map(|(a, b)| (a - b).abs());
        assert!(off.fold(0.0, f64::max) < 1e-6, "{online:?} {deviations:?}");
    }

    #[test]
    fn what_is_no_number_teaches_nothing_and_nonsense_stays_in_bounds() {
        let mut online = OnlinePathLoss::<f32>::new(PathLoss::default(), 8.0, 0.7);
        let before = online;
        for [rssi, distance, deviation] in
            [[f32::NAN, 1.0, 0.1], [-60.0, 0.0, 0.1], [-60.0, f32::INFINITY, 0.1], [-60.0, 1.0, f32::NAN]]
        {
            assert!(!online.learn(rssi, distance, deviation));
        }
        assert_eq!(online, before);
        for step in 0..10_000_u16 {
            online.learn(if step % 3 == 0 { -1.0 } else { -127.0 }, 1.0 + f32::from(step % 50), 0.0);
            online.forget(0.01);
        }
        let model = online.model();
        assert!(model.is_sane() && (1.0..=5.0).contains(&model.exponent), "{model:?}");
        assert!(online.deviations().iter().all(|deviation| deviation.is_finite()), "{online:?}");
    }
}
