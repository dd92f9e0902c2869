//! Native mode: a tag ranges to up to eight anchors in slots of its own. A round needs one frame more than it has
//! anchors.
//!
//! **Round.** The tag broadcasts one poll that names the anchors of the round, in slot order. Each anchor answers in
//! its slot. Its response contains the poll's arrival and the response's departure in the anchor's clock. So the tag
//! has four timestamps for each range (single-sided: A. Linde Cerezo's thesis, Universitat Oberta de Catalunya, 2024,
//! equation 3). Single-sided ranging also needs the ratio of both clocks. The tag estimates this ratio from the polls:
//! it compares their departures in its own clock with their arrivals in the anchor's clock, and filters over the
//! rounds. For an anchor that it has never polled, it uses the carrier of the response. N + 1 frames give what
//! double-sided ranging gives with 2 N + 1 or more. A lost response costs one range. With [`Scheme::DoubleSided`] the
//! tag sends a final after the responses, and each anchor reports the final's arrival in its next response: N + 2
//! frames, and no model of clocks.
//!
//! **No hidden deadlines.** Each node measures how long it takes to answer, to receive again and to decide (`pace`),
//! and requests that time. The coordinator chooses the slot lengths by the request of the slowest node ([`Layout`]). A
//! frame that is too late for its slot is sent in the next slot.
//!
//! **Superframe.** Anchors repeat a sync frame (time, coordinator, members, position). Tags learn from it the network
//! time, the anchors, and their own slots.
//!
//! **Listening.** Anchors may range to each other as tags do, in slots of their own. Any number of tags that only
//! listen can compute their position from the time differences of arrival.
//!
//! All nodes of a network are configured with the same [`Network`]. All times follow from it and from the layout.

mod anchor;
mod anchor_position;
mod anchor_rounds;
mod anchor_table;
mod authentication;
mod clock;
mod compensation;
mod coordinator;
mod downlinks;
mod election;
mod enrolment;
mod introductions;
mod layout_requests;
mod lease_entry;
mod lease_news;
mod leases;
mod memory;
mod own_lease;
mod pace;
mod plan;
mod round;
mod search;
mod superframes;
mod sync;
mod sync_schedule;
mod sync_slot;
mod tag;
mod tdoa_tag;
mod timing;
mod uplink;
mod wake_ups;

pub use anchor::{Anchor, AnchorConfig};
pub use anchor_table::Refused;
pub use authentication::NetworkKey;
pub use clock::{ClockModel, STAMP_DEVIATION_TICKS};
pub use memory::{AnchorMemory, AnchorTables};
pub use plan::{NOTICE_SUPERFRAMES, Rate};
pub use tag::{Tag, TagConfig};
pub use tdoa_tag::{TdoaTag, TdoaTagConfig};
pub use timing::{Network, ReplyDelay, Timing};
pub use wire::config::PollContent;
pub use wire::uwb::MAX_ROUND;
pub use wire::uwb::layout::{Layout, Scheme, Span};
pub use wire::uwb::native::MakeCode;

/// A window or a wait shorter than this costs more than it gives: the node decides at once.
const SHORTEST_WAIT: crate::RadioDuration = crate::RadioDuration::from_micros(50);

/// Whether a node that follows the network `followed` is to follow the network `told` (each a term and a coordinator).
/// True if both are the same, if the term of `told` is greater, or if the terms are equal and the address of `told` is
/// lower. So of any networks that meet, one prevails over all others.
fn prevails(told: (u8, u16), followed: (u8, u16)) -> bool {
    told.0 > followed.0 || told.0 == followed.0 && told.1 <= followed.1
}

/// Spreads choices without a source of randomness: other nodes choose differently, and so does the same node in another
/// superframe.
fn spread(address: u16, superframe: u16, choices: u16) -> u16 {
    // Finaliser of MurmurHash3.
    let mut hash = u32::from(address) << 16 | u32::from(superframe);
    hash = (hash ^ hash >> 16).wrapping_mul(0x85EB_CA6B);
    hash = (hash ^ hash >> 13).wrapping_mul(0xC2B2_AE35);
    ((hash ^ hash >> 16) % u32::from(choices.max(1))) as u16
}

/// A sync frame of a new network without members, for tests: superframe 0, slot 1.
#[cfg(test)]
fn blank_sync_frame() -> wire::uwb::native::SyncFrame {
    wire::uwb::native::SyncFrame {
        session: None,
        superframe: 0,
        term: 0,
        age: 0,
        hops: 0,
        coordinator: 1,
        slot: 1,
        slot_owners: Default::default(),
        request: None,
        wish: Layout::LEAST,
        wishes_relay_slots: false,
        heard: 0,
        version: 0,
        countdown: 0,
        layout: Layout::LEAST,
        layout_is_new: false,
        position: None,
        leased: 0,
        has_relay_slots: false,
        relay: None,
        neighbour: None,
        members: Default::default(),
        leases: Default::default(),
        polls: Default::default(),
    }
}
