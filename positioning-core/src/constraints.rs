//! What is known of the tag's position before any range.

use crate::Real;

/// What a solver may assume. The default is nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Constraints<T, const D: usize> {
    /// Which of two mirror images to take where the anchors lie on a plane.
    pub side: Side<T, D>,
    /// The area where the tag can be. The iterated methods stay inside; the closed forms do not use it.
    pub area: Option<Area<T, D>>,
}

impl<T: Real, const D: usize> Constraints<T, D> {
    /// The point of the known area that is nearest to `point`.
    #[inline(always)]
    pub(crate) fn inside(&self, point: [T; D]) -> [T; D] {
        match &self.area {
            Some(area) => core::array::from_fn(|axis| point[axis].at_least(area.min[axis]).at_most(area.max[axis])),
            None => point,
        }
    }
}

/// Which of two mirror images to take when all anchors lie on a plane (three dimensions only).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Side<T, const D: usize> {
    /// Not known: the solver takes the image that is lower on the last axis, since anchors hang higher than tags. The
    /// covariance then reaches to the other image.
    #[default]
    Unknown,
    /// The side of the anchors' plane on which this point lies: the last position, or a point of the floor.
    Of([T; D]),
}

/// A box along the axes, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Area<T, const D: usize> {
    /// The least coordinate of every axis.
    pub min: [T; D],
    /// The greatest coordinate of every axis.
    pub max: [T; D],
}
