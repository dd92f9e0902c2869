//! Rooms from fingerprints: classifiers are trained, scored, and written for the node.
//!
//! The input is dwells with the names of their rooms ([`Survey`]). The output is models of
//! `positioning_core::ble::rooms` ([`train`]) and how often they are right ([`score`]). The scored model is the one
//! that the node reads, in its `f32`.

mod file;
mod score;
mod survey;
mod svm;
mod train;
mod walk;

pub use file::{ModelFile, Names};
pub use score::{Score, Settled, evaluate, leave_one_out, score};
pub use survey::{MOST_WINDOWS, MeanRssi, Point, Survey};
pub use train::{Method, Trained, train};
pub use walk::{Interval, follow};
