//! The configuration of a tag.

use crate::native::plan::Rate;
use crate::native::{Network, PollContent};
use wire::uwb::layout::Scheme;

/// The configuration of a tag.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TagConfig {
    /// Short address, unique in the network; not 0xFFFF (broadcast).
    pub address: u16,
    /// The network.
    pub network: Network,
    /// Anchors in a round, at most [`MAX_ROUND`](crate::native::MAX_ROUND).
    pub anchors: u8,
    /// How often it wants to range.
    pub rate: Rate,
    /// The scheme of its rounds, as soon as the network has room for it.
    pub scheme: Scheme,
    /// What polls tell the anchors.
    pub tells: PollContent,
}
