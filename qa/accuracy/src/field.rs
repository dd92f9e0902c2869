//! Gaussian fields: errors that change smoothly with the position.

use rand::Rng;

use crate::draw::{normal, uniform};

/// Number of waves in a field.
const WAVES: usize = 40;

/// A Gaussian field over D coordinates, of mean 0, variance 1 and the correlation exp(−d² ⁄ 2 l²): a sum of waves.
pub struct Field<const D: usize>(Vec<([f64; D], f64)>);

impl<const D: usize> Field<D> {
    /// Draws a field of this correlation length, metres.
    pub fn draw(random: &mut impl Rng, length_m: f64) -> Self {
        let wave = |random: &mut _| {
            let vector = std::array::from_fn(|_| normal(random) / length_m);
            (vector, uniform(random) * std::f64::consts::TAU)
        };
        Self((0..WAVES).map(|_| wave(random)).collect())
    }

    /// Its value at a position: a normal number.
    pub fn at(&self, place: &[f64; D]) -> f64 {
        let along = |vector: &[f64; D]| vector.iter().zip(place).map(|(a, b)| a * b).sum::<f64>();
        let sum: f64 = self.0.iter().map(|(vector, phase)| (along(vector) + phase).cos()).sum();
        sum * (2.0 / WAVES as f64).sqrt()
    }

    /// The same as a uniform number, 0 to 1: the distribution function of a normal number makes it uniform.
    pub fn share_at(&self, place: &[f64; D]) -> f64 {
        0.5 * libm::erfc(-self.at(place) / std::f64::consts::SQRT_2)
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_pcg::Pcg64Mcg;

    use super::Field;

    #[test]
    fn values_one_length_apart_have_the_correlation_that_is_stated() {
        let random = &mut Pcg64Mcg::seed_from_u64(1);
        let (mut square, mut product, mut share) = (0.0, 0.0, 0.0);
        let count = 4000;
        for _ in 0..count {
            let field = Field::draw(random, 0.5);
            let (here, there) = (field.at(&[1.0, 2.0, 0.5]), field.at(&[1.3, 2.4, 0.5]));
            square += here * here;
            product += here * there;
            share += field.share_at(&[1.0, 2.0, 0.5]);
        }
        let mean = |sum: f64| sum / f64::from(count);
        // exp(−½) = 0.607; the deviation of a mean of 4000 products is 0.02.
        assert!((mean(square) - 1.0).abs() < 0.08, "{}", mean(square));
        assert!((mean(product) - 0.607).abs() < 0.08, "{}", mean(product));
        assert!((mean(share) - 0.5).abs() < 0.02, "{}", mean(share));
    }
}
