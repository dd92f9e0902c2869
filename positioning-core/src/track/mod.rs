//! Tracking: one filter over position, velocity and the errors that last. It takes all kinds of measurements, one
//! number at a time.
//!
//! `state` has the tracked states. `motion` predicts them between measurements. `update` is the one way in which a
//! measurement ([`crate::measurement`]) changes the track. `filter` predicts the track to a measurement's time and
//! checks its gate. `noise` has the variance of a measurement. `gate` decides whether a measurement can belong to the
//! track. [`hyperbolic`] is the start from differences of arrival. The engine that calls them is [`crate::engine`]; it
//! also decides whether the track can be right at all.

mod anchors;
mod filter;
mod gate;
mod hyperbolic;
mod known_height;
mod motion;
mod noise;
pub(crate) mod state;
pub(crate) mod update;

pub use filter::FilterSettings;
pub use hyperbolic::{TdoaSample, hyperbolic};
pub use motion::Motion;
pub use noise::{Blocked, Noise, POWER_DIFFERENCE_PRIOR};

pub(crate) use anchors::Source;
pub(crate) use filter::{Filter, GateOf, UpdateResult, seconds};
pub(crate) use state::fading;
pub(crate) use update::{Linearised, Model};
