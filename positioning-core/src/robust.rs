//! The default method: the posterior mean under a mixture of direct and blocked ranges and a bias common to all.
//!
//! A range is dᵢ = ‖z − aᵢ‖ + b + eᵢ. The bias b, an antenna delay that was never calibrated, has a zero-mean prior. The
//! error eᵢ is direct (narrow, about zero) or blocked (wide, about a positive mean: nothing outruns light), each by
//! a bell (1 + z ⁄ k)⁻ᵏ, z = ½ (e ⁄ s)², that is, Student's shape: a Gaussian near its middle, a heavy tail for the wild, and no
//! exponential to compute. The model of Alavi and Pahlavan (IEEE Commun. Lett. 10, 2006; equations 7-2 to 7-5) is its pattern.
//!
//! Expectation-maximisation (each step a weighted Gauss-Newton step, the bias eliminated by its Schur complement, the narrow
//! part widened at first) runs from four starts, since the posterior has several modes: bounding box, B-WLS, LLS, and the
//! middle of the anchors. The two modes of most evidence (Laplace's approximation) are refined and averaged by it: the mean of
//! the posterior errs less than its mode, and their distance is part of the covariance.

use crate::bounding_box;
use crate::fix::{Weighing, conclude, widen_to_mirror};
use crate::geometry::{Layout, centroid};
use crate::linalg::{Ldl, Matrix, Vector, add_outer, add_outer_full, add_scaled, dot, sub};
use crate::linear::{PerSample, solve_linear, uncertainties};
use crate::sample::check;
use crate::{Constraints, Fix, MAX_ANCHORS, NoFix, RangeSample, Real};

/// Deviation of a direct range beside its own `sigma`: a surveyed anchor, its antenna and the air add to the radio's noise.
const DIRECT_SCALE: f64 = 1.1;
/// Mean excess of a blocked range, metres.
const BLOCKED_MEAN_M: f64 = 0.9;
/// Deviation of a blocked range, metres.
const BLOCKED_SIGMA_M: f64 = 0.65;
/// Prior probability that a range is blocked.
const BLOCKED_PRIOR: f64 = 0.5;
/// Density of a range that is neither, per metre.
const WILD_DENSITY: f64 = 1.0e-4;
/// Prior deviation of the common bias, metres.
const BIAS_SIGMA_M: f64 = 0.12;
/// How much the narrow part is widened in the steps from a start, so that a start far away still feels its pull.
const WIDENING: [f64; 4] = [3.0, 2.0, 1.4, 1.0];
/// Steps of the two modes that are kept.
const REFINE_STEPS: usize = 2;
/// The longest step, metres.
const STEP_LIMIT_M: f64 = 1.0;
/// The steps count a range's responsibility as certain and so overrate the information (Louis, J. R. Stat. Soc. B 44, 1982);
/// this factor on the covariance brings 95 % ellipses to hold 90-99 % of the truth, simulated and recorded.
const INFLATION: f64 = 1.5;
/// Modes closer than this are one, metres.
const SAME_MODE_M: f64 = 0.1;

/// A position and the common bias.
#[derive(Clone, Copy)]
struct State<T, const D: usize> {
    position: Vector<T, D>,
    bias: T,
}

/// The posterior near a state.
struct Expansion<T, const D: usize> {
    /// ln of the likelihood times the prior of the bias, up to a constant.
    log_posterior: T,
    /// Information about the position with the bias eliminated, factored.
    information: Ldl<T, D>,
    /// Information about the bias.
    bias_information: T,
    /// Cross information of position and bias.
    cross: Vector<T, D>,
    /// Downhill, position (bias eliminated).
    descent: Vector<T, D>,
    /// Downhill, bias.
    bias_descent: T,
}

impl<T: Real, const D: usize> Expansion<T, D> {
    /// ln of the posterior mass of the mode: Laplace's approximation, up to a constant.
    fn log_evidence(&self) -> T {
        self.log_posterior - T::of(0.5) * (self.information.determinant() * self.bias_information).ln()
    }
}

/// Student's bell (1 + z ⁄ 4)⁻⁴ and its own weight 1 ⁄ (1 + z ⁄ 4).
#[inline(always)]
fn narrow_bell<T: Real>(z: T) -> (T, T) {
    let t = T::ONE / (T::ONE + T::of(0.25) * z);
    (t.squared().squared(), t)
}

/// (1 + z ⁄ 2)⁻² above the mean and (1 + z ⁄ 8)⁻⁸ below it, with their own weights.
#[inline(always)]
fn wide_bell<T: Real>(z: T, above: bool) -> (T, T) {
    if above {
        let t = T::ONE / (T::ONE + T::of(0.5) * z);
        (t.squared(), t)
    } else {
        let t = T::ONE / (T::ONE + T::of(0.125) * z);
        (t.squared().squared().squared(), t)
    }
}

/// Probability that each range is direct, at `state`.
fn direct_probabilities<T: Real, const D: usize>(samples: &[RangeSample<T, D>], state: &State<T, D>) -> PerSample<T> {
    let mut probabilities = [T::ZERO; MAX_ANCHORS];
    for (probability, sample) in probabilities.iter_mut().zip(samples) {
        let across = sub(&state.position, &sample.anchor);
        let residual = sample.distance() - dot(&across, &across).sqrt() - state.bias;
        *probability = Share::of(residual, T::of(DIRECT_SCALE) * sample.sigma).direct;
    }
    probabilities
}

/// How a residual is shared between the parts of the mixture.
struct Share<T> {
    /// The mixture's density, in units of the narrow part's greatest.
    density: T,
    /// Probability of the narrow part.
    direct: T,
    /// Precision that the narrow part lends, 1/m².
    direct_precision: T,
    /// Precision that the wide part lends, 1/m².
    blocked_precision: T,
}

impl<T: Real> Share<T> {
    #[inline(always)]
    fn of(residual: T, sigma: T) -> Self {
        let inverse = T::ONE / sigma;
        let half = T::of(0.5);
        let (narrow, narrow_weight) = narrow_bell(half * (residual * inverse).squared());
        let beyond = (residual - T::of(BLOCKED_MEAN_M)) * T::of(1.0 / BLOCKED_SIGMA_M);
        let (wide, wide_weight) = wide_bell(half * beyond.squared(), beyond > T::ZERO);
        // Both densities are divided by the narrow part's greatest, (1 − prior) ⁄ sigma.
        let wide = T::of(BLOCKED_PRIOR / (1.0 - BLOCKED_PRIOR) / BLOCKED_SIGMA_M) * sigma * wide;
        let density = narrow + wide + T::of(WILD_DENSITY / (1.0 - BLOCKED_PRIOR)) * sigma;
        let share = T::ONE / density;
        let direct = narrow * share;
        Self {
            density,
            direct,
            direct_precision: direct * narrow_weight * inverse.squared(),
            blocked_precision: wide * share * wide_weight * T::of(1.0 / (BLOCKED_SIGMA_M * BLOCKED_SIGMA_M)),
        }
    }
}

/// Expands the posterior at `state`, the narrow part widened by `widening`.
fn expand<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    state: &State<T, D>,
    widening: T,
) -> Option<Expansion<T, D>> {
    let prior = T::of(1.0 / (BIAS_SIGMA_M * BIAS_SIGMA_M));
    let scale = T::of(DIRECT_SCALE) * widening;
    let mut hessian: Matrix<T, D> = [[T::ZERO; D]; D];
    let mut cross = [T::ZERO; D];
    let mut descent = [T::ZERO; D];
    let mut bias_information = prior;
    let mut bias_descent = -prior * state.bias;
    let mut log_posterior = -T::of(0.5) * prior * state.bias.squared();
    // A product of densities, and its logarithm only when it leaves the range that `f32` keeps.
    let mut product = T::ONE;
    for sample in samples {
        let across = sub(&state.position, &sample.anchor);
        let distance = dot(&across, &across).at_least(T::EPSILON.squared()).sqrt();
        let inverse = T::ONE / distance;
        let unit = across.map(|component| component * inverse);
        let residual = sample.distance() - distance - state.bias;
        let share = Share::of(residual, scale * sample.sigma);
        product *= share.density;
        if product < T::of(1.0e-24) {
            log_posterior += product.ln();
            product = T::ONE;
        }
        let precision = share.direct_precision + share.blocked_precision;
        let pull = precision * residual - share.blocked_precision * T::of(BLOCKED_MEAN_M);
        add_outer(&mut hessian, precision, &unit);
        cross = add_scaled(&cross, precision, &unit);
        descent = add_scaled(&descent, pull, &unit);
        bias_information += precision;
        bias_descent += pull;
    }
    log_posterior += product.ln();
    let inverse = T::ONE / bias_information;
    add_outer(&mut hessian, -inverse, &cross);
    // Where one precise range outweighs all others, a hundred metres of prior keep the matrix invertible.
    for axis in 0..D {
        hessian[axis][axis] += T::of(1.0e-4) + T::of(1.0e-5) * hessian[axis][axis].abs();
    }
    descent = add_scaled(&descent, -inverse * bias_descent, &cross);
    let information = Ldl::new(hessian)?;
    Some(Expansion { log_posterior, information, bias_information, cross, descent, bias_descent })
}

/// One step of expectation-maximisation: `state`, moved to where `here`, the expansion at it, points.
fn advance<T: Real, const D: usize>(
    state: &State<T, D>,
    here: &Expansion<T, D>,
    constraints: &Constraints<T, D>,
) -> State<T, D> {
    let mut step = here.information.solve(here.descent);
    let length = dot(&step, &step).sqrt();
    let limit = T::of(STEP_LIMIT_M);
    if length > limit {
        step = step.map(|component| component * limit / length);
    }
    State {
        position: constraints.inside(add_scaled(&state.position, T::ONE, &step)),
        bias: state.bias + (here.bias_descent - dot(&here.cross, &step)) / here.bias_information,
    }
}

/// A mode of the posterior, or a point on the way to one.
struct Mode<T, const D: usize> {
    state: State<T, D>,
    expansion: Expansion<T, D>,
    log_evidence: T,
}

impl<T: Real, const D: usize> Mode<T, D> {
    fn at(samples: &[RangeSample<T, D>], state: State<T, D>) -> Option<Self> {
        let expansion = expand(samples, &state, T::ONE)?;
        let log_evidence = expansion.log_evidence();
        log_evidence.is_finite().then_some(Self { state, expansion, log_evidence })
    }

    /// The mode's neighbourhood as seen from a start.
    fn scout(samples: &[RangeSample<T, D>], constraints: &Constraints<T, D>, start: Vector<T, D>) -> Option<Self> {
        let mut state = State { position: constraints.inside(start), bias: T::ZERO };
        for widening in WIDENING {
            state = advance(&state, &expand(samples, &state, T::of(widening))?, constraints);
        }
        Self::at(samples, state)
    }

    fn refine(self, samples: &[RangeSample<T, D>], constraints: &Constraints<T, D>) -> Option<Self> {
        let mut mode = self;
        for _ in 0..REFINE_STEPS {
            mode = Self::at(samples, advance(&mode.state, &mode.expansion, constraints))?;
        }
        Some(mode)
    }

    fn is_near(&self, other: &Self) -> bool {
        let apart = sub(&self.state.position, &other.state.position);
        dot(&apart, &apart) < T::of(SAME_MODE_M).squared()
    }
}

/// The two modes of most evidence that are not the same.
struct Best<T, const D: usize> {
    first: Option<Mode<T, D>>,
    second: Option<Mode<T, D>>,
}

impl<T: Real, const D: usize> Best<T, D> {
    fn offer(&mut self, mode: Mode<T, D>) {
        match &self.first {
            Some(first) if first.is_near(&mode) => {
                if mode.log_evidence > first.log_evidence {
                    self.first = Some(mode);
                }
            }
            Some(first) if first.log_evidence >= mode.log_evidence => {
                if self.second.as_ref().is_none_or(|second| mode.log_evidence > second.log_evidence) {
                    self.second = Some(mode);
                }
            }
            Some(_) | None => self.second = self.first.replace(mode),
        }
    }
}

/// The posterior mean under the mixture: the default, without knowing which ranges are blocked.
///
/// # Errors
/// See [`NoFix`].
pub fn robust<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    constraints: &Constraints<T, D>,
) -> Result<Fix<T, D>, NoFix> {
    check(samples)?;
    let layout = Layout::of(samples, constraints)?;
    let boxed = layout.lift(bounding_box::centre(samples), samples);
    let middle = layout.lift(centroid(samples), samples);
    let starts = [
        Some(boxed),
        solve_linear(samples, &layout, Some(&uncertainties(samples, &boxed))).ok(),
        solve_linear(samples, &layout, None).ok(),
        Some(middle),
    ];
    let mut best = Best { first: None, second: None };
    for start in starts.into_iter().flatten() {
        if let Some(mode) = Mode::scout(samples, constraints, start) {
            best.offer(mode);
        }
    }
    let first = best.first.and_then(|mode| mode.refine(samples, constraints)).ok_or(NoFix::Diverged)?;
    let second = best.second.and_then(|mode| mode.refine(samples, constraints)).filter(|mode| !mode.is_near(&first));

    // The second mode's share of the posterior.
    let share =
        second.as_ref().map_or(T::ZERO, |second| T::ONE / (T::ONE + (first.log_evidence - second.log_evidence).exp()));
    let apart = second.as_ref().map_or([T::ZERO; D], |second| sub(&second.state.position, &first.state.position));
    let position = add_scaled(&first.state.position, share, &apart);
    let state = State { position, bias: first.state.bias };

    let mut fix = conclude(samples, &layout, position, Weighing::Beta(&direct_probabilities(samples, &state)))?;
    fix.covariance = first.expansion.information.inverse().map(|row| row.map(|element| T::of(INFLATION) * element));
    add_outer_full(&mut fix.covariance, share * (T::ONE - share), &apart);
    widen_to_mirror(&mut fix.covariance, samples, &layout, &position);
    Ok(fix)
}
