//! The solvers as their callers see them.

mod consistency;
mod engine;
mod hostile;
mod properties;
mod reference;
mod space;
mod support;
mod tdoa;
