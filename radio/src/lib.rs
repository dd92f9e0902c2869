//! What ranging protocols need of an ultra-wideband radio, whatever chip it is.
//!
//! [`Radio`] sends a frame at an instant, and receives a frame with its instant; [`Restart`] starts it again. A chip's
//! driver implements both, and so does a simulated radio. [`RadioInstant`] and [`RadioDuration`] are the radio's time
//! in ticks of 15.65 ps. [`PhyConfig`] is the radio configuration of the frames. No chip, bus or board is in here.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

mod interface;
pub mod phy;
pub mod time;

pub use interface::{
    Diagnostics, MAX_FRAME, Pace, Radio, ReceiveError, ResponseWindow, Restart, RxFrame, Sample, Sensors, Start,
    TransmitError,
};
pub use phy::PhyConfig;
pub use time::{RadioDuration, RadioInstant};
