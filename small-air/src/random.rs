//! Pseudo-random numbers that are the same on every machine: PCG-XSH-RR 64/32 (O'Neill, 2014).

/// A generator.
#[derive(Clone, Debug)]
pub struct Random(u64);

impl Random {
    /// The sequence of a seed.
    pub const fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(2).wrapping_add(0x9E37_79B9_7F4A_7C15))
    }

    fn next(&mut self) -> u32 {
        let state = self.0;
        self.0 = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        let mixed = ((state >> 18 ^ state) >> 27) as u32;
        mixed.rotate_right((state >> 59) as u32)
    }

    /// Returns true with a probability of `per_mille` in a thousand.
    pub fn happens(&mut self, per_mille: u32) -> bool {
        self.next() % 1000 < per_mille
    }

    /// A nearly normal number with this standard deviation in thousandths, rounded: the sum of twelve uniform numbers.
    pub fn normal(&mut self, deviation_thousandths: i64) -> i64 {
        let sum: i64 = (0..12).map(|_| i64::from(self.next() >> 16)).sum();
        // Each uniform number has the variance 2³²/12. The standard deviation of the sum is 65 536.
        let value = (sum - 6 * 65_535) * deviation_thousandths;
        let half = if value < 0 { -32_768_000 } else { 32_768_000 };
        (value + half) / 65_536_000
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_those_of_the_normal_distribution() {
        let mut random = Random::new(1);
        let values: std::vec::Vec<f64> = (0..20_000).map(|_| random.normal(6_400_000) as f64).collect();
        let mean = values.iter().sum::<f64>() / 20_000.0;
        let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / 20_000.0;
        // The standard deviation of the mean is 6400 / √20 000 = 45; that of the deviation is 6400 / √40 000 = 32.
        assert!(mean.abs() < 180.0, "{mean}");
        assert!((variance.sqrt() - 6400.0).abs() < 130.0, "{}", variance.sqrt());
    }

    #[test]
    fn things_happen_as_often_as_told() {
        let mut random = Random::new(2);
        let times = (0..100_000).filter(|_| random.happens(20)).count();
        // 2000 ± 4 · √1960.
        assert!((1823..2177).contains(&times), "{times}");
    }
}
