//! Native mode: a tag ranges to up to eight anchors with one frame more than anchors, in slots nobody else uses.
//!
//! **Round.** The tag broadcasts one poll that names the anchors of the round, in slot order. Each answers in its slot with the
//! poll's arrival and its answer's departure in its own clock. The tag has four timestamps a range (single-sided, seed 002,
//! equation 3); what single-sided ranging lacks, the ratio of both clocks, it knows from the polls: their departures in its
//! own clock against their arrivals in the anchor's, filtered over the rounds, and for an anchor it has never polled from the
//! carrier of the answer. N + 1 frames give what double-sided ranging gives with 2 N + 1 or more. A lost answer costs one range.
//!
//! **Superframe.** Anchors repeat a beacon (time, coordinator, members, position); tags learn from it where they are in time,
//! who is there, and which slots are theirs.
//!
//! All nodes of a network are built with one [`Network`], from which all times follow.

mod anchor;
mod tag;
mod timing;

pub use anchor::AnchorConfig;
pub use tag::{Rate, TagConfig};
pub use timing::{Network, Turnaround};

/// The most anchors of one round.
pub const MAX_ROUND: usize = 8;
