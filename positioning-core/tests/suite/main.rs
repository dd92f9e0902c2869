//! The solvers as their callers see them.

mod hostile;
mod properties;
mod reference;
mod support;
