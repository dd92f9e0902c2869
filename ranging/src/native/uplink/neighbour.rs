//! A neighbour as the next anchor on a way to a gateway.

use wire::uwb::native::Relay;

/// A neighbour is no way if fewer of its last 16 sync frames came and said that it receives this anchor.
const LEAST_HEARD: u32 = 4;
/// The highest cost of a way.
pub(super) const MOST: u8 = u8::MAX;

/// An anchor that is received in a sync slot of its own.
#[derive(Clone, Copy, Debug)]
pub(super) struct Neighbour {
    pub address: u16,
    pub slot: u8,
    /// The cost of its way; `None`: it knows none.
    pub cost: Option<u8>,
    /// It takes no entries now.
    pub is_busy: bool,
    /// The last 16 superframes (bit 0: this one) with a sync frame of it.
    pub heard: u16,
    /// Those of them in which it said that it receives this anchor.
    pub hears: u16,
    /// The last 16 times that it has taken entries (bit 0: the last time), or has not.
    pub took: u16,
}

impl Neighbour {
    /// What a way through it costs; `None`: none leads through it.
    pub(super) fn way(&self) -> Option<u8> {
        let heard = self.hears.count_ones();
        if heard < LEAST_HEARD {
            return None;
        }
        let hop = (u32::from(Relay::HOP) * 256 * 16 / (heard * heard)).checked_div(self.took.count_ones())?;
        u8::try_from(u32::from(self.cost?) + hop).ok().filter(|cost| *cost < MOST)
    }
}
