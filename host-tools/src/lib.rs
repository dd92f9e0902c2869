//! The library of `baliza`: it reads recordings, and makes positions, figures and pictures.
//!
//! | module | what is in it |
//! |---|---|
//! | [`files`] | CSV rows, recordings, positions, captures of beacons, [`UserError`] |
//! | [`import`] | recordings of other systems |
//! | [`locate`] | positions from recordings, by `positioning-core` with the `f32` of a node |
//! | [`node`] | probe, serial port, stream of telemetry, log, recordings of nodes, config records |
//! | [`survey`] | fingerprints, coverage, path loss, rooms, positions for anchors |
//! | [`train`] | NLOS classifiers |
//! | [`simulate`] | what `baliza simulate` writes |
//! | [`plot`] | pictures |
//! | `station` | what `baliza serve` feeds into the station (feature `station`) |
//! | `view` | MCAP files and a live server for Foxglove (feature `foxglove`) |
//!
//! The library does not read arguments and does not print. The binary's module `cli` does both, with one file for each
//! subcommand.
#![forbid(unsafe_code)]

pub mod files;
pub mod import;
pub mod locate;
pub mod node;
pub mod plot;
pub mod simulate;
#[cfg(feature = "station")]
pub mod station;
pub mod survey;
pub mod train;
#[cfg(feature = "foxglove")]
pub mod view;

pub use files::{
    Anchor, Column, Coordinates, Epoch, Epochs, Files, Interrupted, Measured, Mode, Recording, Row, Table, Truth,
    Truths, UserError, by_time, read_anchors,
};
pub use locate::{Half, Height, NoPosition, Position, Setup, Solved, Solver, Space};
