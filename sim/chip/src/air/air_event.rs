//! The events that the air reports to receivers and to sniffers.

use super::phy::Phy;
use super::port::PortId;
use super::propagation::Link;
use crate::time::TrueTime;
use crate::world::World;
use std::rc::Rc;

/// The client of a port: a chip, or a radio directly on the air.
pub trait AirClient {
    /// A reception event at `now`. The client may transmit and listen through `world`.
    fn on_air(&mut self, world: &World, now: TrueTime, heard: ReceptionEvent);
}

/// A receiver's progress with a frame.
#[derive(Clone, Debug)]
pub enum ReceptionEvent {
    /// A preamble of this receiver's code was found.
    Preamble,
    /// No delimiter was found in time: it was another one, had another rate, or was lost under another frame. The
    /// receiver is off.
    SfdTimeout,
    /// The delimiter was found: this is the RMARKER.
    Sfd,
    /// The PHY header could not be read. The receiver is off.
    HeaderError,
    /// The PHY header was read. The fields describe what follows; they are for frame filters. The frame has not ended.
    Header {
        /// The bytes that will follow.
        bytes: Rc<[u8]>,
        /// The PHY settings of the sender.
        phy: Phy,
    },
    /// The frame is over. The receiver is off.
    Frame(Reception),
}

/// A frame at its end.
#[derive(Clone, Debug)]
pub struct Reception {
    /// The frame as sent, with its check bytes.
    pub bytes: Rc<[u8]>,
    /// The PHY settings of the sender.
    pub phy: Phy,
    /// The ranging bit of its header.
    pub ranging: bool,
    /// When the RMARKER on the first detected path reached the antenna.
    pub marker: TrueTime,
    /// The error that noise and the power's bias add to the time stamp, picoseconds.
    pub stamp_error_ps: f64,
    /// The path of the frame.
    pub link: Link,
    /// Offset of the sender's clock, parts per million of true time.
    pub sender_ppm: f64,
    /// Preamble symbols accumulated until the delimiter.
    pub symbols: u16,
    /// Whether the payload was received without errors.
    pub payload: Payload,
    /// The seed of what differs between frames in the accumulator.
    pub noise_seed: u64,
}

/// The state of a received payload.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Payload {
    /// Intact.
    Good,
    /// More errors than the Reed-Solomon code corrects.
    Uncorrectable,
    /// Errors that only the check bytes show.
    Corrupted,
}

/// A point in a frame's course at a receiver.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AirEvent {
    pub(crate) port: PortId,
    pub(crate) session: u32,
    pub(crate) frame: u32,
    pub(crate) stage: Stage,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stage {
    Preamble,
    Sfd,
    SfdTimeout,
    Header,
    End,
}

/// A frame as a sniffer beside the sender receives it.
#[derive(Clone, Debug)]
pub struct Sniffed {
    /// When its first preamble symbol left the antenna.
    pub start: TrueTime,
    /// When its RMARKER left the antenna.
    pub marker: TrueTime,
    /// When its last bit left.
    pub end: TrueTime,
    /// The sender.
    pub sender: PortId,
    /// The bytes, with check bytes.
    pub bytes: Rc<[u8]>,
    /// The PHY settings of the sender.
    pub phy: Phy,
    /// Radiated power, dBm.
    pub power_dbm: f64,
}

/// Counts of what happened on the air so far.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AirStatistics {
    /// Frames sent.
    pub frames_sent: u64,
    /// Frames that another frame destroyed at one receiver or more.
    pub frames_collided: u64,
    /// Receptions begun: a preamble that a receiver could find.
    pub receptions: u64,
    /// Receptions without errors.
    pub received: u64,
    /// Receptions lost by the configured probability.
    pub lost_by_chance: u64,
    /// Receptions lost because the power was too low, or because the sender stopped.
    pub lost_to_noise: u64,
    /// Receptions lost under another frame.
    pub lost_to_collision: u64,
    /// Receptions that the receiver itself ended: it was switched off, or had another rate or delimiter.
    pub abandoned: u64,
}
