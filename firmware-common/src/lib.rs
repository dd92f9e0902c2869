//! What every node has in common above its board: settings from the record, the event log (telemetry and log), crash reports,
//! supervision, what is counted.
//!
//! Nothing here knows the time or a chip: instants are microseconds since the node started, handed in by whoever has a clock.
#![no_std]
#![deny(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod build;
pub mod counts;
pub mod crash;
pub mod event_log;
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
pub use protocol::{AnchorProtocol, TagProtocol};
pub use reporter::Reporter;
pub use settings::Settings;
pub use start::{Start, introduce};
