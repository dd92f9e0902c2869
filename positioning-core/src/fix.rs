//! What a solver gives: a position with its uncertainty, or the reason why there is none.

use crate::geometry::{Layout, centroid};
use crate::linalg::{Ldl, Matrix, Vector, add_outer, add_outer_full, add_scaled, dot, sub};
use crate::linear::PerSample;
use crate::{MAX_ANCHORS, RangeSample, Real};

/// A set of anchors, as the places of their samples in the solver's input: bit i stands for sample i.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct AnchorSet(pub u16);

impl AnchorSet {
    /// How many anchors are in the set.
    pub fn len(self) -> usize {
        self.0.count_ones() as usize
    }

    /// Whether no anchor is in the set.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Whether sample `index` is in the set.
    pub fn contains(self, index: usize) -> bool {
        index < 16 && self.0 >> index & 1 == 1
    }
}

/// A position of one epoch.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Fix<T, const D: usize> {
    /// Metres, in the anchors' frame.
    pub position: [T; D],
    /// Covariance of the position, m².
    pub covariance: [[T; D]; D],
    /// Dilution of precision per axis: metres of position per metre of range, all ranges weighing the same.
    pub dilution_of_precision: [T; D],
    /// The anchors whose ranges made the position; the others were judged to be without line of sight.
    pub used: AnchorSet,
    /// How far the ranges agree with the position, 0 to 1: the mean weight left to a range.
    pub quality: T,
}

impl<T: Real, const D: usize> Fix<T, D> {
    /// Standard deviation per axis, metres.
    pub fn sigma(&self) -> [T; D] {
        core::array::from_fn(|axis| self.covariance[axis][axis].sqrt())
    }
}

/// Why there is no position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum NoFix {
    /// Fewer than dimensions + 1 ranges.
    TooFewAnchors,
    /// More than [`MAX_ANCHORS`](crate::MAX_ANCHORS) ranges.
    TooManyAnchors,
    /// A number of the input is not finite, beyond a hundred kilometres, or a deviation under 0.1 mm.
    NotFinite,
    /// All anchors at one place.
    CoincidentAnchors,
    /// All anchors on one line: the position and its mirror image explain the ranges equally well.
    CollinearAnchors,
    /// No place is near enough to every anchor: the ranges cannot meet.
    RangesDisjoint,
    /// The geometry leaves the position undetermined, or the iteration left the room.
    Diverged,
    /// An oracle method was asked for, and the line of sight of a range is not known.
    SightUnknown,
}

impl NoFix {
    /// The reason as files and telemetry spell it.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::TooFewAnchors => "too-few-anchors",
            Self::TooManyAnchors => "too-many-anchors",
            Self::NotFinite => "not-finite",
            Self::CoincidentAnchors => "coincident-anchors",
            Self::CollinearAnchors => "collinear-anchors",
            Self::RangesDisjoint => "ranges-disjoint",
            Self::Diverged => "diverged",
            Self::SightUnknown => "sight-unknown",
        }
    }
}

impl core::fmt::Display for NoFix {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(self.as_str())
    }
}

impl core::error::Error for NoFix {}

/// How a method weighed its ranges, in whichever form it has the weights.
#[derive(Clone, Copy)]
pub(crate) enum Weighing<'a, T> {
    /// All alike.
    Equal,
    /// By 1 ⁄ σᵢ².
    Uncertainty(&'a PerSample<T>),
    /// By βᵢ.
    Beta(&'a PerSample<T>),
}

/// A range that misses the position by more than this was not used by a method that weighs, metres: the thesis' own bound
/// between direct and blocked (table 8-9).
const USED_M: f64 = 0.45;
/// A range that ends this far short of the position cannot meet the others, metres.
const SHORT_M: f64 = 1.0;
/// A weight counts as at least this part of the greatest one in the covariance, so that a lone favourite leaves a matrix
/// that can be inverted.
const LEAST_WEIGHT: f64 = 1.0e-4;

/// Judges a position and gives it its covariance.
///
/// The covariance is the sandwich H⁻¹ (Σ wᵢ² sᵢ² uᵢ uᵢᵀ) H⁻¹ with H = Σ wᵢ uᵢ uᵢᵀ (White, Econometrica 48, 1980), which is right
/// for any weights; sᵢ² pools the squared residual, enlarged by N ⁄ (N − D), with the variance a range in line of sight has.
#[inline(always)]
pub(crate) fn conclude<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    layout: &Layout<T, D>,
    position: Vector<T, D>,
    weighing: Weighing<'_, T>,
) -> Result<Fix<T, D>, NoFix> {
    if !position.iter().all(|component| component.is_finite()) {
        return Err(NoFix::Diverged);
    }
    let count = T::of(samples.len() as f64);
    let freedom = count / (count - T::of(D as f64));
    let weight = |i: usize| match weighing {
        Weighing::Equal => T::ONE,
        Weighing::Uncertainty(sigma) => T::ONE / sigma[i].squared(),
        Weighing::Beta(beta) => beta[i],
    };
    let mut least_weight = T::ZERO;
    for i in 0..samples.len().min(MAX_ANCHORS) {
        least_weight = least_weight.at_least(T::of(LEAST_WEIGHT) * weight(i));
    }
    let (mut hessian, mut geometry) = ([[T::ZERO; D]; D], [[T::ZERO; D]; D]);
    let (mut used, mut short, mut quality) = (0_u16, 0, T::ZERO);
    for (i, sample) in samples.iter().enumerate().take(MAX_ANCHORS) {
        let (unit, residual) = sight(sample, layout, &position);
        add_outer(&mut hessian, weight(i).at_least(least_weight), &unit);
        add_outer(&mut geometry, T::ONE, &unit);
        if matches!(weighing, Weighing::Equal) || residual.abs() <= T::of(USED_M) {
            used |= 1 << i;
        }
        if residual < -T::of(SHORT_M) {
            short += 1;
        }
        let wide = T::of(9.0) * sample.sigma.squared();
        quality += wide / (wide + residual.squared());
    }
    if 2 * short > samples.len() {
        return Err(NoFix::RangesDisjoint);
    }
    let hessian = Ldl::new(hessian).ok_or(NoFix::Diverged)?;
    let dilution = Ldl::new(geometry).ok_or(NoFix::Diverged)?.inverse();
    // A sum of outer products, and not a product of matrices, stays positive whatever `f32` loses.
    let mut covariance = [[T::ZERO; D]; D];
    for (i, sample) in samples.iter().enumerate().take(MAX_ANCHORS) {
        let (unit, residual) = sight(sample, layout, &position);
        let gain = hessian.solve(unit.map(|component| weight(i).at_least(least_weight) * component));
        add_outer_full(&mut covariance, freedom * residual.squared() + sample.sigma.squared(), &gain);
    }
    widen_to_mirror(&mut covariance, samples, layout, &position);
    Ok(Fix {
        position,
        covariance,
        dilution_of_precision: core::array::from_fn(|axis| dilution[axis][axis].sqrt()),
        used: AnchorSet(used),
        quality: quality / count,
    })
}

/// The direction from the anchor to the position, and the residual of the range.
///
/// Near the plane of coplanar anchors the ranges depend on the height by its square only; there the direction keeps a
/// component √(σ ⁄ 2d) across the plane, the height at which the two terms are alike, so that the deviation of the height
/// comes out large, not infinite.
#[inline(always)]
fn sight<T: Real, const D: usize>(
    sample: &RangeSample<T, D>,
    layout: &Layout<T, D>,
    position: &Vector<T, D>,
) -> (Vector<T, D>, T) {
    let across = sub(position, &sample.anchor);
    let distance = dot(&across, &across).at_least(T::EPSILON.squared()).sqrt();
    let scale = T::ONE / distance;
    let unit = across.map(|component| component * scale);
    let residual = sample.distance() - distance;
    match layout {
        Layout::Full => (unit, residual),
        Layout::Flat { normal, .. } => {
            let least = (T::of(0.5) * sample.sigma * scale).at_most(T::ONE).sqrt();
            let component = dot(&unit, normal);
            (add_scaled(&unit, component.at_least(least) - component, normal), residual)
        }
    }
}

/// Where the side of the anchors' plane was not known, the mirror image is as likely: half of its squared distance (2h)²
/// joins the variance across the plane.
pub(crate) fn widen_to_mirror<T: Real, const D: usize>(
    covariance: &mut Matrix<T, D>,
    samples: &[RangeSample<T, D>],
    layout: &Layout<T, D>,
    position: &Vector<T, D>,
) {
    if let Layout::Flat { normal, side_known: false } = layout {
        let height = dot(normal, &sub(position, &centroid(samples)));
        let variance = T::of(2.0) * height.squared();
        add_outer_full(covariance, variance, normal);
    }
}
