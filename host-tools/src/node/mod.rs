//! A node at its probe, its serial port or its file: the stream of telemetry, the log, recordings of it, and its config record.

pub mod decode;
pub mod monitor;
pub mod probe;
pub mod provision;
pub mod recorder;
