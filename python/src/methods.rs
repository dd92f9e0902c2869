//! Positions of ranges in arrays.

use analysis::Solver;
use numpy::PyReadonlyArray2;
use positioning_core::Method;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use recording::{Epochs, Measured};

use crate::arguments::{Within, anchors, diagnostics};
use crate::arrays::{OfTag, positions};
use crate::errors::value_error;

/// The names of all methods.
#[pyfunction]
pub(crate) fn methods() -> Vec<&'static str> {
    Method::ALL.map(Method::as_str).to_vec()
}

/// The method of a name.
///
/// # Errors
/// There is none of this name.
pub(crate) fn method(name: &str) -> PyResult<Method> {
    name.parse().map_err(|unknown| value_error(format!("method: {name:?}: {unknown}")))
}

/// The ranges of epochs in arrays with a row an epoch and a column an anchor.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Ranges<'py> {
    /// Metres; NaN where there is none.
    range_m: PyReadonlyArray2<'py, f64>,
    /// 1, 0 or NaN.
    los: Option<PyReadonlyArray2<'py, f64>>,
    rx_power_dbm: Option<PyReadonlyArray2<'py, f64>>,
    fp_power_dbm: Option<PyReadonlyArray2<'py, f64>>,
}

impl Ranges<'_> {
    /// The epochs, named by their rows.
    ///
    /// # Errors
    /// Shapes do not fit, or a range is infinite.
    fn epochs(&self, anchors: usize) -> PyResult<Epochs> {
        let ranges = self.range_m.as_array();
        if ranges.ncols() != anchors {
            return Err(value_error(format!("ranges_m: {} columns for {anchors} anchors", ranges.ncols())));
        }
        let more = [("los", &self.los), ("rx_power_dbm", &self.rx_power_dbm), ("fp_power_dbm", &self.fp_power_dbm)];
        for (name, array) in more {
            if let Some(array) = array
                && array.as_array().shape() != ranges.shape()
            {
                return Err(value_error(format!("{name}: it must have the shape of ranges_m")));
            }
        }
        if let Some(((row, column), _)) = ranges.indexed_iter().find(|(_, range_m)| range_m.is_infinite()) {
            return Err(value_error(format!("ranges_m: [{row}, {column}] is infinite")));
        }
        let of = |array: &Option<PyReadonlyArray2<'_, f64>>, at| {
            array.as_ref().and_then(|array| array.as_array().get(at).copied()).unwrap_or(f64::NAN)
        };
        let mut epochs = Epochs::default();
        for (row, ranges) in ranges.outer_iter().enumerate() {
            let known = ranges.iter().enumerate().filter(|(_, range_m)| range_m.is_finite());
            let ranges = known.map(|(anchor, &range_m)| {
                let [los, power, first_path] =
                    [&self.los, &self.rx_power_dbm, &self.fp_power_dbm].map(|array| of(array, [row, anchor]));
                Measured {
                    anchor,
                    range_m,
                    t_s: None,
                    line_of_sight: (!los.is_nan()).then_some(los != 0.0),
                    diagnostics: diagnostics(power, first_path),
                }
            });
            epochs.push(&row.to_string(), None, None);
            ranges.for_each(|range| epochs.push_range(&range));
        }
        Ok(epochs)
    }
}

/// Solves each row of ranges by itself.
#[pyfunction]
pub(crate) fn solve<'py>(
    py: Python<'py>,
    anchors_m: PyReadonlyArray2<'py, f64>,
    ranges: Ranges<'py>,
    method_name: &str,
    within: Within,
) -> PyResult<Bound<'py, PyDict>> {
    let (method, setup) = (method(method_name)?, within.setup()?);
    let anchors = anchors(&anchors_m, &setup)?;
    let epochs = ranges.epochs(anchors.len())?;
    let solver = Solver::new(&anchors, setup);
    let solved = py.detach(|| solver.solve_all(method, &epochs, |_| ()));
    positions(py, &[OfTag { tag: None, epochs, solved }])
}
