//! The anchor in native mode: answers polls, keeps and relays time, and coordinates when nobody else does.

use super::Network;
use crate::RadioDuration;

/// What an anchor is told at its start.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct AnchorConfig {
    /// Short address, unique in the network; not 0xFFFF (broadcast).
    pub address: u16,
    /// The network.
    pub network: Network,
    /// What the radio adds to the snapped start of a transmission: its transmitting antenna's delay, as
    /// [`Radio::departure`](crate::Radio::departure) does.
    pub antenna_delay: RadioDuration,
    /// Where it stands, metres, once surveyed.
    pub position_m: Option<[f32; 3]>,
}
