//! The messages as they are sent over the wire: quantised, so that they are short, with accessors in SI units. A
//! field's name contains the unit of its number.
//!
//! Variants and fields are append-only: a variant's number is its index in the list, and never changes. An incompatible
//! change takes another [`SCHEMA`](crate::telemetry::SCHEMA) number.

mod arrival;
mod counters;
mod difference;
mod fix;
mod hello;
mod node_state;
mod range;
mod reception;
mod reset;
mod room;
mod sighting;
mod supply;
mod tag_answer;
mod tag_data;
mod tag_fix;

use core::fmt;

use postcard::experimental::max_size::MaxSize;
use serde::{Deserialize, Deserializer, Serialize};

use crate::telemetry::message::{Body, Tone, messages};

pub use crate::config::Board;
pub use arrival::{Arrival, ArrivedFrame};
pub use counters::Counters;
pub use difference::Difference;
pub(crate) use fix::is_definite;
pub use fix::{Doubt, Fix, FixLine, Outcome, Solver};
pub use hello::{Hello, Role};
pub use node_state::{BeaconEvidence, Condition, MotionSensor, RecordError, RssiModelError, SiteModelPart, State};
pub use positioning_core::SolveError;
pub use range::Range;
pub use reception::Diagnostics;
pub use reset::{Crash, CrashReason, Reset, ResetCause};
pub use room::{Room, RoomEstimate, RoomLine, RoomProbability};
pub use sighting::{BeaconId, Sighting};
pub use supply::Supply;
pub use tag_answer::TagAnswer;
pub use tag_data::TagData;
pub use tag_fix::TagFix;

/// A field that was appended to the end of its message. A body that ends before it is from an older build, and an
/// unknown number is from a newer one.
fn or_default<'de, D: Deserializer<'de>, T: Deserialize<'de> + Default>(from: D) -> Result<T, D::Error> {
    Ok(T::deserialize(from).unwrap_or_default())
}

messages! {
    /// The identity of the sender: sent at the start and every few seconds, for a listener that starts later.
    Hello,
    /// A position, or why there is none.
    Fix,
    /// A range of a round.
    Range,
    /// A received advertisement.
    Sighting,
    /// A change of the node's state.
    State,
    /// Counts since the start.
    Counters,
    /// Why the node started.
    Reset,
    /// A difference of arrivals of a received round among anchors.
    Difference,
    /// The room estimate of a tag.
    Room,
    /// Supply voltage and temperature of the radio.
    Supply,
    /// The position of a tag, as an anchor received it in the tag's poll.
    TagFix,
    /// Data of a tag's user, as an anchor received them in the tag's poll.
    TagData,
    /// When a blink or a sync frame arrived at an anchor.
    Arrival,
    /// A tag's answer to a message of a host, as an anchor received it in the tag's poll.
    TagAnswer,
}
