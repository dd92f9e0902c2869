//! Native mode: a tag ranges to up to eight anchors with one frame more than anchors, in slots nobody else uses.
//!
//! **Round.** The tag broadcasts one poll that names the anchors of the round, in slot order. Each answers in its slot with the
//! poll's arrival and its answer's departure in its own clock. The tag has four timestamps a range (single-sided, seed 002,
//! equation 3); what single-sided ranging lacks, the ratio of both clocks, it knows from the polls: their departures in its
//! own clock against their arrivals in the anchor's, filtered over the rounds, and for an anchor it has never polled from the
//! carrier of the answer. N + 1 frames give what double-sided ranging gives with 2 N + 1 or more. A lost answer costs one range.
//! With [`Scheme::DoubleSided`] a final of the tag follows the responses, and each anchor tells in its next response when that came:
//! N + 2 frames, and no model of clocks.
//!
//! **No hidden deadlines.** Each node measures how long it takes to answer, to hear again and to decide (`pace`), and asks for as
//! much; the coordinator lays the slots out by what the slowest node asked for ([`Layout`]). What came too late is sent in the next
//! slot there is.
//!
//! **Superframe.** Anchors repeat a sync frame (time, coordinator, members, position); tags learn from it where they are in time,
//! who is there, and which slots are theirs.
//!
//! **Listening.** Anchors may ask each other as tags do, in slots of their own. Tags that only listen position themselves by the
//! differences of arrival, any number of them.
//!
//! All nodes of a network are built with one [`Network`]; all times follow from it and from the layout.

mod anchor;
mod anchor_position;
mod anchor_rounds;
mod anchor_table;
mod clock;
mod compensation;
mod coordinator;
mod election;
mod layout_requests;
mod leases;
mod pace;
mod plan;
mod round;
mod search;
mod superframes;
mod sync;
mod sync_schedule;
mod tag;
mod tdoa_tag;
mod timing;
mod wake_ups;

pub use anchor::{Anchor, AnchorConfig};
pub use anchor_table::Refused;
pub use clock::{ClockModel, STAMP_DEVIATION_TICKS};
pub use plan::{NOTICE_SUPERFRAMES, Rate};
pub use tag::{Tag, TagConfig};
pub use tdoa_tag::{TdoaTag, TdoaTagConfig};
pub use timing::{Network, ReplyDelay, Timing};
pub use wire::uwb::MAX_ROUND;
pub use wire::uwb::layout::{Layout, Scheme, Span};

/// A window or a wait shorter than this is not worth its commands: the node decides at once.
const SHORTEST_WAIT: crate::RadioDuration = crate::RadioDuration::from_micros(50);

/// Whether what is told by a network of this term and coordinator is to be followed by one who follows that of `term` and
/// `coordinator`: the same, a later term, or of one term the lower address.
fn prevails(told: (u8, u16), followed: (u8, u16)) -> bool {
    match told.0.wrapping_sub(followed.0) {
        0 => told.1 <= followed.1,
        later => later < 0x80,
    }
}

/// Spreads choices without a source of randomness: other nodes, and the same node next time, choose differently.
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
        superframe: 0,
        term: 0,
        age: 0,
        hops: 0,
        coordinator: 1,
        slot: 1,
        slot_owners: Default::default(),
        request: None,
        wish: Layout::LEAST,
        heard: 0,
        version: 0,
        countdown: 0,
        layout: Layout::LEAST,
        layout_is_new: false,
        position: None,
        members: Default::default(),
    }
}
