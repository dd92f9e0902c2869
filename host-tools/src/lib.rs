//! The library behind `baliza`: recordings in, positions, figures and pictures out.
//!
//! [`Recording::read`] takes the CSV files, [`Solver`] runs `positioning-core` on every epoch with the `f32` of the node,
//! [`positions`] writes what comes out, [`Statistics`] condenses its errors, [`plot`] draws it. [`thesis`] is the benchmark on
//! simulated ranges. Nothing here knows of arguments or prints: that is the binary's, one module a subcommand.
#![forbid(unsafe_code)]

pub mod barral;
pub mod ble;
mod cholesky;
pub mod decode;
pub mod example;
pub mod fusion;
pub mod garcia;
pub mod linde;
pub mod monitor;
pub mod nlos;
pub mod output;
pub mod place;
pub mod plot;
pub mod positions;
pub mod presence;
pub mod probe;
pub mod provision;
mod random;
pub mod recorder;
mod recording;
pub mod simulate;
mod solve;
mod statistics;
mod table;
pub mod thesis;
pub mod track;
mod user_error;

pub use recording::{Anchor, Epoch, Files, Measured, Place, Recording, by_time, read_anchors, read_truth};
pub use solve::{Half, Height, NoPosition, Position, Setup, Solved, Solver, Space};
pub use statistics::Statistics;
pub use table::{Column, Row, Table};
pub use user_error::UserError;
