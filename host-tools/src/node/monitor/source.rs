//! Where a node's bytes come from: one trait, so that everything behind it runs without hardware.

use std::time::Duration;

use anyhow::Result;

/// What a node says on: RTT's channel 0 and 1, or what a serial line mixes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channel {
    /// Frames of defmt.
    Log,
    /// Frames of telemetry.
    Telemetry,
}

/// What a source brings.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event {
    /// Bytes of a channel, not necessarily whole frames.
    Bytes(Channel, Vec<u8>),
    /// A line of plain text that came beside: a boot loader's.
    Text(String),
    /// The connection stands: what to, in a few words.
    Connected(String),
    /// The connection is lost and is sought again: why.
    Lost(String),
    /// The node has started anew, or waits for it.
    Restarted,
    /// The node runs, but has no RTT rings.
    Silent,
    /// Whether the chip's flash holds what the ELF file does, as far as was looked.
    Flashed {
        /// It does.
        same: bool,
    },
    /// Nothing comes any more.
    End,
}

/// Where a node's bytes come from.
pub trait Source {
    /// The next event; `None`: none came for as long as `patience`.
    ///
    /// # Errors
    /// What waiting does not cure: a chip that is not known, a file that cannot be read. Whatever may come back is
    /// [`Event::Lost`] instead.
    fn next(&mut self, patience: Duration) -> Result<Option<Event>>;
}

/// How fast a source moves.
#[derive(Clone, Copy, Debug)]
pub struct Pace {
    /// From one look at empty rings to the next.
    pub poll: Duration,
    /// From a failure to the first new attempt; each further one waits twice as long.
    pub retry: Duration,
    /// No wait between attempts is longer.
    pub longest: Duration,
    /// A node without a control block for so long is said to have none.
    pub silent: Duration,
}

impl Default for Pace {
    /// A ring of a kilobyte holds half a second of a busy node.
    fn default() -> Self {
        Self {
            poll: Duration::from_millis(10),
            retry: Duration::from_millis(250),
            longest: Duration::from_secs(4),
            silent: Duration::from_secs(3),
        }
    }
}
