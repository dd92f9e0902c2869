//! Budgets of a position on the Cortex-M4F.

use positioning_core::Method;

/// The limits of one call of a method.
pub struct CallBudget {
    pub method: Method,
    pub dims: usize,
    pub anchors: usize,
    pub instructions: u64,
    /// Bytes.
    pub stack: u64,
}

/// Budgets of calls.
pub const CALLS: [CallBudget; 2] = [
    CallBudget { method: Method::BWls, dims: 2, anchors: 8, instructions: 1_500, stack: 512 },
    CallBudget { method: Method::Robust, dims: 2, anchors: 8, instructions: 18_000, stack: 1024 },
];

/// Budget of the features of one impulse response, instructions.
pub const FEATURES: u64 = 12_000;

/// Budgets of the functions on the RSSI of beacons, instructions: the function, its name in the tables, and its
/// limit.
pub const BEACONS: [(&str, &str, u64); 5] = [
    ("advert", "an advert: judged, smoothed, a distance", 600),
    ("particles", "a step of 256 particles by the levels of 6 beacons", 400_000),
    ("nearest", "5 nearest of 200 points, 12 beacons", 60_000),
    ("lattice", "the posterior over 200 points, 12 beacons", 120_000),
    ("walk", "a step of the walk over them", 600_000),
];

/// Budget of the engine's step with one range, instructions, with [`ENGINE_LINKS`] tracked links.
pub const ENGINE_INSTRUCTIONS: u64 = 6_000;
/// Budget of its stack, bytes.
pub const ENGINE_STACK: u64 = 1_536;
/// Number of links of the budget.
pub const ENGINE_LINKS: u16 = 8;

/// Budget of the code of all methods together in the plane, bytes.
pub const ALL_METHODS_2D: u64 = 24 * 1024;
