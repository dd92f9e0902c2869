//! What ranging protocols need of an ultra-wideband radio, whatever chip it is.
//!
//! [`Radio`] sends a frame at an instant, and receives a frame with its instant; [`Restart`] starts it again. A chip's
//! driver implements both, and so does a simulated radio. [`RadioInstant`] and [`RadioDuration`] are the radio's time
//! in ticks of 15.65 ps. [`PhyConfig`] is the radio configuration of the frames, [`Config`] that of a node.
//! [`Capabilities`] is what a radio can do, and [`StampModel`] how its timestamps relate to its antenna. No chip, bus
//! or board is in here.
//!
//! # Another radio
//!
//! A driver for another chip, for example the DW3000, is a crate beside `dw1000`:
//!
//! 1. It states its [`Capabilities`]. Channels and rates that no radio had before (channel 9) are new variants in
//!    [`phy`], and the compiler lists the matches that must decide about them.
//! 2. It writes a [`Config`] to the chip's registers, at the start and never for a frame.
//! 3. It implements [`Radio`]: instants in ticks of 1/63.8976 GHz with 40 bits, starts snapped to its own step, waits
//!    that always end. A clock of another rate is converted in the driver.
//! 4. It computes [`Diagnostics`] from the chip's registers by the formulae of its manual.
//! 5. It gives its [`RangeBias`], or [`RangeBias::NONE`], and its antenna delay.
//! 6. It implements [`Restart`], with sleep if the chip can.
//!
//! A board that carries the chip is a crate in `boards/` and a row in `wire::config::Board`, with the capabilities.
//! Protocols, apps, formats and host programs stay as they are.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

mod capabilities;
mod config;
mod interface;
pub mod phy;
mod stamps;
pub mod time;

pub use capabilities::{Capabilities, Unsupported};
pub use config::{Config, FrameFilter, TxPower};
pub use interface::{
    Diagnostics, MAX_FRAME, Pace, Radio, ReceiveError, ResponseWindow, Restart, RxFrame, Sample, Sensors, Start,
    TransmitError,
};
pub use phy::PhyConfig;
pub use stamps::{RangeBias, StampModel, decibels};
pub use time::{RadioDuration, RadioInstant};
