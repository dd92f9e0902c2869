//! The solvers as their callers see them.

mod engine;
mod hostile;
mod properties;
mod reference;
mod support;
mod tdoa;
