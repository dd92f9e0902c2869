//! Errors as exceptions.

use pyo3::create_exception;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use recording::UserError;

create_exception!(
    baliza,
    InputError,
    PyValueError,
    "A file is wrong. `file` is its path, `line` the line's number from 1, or None where the whole file is wrong."
);

/// The exception of a wrong file.
pub(crate) fn input_error(py: Python<'_>, error: &UserError) -> PyErr {
    let (file, line) = match error {
        UserError::Line { file, line, .. } => (Some(file.display().to_string()), Some(*line)),
        UserError::File { file, .. } => (Some(file.display().to_string()), None),
        UserError::Flag { .. } => (None, None),
    };
    let exception = InputError::new_err(error.to_string());
    let value = exception.value(py);
    match value.setattr("file", file).and_then(|()| value.setattr("line", line)) {
        Ok(()) => exception,
        Err(error) => error,
    }
}

/// The exception of a wrong argument.
pub(crate) fn value_error(what: impl Into<String>) -> PyErr {
    PyValueError::new_err(what.into())
}
