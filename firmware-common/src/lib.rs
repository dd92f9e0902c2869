//! What all nodes have in common, independent of the board: settings from the record, the event log (telemetry and
//! log), crash reports, supervision, and counters.
//!
//! Nothing here reads a clock or depends on a chip. Instants are microseconds since the node started, and the caller
//! passes them in.
#![no_std]
#![deny(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod build;
pub mod counts;
pub mod crash;
pub mod event_log;
pub mod host;
pub mod lines;
pub mod messages;
#[cfg(feature = "node")]
pub mod node;
pub mod protocol;
pub mod reporter;
pub mod settings;
pub mod start;
pub mod supervision;

pub use counts::Counts;
pub use event_log::EventLog;
pub use host::{Host, HostChannel};
pub use protocol::{AnchorProtocol, TagProtocol};
pub use reporter::Reporter;
pub use settings::Settings;
pub use start::{Start, introduce};
