//! A node's telemetry, from the bytes of a stream to lines and tables.
//!
//! [`Chunks`] reads a file or a pipe; [`Stream`] takes the bytes and gives messages, each with its place in the recording's [`Timeline`]; a message becomes a line of JSON
//! ([`json()`]) or a row of a [`Table`]; [`Summary`] tells what came and what was lost. The bytes are those of `docs/wire-format.md`.

mod chunks;
mod json;
mod summary;
mod table;
mod timeline;

pub use chunks::{Chunks, Waited, open_stream};
pub use json::json;
pub use summary::Summary;
pub(crate) use table::metres;
pub use table::{Table, beacon_name};
pub use timeline::{Stamp, Timeline};

use wire::telemetry::{Decoder, Hello, Message};

/// A stream, as it is read.
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
    hello: u64,
    fix: u64,
    range: u64,
    difference: u64,
    sighting: u64,
    state: u64,
    counters: u64,
    reset: u64,
    room: u64,
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

    /// What came so far.
    pub fn summary(&self) -> Summary {
        Summary::of(&self.seen, &self.timeline, self.decoder.counts(), self.decoder.pending())
    }
}

impl Seen {
    fn message(&mut self, message: &Message, stamp: Stamp) {
        self.first_t_s = self.first_t_s.or(Some(stamp.t_s));
        self.last_t_s = Some(stamp.t_s);
        let count = match message {
            Message::Hello(hello) => {
                self.node = Some(*hello);
                &mut self.hello
            }
            Message::Fix(fix) => {
                self.positions += u64::from(fix.reason().is_none());
                &mut self.fix
            }
            Message::Range(_) => &mut self.range,
            Message::Difference(_) => &mut self.difference,
            Message::Sighting(_) => &mut self.sighting,
            Message::State(_) => &mut self.state,
            Message::Counters(counters) => {
                self.telemetry_dropped = Some(counters.telemetry_dropped);
                &mut self.counters
            }
            Message::Reset(_) => &mut self.reset,
            Message::Room(_) => &mut self.room,
        };
        *count += 1;
    }
}
