//! A node's log and its telemetry together, in the order of their arrival, live or from files.
//!
//! A [`Source`] returns bytes of two channels: a chip behind a [`Probed`] probe, a [`Serial`] port, a [`Piped`] stream,
//! or [`Files`]. A [`Session`] decodes them to lines and messages, and counts what was lost. [`listen()`] runs both
//! until the end. [`Lines`] formats the result for a person, without the log's lines that telemetry also has. An
//! [`Image`] is the ELF file; the log cannot be read without it.

mod demux;
mod elf;
mod formats;
mod images;
mod json;
mod listen;
mod log_frames;
mod probed;
mod rtt;
mod serial;
mod session;
mod show;
mod source;
mod streams;
mod table;

pub use demux::Demux;
pub use elf::{Build, Image, Marks, SourceLocation};
pub use images::ImageFiles;
pub use json::json;
pub use listen::{Limits, Listener, listen};
pub use log_frames::LogLine;
pub use probed::{Attach, Probed};
pub use rtt::{Memory, Polled, Rings, find};
pub use serial::{Open, Port, Serial, no_port, ports};
pub use session::{FindImage, Item, NodeOutput, Session, SessionCounts};
pub use show::{Lines, summary};
pub use source::{Event, NodeChannel, Pace, Source};
pub use streams::{Files, Piped};

#[cfg(test)]
mod testing;
#[cfg(test)]
mod testing_chip;
