//! Tests of the solvers as their callers use them.

mod building;
mod consistency;
mod engine;
mod hostile;
mod links;
mod properties;
mod reference;
mod sides;
mod space;
mod support;
mod tdoa;
