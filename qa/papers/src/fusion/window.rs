//! The recent values of one node, and their mixture of kernels.

use heapless::Vec;

use positioning_core::Real;

/// Number of values that are kept.
pub(super) const WINDOW: usize = 8;
/// The expected deviation of the settings counts as this number of values.
const EXPECTED_COUNTS: f64 = 4.0;
/// From this number of values on, a fitted line is subtracted from them, because the tag moves.
const LINE: usize = 4;
/// (4 ⁄ (3 n))^(1⁄5) for n values, at most 1: the normal reference rule (B. W. Silverman, *Density Estimation*, 1986,
/// equation 3.28).
const REFERENCE_RULE: [f64; WINDOW] = [1.0, 0.922_1, 0.850_3, 0.802_7, 0.767_7, 0.740_2, 0.717_8, 0.698_8];

/// A value and its time.
#[derive(Clone, Copy, Debug)]
struct Value<T> {
    value: T,
    time_us: u64,
}

/// The recent values of a node, the oldest first.
#[derive(Clone, Debug)]
pub(super) struct Window<T> {
    values: Vec<Value<T>, WINDOW>,
    /// Number of the last ones that have not been used.
    fresh: usize,
}

/// The error of a value, as estimated from values: kernels about the mean, and the fresh values.
#[derive(Clone, Debug)]
pub(super) struct Mixture<T> {
    /// Centres of the kernels, relative to the mean.
    pub(super) kernels: Vec<T, WINDOW>,
    /// Deviation of a kernel.
    pub(super) width: T,
    /// Variance of the whole mixture.
    pub(super) variance: T,
    /// Mean of the fresh values.
    pub(super) mean: T,
    /// The fresh values, relative to their mean.
    pub(super) fresh: Vec<T, WINDOW>,
}

impl<T: Real> Mixture<T> {
    /// The variance of the fresh values' mean.
    pub(super) fn variance_of_mean(&self) -> T {
        self.variance / T::count(self.fresh.len().max(1))
    }
}

impl<T: Real> Window<T> {
    pub(super) fn new() -> Self {
        Self { values: Vec::new(), fresh: 0 }
    }

    /// Adds a value; drops those older than `recent_us`.
    pub(super) fn push(&mut self, value: T, now_us: u64, recent_us: u64) {
        while self.values.is_full()
            || self.values.first().is_some_and(|first| now_us.saturating_sub(first.time_us) > recent_us)
        {
            self.values.remove(0);
        }
        // There is room now.
        let _ = self.values.push(Value { value, time_us: now_us });
        self.fresh = (self.fresh + 1).min(self.values.len());
    }

    pub(super) fn has_fresh(&self) -> bool {
        self.fresh > 0
    }

    /// Marks the fresh values as used.
    pub(super) fn used(&mut self) {
        self.fresh = 0;
    }

    /// The mixture, for values with the expected deviation `noise`; `None` without fresh values.
    pub(super) fn mixture(&self, noise: T) -> Option<Mixture<T>> {
        if self.fresh == 0 {
            return None;
        }
        let fresh = self.values.get(self.values.len() - self.fresh..).unwrap_or(&[]);
        let mean = fresh.iter().fold(T::ZERO, |sum, v| sum + v.value) / T::count(fresh.len().max(1));
        let (mut kernels, degrees) = self.residuals();
        let squares = kernels.iter().fold(T::ZERO, |sum, e| sum + e.squared());
        let expected = T::of(EXPECTED_COUNTS);
        let variance = (expected * noise.squared() + squares) / (expected + T::count(degrees));
        let rule = REFERENCE_RULE.get(self.values.len().wrapping_sub(1)).copied().unwrap_or(1.0);
        let width = variance.sqrt() * T::of(rule);
        // The variance of the kernels' centres and that of the kernel's own width together are `variance`.
        let between = (variance - width.squared()).at_least(T::ZERO);
        let scale = if squares > T::ZERO { (between * T::count(kernels.len()) / squares).sqrt() } else { T::ZERO };
        kernels.iter_mut().for_each(|e| *e *= scale);
        let width = if scale == T::ZERO { variance.sqrt() } else { width };
        let fresh = fresh.iter().map(|v| v.value - mean).collect();
        Some(Mixture { kernels, width, variance, mean, fresh })
    }

    /// The residuals of the values about their line (about their mean where they are few), and the number of degrees
    /// of freedom.
    fn residuals(&self) -> (Vec<T, WINDOW>, usize) {
        let count = self.values.len();
        let inverse = T::ONE / T::count(count.max(1));
        let begun = self.values.first().map_or(0, |v| v.time_us);
        // Seconds, as f32 milliseconds: windows are short.
        let time = |v: &Value<T>| T::count((v.time_us.saturating_sub(begun) / 1000) as usize) * T::of(1e-3);
        let mean = self.values.iter().fold(T::ZERO, |sum, v| sum + v.value) * inverse;
        let middle = self.values.iter().fold(T::ZERO, |sum, v| sum + time(v)) * inverse;
        let (mut tt, mut tv) = (T::ZERO, T::ZERO);
        for v in &self.values {
            let t = time(v) - middle;
            tt += t.squared();
            tv += t * (v.value - mean);
        }
        let line = count >= LINE && tt > T::ZERO;
        let slope = if line { tv / tt } else { T::ZERO };
        let residuals = self.values.iter().map(|v| v.value - mean - slope * (time(v) - middle)).collect();
        (residuals, count.saturating_sub(if line { 2 } else { 1 }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn window(values: &[f64], step_us: u64) -> Window<f64> {
        let mut window = Window::new();
        for (k, &value) in values.iter().enumerate() {
            window.push(value, k as u64 * step_us, 60_000_000);
        }
        window
    }

    #[test]
    fn the_reference_rule_is_its_formula() {
        for (k, &rule) in REFERENCE_RULE.iter().enumerate() {
            let formula = (4.0 / (3.0 * (k + 1) as f64)).powf(0.2).min(1.0);
            assert!((rule - formula).abs() < 1e-4, "{k}: {rule} {formula}");
        }
    }

    #[test]
    fn a_single_value_is_one_kernel_of_the_expected_width() {
        let mixture = window(&[-60.0], 1).mixture(3.0).expect("fresh");
        assert_eq!((mixture.kernels.len(), mixture.width, mixture.mean), (1, 3.0, -60.0));
    }

    #[test]
    fn the_variance_is_pooled_from_what_was_expected_and_what_came() {
        // Three values: mean 2, squares 1 + 0 + 1 in two degrees of freedom; (4 · 3² + 2) ⁄ (4 + 2) = 19⁄3. Kernels at
        // ±e carry 19⁄3 (1 − 0.8503²) = 1.7541 = 2 e² ⁄ 3, e = 1.6221.
        let mixture = window(&[1.0, 2.0, 3.0], 1000).mixture(3.0).expect("fresh");
        assert!((mixture.variance - 19.0 / 3.0).abs() < 1e-12);
        assert!((mixture.kernels[2] - 1.6221).abs() < 1e-3, "{}", mixture.kernels[2]);
        assert!((mixture.width - 0.8503 * (19.0_f64 / 3.0).sqrt()).abs() < 1e-12);
    }

    #[test]
    fn walking_does_not_widen_the_kernels() {
        // A range that grows by 0.2 m a step has no residuals: (4 · 0.1²) ⁄ (4 + 6) = 0.004.
        let ramp: std::vec::Vec<f64> = (0..8).map(|k| 3.0 + 0.2 * f64::from(k)).collect();
        let mixture = window(&ramp, 200_000).mixture(0.1).expect("fresh");
        assert!((mixture.variance - 0.004).abs() < 1e-9, "{}", mixture.variance);
    }

    #[test]
    fn old_values_and_the_ninth_are_forgotten() {
        let mut window = window(&[1.0; 12], 1000);
        assert_eq!(window.values.len(), WINDOW);
        window.push(2.0, 100_000_000, 2_000_000);
        assert_eq!(window.values.len(), 1);
        assert_eq!(window.fresh, 1);
        window.used();
        assert!(window.mixture(1.0).is_none());
    }

    #[test]
    fn equal_values_at_one_time_make_a_mixture() {
        let mixture = window(&[5.0; 8], 0).mixture(0.1).expect("fresh");
        assert!(mixture.width > 0.0 && mixture.variance > 0.0);
        assert!(mixture.kernels.iter().all(|&e| e == 0.0));
    }
}
