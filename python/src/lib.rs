//! The compiled part of the Python package `baliza`: recordings, solvers, the track and telemetry, from `host-tools`.
//!
//! This crate only converts: arguments to the types of `host-tools`, results to NumPy arrays and dictionaries, errors
//! to exceptions. `python/baliza/__init__.py` is what a user calls; it checks shapes and names anchors.
#![deny(unsafe_code)]

mod arguments;
mod arrays;
mod errors;
mod methods;
mod recording;
mod telemetry;
mod track;

use pyo3::prelude::*;

#[pymodule]
mod _native {
    #[pymodule_export]
    use crate::errors::InputError;
    #[pymodule_export]
    use crate::methods::{methods, solve};
    #[pymodule_export]
    use crate::recording::Recording;
    #[pymodule_export]
    use crate::telemetry::Decoder;
    #[pymodule_export]
    use crate::track::Track;
}
