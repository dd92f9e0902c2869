//! The default method: the posterior mean under a mixture of direct and blocked ranges, with a bias common to all.
//!
//! A range is dᵢ = ‖z − aᵢ‖ + b + eᵢ. The bias b, an antenna delay that was never calibrated, has a zero-mean prior.
//! The error eᵢ is direct (narrow, about zero) or blocked (wide, about a positive mean, because a blocked path is
//! longer). Each part has the density (1 + x² ⁄ 16)⁻⁸, where x is the error in units of its deviation: Student's
//! shape, a Gaussian near its middle, with a heavier tail for outliers, and without an exponential to compute. It
//! follows the model of Alavi and Pahlavan (IEEE Commun. Lett. 10, 2006; equations 7-2 to 7-5).
//!
//! Expectation-maximisation runs from three starts, since the posterior has several modes: B-WLS, LLS, and the middle
//! of the anchors; for anchors near a line in the plane, B-WLS and a place on each side of the line. Each step is a
//! weighted Gauss-Newton step. The bias is eliminated by its Schur complement, and the narrow part is widened at first.
//! Starts that meet continue as one. The two modes with the most evidence (Laplace's approximation) are averaged with
//! the evidence as weight, as the mean of the posterior errs less than its mode. Where they are two places, the
//! position is the likelier one, and the other one is its alternative. The distance of the modes is part of the covariance.

use crate::fix::{blame, conclude_weighted, widen_to_mirror};
use crate::geometry::{Survey, both_sides, centroid};
use crate::linalg::{Ldl, Matrix, Vector, add_outer, add_outer_full, add_scaled, distance_squared, dot, sub};
use crate::linear::{b_wls_position, lls_position};
use crate::link_error::{BLOCKED_MEAN_M, BLOCKED_SIGMA_M, COMMON_SIGMA_M, WILD_DENSITY, bell};
use crate::sample::PerSample;
use crate::{Alternative, Constraints, Fix, RangeSample, Real, SolveError};

/// With this number of ranges to spare, the odds of a blocked link are those of its prior. With fewer, blocked is less
/// likely in proportion. With none to spare the two cannot be distinguished, and every range counts as direct.
const SPARE_RANGES: f64 = 3.0;
/// The factor by which the narrow part is widened in the first steps from a start, so that distant modes have an
/// effect.
const APPROACH: [f64; 2] = [3.0, 2.0];
/// The same in the following steps, unless another start has arrived at the same position.
const ENTRY: [f64; 2] = [1.4, 1.0];
/// The longest step, metres.
const STEP_LIMIT_M: f64 = 2.0;
/// Modes closer than this are the same mode, metres.
const SAME_MODE_M: f64 = 0.2;
/// A second mode with less than this part of the best one's evidence is dropped: ln of the part.
const LEAST_LOG_EVIDENCE: f64 = -5.0;
/// Modes farther apart than this number of deviations of the best one, and than this many metres, are two places.
const APART: f64 = 3.0;
const APART_M: f64 = 2.0;
/// The steps treat a range's part in the mixture as certain, and so overestimate the information (Louis, J. R. Stat.
/// Soc. B 44, 1982). With this factor on the covariance, 95 % ellipses contain 90-99 % of the true positions,
/// simulated and recorded.
const INFLATION: f64 = 1.8;

/// The posterior mean under the mixture: the default method, which does not need to know which ranges are blocked.
///
/// # Errors
/// There is no position; [`SolveError`] has the reason.
pub fn robust<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    constraints: &Constraints<T, D>,
) -> Result<Fix<T, D>, SolveError> {
    let survey = Survey::of(samples, constraints)?;
    let spare = T::count(samples.len() - D - 1);
    let common = spare.at_most(T::of(SPARE_RANGES)) * T::of(1.0 / SPARE_RANGES);
    let odds = core::array::from_fn(|i| {
        let of = |p: T| common * p / (T::ONE - p).at_least(T::of(0.01));
        samples.get(i).map_or(T::ZERO, |sample| of(sample.p_blocked))
    });
    let posterior = Posterior { samples, constraints, odds };
    let by_box = b_wls_position(samples, &survey).ok();
    let middle = || Some(survey.layout.lift(centroid(samples), samples));
    // Anchors near a line leave its two sides alike, and those near a plane too.
    let one_sided = survey.layout.normal().is_some();
    let sides = by_box.filter(|_| !one_sided).and_then(|place| both_sides(place, samples));
    let starts = match sides {
        Some([one, other]) => [Some(one), Some(other), by_box],
        None => [by_box, lls_position(samples, &survey).ok(), middle()],
    };
    let Best { first, second } = posterior.search(starts);
    let diverged = || blame(samples, SolveError::Diverged);
    let first = first.ok_or_else(diverged)?;
    let second = second.filter(|second| second.log_evidence - first.log_evidence > T::of(LEAST_LOG_EVIDENCE));
    let first = posterior.mode(first.next).ok_or_else(diverged)?;
    let second = second.filter(|found| !found.next.is_near(&first.state));

    // The second mode's share of the posterior, and the vector to it.
    let (share, apart) = second.map_or((T::ZERO, [T::ZERO; D]), |second| {
        let share = T::ONE / (T::ONE + (first.log_evidence - second.log_evidence).at_least(T::ZERO).exp());
        (share, sub(&second.next.position, &first.state.position))
    });
    let covariance = first.information.inverse().map(|row| row.map(|element| T::of(INFLATION) * element));
    let spread = (0..D).fold(T::ZERO, |sum, axis| sum + covariance[axis][axis]);
    let ambiguous = dot(&apart, &apart) > (T::of(APART * APART) * spread).at_least(T::of(APART_M * APART_M));
    // The mean of near modes errs less than either; nobody is between two places.
    let moved = if ambiguous { T::ZERO } else { share };
    let position = add_scaled(&first.state.position, moved, &apart);
    let weights = posterior.direct_probabilities(&State { position, bias: first.state.bias });

    let mut fix = conclude_weighted(samples, &survey.layout, position, &weights)?;
    fix.covariance = covariance;
    add_outer_full(&mut fix.covariance, share * (T::ONE - moved), &apart);
    widen_to_mirror(&mut fix.covariance, samples, &survey.layout, &position);
    fix.alternative = ambiguous.then_some(Alternative { apart, share });
    Ok(fix)
}

/// A position and the common bias.
#[derive(Clone, Copy)]
struct State<T, const D: usize> {
    position: Vector<T, D>,
    bias: T,
}

impl<T: Real, const D: usize> State<T, D> {
    fn is_near(&self, other: &Self) -> bool {
        distance_squared(&self.position, &other.position) < T::of(SAME_MODE_M).squared()
    }
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
    /// Descent direction of the position (bias eliminated).
    descent: Vector<T, D>,
    /// Descent direction of the bias.
    bias_descent: T,
}

impl<T: Real, const D: usize> Expansion<T, D> {
    /// ln of the posterior mass about the state; `None` where it is not finite.
    fn log_evidence(&self) -> Option<T> {
        let determinant = self.information.determinant() * self.bias_information;
        let log_evidence = self.log_posterior - T::of(0.5) * determinant.ln();
        log_evidence.is_finite().then_some(log_evidence)
    }
}

/// A mode of the posterior.
struct Mode<T, const D: usize> {
    state: State<T, D>,
    /// Information about the position, factored.
    information: Ldl<T, D>,
    /// ln of the posterior mass (Laplace's approximation), up to a constant.
    log_evidence: T,
}

/// A state near a mode, the next state, and the evidence.
#[derive(Clone, Copy)]
struct Found<T, const D: usize> {
    state: State<T, D>,
    next: State<T, D>,
    /// ln of the posterior mass, as in [`Mode`].
    log_evidence: T,
}

/// The two states with the most evidence that do not belong to the same mode.
struct Best<T, const D: usize> {
    first: Option<Found<T, D>>,
    second: Option<Found<T, D>>,
}

impl<T: Real, const D: usize> Best<T, D> {
    fn offer(&mut self, found: Found<T, D>) {
        match &self.first {
            Some(first) if first.state.is_near(&found.state) => {
                if found.log_evidence > first.log_evidence {
                    self.first = Some(found);
                }
            }
            Some(first) if first.log_evidence >= found.log_evidence => {
                if self.second.as_ref().is_none_or(|second| found.log_evidence > second.log_evidence) {
                    self.second = Some(found);
                }
            }
            Some(_) | None => self.second = self.first.replace(found),
        }
    }
}

/// How a residual is shared between the parts of the mixture.
struct Share<T> {
    /// The mixture's density, per metre, divided by the prior of a direct range.
    density: T,
    /// Probability of the narrow part.
    direct: T,
    /// Precision by the narrow part, 1/m².
    direct_precision: T,
    /// Precision by the wide part, 1/m².
    blocked_precision: T,
}

impl<T: Real> Share<T> {
    /// The share for a residual (metres) of a range with this deviation (metres), with these odds of blocked to
    /// direct.
    #[inline(always)]
    fn of(residual: T, sigma: T, odds: T) -> Self {
        let inverse = T::ONE / sigma;
        let (narrow, narrow_weight) = bell((residual * inverse).squared());
        let (wide, wide_weight) = bell(((residual - T::of(BLOCKED_MEAN_M)) * T::of(1.0 / BLOCKED_SIGMA_M)).squared());
        let narrow = narrow * inverse;
        let wide = odds * T::of(1.0 / BLOCKED_SIGMA_M) * wide;
        let density = narrow + wide + T::of(WILD_DENSITY);
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

/// The posterior of one epoch.
struct Posterior<'a, T, const D: usize> {
    samples: &'a [RangeSample<T, D>],
    constraints: &'a Constraints<T, D>,
    /// The prior odds that each link is blocked.
    odds: PerSample<T>,
}

impl<T: Real, const D: usize> Posterior<'_, T, D> {
    /// The best modes that are reached from `starts`.
    #[inline(never)]
    fn search(&self, starts: [Option<Vector<T, D>>; 3]) -> Best<T, D> {
        let approached = starts.map(|start| {
            let state = State { position: self.constraints.inside(start?), bias: T::ZERO };
            self.walk(state, APPROACH.map(T::of))
        });
        let mut best = Best { first: None, second: None };
        for (i, state) in approached.iter().enumerate() {
            let Some(state) = *state else { continue };
            if approached.iter().take(i).flatten().any(|earlier| earlier.is_near(&state)) {
                continue;
            }
            if let Some(found) = self.walk(state, ENTRY.map(T::of)).and_then(|state| self.find(state)) {
                best.offer(found);
            }
        }
        best
    }

    /// One step for each of `widenings`.
    #[inline(never)]
    fn walk(&self, mut state: State<T, D>, widenings: [T; 2]) -> Option<State<T, D>> {
        for widening in widenings {
            state = self.advance(&state, &self.expand(&state, widening)?);
        }
        Some(state)
    }

    /// The state at the end of the steps, with its evidence.
    #[inline(never)]
    fn find(&self, state: State<T, D>) -> Option<Found<T, D>> {
        let here = self.expand(&state, T::ONE)?;
        let log_evidence = here.log_evidence()?;
        Some(Found { state, next: self.advance(&state, &here), log_evidence })
    }

    /// The mode at `state`.
    #[inline(never)]
    fn mode(&self, state: State<T, D>) -> Option<Mode<T, D>> {
        let here = self.expand(&state, T::ONE)?;
        let log_evidence = here.log_evidence()?;
        Some(Mode { state, information: here.information, log_evidence })
    }

    /// One step of expectation-maximisation: moves `state` by the step that the expansion at it gives.
    #[inline(never)]
    fn advance(&self, state: &State<T, D>, here: &Expansion<T, D>) -> State<T, D> {
        let mut step = here.information.solve(here.descent);
        let square = dot(&step, &step);
        let limit = T::of(STEP_LIMIT_M);
        if square > limit.squared() {
            let scale = limit / square.sqrt();
            step = step.map(|component| component * scale);
        }
        State {
            position: self.constraints.inside(add_scaled(&state.position, T::ONE, &step)),
            bias: state.bias + (here.bias_descent - dot(&here.cross, &step)) / here.bias_information,
        }
    }

    /// Expands the posterior at `state`, with the narrow part widened by `widening`.
    #[inline(never)]
    fn expand(&self, state: &State<T, D>, widening: T) -> Option<Expansion<T, D>> {
        let prior = T::of(1.0 / (COMMON_SIGMA_M * COMMON_SIGMA_M));
        let mut hessian: Matrix<T, D> = [[T::ZERO; D]; D];
        let mut cross = [T::ZERO; D];
        let mut descent = [T::ZERO; D];
        let mut bias_information = prior;
        let mut bias_descent = -prior * state.bias;
        let mut log_posterior = -T::of(0.5) * prior * state.bias.squared();
        // A product of densities. Its logarithm is taken only when it leaves the range of `f32`.
        let mut product = T::ONE;
        for (sample, odds) in self.samples.iter().zip(&self.odds) {
            let across = sub(&state.position, &sample.anchor);
            let distance = (dot(&across, &across) + T::EPSILON.squared()).sqrt();
            let inverse = T::ONE / distance;
            let unit = across.map(|component| component * inverse);
            let residual = sample.range - distance - state.bias;
            let share = Share::of(residual, widening * sample.sigma, *odds);
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
        // Where one precise range outweighs all others, a prior of a hundred metres keeps the matrix invertible.
        for axis in 0..D {
            hessian[axis][axis] += T::of(1.0e-4) + T::of(1.0e-5) * hessian[axis][axis].abs();
        }
        descent = add_scaled(&descent, -inverse * bias_descent, &cross);
        let information = Ldl::new(hessian)?;
        Some(Expansion { log_posterior, information, bias_information, cross, descent, bias_descent })
    }

    /// Probability that each range is direct, at `state`.
    fn direct_probabilities(&self, state: &State<T, D>) -> PerSample<T> {
        core::array::from_fn(|i| {
            self.samples.get(i).map_or(T::ZERO, |sample| {
                let across = sub(&state.position, &sample.anchor);
                let residual = sample.range - dot(&across, &across).sqrt() - state.bias;
                Share::of(residual, sample.sigma, self.odds[i]).direct
            })
        })
    }
}
