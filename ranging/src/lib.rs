//! Ranging with an ultra-wideband radio, from its frames to a distance.
//!
//! Radio → [`RxFrame`] → protocol → time of flight → range. Protocols do no I/O: they take events and the
//! time, and return actions. So a test, the simulation and the firmware drive the same protocol. The node executes the
//! actions on a [`Radio`], which is a chip's driver or a simulated radio that transmits straight on the simulated air.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(not(target_os = "none"))]
extern crate alloc;
#[cfg(test)]
extern crate std;

pub mod decaranging;
pub mod exchange;
pub mod native;
pub mod node;
pub mod tof;

pub use radio::{
    self, Diagnostics, Pace, PhyConfig, Radio, RadioDuration, RadioInstant, RangeBias, ReceiveError, ResponseWindow,
    Restart, RxFrame, Sample, StampModel, Start, TransmitError, phy, time,
};
pub use tof::TimeOfFlight;
