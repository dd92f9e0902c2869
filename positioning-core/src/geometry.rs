//! How the anchors lie: whether they determine a position at all, and which way it may be mirrored.

use crate::linalg::{Matrix, Vector, add_outer, add_scaled, dot, sub, symmetric_eigen};
use crate::{Constraints, NoFix, RangeSample, Real, Side};

/// Anchors closer together than this are one place, metres.
const COINCIDENT_M: f64 = 0.01;
/// Anchors are on a line when their spread across it is less than this part of their spread along it.
const COLLINEAR: f64 = 0.01;
/// Anchors are on a plane when their spread across it is less than this part of the lesser spread within it: a height from
/// such anchors is worse than the reach of the ranges by a factor of twenty.
const COPLANAR: f64 = 0.05;

/// The arrangement of anchors that determine a position.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Layout<T, const D: usize> {
    /// They span the space.
    Full,
    /// They lie on a plane (three dimensions): a position and its mirror image explain the ranges alike.
    Flat {
        /// Unit vector across the plane, towards the side that the tag is on.
        normal: Vector<T, D>,
        /// Whether the caller knew the side.
        side_known: bool,
    },
}

/// The mean of the anchors' places.
#[inline(always)]
pub(crate) fn centroid<T: Real, const D: usize>(samples: &[RangeSample<T, D>]) -> Vector<T, D> {
    let mut sum = [T::ZERO; D];
    for sample in samples {
        sum = add_scaled(&sum, T::ONE, &sample.anchor);
    }
    let share = T::ONE / T::of(samples.len() as f64);
    sum.map(|component| component * share)
}

impl<T: Real, const D: usize> Layout<T, D> {
    /// Classifies the anchors by the eigenvalues of their scatter matrix.
    #[inline(always)]
    pub(crate) fn of(samples: &[RangeSample<T, D>], constraints: &Constraints<T, D>) -> Result<Self, NoFix> {
        let centre = centroid(samples);
        let mut scatter: Matrix<T, D> = [[T::ZERO; D]; D];
        let share = T::ONE / T::of(samples.len() as f64);
        for sample in samples {
            add_outer(&mut scatter, share, &sub(&sample.anchor, &centre));
        }
        let coincident = T::of(COINCIDENT_M).squared();
        let collinear = T::of(COLLINEAR).squared();
        if D == 2 {
            // For λ₀ ≪ λ₁, det ⁄ trace² is λ₀ ⁄ λ₁: no eigenvalues needed.
            let trace = scatter[0][0] + scatter[1][1];
            if trace < coincident {
                return Err(NoFix::CoincidentAnchors);
            }
            let det = scatter[0][0] * scatter[1][1] - scatter[1][0].squared();
            return if det > collinear * trace.squared() { Ok(Self::Full) } else { Err(NoFix::CollinearAnchors) };
        }
        let (values, vectors) = symmetric_eigen(&scatter);
        if values[D - 1] < coincident {
            return Err(NoFix::CoincidentAnchors);
        }
        if values[1] <= collinear * values[D - 1] {
            return Err(NoFix::CollinearAnchors);
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

    /// Moves a point to where the ranges want it across the anchors' plane: to the height h over their middle, where h² is
    /// the mean of what Pythagoras leaves of each range. A point among anchors that span the space stays.
    pub(crate) fn lift(&self, point: Vector<T, D>, samples: &[RangeSample<T, D>]) -> Vector<T, D> {
        match self {
            Self::Full => point,
            Self::Flat { normal, .. } => {
                let height = dot(normal, &sub(&point, &centroid(samples)));
                let foot = add_scaled(&point, -height, normal);
                let mut sum = T::ZERO;
                for sample in samples {
                    let across = sub(&foot, &sample.anchor);
                    sum += sample.distance().squared() - dot(&across, &across);
                }
                let height = (sum.at_least(T::ZERO) / T::of(samples.len() as f64)).sqrt();
                add_scaled(&foot, height, normal)
            }
        }
    }
}
