//! The bounding box (Min-Max): the centre of the intersection of the boxes around the anchors (6-3, 6-4).
//!
//! It is insensitive to ranges that are too long, and biased towards the middle of the anchors ("perimeter effect").
//! It is used here to weigh the ranges of better methods and to start their iterations.

use crate::fix::conclude_equal;
use crate::geometry::Survey;
use crate::{Constraints, Fix, RangeSample, Real, SolveError};

/// The centre of [max(aᵢ − dᵢ), min(aᵢ + dᵢ)], axis by axis (6-3, 6-4): additions and comparisons only.
///
/// # Errors
/// There is no position; [`SolveError`] has the reason.
pub fn bounding_box<T: Real, const D: usize>(
    samples: &[RangeSample<T, D>],
    constraints: &Constraints<T, D>,
) -> Result<Fix<T, D>, SolveError> {
    let survey = Survey::of(samples, constraints)?;
    conclude_equal(samples, &survey.layout, survey.boxed)
}
