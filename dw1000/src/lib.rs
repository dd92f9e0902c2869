//! The DW1000: its driver, and the errors that it adds to distances.
//!
//! [`Dw1000`] is the driver: async over an SPI device, an interrupt line, a reset line and a delay. It implements
//! [`Radio`](radio::Radio), the trait that protocols use, so that another chip or a simulated radio can replace it.
//! [`bias`] has the errors of its distances by received power, temperature and supply.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod bias;
pub mod driver;

pub use driver::{Dw1000, Parts};

use radio::Capabilities;
use radio::phy::{Channel, DataRate, PreambleLength, Prf};

/// What the DW1000 can do.
pub const CAPABILITIES: Capabilities = Capabilities {
    channels: &[Channel::Ch1, Channel::Ch2, Channel::Ch3, Channel::Ch4, Channel::Ch5, Channel::Ch7],
    pulse_rates: &[Prf::Mhz16, Prf::Mhz64],
    data_rates: &[DataRate::Kbps110, DataRate::Kbps850, DataRate::Kbps6810],
    preambles: &[
        PreambleLength::Symbols64,
        PreambleLength::Symbols128,
        PreambleLength::Symbols256,
        PreambleLength::Symbols512,
        PreambleLength::Symbols1024,
        PreambleLength::Symbols1536,
        PreambleLength::Symbols2048,
        PreambleLength::Symbols4096,
    ],
    // The low nine bits of DX_TIME are ignored (DW1000 user manual, 7.2.12).
    delayed_step: 512,
};
