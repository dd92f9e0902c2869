//! When things happen in native mode: from the frames' time on the air and the quickness of the boards.

use crate::{PhyConfig, RadioDuration};

/// How quick the slowest board of a network is, beside its frames' time on the air; measured on the board, interrupt latency,
/// bus and computation together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Turnaround {
    /// From the end of a frame heard to the first pulse of the answer.
    pub answer: RadioDuration,
    /// From the end of a frame heard to the first pulse of the next frame that can be heard, the receiver being told to stay on.
    pub listen_again: RadioDuration,
    /// From a decision to transmit to the first pulse.
    pub transmit: RadioDuration,
}

impl Turnaround {
    /// A DWM1001 (nRF52832 at 64 MHz, SPI at 8 MHz) with its Bluetooth off.
    pub const DWM1001: Self = Self {
        answer: RadioDuration::from_micros(250),
        listen_again: RadioDuration::from_micros(40),
        transmit: RadioDuration::from_micros(150),
    };
}

/// What all nodes of a network have in common.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Network {
    /// PAN identifier; frames of other networks are ignored.
    pub pan: u16,
    /// How frames are put on the air.
    pub phy: PhyConfig,
    /// The quickness of the slowest board.
    pub turnaround: Turnaround,
}
