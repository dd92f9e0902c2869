//! Positions and models from recordings.
//!
//! | module | what is in it |
//! |---|---|
//! | [`check`] | what a recording says against itself and its site |
//! | [`locate`] | positions from recordings, by `positioning-core` with the `f32` of a node |
//! | [`survey`] | fingerprints, coverage, path loss, rooms, positions for anchors |
//! | [`train`] | NLOS classifiers |
#![forbid(unsafe_code)]

pub mod check;
pub mod locate;
mod regression;
pub mod survey;
pub mod train;

pub use locate::{Setup, Solver};
