//! A summary of what was received in a stream and what was lost, for people and for programs.

use std::fmt::Write as _;
use std::path::Path;

use serde::{Serialize, Serializer};
use wire::telemetry::{Body, Counts, Hello, Message};

use super::{Seen, Timeline};
use crate::provision::SiteNames;
use recording::UserError;

/// What was received in a stream, and what was lost.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DecodeSummary {
    /// The number of bytes.
    pub bytes: u64,
    /// The number of messages, by their kind.
    pub frames: FrameCounts,
    /// Fixes with a position.
    pub positions: u64,
    /// How many times a full network refused the node.
    pub network_full: u64,
    /// Incomplete or damaged frames, by the kind of error.
    pub malformed: Malformed,
    /// Complete frames that this build cannot decode.
    pub newer: Newer,
    /// How many times the stream began within a frame.
    pub torn_at_start: u64,
    /// Bytes of frames that were malformed or torn at the start.
    pub lost_bytes: u64,
    /// Bytes of a frame that has not ended.
    pub unfinished_bytes: u64,
    /// Chunks that are no telemetry: `defmt` frames and text.
    pub foreign: u64,
    /// The bytes of those chunks.
    pub foreign_bytes: u64,
    /// How many times rounds are missing between two received rounds.
    pub gaps: u64,
    /// The number of missing rounds.
    pub rounds_missed: u64,
    /// The number of restarts of the node.
    pub restarts: u64,
    /// Frames that the node dropped because its channel was full, as last reported.
    pub telemetry_dropped: Option<u32>,
    /// Time of the first message, seconds. The time line continues across restarts.
    pub first_t_s: Option<f64>,
    /// Time of the last message, seconds.
    pub last_t_s: Option<f64>,
    /// The node's last `Hello`.
    #[serde(serialize_with = "node")]
    pub node: Option<Hello>,
}

/// Messages by their kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameCounts {
    /// All messages.
    pub total: u64,
    /// Messages of each kind, in the order of [`Message::KINDS`].
    pub kinds: [u64; Message::KINDS.len()],
}

impl FrameCounts {
    fn by_kind(&self) -> impl Iterator<Item = (&'static str, u64)> {
        Message::KINDS.iter().copied().zip(self.kinds)
    }
}

impl Serialize for FrameCounts {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map([("total", self.total)].into_iter().chain(self.by_kind()))
    }
}

/// Incomplete or damaged frames, by the names of [`wire::telemetry::DecodeError`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[allow(missing_docs, reason = "they are called as wire::telemetry::Counts calls them")]
pub struct Malformed {
    pub total: u64,
    pub too_long: u64,
    pub cobs: u64,
    pub checksum: u64,
    pub body: u64,
}

/// Complete frames that this build cannot decode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Newer {
    /// Of another schema.
    pub schema: u64,
    /// Of this schema, but with an unknown message or an unknown value.
    pub unknown: u64,
}

impl DecodeSummary {
    pub(super) fn of(seen: &Seen, timeline: &Timeline, counts: &Counts, pending: usize) -> Self {
        let (gaps, rounds_missed) = timeline.gaps();
        Self {
            bytes: seen.bytes,
            frames: FrameCounts { total: counts.frames, kinds: seen.kinds },
            positions: seen.positions,
            network_full: seen.network_full,
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
            node: seen.node,
        }
    }

    /// Refuses a file that is not empty, but has no frame. A frame of a newer node is a frame.
    ///
    /// # Errors
    /// The file has no telemetry.
    pub fn is_of_telemetry(&self, file: &Path) -> Result<(), UserError> {
        let Newer { schema, unknown } = self.newer;
        if self.bytes > 0 && self.frames.total + schema + unknown == 0 {
            return Err(no_telemetry(file, self.bytes));
        }
        Ok(())
    }

    /// The summary as text, with the names of the site: what was received, then one line for each kind of error.
    pub fn text(&self, names: &SiteNames) -> String {
        let mut text = format!("{} frames in {} bytes", self.frames.total, self.bytes);
        let mut separator = ": ";
        for (kind, count) in self.frames.by_kind().filter(|(_, count)| *count > 0) {
            let _ = write!(text, "{separator}{count} {kind}");
            separator = ", ";
        }
        text.push('\n');
        if let Some(Hello { eui, address, role, board, build, keyed, .. }) = self.node {
            let (role, board, build) = (role.as_str(), board.name(), u64::from_be_bytes(build));
            let _ = writeln!(
                text,
                "node: {role} {} on {board}, EUI-64 {eui:016x}, build {build:016x}, frames {}",
                names.with_address(address),
                if keyed { "authenticated" } else { "not authenticated" }
            );
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
        line(self.network_full, "times without a place, the network being full: its tags share 24 in turn");
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

/// The error of a file without a frame.
pub(crate) fn no_telemetry(file: &Path, bytes: u64) -> UserError {
    UserError::file(file, format!("this is no telemetry: there is no frame in {bytes} bytes"))
}

/// Serializes the node's last `Hello`, with the keys of that message.
fn node<S: Serializer>(hello: &Option<Hello>, serializer: S) -> Result<S::Ok, S::Error> {
    hello.map(|hello| hello.json()).serialize(serializer)
}
