//! What a radio can do: the same type for a driver, for the table of boards, and for the check of a configuration.

use crate::PhyConfig;
use crate::phy::{Channel, DataRate, PreambleLength, Prf};

/// What a radio can do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Capabilities {
    /// Its channels.
    pub channels: &'static [Channel],
    /// Its pulse repetition frequencies.
    pub pulse_rates: &'static [Prf],
    /// Its data rates.
    pub data_rates: &'static [DataRate],
    /// Its preambles.
    pub preambles: &'static [PreambleLength],
    /// A transmission or reception at an instant starts at a multiple of this many ticks, a power of two.
    pub delayed_step: u32,
}

/// The part of a configuration that a radio cannot do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Unsupported {
    /// It lacks the channel.
    Channel(Channel),
    /// It lacks the pulse repetition frequency.
    PulseRate(Prf),
    /// It lacks the data rate.
    DataRate(DataRate),
    /// It lacks the preamble.
    Preamble(PreambleLength),
}

impl Capabilities {
    /// Checks whether the radio can send and receive such frames.
    ///
    /// # Errors
    /// The first part that it cannot do.
    pub fn check(&self, phy: &PhyConfig) -> Result<(), Unsupported> {
        if !self.channels.contains(&phy.channel()) {
            return Err(Unsupported::Channel(phy.channel()));
        }
        if !self.pulse_rates.contains(&phy.prf()) {
            return Err(Unsupported::PulseRate(phy.prf()));
        }
        if !self.data_rates.contains(&phy.data_rate()) {
            return Err(Unsupported::DataRate(phy.data_rate()));
        }
        if !self.preambles.contains(&phy.preamble_length()) {
            return Err(Unsupported::Preamble(phy.preamble_length()));
        }
        Ok(())
    }
}
