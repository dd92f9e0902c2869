//! The track of a tag, one step after another.

use analysis::locate::track::{Tracker, Weighting, settings};
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use recording::{Epochs, Measured};

use crate::arguments::{Within, anchors, diagnostics};
use crate::arrays::{OfTag, positions};
use crate::errors::value_error;

/// How powers are used.
///
/// # Errors
/// The name is unknown.
pub(crate) fn weighting(name: &str) -> PyResult<Weighting> {
    match name {
        "weigh" => Ok(Weighting::Weigh),
        "ignore" => Ok(Weighting::Ignore),
        "alike" => Ok(Weighting::Alike),
        other => Err(value_error(format!("nlos: {other:?} is none of 'weigh', 'ignore', 'alike'"))),
    }
}

/// A range: the index of its anchor, metres, received power and first-path power, dBm (NaN: unknown).
type Range = (usize, f64, f64, f64);

/// Follows a tag.
#[pyclass(module = "baliza._native")]
pub(crate) struct Track {
    tracker: Tracker<'static>,
    anchors: usize,
}

#[pymethods]
impl Track {
    #[new]
    fn new(anchors_m: PyReadonlyArray2<'_, f64>, nlos: &str, within: Within) -> PyResult<Self> {
        let (weighting, setup) = (weighting(nlos)?, within.setup()?);
        let anchors = anchors(&anchors_m, &setup)?;
        let count = anchors.len();
        Ok(Self { tracker: Tracker::new(anchors, setup, settings(&setup, weighting), None), anchors: count })
    }

    /// Takes the ranges of one time, and returns the position after them.
    fn step<'py>(&mut self, py: Python<'py>, t_s: f64, ranges: Vec<Range>) -> PyResult<Bound<'py, PyDict>> {
        if !t_s.is_finite() {
            return Err(value_error(format!("t_s: {t_s} is not finite")));
        }
        let mut epochs = Epochs::default();
        epochs.push("", Some(t_s), None);
        for (anchor, range_m, power_dbm, first_path_dbm) in ranges {
            if anchor >= self.anchors {
                return Err(value_error(format!("ranges: there is no anchor {anchor}")));
            }
            if !range_m.is_finite() {
                return Err(value_error(format!("ranges: {range_m} is not finite")));
            }
            let diagnostics = diagnostics(power_dbm, first_path_dbm);
            epochs.push_range(&Measured { anchor, range_m, t_s: None, line_of_sight: None, diagnostics });
        }
        let solved = self.tracker.follow_all(&epochs, || ());
        positions(py, &[OfTag { tag: None, epochs, solved }])
    }
}
