//! The messages, as they go over the wire: quantised, so that they are short, with accessors in SI units. A field's name has the unit of
//! its number.

mod counters;
mod difference;
mod fix;
mod hello;
mod range;
mod reception;
mod reset;
mod room;
mod sighting;
mod state;

pub use crate::config::Board;
pub use counters::Counters;
pub use difference::Difference;
pub use fix::{Fix, FixLine, Outcome, Solver};
pub use hello::{Hello, Role};
pub use positioning_core::SolveError;
pub use range::Range;
pub use reception::Diagnostics;
pub use reset::{Crash, CrashReason, Reset, ResetCause};
pub use room::{Room, RoomEstimate, RoomLine, RoomProbability};
pub use sighting::{BeaconId, Sighting};
pub use state::{BeaconEvidence, Condition, Levels, MotionSensor, RecordError, RssiModelError, State};
