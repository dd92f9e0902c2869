//! The likelihood of the difference between the mean of a node's fresh values and the value expected at a distance:
//! the mixture's product, marginalised over the bias, as a table.

use super::window::Mixture;
use positioning_core::Real;

/// Knots of a table.
pub(super) const KNOTS: usize = 64;
/// A table reaches to this number of deviations on each side.
const REACH: f64 = 4.5;
/// A bell whose centre lies more than this number of deviations outside the table is left out.
const OUTSIDE: f64 = 6.0;
/// The probability that a value is an outlier.
const STRAY: f64 = 0.01;
/// A Gaussian counts as zero beyond this number of deviations.
const NOTHING: f64 = 4.0;

/// Densities over the difference x of mean and expectation. Between knots they are linear; beyond the last they fall
/// with 1 ⁄ x².
#[derive(Clone, Debug)]
pub(super) struct Likelihood<T> {
    direct: [T; KNOTS],
    blocked: [T; KNOTS],
    half: T,
    inverse_step: T,
    /// 1 ⁄ the mean excess of a blocked link; 0 where links cannot be blocked.
    decay: T,
}

impl<T: Real> Likelihood<T> {
    /// The likelihood of a mixture, for a bias of this variance and, on a blocked link, an additional excess of the
    /// mean `excess`.
    #[inline(never)]
    pub(super) fn new(mixture: &Mixture<T>, bias_variance: T, excess: Option<T>) -> Self {
        let count = T::count(mixture.fresh.len().max(1));
        let variance = mixture.variance / count;
        let half = T::of(REACH) * (variance + bias_variance).sqrt();
        let step = half * T::of(2.0 / (KNOTS - 1) as f64);
        // Where the bias is far wider than the values, the values are only a spike between two knots. The width must
        // not be less than the knots can represent.
        let width = mixture.width.at_least(step * count.sqrt() * T::of(0.7));
        let mut product = [T::ONE; KNOTS];
        for &fresh in &mixture.fresh {
            let mut density = [T::ZERO; KNOTS];
            for &kernel in &mixture.kernels {
                // The kernel relative to the mean; `fresh` is the offset of this value.
                add_bell(&mut density, kernel - fresh + half, step, width);
            }
            scale_to_peak(&mut density);
            product.iter_mut().zip(&density).for_each(|(p, &d)| *p *= d);
            scale_to_peak(&mut product);
        }
        let direct = smooth(&product, bias_variance.sqrt() / step);
        let mut this = Self {
            direct,
            blocked: [T::ZERO; KNOTS],
            half,
            inverse_step: T::ONE / step,
            decay: excess.map_or(T::ZERO, |excess| T::ONE / excess),
        };
        this.normalise(step);
        this
    }

    /// Scales to unit areas, computes the blocked density, and adds the outliers.
    fn normalise(&mut self, step: T) {
        let area = self.direct.iter().fold(T::ZERO, |sum, &d| sum + d) * step;
        let scale = if area > T::ZERO { T::ONE / area } else { T::ZERO };
        let kept = (-self.decay * step).exp();
        let fresh = T::of(0.5) * self.decay * step;
        let stray = T::of(STRAY / 2.0) / self.half;
        let (mut before, mut sum) = (T::ZERO, T::ZERO);
        for (direct, blocked) in self.direct.iter_mut().zip(&mut self.blocked) {
            let density = *direct * scale;
            // ∫ direct(x − b) λ⁻¹ exp(−b ⁄ λ) db, knot by knot.
            sum = kept * (sum + fresh * before) + fresh * density;
            before = density;
            *direct = density + stray;
            *blocked = sum + stray;
        }
    }

    /// Density of x on a direct link.
    #[inline(always)]
    pub(super) fn direct(&self, x: T) -> T {
        match self.knot(x) {
            Ok((knot, part)) => between(&self.direct, knot, part),
            Err(end) => self.direct.get(end).copied().unwrap_or(T::ZERO) * (self.half / x).squared(),
        }
    }

    /// Densities of x on a direct and on a blocked link.
    #[inline(always)]
    pub(super) fn both(&self, x: T) -> [T; 2] {
        match self.knot(x) {
            Ok((knot, part)) => [between(&self.direct, knot, part), between(&self.blocked, knot, part)],
            Err(end) => {
                let far = (self.half / x).squared();
                let [direct, blocked] = [&self.direct, &self.blocked].map(|t| t.get(end).copied().unwrap_or(T::ZERO));
                let tail = if end == 0 { T::ZERO } else { blocked * (-self.decay * (x - self.half)).exp() };
                [direct * far, tail.at_least(direct * far)]
            }
        }
    }

    /// The knot below x and the part of the way to the next, or the table's end beyond which x lies.
    #[inline(always)]
    fn knot(&self, x: T) -> Result<(usize, T), usize> {
        let place = (x + self.half) * self.inverse_step;
        if !(place >= T::ZERO) {
            return Err(0);
        }
        let knot = place.truncated() as usize;
        if knot >= KNOTS - 1 { Err(KNOTS - 1) } else { Ok((knot, place - T::count(knot))) }
    }
}

#[inline(always)]
fn between<T: Real>(table: &[T; KNOTS], knot: usize, part: T) -> T {
    match table.get(knot..knot + 2) {
        Some(&[low, high]) => low + part * (high - low),
        Some(_) | None => T::ZERO,
    }
}

/// Adds exp(−(k·step − middle)² ⁄ 2 width²) to every knot k, with three exponentials, and two products a knot.
fn add_bell<T: Real>(table: &mut [T; KNOTS], middle: T, step: T, width: T) {
    let unit = step / width;
    let nearest = ((middle / step + T::of(0.5)).at_least(T::ZERO).truncated() as usize).min(KNOTS - 1);
    let z = T::count(nearest) * unit - middle / width;
    if z.abs() > T::of(OUTSIDE) {
        return;
    }
    let half = T::of(0.5);
    let curve = (-unit.squared()).exp();
    let peak = (-half * z.squared()).exp();
    // From knot to knot the bell changes by a ratio; the ratio changes by `curve`.
    let mut up = (-z * unit - half * unit.squared()).exp();
    let mut down = (z * unit - half * unit.squared()).exp();
    let (below, above) = table.split_at_mut(nearest);
    let mut bell = peak;
    for knot in above {
        *knot += bell;
        bell *= up;
        up *= curve;
    }
    bell = peak * down;
    for knot in below.iter_mut().rev() {
        down *= curve;
        *knot += bell;
        bell *= down;
    }
}

fn scale_to_peak<T: Real>(table: &mut [T; KNOTS]) {
    let peak = table.iter().fold(T::ZERO, |peak, &d| peak.at_least(d));
    if peak > T::ZERO {
        let scale = T::ONE / peak;
        table.iter_mut().for_each(|d| *d *= scale);
    }
}

/// The table convolved with a Gaussian; its deviation is a number of knots.
fn smooth<T: Real>(table: &[T; KNOTS], deviation: T) -> [T; KNOTS] {
    let mut bell = [T::ZERO; KNOTS];
    if deviation < T::of(0.1) {
        return *table;
    }
    add_bell(&mut bell, T::ZERO, T::ONE, deviation);
    let far = ((T::of(NOTHING) * deviation).truncated() as usize + 1).min(KNOTS - 1);
    let mut smoothed = [T::ZERO; KNOTS];
    let peak = table.iter().fold(T::ZERO, |peak, &d| peak.at_least(d));
    for (from, &density) in table.iter().enumerate() {
        if density < peak * T::of(1e-6) {
            continue;
        }
        let low = from.saturating_sub(far);
        let down = smoothed.iter_mut().take(from).skip(low).rev().zip(bell.iter().skip(1));
        down.for_each(|(s, &b)| *s += density * b);
        let up = smoothed.iter_mut().skip(from).take(far + 1).zip(&bell);
        up.for_each(|(s, &b)| *s += density * b);
    }
    smoothed
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fusion::window::Window;

    const TAU: f64 = std::f64::consts::TAU;

    fn bell(x: f64, variance: f64) -> f64 {
        (-0.5 * x * x / variance).exp() / (TAU * variance).sqrt()
    }

    /// The sum of a Gaussian and an exponential number: (2λ)⁻¹ exp(σ² ⁄ 2λ² − x ⁄ λ) erfc((σ ⁄ λ − x ⁄ σ) ⁄ √2).
    fn late_bell(x: f64, variance: f64, mean: f64) -> f64 {
        let sigma = variance.sqrt();
        (0.5 * variance / mean.powi(2) - x / mean).exp() * libm::erfc((sigma / mean - x / sigma) / 2.0_f64.sqrt())
            / (2.0 * mean)
    }

    fn mixture(values: &[f32], noise: f32) -> Mixture<f32> {
        let mut window = Window::new();
        values.iter().for_each(|&value| window.push(value, 0, 1));
        window.mixture(noise).expect("fresh")
    }

    /// The greatest difference of table and reference between −`far` and `far`, relative to the reference's greatest
    /// value.
    fn worst(far: f64, table: impl Fn(f32) -> f32, reference: impl Fn(f64) -> f64) -> f64 {
        let places = || (-400..=400).map(|k| f64::from(k) * far / 400.0);
        let peak = places().map(&reference).fold(0.0, f64::max);
        places().map(|x| (f64::from(table(x as f32)) - reference(x)).abs()).fold(0.0, f64::max) / peak
    }

    #[test]
    fn one_power_and_a_gaussian_bias_are_a_gaussian() {
        // Variances 3² + 4² = 25, and outliers.
        let table = Likelihood::new(&mixture(&[-60.0], 3.0), 16.0, None);
        let stray = STRAY / 45.0;
        let worst = worst(20.0, |x| table.direct(x), |x| bell(x, 25.0) + stray);
        assert!(worst < 0.005, "{worst}");
    }

    #[test]
    fn one_delay_and_an_exponential_excess_are_their_closed_form() {
        let table = Likelihood::new(&mixture(&[5.0], 0.1), 0.03 * 0.03, Some(1.5));
        let variance = 0.01 + 0.0009;
        let stray = STRAY / (9.0 * variance.sqrt());
        let [direct, blocked] = [0, 1].map(|which| {
            worst(
                0.45,
                |x| table.both(x)[which],
                |x| stray + if which == 0 { bell(x, variance) } else { late_bell(x, variance, 1.5) },
            )
        });
        assert!(direct < 0.005, "{direct}");
        assert!(blocked < 0.02, "{blocked}");
        // Far beyond the table the excess still falls like its exponential: e⁻¹ in 1.5 m, and the outliers.
        let [near, far] = [3.0, 4.5].map(|x| f64::from(table.both(x)[1]));
        assert!((far / near - (-1.0_f64).exp()).abs() < 0.01, "{}", far / near);
    }

    #[test]
    fn many_values_are_their_product_integrated_finely() {
        // Equations 1 to 3 by brute force: 20,001 values of the bias.
        let mixture = mixture(&[-60.0, -63.0, -61.0, -70.0, -62.0], 3.0);
        let product = |x: f64| {
            let density = |&fresh: &f32| {
                let kernel = |&k: &f32| bell(x + f64::from(fresh) - f64::from(k), f64::from(mixture.width).powi(2));
                mixture.kernels.iter().map(kernel).sum::<f64>()
            };
            mixture.fresh.iter().map(density).product::<f64>()
        };
        let biases = || (-10_000..=10_000).map(|k| f64::from(k) * 0.004);
        let area: f64 = biases().map(product).sum::<f64>() * 0.004;
        let reference = |x: f64| biases().map(|b| product(x - b) * bell(b, 25.0)).sum::<f64>() * 0.004 / area;
        let table = Likelihood::new(&mixture, 25.0, None);
        let stray = STRAY / (2.0 * f64::from(table.half));
        for x in [-12.0, -6.0, -2.0, 0.0, 1.5, 4.0, 9.0] {
            let (table, reference) = (f64::from(table.direct(x as f32)), reference(x) + stray);
            assert!((table - reference).abs() < 0.01 * bell(0.0, 25.0), "{x}: {table} {reference}");
        }
    }

    #[test]
    fn a_bias_far_wider_than_the_values_hides_them() {
        // Eight equal values with 1 dB of expected noise under 20 dB of bias.
        let table = Likelihood::new(&mixture(&[-60.0; 8], 1.0), 400.0, None);
        let worst = worst(60.0, |x| table.direct(x), |x| bell(x, 400.0) + STRAY / 180.0);
        assert!(worst < 0.02, "{worst}");
    }

    #[test]
    fn numbers_that_are_none_have_a_density_that_is_one() {
        let table = Likelihood::new(&mixture(&[5.0], 0.1), 0.0009, Some(1.5));
        for x in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30, -1e30] {
            assert!(table.both(x).iter().all(|d| !(*d < 0.0)), "{x}");
        }
    }
}
