//! A position from another source with its covariance: z = p + b + n, where b is an error that lasts, if there is
//! one. Its three numbers are made independent first. With R = L D Lᵀ the components of L⁻¹ z have the variances D,
//! and depend on the position by the rows of L⁻¹.

use super::{LEAST_SIGMA_M, Observation, POSITION_GATES, magnitude, sane};
use crate::Real;
use crate::track::state::STATES;
use crate::track::{Filter, FilterSettings, Linearised, Model, UpdateResult};

/// A position from another source.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ExternalPosition<T> {
    /// The position, metres.
    pub position_m: [T; 3],
    /// Covariance, m².
    pub covariance_m2: [[T; 3]; 3],
}

/// One independent component of a position.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PositionModel<T> {
    row: [T; 3],
    value: T,
    /// The index of the state that is its lasting error.
    link: Option<usize>,
}

impl<T> PositionModel<T> {
    /// The same component with a lasting error.
    pub(crate) fn with_link(self, link: usize) -> Self {
        Self { link: Some(link), ..self }
    }
}

impl<T: Real> Model<T> for PositionModel<T> {
    #[inline(always)]
    fn linearise(&self, mean: &[T; STATES]) -> Linearised<T> {
        let expected = self.row[0] * mean[0] + self.row[1] * mean[1] + self.row[2] * mean[2];
        let (link, slope) = self.link.map_or((0, T::ZERO), |link| (link, T::ONE));
        let lasting = slope * mean.get(link).copied().unwrap_or(T::ZERO);
        Linearised {
            innovation: self.value - expected - lasting,
            position: self.row,
            others: [(link, slope), (0, T::ZERO), (0, T::ZERO)],
            curvature: T::ZERO,
        }
    }
}

/// The independent components of a position, and their variances, none less than `least`.
pub(crate) fn components<T: Real>(position: [T; 3], covariance: &[[T; 3]; 3], least: T) -> [(PositionModel<T>, T); 3] {
    let r = covariance;
    let d0 = r[0][0].at_least(least);
    let l10 = r[1][0] / d0;
    let l20 = r[2][0] / d0;
    let d1 = (r[1][1] - l10 * r[1][0]).at_least(least);
    let l21 = (r[2][1] - l20 * r[1][0]) / d1;
    let d2 = (r[2][2] - l20 * r[2][0] - l21.squared() * d1).at_least(least);
    // L⁻¹.
    let rows = [[T::ONE, T::ZERO, T::ZERO], [-l10, T::ONE, T::ZERO], [l21 * l10 - l20, -l21, T::ONE]];
    let variances = [d0, d1, d2];
    core::array::from_fn(|k| {
        let row = rows[k];
        let value = row[0] * position[0] + row[1] * position[1] + row[2] * position[2];
        (PositionModel { row, value, link: None }, variances[k])
    })
}

impl<T: Real> Observation<T> for ExternalPosition<T> {
    fn is_sane(&self) -> bool {
        let sum =
            self.covariance_m2.iter().flatten().fold(magnitude(&self.position_m), |sum, element| sum + element.abs());
        sane(sum, T::ONE) && is_covariance(&self.covariance_m2)
    }

    #[inline(never)]
    fn update(&self, filter: &mut Filter<T>, settings: &FilterSettings<T>) -> UpdateResult {
        let mut result = UpdateResult::Accepted;
        let components = components(self.position_m, &self.covariance_m2, T::of(LEAST_SIGMA_M * LEAST_SIGMA_M));
        for (gate, (model, variance)) in POSITION_GATES.into_iter().zip(components) {
            let taken = filter.observe(&model, variance, gate, settings);
            if taken != UpdateResult::Accepted {
                result = taken;
            }
        }
        result
    }
}

/// Whether the lower triangle is that of a matrix without negative eigenvalues: no principal minor is negative, apart
/// from rounding.
fn is_covariance<T: Real>(m: &[[T; 3]; 3]) -> bool {
    let slack = T::of(8.0) * T::EPSILON;
    let diagonal = (0..3).all(|axis| m[axis][axis] >= T::ZERO);
    let pairs = [(1, 0), (2, 0), (2, 1)];
    let pair = |(r, c): (usize, usize)| m[r][c].squared() <= m[r][r] * m[c][c] * (T::ONE + slack);
    let product = m[0][0] * m[1][1] * m[2][2];
    let determinant = product + T::of(2.0) * m[1][0] * m[2][0] * m[2][1]
        - m[0][0] * m[2][1].squared()
        - m[1][1] * m[2][0].squared()
        - m[2][2] * m[1][0].squared();
    diagonal && pairs.into_iter().all(pair) && determinant >= -slack * product
}
