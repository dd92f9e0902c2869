//! The bounding box (Min-Max): the centre of the intersection of the boxes around the anchors (6-3, 6-4).
//!
//! Insensitive to ranges that are too long, biased towards the middle of the anchors ("perimeter effect"); its use here is
//! to weigh the ranges of better methods and to start their iterations.

use crate::fix::{Weighing, conclude};
use crate::geometry::Layout;
use crate::linalg::Vector;
use crate::sample::check;
use crate::{Constraints, Fix, NoFix, RangeSample, Real};

/// The centre of [max(aᵢ − dᵢ), min(aᵢ + dᵢ)], axis by axis (6-4). `samples` is not empty.
#[inline(always)]
pub(crate) fn centre<T: Real, const D: usize>(samples: &[RangeSample<T, D>]) -> Vector<T, D> {
    let Some((first, rest)) = samples.split_first() else {
        return [T::ZERO; D];
    };
    let half = T::of(0.5);
    core::array::from_fn(|axis| {
        let mut low = first.anchor[axis] - first.distance();
        let mut high = first.anchor[axis] + first.distance();
        for sample in rest {
            low = low.at_least(sample.anchor[axis] - sample.distance());
            high = high.at_most(sample.anchor[axis] + sample.distance());
        }
        half * (low + high)
    })
}

/// Bounding box (6-3, 6-4): additions and comparisons only.
///
/// # Errors
/// See [`NoFix`].
pub fn bounding_box<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    constraints: &Constraints<T, D>,
) -> Result<Fix<T, D>, NoFix> {
    check(samples)?;
    let layout = Layout::of(samples, constraints)?;
    conclude(samples, &layout, layout.lift(centre(samples), samples), Weighing::Equal)
}
