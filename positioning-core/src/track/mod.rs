//! Tracking: one filter over position, velocity and the errors that last, fed by whatever is measured, one number at a time.
//!
//! `state` is what is tracked, `motion` what happens between measurements; `update` is the one way in which a measurement
//! ([`crate::measurement`]) changes the track, and `filter` carries the track to a measurement's time and asks its gate. Around them
//! stand `noise` (how far a measurement may err), `gate` (whether it can belong to the track) and `supervisor` (whether the track can
//! be right at all). [`hyperbolic`] is the start from differences of arrival. The orchestrator is [`crate::engine`].

mod anchors;
mod filter;
mod gate;
mod hyperbolic;
mod motion;
mod noise;
pub(crate) mod state;
mod supervisor;
pub(crate) mod update;

pub use filter::FilterSettings;
pub use hyperbolic::{TdoaSample, hyperbolic};
pub use motion::Motion;
pub use noise::{Blocked, Noise, POWER_DIFFERENCE_PRIOR};

pub(crate) use filter::{Filter, GateOf, UpdateResult};
pub(crate) use supervisor::Supervisor;
pub(crate) use update::{Linearised, Model};
