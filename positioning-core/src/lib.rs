//! The mathematics of Baliza: positions from ranges to anchors and from the RSSI of beacons.
//!
//! The crate uses no operating system, no heap, no I/O, no clock and no logger. So a tag, a replay and a simulation
//! run the same code.
//!
//! - Input of a solver: [`RangeSample`]s, one per range. Output: a [`Fix`] with its covariance, or a [`SolveError`]
//!   with the reason. Call [`solve`] with a [`Method`], or the method's own function.
//! - [`engine`] keeps a state: it takes measurements as they come, and tracks.
//! - [`locator`] is called by a tag, a replay and a simulation: it gives the engine ranges, differences of arrival
//!   and advertisements.
//!
//! Equation numbers are those of P. M. de Rojas Malpartida, *Evaluación de un sistema UWB frente a medidas sin línea de
//! visión directa* (Universidad de Sevilla, 2021), unless another source is named.
#![no_std]
#![deny(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod ble;
mod bounding_box;
mod constraints;
#[cfg(test)]
mod derivatives;
pub mod engine;
mod fix;
pub mod geodesy;
mod geometry;
pub mod linalg;
mod linear;
mod link_error;
pub mod locator;
mod measurement;
mod method;
pub mod nlos;
mod nonlinear;
mod real;
mod robust;
mod sample;
#[cfg(feature = "serde")]
mod stored;
mod track;

pub use bounding_box::bounding_box;
pub use constraints::{Area, Constraints, Side};
pub use fix::{Alternative, AnchorSet, Fix, Flag, SolveError};
pub use linear::{b_wls, b_wls_c, b_wls_r, lls};
pub use method::{Method, Solver, UnknownMethod, solve};
pub use nonlinear::{bb_nls, bb_nls_c, bb_nls_r, nls, nls_ccv};
pub use real::Real;
pub use robust::robust;
pub use sample::{MAX_ANCHORS, RangeSample, flatten};
pub use track::{Blocked, Motion, Noise, POWER_DIFFERENCE_PRIOR, TdoaSample, hyperbolic};
