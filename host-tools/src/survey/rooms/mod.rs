//! Rooms from fingerprints: classifiers trained, scored, and written for the node.
//!
//! Stays with the names of their rooms flow in ([`Survey`]); out flow models of `positioning_core::ble::rooms` ([`train`]) and how
//! often they are right ([`score`]). What is scored is the model as the node reads it, in its `f32`.

mod file;
mod score;
mod survey;
mod svm;
mod train;

pub use file::{ModelFile, Names};
pub use score::{Score, Settled, evaluate, leave_one_out, score};
pub use survey::{MeanRssi, Point, Survey};
pub use train::{Method, Trained, train};
