//! Ranging over a DW1000, from its registers to a distance.
//!
//! Registers → driver → [`RxFrame`] → exchange state machine → time of flight → range. Exchanges do no I/O: they take events
//! and the time, and answer with actions, so that a test, the simulation and the firmware drive the same machine; the node
//! executes the actions on a [`Radio`], which is the DW1000 driver or a simulated radio straight on the air.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod bias;
pub mod decaranging;
pub mod dw1000;
pub mod exchange;
pub mod frame;
pub mod native;
pub mod node;
pub mod phy;
pub mod radio;
pub mod time;
pub mod tof;

pub use bias::RangeBias;
pub use phy::PhyConfig;
pub use radio::{Diagnostics, Pace, Radio, ReceiveError, ResponseWindow, RxFrame, Sample, Start, TransmitError};
pub use time::{RadioDuration, RadioInstant};
pub use tof::TimeOfFlight;

/// 10 ⁄ ln 10: decibels a natural logarithm. A logarithm to the base of ten would be 256 bytes more in an image.
const DECIBELS: f32 = 4.342_944_8;

/// A ratio of powers in decibels.
fn decibels(ratio: f32) -> f32 {
    DECIBELS * positioning_core::Real::ln(ratio)
}
