//! Ranging with a DW1000, from its registers to a distance.
//!
//! Registers → driver → [`RxFrame`] → protocol → time of flight → range. Protocols do no I/O: they take events and the
//! time, and return actions. So a test, the simulation and the firmware drive the same protocol. The node executes the
//! actions on a [`Radio`], which is the DW1000 driver or a simulated radio that transmits straight on the simulated
//! air.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod decaranging;
pub mod exchange;
pub mod native;
pub mod node;
pub mod tof;

pub use baliza_dw1000::{RangeBias, driver as dw1000};
pub use radio::{
    self, Diagnostics, Pace, PhyConfig, Radio, RadioDuration, RadioInstant, ReceiveError, ResponseWindow, Restart,
    RxFrame, Sample, Start, TransmitError, phy, time,
};
pub use tof::TimeOfFlight;
