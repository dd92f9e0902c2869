//! The result of a solver: a position with its uncertainty, or the reason why there is none.

use crate::geometry::{Layout, centroid};
use crate::linalg::{Ldl, Matrix, Vector, add_outer, add_outer_full, add_scaled, dot, sub};
use crate::sample::PerSample;
use crate::{MAX_ANCHORS, RangeSample, Real};

/// A set of anchors, as the indices of their samples in the solver's input: bit i is sample i.
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
    /// The anchors whose ranges made the position. The others were classified as without line of sight.
    pub used: AnchorSet,
    /// How far the ranges agree with the position, 0 to 1: the mean weight of a range.
    pub quality: T,
    /// The second of two places that explain the ranges, if there are two: `position` is the likelier one, and the
    /// covariance reaches from it to the other.
    pub alternative: Option<Alternative<T, D>>,
}

/// Two places that both explain the ranges of an epoch.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Alternative<T, const D: usize> {
    /// The vector from the likelier place to the other one, metres.
    pub apart: [T; D],
    /// The probability of the other one, at most one half.
    pub share: T,
}

impl<T: Real, const D: usize> Fix<T, D> {
    /// Standard deviation per axis, metres.
    pub fn sigma(&self) -> [T; D] {
        core::array::from_fn(|axis| self.covariance[axis][axis].sqrt())
    }

    /// The variances of all axes together, m².
    pub(crate) fn spread(&self) -> T {
        (0..D).fold(T::ZERO, |sum, axis| sum + self.covariance[axis][axis])
    }

    /// What makes the position doubtful, where it is from this number of ranges.
    pub fn flag(&self, given: usize) -> Option<Flag> {
        Flag::of(self.alternative.is_some(), D, given, self.used.len())
    }

    /// The likelier of two places, with the covariance about it, and the other place with its share. Where there is
    /// only one, it is the fix itself.
    pub(crate) fn places(&self) -> (Self, Option<(Self, T)>) {
        let Some(Alternative { apart, share }) = self.alternative else { return (*self, None) };
        let mut likelier = *self;
        add_outer_full(&mut likelier.covariance, -share, &apart);
        let other = Self { position: add_scaled(&likelier.position, T::ONE, &apart), ..likelier };
        (likelier, Some((other, share)))
    }
}

/// What makes a position doubtful beyond its covariance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Flag {
    /// The ranges fit two places, and the position is the likelier one.
    Ambiguous,
    /// Ranges contradict each other, and those that agree are too few to confirm the position: another choice of
    /// blocked links fits as well.
    Suspect,
}

impl Flag {
    /// The flag of a position of `D` unknown coordinates from this number of ranges, of which `used` agree with it.
    pub(crate) fn of(has_alternative: bool, unknowns: usize, given: usize, used: usize) -> Option<Self> {
        // As many ranges as unknowns and the common error always meet somewhere.
        let unconfirmed = used < given && used <= unknowns + 1;
        has_alternative.then_some(Self::Ambiguous).or(unconfirmed.then_some(Self::Suspect))
    }

    /// The flag as it is written in files.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Ambiguous => "ambiguous",
            Self::Suspect => "suspect",
        }
    }
}

/// Why there is no position. Telemetry writes the variants as numbers: add new ones at the end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize, postcard::experimental::max_size::MaxSize))]
pub enum SolveError {
    /// Fewer than dimensions + 1 ranges.
    TooFewAnchors,
    /// More than [`MAX_ANCHORS`](crate::MAX_ANCHORS) ranges.
    TooManyAnchors,
    /// A number of the input is not finite or beyond a hundred kilometres, or a deviation is under 0.1 mm.
    NotFinite,
    /// All anchors are at one position.
    CoincidentAnchors,
    /// All anchors are on one line: the position and its mirror image explain the ranges equally well.
    CollinearAnchors,
    /// No position is near enough to every anchor: the ranges cannot meet.
    RangesDisjoint,
    /// The geometry leaves the position undetermined, or the iteration left the room.
    Diverged,
    /// An oracle method was chosen, and the line of sight of a range is not known.
    SightUnknown,
}

impl SolveError {
    /// The reason as it is written in files and telemetry.
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

impl core::fmt::Display for SolveError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(self.as_str())
    }
}

impl core::error::Error for SolveError {}

/// A range whose residual exceeds this was not used by a weighted method, metres: the thesis' own bound between
/// direct and blocked (table 8-9).
const USED_M: f64 = 0.45;
/// A range that is too short by this much cannot meet the others, metres.
const SHORT_M: f64 = 1.0;
/// If the mean residual is below this, metres, the solver checks whether the ranges can meet.
const SUSPECT_M: f64 = -0.25;

/// [`conclude`] for a method that weighs all ranges alike, and so has used all of them.
#[inline(never)]
pub(crate) fn conclude_equal<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    layout: &Layout<T, D>,
    position: Vector<T, D>,
) -> Result<Fix<T, D>, SolveError> {
    let all = AnchorSet(((1_u32 << samples.len().min(MAX_ANCHORS)) - 1) as u16);
    // All weights share one copy of the code.
    Ok(Fix { used: all, ..conclude_weighted(samples, layout, position, &[T::ONE; MAX_ANCHORS])? })
}

/// [`conclude`] for a method that weighed its ranges by `weights`.
#[inline(never)]
pub(crate) fn conclude_weighted<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    layout: &Layout<T, D>,
    position: Vector<T, D>,
    weights: &PerSample<T>,
) -> Result<Fix<T, D>, SolveError> {
    conclude(samples, layout, position, weights.iter().copied())
}

/// Computes the quality and the covariance of a position. The covariance is the sandwich H⁻¹ M H⁻¹ with H = Σ wᵢ uᵢ
/// uᵢᵀ and M = Σ wᵢ² sᵢ² uᵢ uᵢᵀ (White, Econometrica 48, 1980), which is right for any weights. sᵢ² pools the squared
/// residual, enlarged by N ⁄ (N − D), with the variance of a range in line of sight.
#[inline(always)]
pub(crate) fn conclude<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    layout: &Layout<T, D>,
    position: Vector<T, D>,
    weights: impl Iterator<Item = T>,
) -> Result<Fix<T, D>, SolveError> {
    let count = T::count(samples.len());
    let freedom = count / (count - T::count(D));
    let (mut hessian, mut scatter, mut geometry) = ([[T::ZERO; D]; D], [[T::ZERO; D]; D], [[T::ZERO; D]; D]);
    let (mut used, mut bit, mut quality, mut balance) = (0_u32, 1_u32, T::ZERO, T::ZERO);
    for (sample, weight) in samples.iter().zip(weights) {
        let (unit, residual) = sight(sample, layout, &position);
        let (square, nominal) = (residual.squared(), sample.sigma.squared());
        add_outer(&mut geometry, T::ONE, &unit);
        add_outer(&mut hessian, weight, &unit);
        add_outer(&mut scatter, weight.squared() * (freedom * square + nominal), &unit);
        if square <= T::of(USED_M * USED_M) {
            used |= bit;
        }
        bit <<= 1;
        let wide = T::of(9.0) * nominal;
        quality += wide / (wide + square);
        balance += residual;
    }
    quality /= count;
    if balance < count * T::of(SUSPECT_M) && cannot_meet(samples, layout, &position) {
        return Err(blame(samples, SolveError::RangesDisjoint));
    }
    let (Some(dilution), Some(hessian)) = (Ldl::new(geometry), Ldl::new(hessian)) else {
        return Err(blame(samples, SolveError::Diverged));
    };
    let dilution = dilution.inverse();
    let mut covariance = sandwich(&hessian, scatter);
    // Any invalid number of a sample has reached this sum.
    let health = (0..D).fold(quality, |sum, axis| sum + covariance[axis][axis]);
    if !health.is_finite() {
        return Err(blame(samples, SolveError::Diverged));
    }
    widen_to_mirror(&mut covariance, samples, layout, &position);
    Ok(Fix {
        position,
        covariance,
        dilution_of_precision: core::array::from_fn(|axis| dilution[axis][axis].sqrt()),
        used: AnchorSet(used as u16),
        quality,
        alternative: None,
    })
}

/// The reason for a failure: an invalid sample, if there is one, else `otherwise`. It is called only after a failure,
/// so that good samples are not examined twice.
#[inline(never)]
pub(crate) fn blame<T: Real, const D: usize>(samples: &[RangeSample<T, D>], otherwise: SolveError) -> SolveError {
    if samples.iter().all(RangeSample::is_sane) { otherwise } else { SolveError::NotFinite }
}

/// Whether more than half of the ranges are too short to reach the position.
#[inline(never)]
fn cannot_meet<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    layout: &Layout<T, D>,
    position: &Vector<T, D>,
) -> bool {
    let short = samples.iter().filter(|sample| sight(sample, layout, position).1 < -T::of(SHORT_M)).count();
    2 * short > samples.len()
}

/// H⁻¹ M H⁻¹ as a sum of outer products, one for each column that is removed from M (whose lower triangle is given).
/// So it stays positive despite the rounding of `f32`.
#[inline(always)]
fn sandwich<T: Real, const D: usize>(hessian: &Ldl<T, D>, mut m: Matrix<T, D>) -> Matrix<T, D> {
    let mut product = [[T::ZERO; D]; D];
    for column in 0..D {
        let pivot = m[column][column];
        if pivot > T::ZERO {
            let inverse = T::ONE / pivot;
            let peel: Vector<T, D> =
                core::array::from_fn(|row| if row < column { T::ZERO } else { m[row][column] * inverse });
            add_outer_full(&mut product, pivot, &hessian.solve(peel));
            add_outer(&mut m, -pivot, &peel);
        }
    }
    product
}

/// The direction from the anchor to the position, and the residual of the range.
///
/// Near the plane of coplanar anchors the ranges depend on the height only by its square. There the direction keeps a
/// component √(σ ⁄ 2d) across the plane: the height at which the two terms are equal. So the deviation of the height
/// is large, but not infinite.
#[inline(always)]
fn sight<T: Real, const D: usize>(
    sample: &RangeSample<T, D>,
    layout: &Layout<T, D>,
    position: &Vector<T, D>,
) -> (Vector<T, D>, T) {
    let across = sub(position, &sample.anchor);
    let distance = (dot(&across, &across) + T::EPSILON.squared()).sqrt();
    let scale = T::ONE / distance;
    let unit = across.map(|component| component * scale);
    let residual = sample.range - distance;
    match layout.normal() {
        None => (unit, residual),
        Some(normal) => {
            let least = (T::of(0.5) * sample.sigma * scale).at_most(T::ONE).sqrt();
            let component = dot(&unit, normal);
            (add_scaled(&unit, component.at_least(least) - component, normal), residual)
        }
    }
}

/// If the side of the anchors' plane was not known, the mirror image is equally likely: half of its squared distance
/// (2h)² is added to the variance across the plane.
pub(crate) fn widen_to_mirror<T: Real, const D: usize>(
    covariance: &mut Matrix<T, D>,
    samples: &[RangeSample<T, D>],
    layout: &Layout<T, D>,
    position: &Vector<T, D>,
) {
    if let (Layout::Flat { side_known: false, .. }, Some(normal)) = (layout, layout.normal()) {
        let height = dot(normal, &sub(position, &centroid(samples)));
        let variance = T::of(2.0) * height.squared();
        add_outer_full(covariance, variance, normal);
    }
}
