//! What came through a stream and what was lost, for people and for programs.

use std::fmt::Write as _;

use serde::Serialize;
use wire::telemetry::Counts;

use super::json::hex;
use super::{Seen, Timeline};

/// What came through a stream.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// All bytes.
    pub bytes: u64,
    /// Messages by their kind.
    pub frames: Frames,
    /// Fixes with a position.
    pub positions: u64,
    /// Frames that did not come whole, by what is wrong with them.
    pub malformed: Malformed,
    /// Whole frames that this build cannot read.
    pub newer: Newer,
    /// How many times the stream began in the middle of a frame.
    pub torn_at_start: u64,
    /// Bytes of frames that were malformed or torn at the start.
    pub lost_bytes: u64,
    /// Bytes of a frame that has not ended.
    pub unfinished_bytes: u64,
    /// Chunks that are no telemetry: `defmt` frames and text.
    pub foreign: u64,
    /// Their bytes.
    pub foreign_bytes: u64,
    /// How many times rounds are missing between two that came.
    pub gaps: u64,
    /// How many rounds.
    pub rounds_missed: u64,
    /// How many times the node started anew.
    pub restarts: u64,
    /// Frames that the node dropped because its channel was full, as it told last.
    pub telemetry_dropped: Option<u32>,
    /// Time of the first message; it runs on across restarts.
    pub first_t_s: Option<f64>,
    /// Time of the last message.
    pub last_t_s: Option<f64>,
    /// Who spoke, as it told last.
    pub node: Option<Node>,
}

/// Messages by their kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[allow(missing_docs, reason = "they are called as the messages are")]
pub struct Frames {
    pub total: u64,
    pub hello: u64,
    pub fix: u64,
    pub range: u64,
    pub sighting: u64,
    pub state: u64,
    pub counters: u64,
    pub reset: u64,
    pub difference: u64,
    pub room: u64,
}

/// Frames that did not come whole, as [`wire::telemetry::DecodeError`] calls them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[allow(missing_docs, reason = "they are called as wire::telemetry::Counts calls them")]
pub struct Malformed {
    pub total: u64,
    pub too_long: u64,
    pub cobs: u64,
    pub checksum: u64,
    pub body: u64,
}

/// Whole frames that this build cannot read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Newer {
    /// Of another schema.
    pub schema: u64,
    /// Of this schema, but with a message or a value that is not known.
    pub unknown: u64,
}

/// Who spoke.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[allow(missing_docs, reason = "they are called as wire::telemetry::Hello calls them")]
pub struct Node {
    pub eui: String,
    pub address: u16,
    pub role: &'static str,
    pub board: &'static str,
    pub build: String,
}

impl Summary {
    pub(super) fn of(seen: &Seen, timeline: &Timeline, counts: &Counts, pending: usize) -> Self {
        let (gaps, rounds_missed) = timeline.gaps();
        Self {
            bytes: seen.bytes,
            frames: Frames {
                total: counts.frames,
                hello: seen.hello,
                fix: seen.fix,
                range: seen.range,
                sighting: seen.sighting,
                state: seen.state,
                counters: seen.counters,
                reset: seen.reset,
                difference: seen.difference,
                room: seen.room,
            },
            positions: seen.positions,
            malformed: Malformed {
                total: counts.malformed(),
                too_long: counts.too_long,
                cobs: counts.cobs,
                checksum: counts.checksum,
                body: counts.body,
            },
            newer: Newer { schema: counts.schema, unknown: counts.unknown },
            torn_at_start: counts.torn_at_start,
            lost_bytes: counts.lost_bytes,
            unfinished_bytes: pending as u64,
            foreign: counts.foreign,
            foreign_bytes: counts.foreign_bytes,
            gaps,
            rounds_missed,
            restarts: timeline.restarts(),
            telemetry_dropped: seen.telemetry_dropped,
            first_t_s: seen.first_t_s,
            last_t_s: seen.last_t_s,
            node: seen.node.map(|hello| Node {
                eui: format!("{:016x}", hello.eui),
                address: hello.address,
                role: hello.role.as_str(),
                board: hello.board.name(),
                build: hex(&hello.build),
            }),
        }
    }

    /// For reading: what came, then a line for each thing that is not as it should be.
    pub fn told(&self) -> String {
        let Frames { total, hello, fix, range, sighting, state, counters, reset, difference, room } = self.frames;
        let mut text = format!("{total} frames in {} bytes", self.bytes);
        let kinds = [
            ("hello", hello),
            ("fix", fix),
            ("range", range),
            ("sighting", sighting),
            ("state", state),
            ("counters", counters),
            ("reset", reset),
            ("difference", difference),
            ("room", room),
        ];
        let mut separator = ": ";
        for (kind, count) in kinds.into_iter().filter(|(_, count)| *count > 0) {
            let _ = write!(text, "{separator}{count} {kind}");
            separator = ", ";
        }
        text.push('\n');
        if let Some(Node { eui, address, role, board, build }) = &self.node {
            let _ = writeln!(text, "node: {role} {address} on {board}, EUI-64 {eui}, build {build}");
        }
        if let (Some(first), Some(last)) = (self.first_t_s, self.last_t_s) {
            let _ = writeln!(text, "from {first:.3} s to {last:.3} s, {} positions", self.positions);
        }
        let Malformed { total, too_long, cobs, checksum, body } = self.malformed;
        if total > 0 {
            let _ = writeln!(
                text,
                "malformed: {total} ({checksum} by their checksum, {cobs} by COBS, {body} by their body, {too_long} too long)"
            );
        }
        let mut line = |count: u64, what: &str| {
            if count > 0 {
                let _ = writeln!(text, "{count} {what}");
            }
        };
        line(self.newer.schema, "frames of another schema: the node's build is another than this program's");
        line(self.newer.unknown, "frames with a message that this program does not know: the node's build is newer");
        line(self.torn_at_start, "frame torn at the start: the stream begins in its middle");
        line(self.lost_bytes, "bytes lost");
        line(self.unfinished_bytes, "bytes of a frame that has not ended");
        line(self.foreign_bytes, "bytes of something else: defmt frames, text");
        line(self.rounds_missed, "rounds missing");
        line(self.restarts, "restarts of the node");
        line(self.telemetry_dropped.unwrap_or(0).into(), "frames dropped by the node, its channel being full");
        text
    }
}
