//! The DW1000 and what all protocols on it share.
//!
//! [`Dw1000`] is the driver: async over an SPI device, an interrupt line, a reset line and a delay. It implements
//! [`Radio`], the trait that protocols use, so that a simulated radio can replace it. [`PhyConfig`] is the radio
//! configuration of the frames. [`RadioInstant`] and [`RadioDuration`] are the chip's time in ticks of 15.65 ps.
//! [`RangeBias`] corrects ranges by received power.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod bias;
pub mod driver;
pub mod phy;
pub mod radio;
pub mod time;

pub use bias::RangeBias;
pub use driver::Dw1000;
pub use phy::PhyConfig;
pub use radio::{
    Diagnostics, Pace, Radio, ReceiveError, ResponseWindow, Restart, RxFrame, Sample, Start, TransmitError,
};
pub use time::{RadioDuration, RadioInstant};

/// 10 ⁄ ln 10: converts a natural logarithm to decibels. A logarithm to the base of ten would take 256 bytes more in an
/// image.
const DECIBELS: f32 = 4.342_944_8;

/// A ratio of powers in decibels.
fn decibels(ratio: f32) -> f32 {
    DECIBELS * libm::logf(ratio)
}
