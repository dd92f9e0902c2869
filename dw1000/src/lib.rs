//! The DW1000: its driver, and the errors that it adds to distances.
//!
//! [`Dw1000`] is the driver: async over an SPI device, an interrupt line, a reset line and a delay. It implements
//! [`Radio`](radio::Radio), the trait that protocols use, so that another chip or a simulated radio can replace it.
//! [`RangeBias`] corrects ranges by received power.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod bias;
pub mod driver;

pub use bias::RangeBias;
pub use driver::Dw1000;

/// 10 ⁄ ln 10: converts a natural logarithm to decibels. A logarithm to the base of ten would take 256 bytes more in an
/// image.
const DECIBELS: f32 = 4.342_944_8;

/// A ratio of powers in decibels.
fn decibels(ratio: f32) -> f32 {
    DECIBELS * libm::logf(ratio)
}
