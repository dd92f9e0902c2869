//! Random numbers for particles: repeatable, fast, and good enough for them.

use crate::Real;

/// The sum of four uniform numbers from 0 to 2¹⁶ − 1 has the deviation √((2³² − 1) ⁄ 3) = 37,837.227.
const UNIT: f64 = 1.0 / 37_837.227;

/// A permuted congruential generator (M. O'Neill, PCG-XSH-RR 64 ⁄ 32).
#[derive(Clone, Debug)]
pub(super) struct Random {
    state: u64,
}

impl Random {
    pub(super) fn new(seed: u64) -> Self {
        let mut random = Self { state: seed.wrapping_add(0x853c_49e6_748f_ea9b) };
        random.word();
        random
    }

    fn word(&mut self) -> u32 {
        let old = self.state;
        self.state = old.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((((old >> 18) ^ old) >> 27) as u32).rotate_right((old >> 59) as u32)
    }

    /// Uniform from 0 up to, but without, 1.
    pub(super) fn uniform<T: Real>(&mut self) -> T {
        T::count((self.word() >> 8) as usize) * T::of(1.0 / 16_777_216.0)
    }

    /// Nearly normal, of mean 0 and variance 1, within ±3.5: the sum of four uniform numbers.
    pub(super) fn normal<T: Real>(&mut self) -> T {
        let (a, b) = (self.word(), self.word());
        let sum = (a & 0xffff) + (a >> 16) + (b & 0xffff) + (b >> 16);
        // Its mean is 4 · 65,535 ⁄ 2.
        (T::count(sum as usize) - T::of(131_070.0)) * T::of(UNIT)
    }
}

#[cfg(test)]
mod tests {
    use super::Random;

    #[test]
    fn the_moments_are_those_of_a_normal_number() {
        let mut random = Random::new(3);
        let draws: std::vec::Vec<f64> = (0..100_000).map(|_| random.normal()).collect();
        let mean = draws.iter().sum::<f64>() / 1e5;
        let variance = draws.iter().map(|x| x * x).sum::<f64>() / 1e5;
        // Deviations of the two over 100,000 draws: 0.003 and less than 0.0045.
        assert!(mean.abs() < 0.015 && (variance - 1.0).abs() < 0.02, "{mean} {variance}");
    }

    #[test]
    fn uniform_numbers_stay_below_one_and_fill_the_unit() {
        let mut random = Random::new(4);
        let draws: std::vec::Vec<f32> = (0..10_000).map(|_| random.uniform()).collect();
        assert!(draws.iter().all(|x| (0.0..1.0).contains(x)));
        // A tenth of them in each tenth: 1000 ± 30.
        for tenth in 0..10 {
            let range = tenth as f32 / 10.0..(tenth + 1) as f32 / 10.0;
            let count = draws.iter().filter(|x| range.contains(*x)).count();
            assert!(count.abs_diff(1000) < 150, "{count}");
        }
    }
}
