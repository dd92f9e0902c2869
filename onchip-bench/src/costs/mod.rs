//! What everything that a node runs costs, piece by piece, as the table of the simulation has it: the driver over a chip that answers
//! at once ([`driver`]), the protocols in a small air ([`protocol`]), waking ([`executor`]), and a tag's engine and telemetry ([`tag`]).
//!
//! Intervals are measured between two looks at the counter; what a look costs is taken off.

pub mod chip;
pub mod driver;
pub mod executor;
pub mod protocol;
pub mod tag;

use core::cell::Cell;

use crate::instrument::{between, stamp};

/// Instructions summed up, and how many times.
#[derive(Default)]
pub struct Mean {
    sum: Cell<u32>,
    count: Cell<u32>,
}

impl Mean {
    /// Nothing yet.
    pub const fn new() -> Self {
        Self { sum: Cell::new(0), count: Cell::new(0) }
    }

    /// One more.
    pub fn add(&self, instructions: u32) {
        self.sum.set(self.sum.get() + instructions);
        self.count.set(self.count.get() + 1);
    }

    /// The mean, rounded; none of nothing.
    pub fn get(&self) -> Option<u32> {
        let (sum, count) = (self.sum.get(), self.count.get());
        (sum + count / 2).checked_div(count)
    }

    /// How many there were.
    pub fn count(&self) -> u32 {
        self.count.get()
    }
}

/// Instructions since `from`, without what looking at the counter costs.
pub fn since(from: u32) -> u32 {
    let now = stamp();
    between(from, now).saturating_sub(look())
}

/// What two looks at the counter, one after the other, differ by.
fn look() -> u32 {
    let (first, second) = (stamp(), stamp());
    between(first, second)
}
