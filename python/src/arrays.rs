//! Results as dictionaries of NumPy arrays; NaN where a number is not known.

use numpy::{Element, IntoPyArray, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use recording::{Coordinates, Epochs, Position, Solved};

/// Unknown coordinates.
const NONE_M: [f64; 3] = [f64::NAN; 3];

/// The coordinates as numbers, metres.
pub(crate) fn metres(place: &Coordinates) -> [f64; 3] {
    [place.x_m, place.y_m, place.z_m.unwrap_or(f64::NAN)]
}

/// An array with a vector of three in each row.
///
/// # Errors
/// NumPy returns an error.
pub(crate) fn vectors(py: Python<'_>, rows: impl IntoIterator<Item = [f64; 3]>) -> PyResult<Bound<'_, PyAny>> {
    let numbers: Vec<f64> = rows.into_iter().flatten().collect();
    let count = numbers.len() / 3;
    Ok(numbers.into_pyarray(py).reshape([count, 3])?.into_any())
}

/// An array of numbers.
pub(crate) fn numbers<T: Element>(py: Python<'_>, numbers: impl IntoIterator<Item = T>) -> Bound<'_, PyAny> {
    numbers.into_iter().collect::<Vec<T>>().into_pyarray(py).into_any()
}

/// The positions of a tag.
pub(crate) struct OfTag {
    /// The tag's name.
    pub(crate) tag: Option<String>,
    /// The epochs.
    pub(crate) epochs: Epochs,
    /// What was found for each of them.
    pub(crate) solved: Vec<Solved>,
}

/// The positions of all tags, tag after tag.
///
/// # Errors
/// Python returns an error.
pub(crate) fn positions<'py>(py: Python<'py>, tags: &[OfTag]) -> PyResult<Bound<'py, PyDict>> {
    let epochs = || tags.iter().flat_map(|of| of.epochs.iter());
    let solved = || tags.iter().flat_map(|of| &of.solved);
    let found = || solved().map(|solved| solved.outcome.as_ref().ok());
    let dict = PyDict::new(py);
    let names = tags.iter().flat_map(|of| of.epochs.iter().map(|_| of.tag.as_deref()));
    dict.set_item("tag", names.collect::<Vec<_>>())?;
    dict.set_item("epoch", epochs().map(|epoch| epoch.name).collect::<Vec<_>>())?;
    dict.set_item("t_s", numbers(py, epochs().map(|epoch| epoch.t_s.unwrap_or(f64::NAN))))?;
    dict.set_item("position_m", vectors(py, found().map(|at| at.map_or(NONE_M, |at| metres(&at.place))))?)?;
    dict.set_item("sigma_m", vectors(py, found().map(|at| at.map_or(NONE_M, |at| metres(&at.sigma))))?)?;
    let rows: Vec<f64> = found().flat_map(|at| at.map_or([NONE_M; 3], covariance_m2)).flatten().collect();
    let count = rows.len() / 9;
    dict.set_item("covariance_m2", rows.into_pyarray(py).reshape([count, 3, 3])?)?;
    dict.set_item("used", numbers(py, found().map(|at| at.map_or(0, |at| at.used as i64))))?;
    let reasons = solved().map(|solved| solved.outcome.as_ref().err().map(|reason| reason.as_str()));
    dict.set_item("reason", reasons.collect::<Vec<_>>())?;
    let flags = found().map(|at| at.and_then(|at| at.flag).map(|flag| flag.as_str()));
    dict.set_item("flag", flags.collect::<Vec<_>>())?;
    let velocities = found().map(|at| at.and_then(|at| at.velocity_m_s.as_ref()).map_or(NONE_M, metres));
    dict.set_item("velocity_m_s", vectors(py, velocities)?)?;
    let others = || found().map(|at| at.and_then(|at| at.alternative));
    dict.set_item(
        "alternative_apart_m",
        vectors(py, others().map(|other| other.map_or(NONE_M, |other| other.apart)))?,
    )?;
    let shares = others().map(|other| other.map_or(f64::NAN, |other| other.share));
    dict.set_item("alternative_share", numbers(py, shares))?;
    let truths = epochs().map(|epoch| epoch.truth.as_ref().map_or(NONE_M, metres));
    dict.set_item("truth_m", vectors(py, truths)?)?;
    dict.set_item("error_m", numbers(py, solved().map(|solved| solved.error_m.unwrap_or(f64::NAN))))?;
    Ok(dict)
}

/// The covariance, m²; NaN in the row and column of a height that is not computed.
fn covariance_m2(position: &Position) -> [[f64; 3]; 3] {
    let [x, y, z] = metres(&position.sigma);
    let xy = position.covariance_xy;
    let [xz, yz] = position.covariance_z.unwrap_or([f64::NAN; 2]);
    [[x * x, xy, xz], [xy, y * y, yz], [xz, yz, z * z]]
}
