//! Telemetry: messages of a stream as dictionaries.

use node_link::decode::Stream;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use serde_json::Value;

/// Decodes a stream of telemetry.
#[pyclass(module = "baliza._native")]
#[derive(Default)]
pub(crate) struct Decoder {
    stream: Stream,
}

#[pymethods]
impl Decoder {
    #[new]
    fn new() -> Self {
        Self::default()
    }

    /// The messages that these bytes complete.
    fn feed<'py>(&mut self, py: Python<'py>, bytes: &[u8]) -> PyResult<Vec<Bound<'py, PyAny>>> {
        let messages = bytes.iter().filter_map(|byte| self.stream.feed(*byte));
        messages.map(|(_, message)| object(py, &message.json())).collect()
    }

    /// What was received so far, and what was lost.
    fn summary<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let summary = serde_json::to_value(self.stream.summary());
        object(py, &summary.map_err(|error| PyRuntimeError::new_err(error.to_string()))?)
    }
}

/// A JSON value as an object of Python.
fn object<'py>(py: Python<'py>, value: &Value) -> PyResult<Bound<'py, PyAny>> {
    Ok(match value {
        Value::Null => py.None().into_bound(py),
        Value::Bool(value) => value.into_pyobject(py)?.to_owned().into_any(),
        Value::Number(number) => match (number.as_i64(), number.as_u64(), number.as_f64()) {
            (Some(number), _, _) => number.into_pyobject(py)?.into_any(),
            (None, Some(number), _) => number.into_pyobject(py)?.into_any(),
            (None, None, number) => number.into_pyobject(py)?.into_any(),
        },
        Value::String(text) => text.into_pyobject(py)?.into_any(),
        Value::Array(values) => {
            let values: Vec<_> = values.iter().map(|value| object(py, value)).collect::<PyResult<_>>()?;
            PyList::new(py, values)?.into_any()
        }
        Value::Object(fields) => {
            let dict = PyDict::new(py);
            for (key, value) in fields {
                dict.set_item(key, object(py, value)?)?;
            }
            dict.into_any()
        }
    })
}
