//! A random field over the floor plan: an RSSI in dB that belongs to a place, alike nearby and independent far off.
//!
//! Its correlation falls as e^(−d ⁄ length), which is what M. Gudmundson measured of shadowing (*Correlation model for shadow fading in
//! mobile radio systems*, Electronics Letters 27(23), 1991). It is a sum of cosines whose wave vectors are drawn from the correlation's
//! spectrum, in the plane a Cauchy distribution (A. Rahimi and B. Recht, *Random features for large-scale kernel machines*, 2007): a
//! function of the place, so that a tag that comes back finds what it left.

use std::f64::consts::{SQRT_2, TAU};

use rand::Rng;
use rand_distr::{Distribution, StandardNormal};

use crate::random::Stream;

/// How many cosines: the sum of so many is as good as Gaussian.
const WAVES: usize = 48;

/// A field of zero mean.
#[derive(Clone, Debug)]
pub(super) struct Field {
    scale_db: f64,
    /// Wave vector, radians a metre, and phase.
    waves: [([f64; 2], f64); WAVES],
}

impl Field {
    /// A field of this deviation that forgets two thirds of itself within `length_m`.
    pub(super) fn draw(sigma_db: f64, length_m: f64, draws: &mut Stream) -> Self {
        let gauss = |draws: &mut Stream| -> f64 { StandardNormal.sample(draws) };
        let waves = std::array::from_fn(|_| {
            // A Cauchy vector is a Gaussian one over the magnitude of one more Gaussian.
            let spread = 1.0 / (length_m * gauss(draws).abs().max(1e-9));
            ([spread * gauss(draws), spread * gauss(draws)], draws.random_range(0.0..TAU))
        });
        Self { scale_db: sigma_db * SQRT_2 / (WAVES as f64).sqrt(), waves }
    }

    /// Its RSSI at a place of the floor plan, dB.
    pub(super) fn at(&self, place: [f64; 3]) -> f64 {
        let sum: f64 = self.waves.iter().map(|([kx, ky], phase)| (kx * place[0] + ky * place[1] + phase).cos()).sum();
        self.scale_db * sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Purpose, stream};

    /// Mean product of the RSSI values of 4000 fields at two places so far apart, dB².
    fn covariance(apart_m: f64) -> f64 {
        let fields = (0..4000_u64).map(|index| Field::draw(3.0, 2.0, &mut stream(5, Purpose::Shadowing, index)));
        fields
            .map(|field| field.at([7.0, 3.0, 1.0]) * field.at([7.0 + 0.6 * apart_m, 3.0 + 0.8 * apart_m, 0.0]))
            .sum::<f64>()
            / 4000.0
    }

    #[test]
    fn levels_are_alike_nearby_as_gudmundson_has_it() {
        // 3² = 9 dB², at 1 m 9 e^-0.5 = 5.459, at 2 m 9 e^-1 = 3.311, at 8 m 9 e^-4 = 0.165; the mean of 4000 products of such
        // numbers errs by √2 · 9 ⁄ √4000 = 0.20 at most (1σ).
        for (apart_m, expected) in [(0.0, 9.0), (1.0, 5.459), (2.0, 3.311), (8.0, 0.165)] {
            assert!((covariance(apart_m) - expected).abs() < 0.6, "{apart_m} m: {}", covariance(apart_m));
        }
    }
}
