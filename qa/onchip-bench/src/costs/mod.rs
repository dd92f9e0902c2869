//! Measures all code that a node runs, piece by piece, as the simulation's table lists it: the driver with a chip that
//! answers at once ([`driver`]), the protocols on an ideal air ([`protocol`]), waking ([`executor`]), and a tag's engine
//! and telemetry ([`tag`]).
//!
//! Intervals are measured between two readings of the counter. The cost of a reading is subtracted.

pub mod air;
pub mod chip;
pub mod driver;
pub mod executor;
pub mod protocol;
pub mod tag;

use core::cell::Cell;

use crate::instrument::{between, stamp};

/// A sum of instructions, and the number of its terms.
#[derive(Default)]
pub struct Mean {
    sum: Cell<u32>,
    count: Cell<u32>,
}

impl Mean {
    /// An empty sum.
    pub const fn new() -> Self {
        Self { sum: Cell::new(0), count: Cell::new(0) }
    }

    /// Adds one term.
    pub fn add(&self, instructions: u32) {
        self.sum.set(self.sum.get() + instructions);
        self.count.set(self.count.get() + 1);
    }

    /// The rounded mean. `None` for an empty sum.
    pub fn get(&self) -> Option<u32> {
        let (sum, count) = (self.sum.get(), self.count.get());
        (sum + count / 2).checked_div(count)
    }

    /// The number of terms.
    pub fn count(&self) -> u32 {
        self.count.get()
    }
}

/// The instructions since `from`, without the cost of reading the counter.
pub fn since(from: u32) -> u32 {
    let now = stamp();
    between(from, now).saturating_sub(look())
}

/// The difference of two consecutive readings of the counter.
fn look() -> u32 {
    let (first, second) = (stamp(), stamp());
    between(first, second)
}
