//! What the hub counts.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use serde::Serialize;
use utoipa::ToSchema;

/// What the hub has done since its start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, ToSchema)]
#[schema(as = Counts)]
pub struct HubCounts {
    /// Reports that were taken.
    pub reports: u64,
    /// Reports of these that were refused: their numbers cannot be measurements, or there are too many tags or nodes.
    pub refused: u64,
    /// Positions among the updates.
    pub positions: u64,
    /// Events among the updates.
    pub events: u64,
    /// Rows that the store has.
    pub rows_written: u64,
    /// Rows that wait for the store now.
    pub backlog: u64,
    /// Rows that were lost because the store failed for too long, or has no number for another tag.
    pub dropped: u64,
    /// Operations of the store that failed.
    pub store_failures: u64,
    /// Updates that slow listeners have missed.
    pub missed: u64,
}

/// The counters behind [`HubCounts`].
#[derive(Debug, Default)]
pub(super) struct Counters {
    pub(super) reports: AtomicU64,
    pub(super) positions: AtomicU64,
    pub(super) events: AtomicU64,
    pub(super) rows_written: AtomicU64,
    pub(super) store_failures: AtomicU64,
    pub(super) missed: AtomicU64,
    /// The last write failed, or is late.
    pub(super) is_failing: AtomicBool,
}

pub(super) fn add(counter: &AtomicU64, count: usize) {
    counter.fetch_add(u64::try_from(count).unwrap_or(u64::MAX), Ordering::Relaxed);
}
