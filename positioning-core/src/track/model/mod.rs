//! What can be measured, a file each: the expected number h(x), its derivatives, and the innovation.

pub(crate) mod height;
pub(crate) mod position;
pub(crate) mod range;
pub(crate) mod tdoa;

use crate::Real;

/// The distance of two points, metres, and the unit vector from the second to the first; on top of each other any finite one.
#[inline(always)]
fn sight<T: Real>(from: &[T; 3], to: &[T; 3]) -> (T, [T; 3]) {
    let across: [T; 3] = core::array::from_fn(|axis| from[axis] - to[axis]);
    let square = across[0].squared() + across[1].squared() + across[2].squared();
    let distance = (square + T::of(1.0e-6)).sqrt();
    let inverse = T::ONE / distance;
    (distance, across.map(|component| component * inverse))
}
