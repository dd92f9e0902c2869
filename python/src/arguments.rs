//! Arguments of several functions: the space to solve in, anchors, the powers of a range.

use analysis::Setup;
use numpy::PyReadonlyArray2;
use positioning_core::nlos::{Feature, Features};
use pyo3::prelude::*;
use recording::Diagnostics;
use recording::folder::{MOST_HEIGHT_SIGMA_M, RecordingSettings};
use recording::{Anchor, Coordinates, Half, Height, Space};

use crate::errors::value_error;

/// The space to solve in, as a user writes it.
#[derive(Clone, FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Within {
    /// 2 or 3; `None`: as the recording says, else 3.
    dims: Option<u8>,
    /// Metres.
    height_m: Option<f64>,
    /// Standard deviation of the height, metres; `None`: as the recording says, else 0.
    height_sigma_m: Option<f64>,
    height_from_truth: bool,
    side: Option<String>,
    /// Least x and y, greatest x and y, metres.
    area_m: Option<[f64; 4]>,
}

impl Within {
    /// The same with what a recording says where the user says nothing.
    pub(crate) fn or(self, settings: &RecordingSettings) -> Self {
        let dims = self.dims.or(settings.dims);
        let height_m = if dims == Some(2) && !self.height_from_truth { settings.height_m } else { None };
        let sigma_m = height_m.and(settings.height_sigma_m).filter(|_| self.height_m.is_none());
        let area_m = settings.area_m.map(|[[x0, y0], [x1, y1]]| [x0, y0, x1, y1]);
        let (height_sigma_m, area_m) = (self.height_sigma_m.or(sigma_m), self.area_m.or(area_m));
        Self { dims, height_m: self.height_m.or(height_m), height_sigma_m, area_m, ..self }
    }

    /// The same as the types of `host-tools`.
    ///
    /// # Errors
    /// The values cannot be combined.
    pub(crate) fn setup(&self) -> PyResult<Setup> {
        if self.height_m.is_some_and(|height_m| !height_m.is_finite()) {
            return Err(value_error("height_m: it must be finite"));
        }
        let space = match (self.dims.unwrap_or(3), self.side.as_deref()) {
            (2, Some(_)) => return Err(value_error("side: only with dims=3")),
            (2, None) => Space::Plane(match (self.height_m, self.height_from_truth) {
                (Some(_), true) => return Err(value_error("height_m and height_from_truth exclude each other")),
                (Some(height_m), false) => Height::Fixed(height_m),
                (None, true) => Height::FromTruth,
                (None, false) => Height::Unknown,
            }),
            (3, _) if self.height_m.is_some() => return Err(value_error("height_m: only with dims=2")),
            (3, _) if self.height_from_truth => return Err(value_error("height_from_truth: only with dims=2")),
            (3, None) => Space::Full(None),
            (3, Some("below")) => Space::Full(Some(Half::Below)),
            (3, Some("above")) => Space::Full(Some(Half::Above)),
            (3, Some(other)) => return Err(value_error(format!("side: {other:?} is neither 'below' nor 'above'"))),
            (other, _) => return Err(value_error(format!("dims: {other} is neither 2 nor 3"))),
        };
        let height_sigma_m = match (space, self.height_sigma_m) {
            (_, None) => 0.0,
            (Space::Plane(Height::Fixed(_)), Some(sigma_m)) if (0.0..=MOST_HEIGHT_SIGMA_M).contains(&sigma_m) => {
                sigma_m
            }
            (_, Some(_)) => {
                return Err(value_error(format!("height_sigma_m: 0 to {MOST_HEIGHT_SIGMA_M}, beside height_m")));
            }
        };
        let area_m = match self.area_m {
            None => None,
            Some([x0, y0, x1, y1]) if x0 < x1 && y0 < y1 && [x0, y0, x1, y1].iter().all(|at| at.is_finite()) => {
                Some([[x0, y0], [x1, y1]])
            }
            Some(_) => return Err(value_error("area_m: (x0, y0, x1, y1) with x0 < x1 and y0 < y1 is expected")),
        };
        Ok(Setup { space, height_sigma_m, area_m })
    }
}

/// Whether solving needs the heights of anchors.
pub(crate) fn needs_heights(setup: &Setup) -> bool {
    setup.space != Space::Plane(Height::Unknown)
}

/// Anchors of an array with a row each: x and y, or x, y and z, metres.
///
/// # Errors
/// The array has another shape, a number is not finite, or a height is missing.
pub(crate) fn anchors(places_m: &PyReadonlyArray2<'_, f64>, setup: &Setup) -> PyResult<Vec<Anchor>> {
    let places_m = places_m.as_array();
    let [count, columns] = *places_m.shape() else { return Err(value_error("anchors_m: two dimensions are expected")) };
    if !matches!(columns, 2 | 3) || count == 0 {
        return Err(value_error(format!(
            "anchors_m: shape ({count}, {columns}), but (anchors, 3) or (anchors, 2) is expected"
        )));
    }
    if columns == 2 && needs_heights(setup) {
        return Err(value_error("anchors_m: a third column, the heights, is needed, or dims=2 without height_m"));
    }
    if let Some(((row, _), at)) = places_m.indexed_iter().find(|(_, at)| !at.is_finite()) {
        return Err(value_error(format!("anchors_m: {at} in row {row} is not finite")));
    }
    let place = |row: &[f64]| match *row {
        [x_m, y_m] => Some(Coordinates { x_m, y_m, z_m: None }),
        [x_m, y_m, z_m] => Some(Coordinates { x_m, y_m, z_m: Some(z_m) }),
        _ => None,
    };
    let rows = places_m.outer_iter().filter_map(|row| place(&row.to_vec()));
    Ok(rows.enumerate().map(|(index, place)| Anchor { name: index.to_string(), place }).collect())
}

/// The diagnostics of a range whose received power and first-path power are known, dBm; NaN where they are not.
pub(crate) fn diagnostics(power_dbm: f64, first_path_dbm: f64) -> Diagnostics {
    let mut features = Features::default();
    features.set(Feature::PowerDifference, (power_dbm - first_path_dbm) as f32);
    Diagnostics { features, power_dbm: power_dbm as f32, ..Diagnostics::default() }
}
