//! A node at a debug probe, at a serial port or in a file: its telemetry stream, its log, recordings of it, and its
//! config record.
#![forbid(unsafe_code)]

pub mod decode;
pub mod gateway_key;
pub mod hexadecimal;
pub mod monitor;
pub mod probe;
pub mod provision;
pub mod recorder;
