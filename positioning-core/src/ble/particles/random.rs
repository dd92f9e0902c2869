//! Random numbers at a low cost for a node: M. O'Neill's PCG-XSH-RR of 32 bits (*PCG: A Family of Simple Fast
//! Space-Efficient Statistically Good Algorithms for Random Number Generation*, Harvey Mudd College, 2014). The same
//! seed gives the same numbers.

use rand_pcg::Lcg64Xsh32;
use rand_pcg::rand_core::RngCore;

use crate::Real;

/// The state of a stream of random numbers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Random(Lcg64Xsh32);

/// PCG's default increment, 1442695040888963407, as `rand_pcg` takes it: halved.
const STREAM: u64 = 721_347_520_444_481_703;

impl Random {
    /// A separate stream for every seed.
    pub fn new(seed: u64) -> Self {
        Self(Lcg64Xsh32::new(seed, STREAM))
    }

    /// 32 random bits.
    #[inline]
    pub fn bits(&mut self) -> u32 {
        self.0.next_u32()
    }

    /// A number from 0 to below 1, in steps of 2⁻²⁴.
    #[inline]
    pub fn uniform<T: Real>(&mut self) -> T {
        T::count((self.bits() >> 8) as usize) * T::of(1.0 / 16_777_216.0)
    }

    /// A number of mean 0 and variance 1, as the sum of four uniform ones. The distribution ends at ±3.46 and has a
    /// kurtosis of 2.7, where the normal one has 3. It is for noise, where neither matters.
    #[inline]
    pub fn normal<T: Real>(&mut self) -> T {
        let (a, b) = (self.bits(), self.bits());
        let sum = (a & 0xffff) + (a >> 16) + (b & 0xffff) + (b >> 16);
        // Mean 4 · 65535 ⁄ 2; deviation 65536 √(4 ⁄ 12).
        (T::count(sum as usize) - T::of(131_070.0)) * T::of(1.0 / 37_837.23)
    }
}

#[cfg(test)]
mod tests {
    use super::Random;

    #[test]
    fn the_stream_is_that_of_the_paper() {
        // Computed separately from PCG-XSH-RR as the paper prints it: state = increment + 7, one step, then the
        // output of the old state of each step.
        let mut random = Random::new(7);
        assert_eq!([0, 1, 2, 3].map(|_: i32| random.bits()), [0x4be7_88d7, 0xfa6a_c9dc, 0x68ef_91ea, 0xe32a_3f28]);
    }

    #[test]
    fn moments_are_those_of_their_distributions() {
        let mut random = Random::new(1);
        let count = 100_000;
        let (mut normal, mut uniform) = ([0.0_f64; 3], 0.0_f64);
        for _ in 0..count {
            let x = random.normal::<f64>();
            normal = [normal[0] + x, normal[1] + x * x, normal[2].max(x.abs())];
            uniform += random.uniform::<f64>();
        }
        let count = f64::from(count);
        // Five standard errors: 5 ⁄ √100000 = 0.016, of the variance √1.7 times as much, of the uniform 0.289 times.
        assert!((normal[0] / count).abs() < 0.016 && (normal[1] / count - 1.0).abs() < 0.021, "{normal:?}");
        assert!(normal[2] <= 3.4642 && (uniform / count - 0.5).abs() < 0.005, "{normal:?} {uniform}");
    }
}
