//! The configuration of a tag.

use crate::native::lease_entry::LONGEST_BLINK_PERIOD;
use crate::native::plan::{Rate, share_of};
use crate::native::timing::Timing;
use crate::native::{Network, PollContent};
use wire::uwb::layout::Scheme;
use wire::uwb::native::{Period, Share, Turns};

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
    /// Whether it blinks instead of ranging: it sends a frame whose arrivals anchors report, and asks none.
    pub blinks: bool,
}

impl TagConfig {
    /// What the tag requests for this rate.
    #[inline(never)]
    pub(super) fn share_of(&self, rate: Option<Rate>, timing: &Timing) -> Share {
        let Some(rate) = rate else { return Share::Release };
        match share_of(rate, timing) {
            share if !self.blinks => share,
            Share::Leased(Turns { period, .. }) => {
                let superframes = period.superframes().min(LONGEST_BLINK_PERIOD);
                Share::Leased(Turns::blinks(Period::at_most(superframes)))
            }
            Share::Release | Share::Slots(_) | Share::Greedy => Share::Leased(Turns::blinks(Period::ONE)),
        }
    }
}
