//! The survey of the samples: whether the anchors determine a position at all, in which direction it may be mirrored,
//! the bounding box that every better method starts from, and the reference anchor of the closed forms. One pass
//! computes all of it.

use crate::linalg::{Matrix, Vector, add_outer, add_scaled, dot, sub, symmetric_eigen};
use crate::link_error::DIRECT_SIGMA_M;
use crate::{Constraints, MAX_ANCHORS, RangeSample, Real, Side, SolveError};

/// Anchors closer together than this are at one position, metres.
const COINCIDENT_M: f64 = 0.01;
/// Anchors are on a line when their spread across it is less than this part of their spread along it.
const COLLINEAR: f64 = 0.01;
/// The same in the plane, where anchors a few centimetres off a line still leave two places, which `robust` returns.
const COLLINEAR_IN_PLANE: f64 = 0.001;
/// Anchors are on a plane when their spread across it is less than this part of the lesser spread within it. A height
/// from such anchors has an error twenty times that of the ranges.
const COPLANAR: f64 = 0.05;

/// Anchors in the plane leave the two sides of a line alike when their spread across it is less than this part of their
/// spread along it.
const ELONGATED: f64 = 0.2;

/// The sum of squared distances of anchors from a line or plane that lasting errors of direct links hide, m². Of a range
/// at an angle of 30° to the line, the two sides differ by the anchor's distance from it. A sum of sixteen squared
/// deviations makes log odds of four.
const HIDDEN_M2: f64 = 16.0 * DIRECT_SIGMA_M * DIRECT_SIGMA_M;

/// What is known before any method runs.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Survey<T, const D: usize> {
    /// The arrangement of the anchors.
    pub(crate) layout: Layout<T, D>,
    /// The centre of the bounding box (6-4), moved across the anchors' plane where they lie on one.
    pub(crate) boxed: Vector<T, D>,
    /// The index of the sample of least range (6-16).
    pub(crate) reference: usize,
}

/// The arrangement of anchors that determine a position.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Layout<T, const D: usize> {
    /// They span the space.
    Full,
    /// They lie on a plane (three dimensions): a position and its mirror image explain the ranges equally well.
    Flat {
        /// Unit vector across the plane, towards the side that the tag is on.
        normal: Vector<T, D>,
        /// Whether the caller gave the side.
        side_known: bool,
    },
}

/// The mean of the anchors' positions.
pub(crate) fn centroid<T: Real, const D: usize>(samples: &[RangeSample<T, D>]) -> Vector<T, D> {
    let mut sum = [T::ZERO; D];
    for sample in samples {
        sum = add_scaled(&sum, T::ONE, &sample.anchor);
    }
    let share = T::ONE / T::count(samples.len());
    sum.map(|component| component * share)
}

/// The two places on both sides of the line (in the plane) or plane near which the anchors lie that fit the ranges best:
/// at the height over it that [`Layout::lift`] takes. `None` where the anchors are spread. Near the line itself the ranges
/// say nothing of the direction across, so no method gets away from there.
#[inline(never)]
pub(crate) fn both_sides<T: Real, const D: usize>(
    point: Vector<T, D>,
    samples: &[RangeSample<T, D>],
) -> Option<[Vector<T, D>; 2]> {
    let Plane { normal, .. } = plane_of(samples.iter().map(|sample| sample.anchor))?;
    Some([normal, normal.map(|c| -c)].map(|normal| lift_along(&normal, point, samples)))
}

/// The line (in two dimensions) or plane near which places lie.
pub(crate) struct Plane<T, const D: usize> {
    /// The middle of the places.
    pub(crate) centre: Vector<T, D>,
    /// Its unit normal.
    pub(crate) normal: Vector<T, D>,
    /// Whether a solver takes the places to lie on it, and so takes one side.
    pub(crate) is_exact: bool,
}

/// The line or plane near which places lie. `None` where they are spread by more than [`ELONGATED`] and by more than
/// lasting errors of links hide, or do not determine it.
#[inline(never)]
pub(crate) fn plane_of<T: Real, const D: usize>(
    places: impl Iterator<Item = Vector<T, D>> + Clone,
) -> Option<Plane<T, D>> {
    if places.clone().count() < D {
        return None;
    }
    let (centre, scatter) = spread_of(places);
    if D == 2 {
        // λ₀ ≥ det ⁄ trace, and λ₁ ≤ trace: most anchors are spread, and need no eigenvalues.
        let trace = scatter[0][0] + scatter[1][1];
        let det = scatter[0][0] * scatter[1][1] - scatter[1][0].squared();
        if det > trace * (T::of(ELONGATED * ELONGATED) * trace).at_least(T::of(HIDDEN_M2)) {
            return None;
        }
    }
    let (values, vectors) = symmetric_eigen(&scatter);
    let least = T::of(COINCIDENT_M).at_least(T::of(COLLINEAR * COLLINEAR) * values[D - 1]);
    let near = (T::of(ELONGATED * ELONGATED) * values[1]).at_least(T::of(HIDDEN_M2));
    let is_exact = values[0] <= T::of(COPLANAR * COPLANAR) * values[1];
    (values[1] > least && values[0] <= near).then_some(Plane { centre, normal: vectors[0], is_exact })
}

/// The mean of places and their scatter about it.
fn spread_of<T: Real, const D: usize>(
    places: impl Iterator<Item = Vector<T, D>> + Clone,
) -> (Vector<T, D>, Matrix<T, D>) {
    let (sum, count) =
        places.clone().fold(([T::ZERO; D], 0), |(sum, count), place| (add_scaled(&sum, T::ONE, &place), count + 1));
    let centre = sum.map(|component| component / T::count(count));
    let mut scatter: Matrix<T, D> = [[T::ZERO; D]; D];
    places.for_each(|place| add_outer(&mut scatter, T::ONE, &sub(&place, &centre)));
    (centre, scatter)
}

impl<T: Real, const D: usize> Survey<T, D> {
    /// Surveys samples in any order.
    #[inline(never)]
    pub(crate) fn of(samples: &[RangeSample<T, D>], constraints: &Constraints<T, D>) -> Result<Self, SolveError> {
        Self::of_inlined(samples, constraints)
    }

    /// The same, inlined, for the one method for which a copy of the code is worth it.
    #[inline(always)]
    pub(crate) fn of_inlined(
        samples: &[RangeSample<T, D>],
        constraints: &Constraints<T, D>,
    ) -> Result<Self, SolveError> {
        if samples.len() > MAX_ANCHORS {
            return Err(SolveError::TooManyAnchors);
        }
        let (Some(first), true) = (samples.first(), samples.len() > D) else {
            return Err(SolveError::TooFewAnchors);
        };
        // The scatter of the anchors about the first one: as singular as that about their mean.
        let mut scatter: Matrix<T, D> = [[T::ZERO; D]; D];
        let (mut low, mut high) = (first.anchor, first.anchor);
        for axis in 0..D {
            low[axis] -= first.range;
            high[axis] += first.range;
        }
        let (mut reference, mut least) = (0, first.range);
        for (i, sample) in samples.iter().enumerate().skip(1) {
            add_outer(&mut scatter, T::ONE, &sub(&sample.anchor, &first.anchor));
            for axis in 0..D {
                low[axis] = low[axis].at_least(sample.anchor[axis] - sample.range);
                high[axis] = high[axis].at_most(sample.anchor[axis] + sample.range);
            }
            if sample.range < least {
                (reference, least) = (i, sample.range);
            }
        }
        let half = T::of(0.5);
        let boxed = core::array::from_fn(|axis| half * (low[axis] + high[axis]));
        let layout = Layout::of(samples, &scatter, constraints)?;
        Ok(Self { layout, boxed: layout.lift(boxed, samples), reference })
    }
}

impl<T: Real, const D: usize> Layout<T, D> {
    /// Classifies the anchors by the eigenvalues of their scatter about the first one.
    #[inline(always)]
    fn of(
        samples: &[RangeSample<T, D>],
        scatter: &Matrix<T, D>,
        constraints: &Constraints<T, D>,
    ) -> Result<Self, SolveError> {
        let trace = (0..D).fold(T::ZERO, |sum, axis| sum + scatter[axis][axis]);
        if trace < T::count(samples.len()) * T::of(COINCIDENT_M).squared() {
            return Err(SolveError::CoincidentAnchors);
        }
        if D == 2 {
            // For λ₀ ≪ λ₁, det ⁄ trace² is λ₀ ⁄ λ₁: no eigenvalues needed.
            let det = scatter[0][0] * scatter[1][1] - scatter[1][0].squared();
            let collinear = T::of(COLLINEAR_IN_PLANE).squared();
            return if det < collinear * trace.squared() { Err(SolveError::CollinearAnchors) } else { Ok(Self::Full) };
        }
        Self::of_space(samples, constraints)
    }

    /// The same for three dimensions, where the anchors may lie on a plane.
    #[inline(never)]
    fn of_space(samples: &[RangeSample<T, D>], constraints: &Constraints<T, D>) -> Result<Self, SolveError> {
        let (centre, scatter) = spread_of(samples.iter().map(|sample| sample.anchor));
        let (values, vectors) = symmetric_eigen(&scatter);
        if values[1] <= T::of(COLLINEAR).squared() * values[D - 1] {
            return Err(SolveError::CollinearAnchors);
        }
        if values[0] > T::of(COPLANAR).squared() * values[1] {
            return Ok(Self::Full);
        }
        let across = vectors[0];
        let (towards_tag, side_known) = match constraints.side {
            Side::Unknown => (-across[D - 1], false),
            Side::Of(point) => (dot(&across, &sub(&point, &centre)), true),
        };
        let normal = if towards_tag < T::ZERO { across.map(|c| -c) } else { across };
        Ok(Self::Flat { normal, side_known })
    }

    /// The normal where the anchors lie on a plane; in two dimensions the compiler knows that they never do.
    #[inline(always)]
    pub(crate) fn normal(&self) -> Option<&Vector<T, D>> {
        match self {
            Self::Flat { normal, .. } if D > 2 => Some(normal),
            Self::Flat { .. } | Self::Full => None,
        }
    }

    /// Moves a point across the anchors' plane to the height that fits the ranges: to the height h over the anchors'
    /// mean, where h² is the mean of the remainder of each range by Pythagoras. A point among anchors that span the
    /// space does not move.
    #[inline(always)]
    pub(crate) fn lift(&self, point: Vector<T, D>, samples: &[RangeSample<T, D>]) -> Vector<T, D> {
        match self.normal() {
            Some(normal) => lift_along(normal, point, samples),
            None => point,
        }
    }
}

#[inline(never)]
fn lift_along<T: Real, const D: usize>(
    normal: &Vector<T, D>,
    point: Vector<T, D>,
    samples: &[RangeSample<T, D>],
) -> Vector<T, D> {
    let height = dot(normal, &sub(&point, &centroid(samples)));
    let foot = add_scaled(&point, -height, normal);
    let mut sum = T::ZERO;
    for sample in samples {
        let across = sub(&foot, &sample.anchor);
        sum += sample.range.squared() - dot(&across, &across);
    }
    let height = (sum.at_least(T::ZERO) / T::count(samples.len())).sqrt();
    add_scaled(&foot, height, normal)
}
