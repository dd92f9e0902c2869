//! The tag in native mode.

use super::Network;
use crate::RadioDuration;

/// How often a tag ranges.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Rate {
    /// A fair share of all slots: a lone tag uses every one.
    Greedy,
    /// Once in this time (rounded down to what slots allow), as long as there are slots for it.
    Every(RadioDuration),
}

/// What a tag is told at its start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TagConfig {
    /// Short address, unique in the network; not 0xFFFF (broadcast).
    pub address: u16,
    /// The network.
    pub network: Network,
    /// Anchors a round, at most [`MAX_ROUND`](super::MAX_ROUND).
    pub anchors: u8,
    /// How often it wants to range.
    pub rate: Rate,
}
