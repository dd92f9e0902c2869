//! A node's telemetry, from the bytes of a stream to messages in one time.
//!
//! [`Chunks`] reads a file or a pipe; [`Stream`] takes the bytes and gives messages, each with its place in the recording's
//! [`Timeline`]; [`row`] makes of a message the row of its table, and [`Summary`] tells what came and what was lost. The bytes are those of
//! `docs/wire-format.md`.

mod chunks;
mod summary;
mod timeline;

pub use chunks::{Chunks, Waited, open_stream};
pub use summary::Summary;
pub use timeline::{Stamp, Timeline};

use wire::telemetry::{Decoder, Hello, Message, Table};

/// A stream, as it is read: the one decoder of telemetry for all commands.
#[derive(Clone, Debug, Default)]
pub struct Stream {
    decoder: Decoder,
    timeline: Timeline,
    seen: Seen,
}

/// What came, beside what the decoder and the timeline count.
#[derive(Clone, Copy, Debug, Default)]
struct Seen {
    bytes: u64,
    /// Messages, in the order of [`Message::KINDS`].
    kinds: [u64; Message::KINDS.len()],
    positions: u64,
    telemetry_dropped: Option<u32>,
    node: Option<Hello>,
    first_t_s: Option<f64>,
    last_t_s: Option<f64>,
}

impl Stream {
    /// Takes the next byte; a message where one is whole with it.
    pub fn feed(&mut self, byte: u8) -> Option<(Stamp, Message)> {
        self.seen.bytes += 1;
        // What is malformed is counted by the decoder.
        let message = self.decoder.feed(byte)?.ok()?;
        let stamp = self.timeline.place(&message);
        self.seen.message(&message, stamp);
        Some((stamp, message))
    }

    /// Bytes are missing from here on: a connection was lost.
    pub fn interrupted(&mut self) {
        self.decoder.interrupted();
    }

    /// The node has restarted: the source saw it.
    pub fn restarted(&mut self) {
        self.decoder.interrupted();
        self.timeline.restart();
    }

    /// How many times the node started anew.
    pub fn restarts(&self) -> u64 {
        self.timeline.restarts()
    }

    /// What became of the bytes so far.
    pub fn counts(&self) -> &wire::telemetry::Counts {
        self.decoder.counts()
    }

    /// What came so far.
    pub fn summary(&self) -> Summary {
        Summary::of(&self.seen, &self.timeline, self.decoder.counts(), self.decoder.pending())
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
        if let Message::Counters(counters) = message {
            self.telemetry_dropped = Some(counters.telemetry_dropped);
        }
    }
}

/// The table that a message is a row of, and the row; `None` where it is in none.
pub fn row(stamp: Stamp, message: &Message) -> Option<(Table, Vec<String>)> {
    let (table, fields) = message.row()?;
    let start = [stamp.epoch.to_string(), format!("{:.6}", stamp.t_s)];
    Some((table, start.into_iter().chain(fields).collect()))
}
