//! What the air tells the receivers and the listeners at the side.

use super::phy::Phy;
use super::port::PortId;
use super::propagation::Link;
use crate::time::TrueTime;
use crate::world::World;
use std::rc::Rc;

/// Whoever is behind a port: a chip, or a radio straight on the air.
pub trait AirClient {
    /// Something was heard at `now`. May transmit and listen through `world`.
    fn on_air(&mut self, world: &World, now: TrueTime, heard: ReceptionEvent);
}

/// A receiver's progress with a frame.
#[derive(Clone, Debug)]
pub enum ReceptionEvent {
    /// A preamble of this receiver's code was found.
    Preamble,
    /// No delimiter followed in time: another one, another rate, or lost under another frame. The receiver is off.
    SfdTimeout,
    /// The delimiter was found: this is the RMARKER.
    Sfd,
    /// The PHY header could not be read. The receiver is off.
    HeaderError,
    /// The PHY header was read: what follows, for frame filters. The frame is not over.
    Header {
        /// The bytes to come.
        bytes: Rc<[u8]>,
        /// How they are sent.
        phy: Phy,
    },
    /// The frame is over. The receiver is off.
    Frame(Reception),
}

/// A frame at its end.
#[derive(Clone, Debug)]
pub struct Reception {
    /// The frame as sent, check bytes included, wherever they are due.
    pub bytes: Rc<[u8]>,
    /// How it was sent.
    pub phy: Phy,
    /// The ranging bit of its header.
    pub ranging: bool,
    /// When the RMARKER on the first detected path reached the antenna.
    pub marker: TrueTime,
    /// What noise and the power's bias add to the stamp, picoseconds.
    pub stamp_error_ps: f64,
    /// The way it came.
    pub link: Link,
    /// Offset of the sender's clock, parts per million of true time.
    pub sender_ppm: f64,
    /// Preamble symbols gathered until the delimiter.
    pub symbols: u16,
    /// Whether the payload came through.
    pub payload: Payload,
    /// Seeds what differs from frame to frame in the accumulator.
    pub noise_seed: u64,
}

/// How a payload came through.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Payload {
    /// Intact.
    Good,
    /// More errors than the Reed-Solomon code corrects.
    Uncorrectable,
    /// Errors that only the check bytes show.
    Corrupted,
}

/// A point of a frame's course at a receiver.
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

/// A frame as a sniffer beside the sender sees it.
#[derive(Clone, Debug)]
pub struct Sniffed {
    /// When its RMARKER left the antenna.
    pub marker: TrueTime,
    /// When its last bit left.
    pub end: TrueTime,
    /// Who sent it.
    pub sender: PortId,
    /// The bytes, check bytes included.
    pub bytes: Rc<[u8]>,
    /// How it was sent.
    pub phy: Phy,
    /// Radiated power, dBm.
    pub power_dbm: f64,
}

/// What happened on the air so far.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AirStatistics {
    /// Frames sent.
    pub frames_sent: u64,
    /// Frames that another frame destroyed at one receiver or more.
    pub frames_collided: u64,
    /// Receptions begun: a preamble that a receiver could find.
    pub receptions: u64,
    /// Receptions that came to a good end.
    pub received: u64,
    /// Receptions lost by the configured chance.
    pub lost_by_chance: u64,
    /// Receptions lost for want of power, or because the sender stopped.
    pub lost_to_noise: u64,
    /// Receptions lost under another frame.
    pub lost_to_collision: u64,
    /// Receptions that the receiver itself gave up: switched off, another rate or delimiter.
    pub abandoned: u64,
    /// Time that frames were on the air, summed over frames, seconds: its ratio to the time passed is the airtime share.
    pub airtime_s: f64,
}
