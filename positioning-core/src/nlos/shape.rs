//! The shape of one channel impulse response: the properties that do not depend on the strength of the signal or on
//! its distance.
//!
//! **The window.** García et al. take the skewness over 201 samples of 0.2 ns: 40 ns centred on the maximum. The
//! accumulator of a DW1000 has samples of 1.0016 ns. Of these, [`WINDOW`] samples are read, from [`BEFORE`] samples
//! ahead of the first path: reading all 1016 takes 2 ms of a bus at 16 MHz. The widest window centred on the maximum
//! that is always within these samples has 16 samples on either side, 33 ns: [`NEAR`]. This holds for every position
//! of the maximum behind the first path. Recorded responses confirm the choice: with 14 to 17 samples on either side
//! the skewness classifies best. Over all 152 samples it classifies worse, because their tail is mostly noise.

use crate::Real;

/// The number of samples of the accumulator that are read.
pub const WINDOW: usize = 152;
/// The number of them before the sample of the first path.
pub const BEFORE: usize = 16;
/// The number of samples on either side of the maximum for [`Shape::skewness_near`].
pub const NEAR: usize = 16;
/// The time between two samples, nanoseconds: half a period of 499.2 MHz.
pub const SAMPLE_NS: f32 = 1.001_602_6;

/// Samples below this part of the maximum do not count for delays: −20 dB, above the noise of any received frame.
const DELAY_FLOOR: f32 = 0.1;
/// The number of bits of a sample that moments use: noise is about forty steps of them.
const BITS: u32 = 12;
/// The rise goes from this part of the maximum to this one.
const RISE: [f32; 2] = [0.1, 0.9];

/// The magnitude of one sample of the accumulator, rounded.
#[inline]
pub fn magnitude(i: i16, q: i16) -> u16 {
    let (i, q) = (i32::from(i), i32::from(q));
    // The sum of two squares of at most 2³⁰ each is at most 2³¹, which fits in an unsigned number. The root is at
    // most 46,341.
    let square = (i * i) as u32 + (q * q) as u32;
    (Real::sqrt(square as f32) + 0.5) as u16
}

/// The shape of a channel impulse response. All members are finite.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Shape {
    /// E[(c − µ)³]/E[(c − µ)²]^(3/2) of the magnitudes c of the whole window (García et al., equation 2).
    pub skewness: f32,
    /// E[(c − µ)⁴]/E[(c − µ)²]² of the whole window (Marano et al.); 3 for a normal distribution.
    pub kurtosis: f32,
    /// The skewness of [`NEAR`] samples on either side of the maximum.
    pub skewness_near: f32,
    /// The kurtosis of [`NEAR`] samples on either side of the maximum.
    pub kurtosis_near: f32,
    /// The time from the first path to the maximum, nanoseconds; slightly below zero where the maximum is the first
    /// path (APS006-3 has the distance in samples).
    pub first_path_to_peak_ns: f32,
    /// The largest magnitude of the three samples after the first path's, as a part of the maximum.
    pub first_path_ratio: f32,
    /// The time from the first sample of a tenth of the maximum to the first sample of nine tenths, nanoseconds
    /// (Marano et al., with both thresholds relative to the maximum, so that the signal strength does not matter).
    pub rise_time_ns: f32,
    /// Mean of the delay after the first path, weighted with power, nanoseconds (Marano et al.). Only samples from
    /// the first path on and above a tenth of the maximum count.
    pub mean_excess_delay_ns: f32,
    /// Standard deviation of the delay, with the same weights, nanoseconds (Marano et al.).
    pub rms_delay_spread_ns: f32,
}

impl Shape {
    /// The shape of the magnitudes in `window`. `first_path` is the index of the first path (from 0, with a
    /// fraction). Returns `None` where there is no shape: fewer than eight samples or more than [`WINDOW`], all
    /// samples equal (silent, or all saturated), or a first path outside the window.
    #[inline(never)] // So that it has the optimisation level of this crate, also in an image optimised for size.
    pub fn of(window: &[u16], first_path: f32) -> Option<Self> {
        let inside = (0.0..window.len() as f32).contains(&first_path);
        if !inside || !(8..=WINDOW).contains(&window.len()) {
            return None;
        }
        let (mut peak_at, mut peak) = (0, 0);
        for (at, &sample) in window.iter().enumerate() {
            if sample > peak {
                (peak_at, peak) = (at, sample);
            }
        }
        // Sums of integers, also without an FPU: 152 squares of 12 bits fit in 32 bits, fourth powers in 64.
        let shift = (u16::BITS - peak.leading_zeros()).saturating_sub(BITS);
        let [skewness, kurtosis] = skewness_and_kurtosis(window, shift)?;
        let near = window.get(peak_at.saturating_sub(NEAR)..window.len().min(peak_at + NEAR + 1))?;
        let [skewness_near, kurtosis_near] = skewness_and_kurtosis(near, shift)?;

        let first = first_path as usize;
        let direct = window.iter().skip(first + 1).take(3).max().copied().unwrap_or(0);
        let peak_level = f32::from(peak);
        let reaches = |part: f32| {
            let level = peak_level * part;
            window.iter().position(|&sample| f32::from(sample) >= level).unwrap_or(peak_at)
        };
        let [mean_excess_delay_ns, rms_delay_spread_ns] = delays(window, first_path, peak, shift);
        Some(Self {
            skewness,
            kurtosis,
            skewness_near,
            kurtosis_near,
            first_path_to_peak_ns: (peak_at as f32 - first_path) * SAMPLE_NS,
            first_path_ratio: f32::from(direct) / peak_level,
            rise_time_ns: reaches(RISE[1]).saturating_sub(reaches(RISE[0])) as f32 * SAMPLE_NS,
            mean_excess_delay_ns,
            rms_delay_spread_ns,
        })
    }
}

/// Third and fourth standardised moments of the samples without their lowest `shift` bits; `None` where all samples
/// are equal.
#[inline(never)] // A second copy of the code would gain nothing.
fn skewness_and_kurtosis(samples: &[u16], shift: u32) -> Option<[f32; 2]> {
    let count = samples.len() as i32;
    let sum: i32 = samples.iter().map(|&sample| i32::from(sample >> shift)).sum();
    // Powers of the deviations from the integer nearest to the mean, exactly. The difference to the mean is corrected
    // below.
    let middle = (sum + count / 2) / count;
    let (mut second, mut third, mut fourth) = (0_u32, 0_i64, 0_u64);
    for &sample in samples {
        let deviation = i32::from(sample >> shift) - middle;
        let square = deviation * deviation;
        second += square as u32;
        third += i64::from(square) * i64::from(deviation);
        fourth += u64::from(square as u32) * u64::from(square as u32);
    }
    if second == 0 {
        return None;
    }
    let n = count as f32;
    let rest = (sum - middle * count) as f32 / n;
    let [m2, m3, m4] = [second as f32 / n, third as f32 / n, fourth as f32 / n];
    let square = rest * rest;
    let variance = m2 - square;
    let third = m3 - rest * (3.0 * m2 - 2.0 * square);
    let fourth = m4 - rest * (4.0 * m3 - rest * (6.0 * m2 - 3.0 * square));
    Some([third / (variance * Real::sqrt(variance)), fourth / (variance * variance)])
}

/// Mean and deviation of the delay after the first path, nanoseconds, over the samples without their lowest `shift`
/// bits; zeros where no sample after the first path reaches the floor.
fn delays(window: &[u16], first_path: f32, peak: u16, shift: u32) -> [f32; 2] {
    let floor = (f32::from(peak) * DELAY_FLOOR) as u16;
    let first = first_path as usize;
    let (mut power, mut once, mut twice) = (0_u32, 0_u64, 0_u64);
    for (delay, &sample) in (0_u32..).zip(window.iter().skip(first)) {
        if sample > floor {
            let sample = u32::from(sample >> shift);
            let square = sample * sample;
            power += square;
            once += u64::from(square) * u64::from(delay);
            twice += u64::from(square) * u64::from(delay * delay);
        }
    }
    if power == 0 {
        return [0.0; 2];
    }
    let power = power as f32;
    let mean = once as f32 / power;
    let variance = (twice as f32 / power - mean * mean).at_least(0.0);
    // Sample `first` is ahead of the first path by the fraction of its index.
    [(mean - (first_path - first as f32)) * SAMPLE_NS, Real::sqrt(variance) * SAMPLE_NS]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(found: f32, expected: f32) {
        assert!((found - expected).abs() <= 2.0e-5 * expected.abs().max(1.0), "{found} is not {expected}");
    }

    #[test]
    fn magnitudes_are_rounded_roots() {
        // √(3² + 4²) = 5; √2 = 1.41; √8 = 2.83; 32768·√2 = 46340.95.
        assert_eq!(magnitude(3, -4), 5);
        assert_eq!([magnitude(1, 1), magnitude(-2, 2), magnitude(0, 0)], [1, 3, 0]);
        assert_eq!(magnitude(i16::MIN, i16::MIN), 46_341);
    }

    #[test]
    fn moments_are_those_of_a_hand_calculation() {
        // 0 0 0 0 0 0 0 80: mean 10; deviations −10 (7×), 70.
        // m2 = (7·100 + 4900)/8 = 700; m3 = (−7·1000 + 343000)/8 = 42000; m4 = (7·10⁴ + 2401·10⁴)/8 = 3.01·10⁶.
        // skewness = 42000/700^1.5 = 42000/18520.26 = 2.267787; kurtosis = 3.01·10⁶/4.9·10⁵ = 6.142857.
        let shape = Shape::of(&[0, 0, 0, 0, 0, 0, 0, 80], 5.0).expect("a shape");
        close(shape.skewness, 2.267_787);
        close(shape.kurtosis, 6.142_857);
        // All samples are within 16 samples of the maximum.
        close(shape.skewness_near, 2.267_787);
        close(shape.kurtosis_near, 6.142_857);
    }

    #[test]
    fn moments_are_those_of_the_definition_in_doubles() {
        // Equation 2 and the same with fourth powers, as they are written, over windows of every strength.
        let mut random = uniform(9);
        for scale in [3, 40, 700, 9000, 65535] {
            let window: [u16; WINDOW] = core::array::from_fn(|_| (random() * random() * f64::from(scale)) as u16);
            let shape = Shape::of(&window, 16.0).expect("a shape");
            let mean = |power: i32, about: f64| {
                window.iter().map(|&c| (f64::from(c) - about).powi(power)).sum::<f64>() / WINDOW as f64
            };
            let mu = mean(1, 0.0);
            let (skewness, kurtosis) = (mean(3, mu) / mean(2, mu).powf(1.5), mean(4, mu) / mean(2, mu).powi(2));
            assert!(
                (f64::from(shape.skewness) / skewness - 1.0).abs() < 1e-3,
                "{scale}: {} {skewness}",
                shape.skewness
            );
            assert!(
                (f64::from(shape.kurtosis) / kurtosis - 1.0).abs() < 1e-3,
                "{scale}: {} {kurtosis}",
                shape.kurtosis
            );
        }
    }

    /// Random numbers below one.
    fn uniform(seed: u64) -> impl FnMut() -> f64 {
        use rand::{Rng, SeedableRng};
        let mut random = rand_pcg::Pcg32::seed_from_u64(seed);
        move || random.random::<f64>()
    }

    #[test]
    fn only_samples_near_the_maximum_count_for_the_near_moments() {
        // One sample of 41 is not zero, and one of the 33 near it. One in n, p = 1/n, has the skewness (1 − 2p)/√(p(1
        // − p)).
        let mut window = [0; 41];
        window[20] = 1000;
        let shape = Shape::of(&window, 16.0).expect("a shape");
        // √(p(1 − p)) for p = 1/33: √(32)/33 = 0.1714195; 0.9393939/0.1714195 = 5.480078.
        close(shape.skewness_near, 5.480_078);
        // p = 1/41: √40/41 = 0.1542574; (39/41)/0.1542574 = 6.166441.
        close(shape.skewness, 6.166_441);
    }

    #[test]
    fn delays_are_those_of_a_hand_calculation() {
        // First path at 2.5; samples 3: 100, 4: 0, 5: 200 (maximum), 6: 10 (below a tenth of 200: does not count).
        let shape = Shape::of(&[0, 0, 0, 100, 0, 200, 10, 0, 0, 0], 2.5).expect("a shape");
        // Power 1·10⁴ at 3 and 4·10⁴ at 5: mean 3·0.2 + 5·0.8 = 4.6, 2.1 samples behind 2.5: 2.1·1.0016026 = 2.1033655
        // ns.
        close(shape.mean_excess_delay_ns, 2.103_365_5);
        // Variance 0.2·1.6² + 0.8·0.4² = 0.64, deviation 0.8 samples: 0.8012821 ns.
        close(shape.rms_delay_spread_ns, 0.801_282_1);
        // Maximum 2.5 samples behind the first path: 2.5040065 ns; the larger of samples 3, 4, 5 is the maximum itself.
        close(shape.first_path_to_peak_ns, 2.504_006_5);
        close(shape.first_path_ratio, 1.0);
        // A tenth of 200 is first reached at 3, nine tenths at 5: 2 samples, 2.0032052 ns.
        close(shape.rise_time_ns, 2.003_205_2);
    }

    #[test]
    fn a_weak_first_path_shows_in_its_ratio() {
        // Samples 2, 3, 4 after the first path at 1.2: 30, 50, 20; maximum 400 at 7: 50/400.
        let shape = Shape::of(&[0, 10, 30, 50, 20, 0, 0, 400, 0, 0], 1.2).expect("a shape");
        close(shape.first_path_ratio, 0.125);
    }

    #[test]
    fn strength_does_not_matter() {
        let weak: [u16; 12] = [3, 1, 4, 1, 59, 26, 53, 58, 9, 7, 9, 3];
        let strong = weak.map(|sample| sample * 700);
        let (weak, strong) = (Shape::of(&weak, 3.5).expect("a shape"), Shape::of(&strong, 3.5).expect("a shape"));
        // The strong response, of at most 41,300, has lost its four lowest bits.
        let near = |strong: f32, weak: f32| assert!((strong / weak - 1.0).abs() < 2.0e-3, "{strong} is not {weak}");
        near(strong.skewness, weak.skewness);
        near(strong.kurtosis, weak.kurtosis);
        near(strong.rms_delay_spread_ns, weak.rms_delay_spread_ns);
        near(strong.mean_excess_delay_ns, weak.mean_excess_delay_ns);
        assert_eq!((strong.rise_time_ns, strong.first_path_ratio), (weak.rise_time_ns, weak.first_path_ratio));
    }

    #[test]
    fn what_has_no_shape_has_none() {
        assert_eq!(Shape::of(&[], 0.0), None);
        assert_eq!(Shape::of(&[1, 2, 3], 1.0), None);
        assert_eq!(Shape::of(&[0; WINDOW], 16.5), None);
        assert_eq!(Shape::of(&[u16::MAX; WINDOW], 16.5), None);
        let window: [u16; WINDOW] = core::array::from_fn(|at| at as u16 * 7 % 31);
        for first_path in [f32::NAN, -1.0, 152.0, f32::INFINITY, f32::NEG_INFINITY] {
            assert_eq!(Shape::of(&window, first_path), None);
        }
    }

    #[test]
    fn hostile_windows_give_finite_shapes() {
        let finite = |shape: Shape| {
            [
                shape.skewness,
                shape.kurtosis,
                shape.skewness_near,
                shape.kurtosis_near,
                shape.first_path_to_peak_ns,
                shape.first_path_ratio,
                shape.rise_time_ns,
                shape.mean_excess_delay_ns,
                shape.rms_delay_spread_ns,
            ]
            .iter()
            .all(|member| member.is_finite())
        };
        let mut shapes = 0;
        for saturated in 0..=WINDOW {
            for first_path in [0.0, 16.3, 151.9] {
                let window: [u16; WINDOW] = core::array::from_fn(|at| if at < saturated { u16::MAX } else { 0 });
                let reversed: [u16; WINDOW] = core::array::from_fn(|at| window[WINDOW - 1 - at]);
                for shape in [window, reversed].iter().filter_map(|window| Shape::of(window, first_path)) {
                    assert!(finite(shape), "{shape:?}");
                    shapes += 1;
                }
            }
        }
        // Half of the saturated windows have only saturated samples near the maximum.
        assert!(shapes > 300, "{shapes}");
    }
}
