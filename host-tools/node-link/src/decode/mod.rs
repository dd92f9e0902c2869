//! A node's telemetry: from the bytes of a stream to messages on one time line.
//!
//! [`StreamFiles`] opens files, and [`Chunks`] reads them or a pipe. [`Stream`] takes the bytes and returns messages,
//! each with its time in the recording's [`Timeline`]. [`row`] returns a message's row in its table. [`DecodeSummary`] counts
//! what was received and what was lost. `docs/reference/wire-format.md` specifies the bytes.

mod chunks;
mod opened;
mod pacing;
mod summary;
mod timeline;

pub use chunks::{Chunks, Waited};
pub use opened::{NodeStream, StreamFiles, node_streams};
pub use pacing::Pacing;
pub use summary::DecodeSummary;
pub(crate) use summary::no_telemetry;
pub use timeline::{Stamp, Timeline};

use serde_json::Value;
use wire::telemetry::{Condition, Decoder, Hello, Message, State, Table};

/// A telemetry stream that is being read. All commands use this decoder.
#[derive(Clone, Debug, Default)]
pub struct Stream {
    decoder: Decoder,
    timeline: Timeline,
    seen: Seen,
}

/// Counts in addition to those of the decoder and the timeline.
#[derive(Clone, Copy, Debug, Default)]
struct Seen {
    bytes: u64,
    /// The number of messages of each kind, in the order of [`Message::KINDS`].
    kinds: [u64; Message::KINDS.len()],
    positions: u64,
    network_full: u64,
    telemetry_dropped: Option<u32>,
    node: Option<Hello>,
    first_t_s: Option<f64>,
    last_t_s: Option<f64>,
}

impl Stream {
    /// Takes the next byte. Returns a message where the byte completes one.
    pub fn feed(&mut self, byte: u8) -> Option<(Stamp, Message)> {
        self.seen.bytes += 1;
        // The decoder counts malformed frames.
        let message = self.decoder.feed(byte)?.ok()?;
        let stamp = self.timeline.place(&message);
        self.seen.message(&message, stamp);
        Some((stamp, message))
    }

    /// The connection was lost: bytes are missing from here on.
    pub fn interrupted(&mut self) {
        self.decoder.interrupted();
    }

    /// The source has seen a restart of the node.
    pub fn restarted(&mut self) {
        self.decoder.interrupted();
        self.timeline.restart();
    }

    /// The number of restarts of the node.
    pub fn restarts(&self) -> u64 {
        self.timeline.restarts()
    }

    /// The decoder's counts so far.
    pub fn counts(&self) -> &wire::telemetry::Counts {
        self.decoder.counts()
    }

    /// The summary so far.
    pub fn summary(&self) -> DecodeSummary {
        DecodeSummary::of(&self.seen, &self.timeline, self.decoder.counts(), self.decoder.pending())
    }
}

impl Seen {
    fn message(&mut self, message: &Message, stamp: Stamp) {
        self.first_t_s = self.first_t_s.or(Some(stamp.t_s));
        self.last_t_s = Some(stamp.t_s);
        for (kind, count) in Message::KINDS.iter().zip(&mut self.kinds) {
            *count += u64::from(*kind == message.kind());
        }
        if let Message::Hello(hello) = message {
            self.node = Some(*hello);
        }
        if let Message::Fix(fix) = message {
            self.positions += u64::from(fix.reason().is_none());
        }
        if let Message::State(State { is: Condition::NetworkFull, .. }) = message {
            self.network_full += 1;
        }
        if let Message::Counters(counters) = message {
            self.telemetry_dropped = Some(counters.telemetry_dropped);
        }
    }
}

/// A message as a JSON object, with the address of its node where there are several.
pub fn object(message: &Message, node: Option<&str>) -> Value {
    let mut object = message.json();
    if let (Some(fields), Some(node)) = (object.as_object_mut(), node) {
        fields.insert("node".to_owned(), node.into());
    }
    object
}

/// The table of a message, and the message's row in it; `None` where the message is in no table.
pub fn row(stamp: Stamp, message: &Message) -> Option<(Table, Vec<String>)> {
    let (table, fields) = message.row()?;
    let start = [stamp.epoch.to_string(), format!("{:.6}", stamp.t_s)];
    Some((table, start.into_iter().chain(fields).collect()))
}
