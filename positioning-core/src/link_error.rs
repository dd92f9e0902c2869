//! The error of a link to an anchor: the one model of the solver [`robust`](crate::robust) and of the track.
//!
//! A link is direct or blocked. The error of a direct link is narrow and has mean zero: multipath, the anchor's
//! surveyed position and its antenna. The error of a blocked link is wide and has a positive mean, because a blocked
//! path is longer (Alavi and Pahlavan, IEEE Commun. Lett. 10, 2006; equations 7-2 to 7-5 of the thesis). Recorded links
//! err by 0.3 to 1 m in this way and are quiet meanwhile, so their noise does not show it. Besides, a single range can
//! be wild.
//!
//! The densities are Student's, (1 + x² ⁄ 16)⁻⁸, where x is the error in units of its deviation: a Gaussian near the
//! middle, a heavier tail for outliers, and no exponential to compute. All of them omit the factor (2π)⁻½, so their
//! ratios are right.

use crate::Real;

/// Deviation of the error of a direct link, metres: what recorded links in line of sight have about their common error
/// (0.06 to 0.10 m; `positioning-core/README.md`).
pub(crate) const DIRECT_SIGMA_M: f64 = 0.1;
/// Deviation of the error common to all ranges of a tag, metres: an antenna delay that was never calibrated.
pub(crate) const COMMON_SIGMA_M: f64 = 0.14;
/// Mean error of a blocked link, metres.
pub(crate) const BLOCKED_MEAN_M: f64 = 0.8;
/// Deviation of the error of a blocked link, metres.
pub(crate) const BLOCKED_SIGMA_M: f64 = 0.65;
/// Density of a range that is neither direct nor blocked, per metre.
pub(crate) const WILD_DENSITY: f64 = 2.0e-3;
/// The prior probability that a link is blocked, if diagnostics indicate line of sight …
const LEAST_BLOCKED: f64 = 0.1;
/// … if they indicate a blocked path …
const MOST_BLOCKED: f64 = 0.75;
/// … and if there are none.
const USUALLY_BLOCKED: f64 = 0.1;

/// The prior probability that a link is blocked. `p_nlos` is the probability by its diagnostics, if there are any. It
/// is bounded: powers mislead at some sites, and a bounded prior can be overruled by the other ranges.
#[inline]
pub(crate) fn prior_blocked<T: Real>(p_nlos: Option<T>) -> T {
    match p_nlos {
        Some(p_nlos) => T::of(LEAST_BLOCKED) + p_nlos * T::of(MOST_BLOCKED - LEAST_BLOCKED),
        None => T::of(USUALLY_BLOCKED),
    }
}

/// Student's density (1 + x² ⁄ 16)⁻⁸ at the square x², and its weight 1 ⁄ (1 + x² ⁄ 16), relative to the pull of a
/// Gaussian.
#[inline(always)]
pub(crate) fn bell<T: Real>(square: T) -> (T, T) {
    let weight = T::ONE / (T::ONE + T::of(0.0625) * square);
    (weight.squared().squared().squared(), weight)
}

/// The density of a number with this square and variance.
#[inline(always)]
pub(crate) fn density<T: Real>(square: T, variance: T) -> T {
    let inverse = T::ONE / variance;
    bell(square * inverse).0 * inverse.sqrt()
}

/// A Gaussian.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Gaussian<T> {
    pub(crate) mean: T,
    pub(crate) variance: T,
}

/// The prior of a link's error: direct or blocked.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LinkPrior<T> {
    /// Variance of the error of a direct link, m².
    pub(crate) direct_m2: T,
    /// The probability that the link is blocked.
    pub(crate) blocked: T,
}

/// The prior times a Gaussian likelihood.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LinkPosterior<T> {
    /// The likelihood of the prior, per metre.
    pub(crate) density: T,
    /// The probability that the link is blocked.
    pub(crate) blocked: T,
    /// The Gaussian that stands for the prior: times the likelihood it has the posterior's mean and variance.
    pub(crate) site: Gaussian<T>,
}

impl<T: Real> LinkPrior<T> {
    /// What the prior becomes when all other measurements say that the link's error is `likelihood`: one step of
    /// expectation propagation (T. Minka, *Expectation propagation for approximate Bayesian inference*, UAI 2001).
    #[inline(never)]
    pub(crate) fn posterior(&self, likelihood: Gaussian<T>) -> LinkPosterior<T> {
        let blocked_m2 = T::of(BLOCKED_SIGMA_M * BLOCKED_SIGMA_M);
        let part = |probability: T, mean: T, variance: T| {
            let sum = variance + likelihood.variance;
            let off = likelihood.mean - mean;
            let gain = variance / sum;
            (probability * density(off.squared(), sum), mean + gain * off, gain * likelihood.variance)
        };
        let (direct, direct_mean, direct_variance) = part(T::ONE - self.blocked, T::ZERO, self.direct_m2);
        let (blocked, blocked_mean, blocked_variance) = part(self.blocked, T::of(BLOCKED_MEAN_M), blocked_m2);
        let density = direct + blocked;
        // Beyond all tails a link is blocked as it is by its prior.
        let share = if density > T::ZERO { blocked / density } else { self.blocked };
        let apart = blocked_mean - direct_mean;
        let mean = direct_mean + share * apart;
        let variance =
            direct_variance + share * (blocked_variance - direct_variance) + share * (T::ONE - share) * apart.squared();

        // A posterior that is wider than the likelihood, since it has two peaks, has no Gaussian prior. Then the prior
        // is as wide as both kinds of links together.
        let widest = blocked_m2 + T::of(BLOCKED_MEAN_M * BLOCKED_MEAN_M);
        let precision = T::ONE / variance - T::ONE / likelihood.variance;
        let site = if precision * widest > T::ONE {
            let variance_of_site = (T::ONE / precision).at_least(T::of(0.25) * self.direct_m2);
            let mean = variance_of_site * (mean / variance - likelihood.mean / likelihood.variance);
            let farthest = T::of(BLOCKED_MEAN_M + 3.0 * BLOCKED_SIGMA_M);
            Gaussian { mean: mean.at_least(-farthest).at_most(farthest), variance: variance_of_site }
        } else {
            Gaussian { mean: share * T::of(BLOCKED_MEAN_M), variance: widest }
        };
        LinkPosterior { density, blocked: share, site }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Moments of the prior times a Gaussian, by sums over a grid of errors, with true Gaussians.
    fn by_grid(prior: LinkPrior<f64>, likelihood: Gaussian<f64>) -> (f64, f64, f64) {
        let gaussian = |x: f64, mean: f64, v: f64| libm::exp(-0.5 * (x - mean).powi(2) / v) / libm::sqrt(v);
        let (mut sum, mut first, mut second, mut blocked) = (0.0, 0.0, 0.0, 0.0);
        for k in -40_000..60_000 {
            let x = f64::from(k) * 1.0e-4;
            let l = gaussian(x, likelihood.mean, likelihood.variance);
            let of_blocked = prior.blocked * gaussian(x, BLOCKED_MEAN_M, BLOCKED_SIGMA_M * BLOCKED_SIGMA_M) * l;
            let all = (1.0 - prior.blocked) * gaussian(x, 0.0, prior.direct_m2) * l + of_blocked;
            (sum, first, second, blocked) = (sum + all, first + x * all, second + x * x * all, blocked + of_blocked);
        }
        let mean = first / sum;
        (blocked / sum, mean, second / sum - mean * mean)
    }

    #[test]
    fn the_site_times_the_likelihood_has_the_moments_of_prior_times_likelihood() {
        for (mean, sigma) in [(0.0, 0.05), (0.1, 0.1), (0.45, 0.08), (0.9, 0.1)] {
            let prior = LinkPrior { direct_m2: 0.01, blocked: 0.3 };
            let likelihood = Gaussian { mean, variance: sigma * sigma };
            let (blocked, first, second) = by_grid(prior, likelihood);
            let found = prior.posterior(likelihood);
            // Student's bells differ from Gaussians in their tails.
            assert!((found.blocked - blocked).abs() < 0.1, "{mean}: {found:?}, {blocked}");
            let precision = 1.0 / found.site.variance + 1.0 / likelihood.variance;
            let moment = (found.site.mean / found.site.variance + likelihood.mean / likelihood.variance) / precision;
            assert!((moment - first).abs() < 0.01, "{mean}: {found:?}, {first}");
            assert!((precision.recip() - second).abs() < 0.15 * second, "{mean}: {found:?}, {second}");
        }
    }

    #[test]
    fn a_likelihood_that_leaves_both_kinds_open_makes_a_wide_site() {
        // 2.1 joint deviations of a direct link, 0.8 of a blocked one.
        let prior = LinkPrior { direct_m2: 0.01, blocked: 0.2 };
        let found = prior.posterior(Gaussian { mean: 0.3, variance: 0.01 });
        assert!((0.2..0.8).contains(&found.blocked) && found.site.variance > 0.02, "{found:?}");
    }

    #[test]
    fn diagnostics_move_the_prior_within_bounds() {
        assert_eq!([Some(0.0), Some(1.0), None].map(prior_blocked::<f64>), [0.1, 0.75, 0.1]);
    }

    #[test]
    fn no_likelihood_makes_a_site_that_is_none() {
        let prior = LinkPrior { direct_m2: 0.01_f32, blocked: 0.75 };
        for mean in [-1.0e5, -3.0, 0.0, 3.0, 1.0e5] {
            for variance in [1.0e-8, 1.0e-4, 1.0, 1.0e6] {
                let found = prior.posterior(Gaussian { mean, variance });
                assert!(found.site.variance > 0.0 && found.site.variance < 1.1, "{found:?}");
                assert!(found.site.mean.abs() < 3.0 && (0.0..=1.0).contains(&found.blocked), "{found:?}");
            }
        }
    }
}
