//! The source of a node's bytes: one trait, so that all code behind it runs without hardware.

use std::time::{Duration, Instant};

use anyhow::Result;

/// A channel of a node: RTT channel 0 or 1, or its part of the mixture on a serial line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NodeChannel {
    /// Frames of defmt.
    Log,
    /// Frames of telemetry.
    Telemetry,
}

/// An event of a source.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event {
    /// Bytes of a channel, not necessarily whole frames.
    Bytes(NodeChannel, Vec<u8>),
    /// A line of plain text between the frames, from a boot loader.
    Text(String),
    /// The connection is established: a short description of the other end.
    Connected(String),
    /// The connection is lost, and the source tries to connect again: the reason.
    Lost(String),
    /// The node has restarted, or is about to.
    Restarted,
    /// The node runs, but has no RTT rings.
    Silent,
    /// Whether the chip's flash agrees with the ELF file, in the parts that were compared.
    Flashed {
        /// The flash agrees.
        same: bool,
    },
    /// No more events follow.
    End,
}

/// A source of a node's bytes.
pub trait Source {
    /// The next event; `None`: no event within `patience`.
    ///
    /// # Errors
    /// An error that waiting does not remove: an unknown chip, or a file that cannot be read. A failure that may pass
    /// is reported as [`Event::Lost`] instead.
    fn next(&mut self, patience: Duration) -> Result<Option<Event>>;

    /// Passes bytes of a host on to the node. Returns whether it got all of them; else it got none, because it is not
    /// connected, has no room, or is a file.
    fn send(&mut self, bytes: &[u8]) -> bool {
        let _ = bytes;
        false
    }
}

/// The intervals of a source.
#[derive(Clone, Copy, Debug)]
pub struct Pace {
    /// The interval between two polls of empty rings.
    pub poll: Duration,
    /// The time from a failure to the first new attempt. The interval doubles for each further attempt.
    pub retry: Duration,
    /// The longest interval between attempts.
    pub longest: Duration,
    /// After this time without a control block, the node is reported as having none.
    pub silent: Duration,
}

/// The next attempt to connect again.
#[derive(Clone, Copy, Debug)]
pub(super) struct Retry {
    at: Instant,
    /// The interval after that attempt, if it fails.
    wait: Duration,
}

impl Retry {
    /// The first attempt after a failure.
    pub(super) fn first(pace: &Pace) -> Self {
        Self { at: Instant::now() + pace.retry, wait: pace.retry * 2 }
    }

    /// The attempt after this one, which has failed.
    pub(super) fn next(self, pace: &Pace) -> Self {
        Self { at: Instant::now() + self.wait, wait: (self.wait * 2).min(pace.longest) }
    }

    /// Whether it is time for the attempt.
    pub(super) fn is_due(&self) -> bool {
        Instant::now() >= self.at
    }
}

impl Default for Pace {
    /// A ring of one kilobyte holds the data of half a second of a busy node.
    fn default() -> Self {
        Self {
            poll: Duration::from_millis(10),
            retry: Duration::from_millis(250),
            longest: Duration::from_secs(4),
            silent: Duration::from_secs(3),
        }
    }
}
