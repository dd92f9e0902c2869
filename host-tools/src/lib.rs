//! The library behind `baliza`: recordings in, positions, figures and pictures out.
//!
//! | module | what is in it |
//! |---|---|
//! | [`files`] | CSV rows, recordings, positions, captures of beacons, [`UserError`] |
//! | [`locate`] | recordings into positions, through `positioning-core` with the `f32` of a node |
//! | [`node`] | probe, serial port, stream of telemetry, log, recordings of nodes, config records |
//! | [`survey`] | fingerprints, coverage, path loss, rooms, positions for anchors |
//! | [`train`] | NLOS classifiers |
//! | [`simulate`] | what `baliza simulate` writes |
//! | [`plot`] | pictures |
//!
//! Nothing here reads arguments or prints: the binary's module `cli` does, one file a subcommand.
#![forbid(unsafe_code)]

pub mod files;
pub mod locate;
pub mod node;
pub mod plot;
pub mod simulate;
pub mod survey;
pub mod train;

pub use files::{
    Anchor, Column, Coordinates, Epoch, Files, Measured, Recording, Row, Table, UserError, by_time, read_anchors,
    read_truth,
};
pub use locate::{Half, Height, NoPosition, Position, Setup, Solved, Solver, Space};
