//! A random field over the floor plan: a part of the RSSI in dB that belongs to a position. Values nearby are alike,
//! values far apart are independent.
//!
//! The correlation falls as e^(−d ⁄ length), which is what M. Gudmundson measured of shadowing (*Correlation model for
//! shadow fading in mobile radio systems*, Electronics Letters 27(23), 1991). The field is a sum of cosines whose wave
//! vectors are drawn from the correlation's spectrum, which is a Cauchy distribution in the plane (A. Rahimi and B.
//! Recht, *Random features for large-scale kernel machines*, 2007). The field is a function of the position, so a tag
//! that returns to a position finds the same value.

use std::f64::consts::{SQRT_2, TAU};

use rand::Rng;

use crate::random::{Stream, gauss};

/// The number of cosines: the sum of 48 cosines is close enough to Gaussian.
const WAVES: usize = 48;

/// A field of zero mean.
#[derive(Clone, Debug)]
pub(super) struct Field {
    scale_db: f64,
    /// Wave vector, radians per metre, and phase.
    waves: [([f64; 2], f64); WAVES],
}

impl Field {
    /// A field with this standard deviation whose correlation is 1/e at the distance `length_m`.
    pub(super) fn draw(sigma_db: f64, length_m: f64, draws: &mut Stream) -> Self {
        let waves = std::array::from_fn(|_| {
            // A Cauchy vector is a Gaussian vector divided by the magnitude of another Gaussian number.
            let spread = 1.0 / (length_m * gauss(draws).abs().max(1e-9));
            ([spread * gauss(draws), spread * gauss(draws)], draws.random_range(0.0..TAU))
        });
        Self { scale_db: sigma_db * SQRT_2 / (WAVES as f64).sqrt(), waves }
    }

    /// The field's value at a position of the floor plan, dB.
    pub(super) fn at(&self, place: [f64; 3]) -> f64 {
        let sum: f64 = self.waves.iter().map(|([kx, ky], phase)| (kx * place[0] + ky * place[1] + phase).cos()).sum();
        self.scale_db * sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Purpose, stream};

    /// Mean product of the values of 4000 fields at two positions `apart_m` from each other, dB².
    fn covariance(apart_m: f64) -> f64 {
        let fields = (0..4000_u64).map(|index| Field::draw(3.0, 2.0, &mut stream(5, Purpose::Shadowing, index)));
        fields
            .map(|field| field.at([7.0, 3.0, 1.0]) * field.at([7.0 + 0.6 * apart_m, 3.0 + 0.8 * apart_m, 0.0]))
            .sum::<f64>()
            / 4000.0
    }

    #[test]
    fn levels_are_alike_nearby_as_gudmundson_has_it() {
        // 3² = 9 dB²; 9 e^-0.5 = 5.459 at 1 m, 9 e^-1 = 3.311 at 2 m, 9 e^-4 = 0.165 at 8 m. The mean of 4000 products
        // of such numbers has an error of √2 · 9 ⁄ √4000 = 0.20 at most (1σ).
        for (apart_m, expected) in [(0.0, 9.0), (1.0, 5.459), (2.0, 3.311), (8.0, 0.165)] {
            assert!((covariance(apart_m) - expected).abs() < 0.6, "{apart_m} m: {}", covariance(apart_m));
        }
    }
}
