//! The configuration of a node's radio, from the config record to the driver.

use crate::PhyConfig;

/// The frames that the radio accepts, by their type in IEEE 802.15.4. Kinds are added with [`and`](Self::and). A
/// frame of a kind with a destination is accepted only if the destination is this node's PAN and address, or broadcast.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FrameFilter(u16);

impl FrameFilter {
    /// No filter: every frame is accepted.
    pub const OFF: Self = Self(0);
    /// Frames without a destination are accepted if their PAN is this node's: it is the coordinator.
    pub const COORDINATOR: Self = Self(1 << 1);
    /// Beacon frames.
    pub const BEACON: Self = Self(1 << 2);
    /// Data frames.
    pub const DATA: Self = Self(1 << 3);
    /// Acknowledgements.
    pub const ACKNOWLEDGEMENT: Self = Self(1 << 4);
    /// MAC command frames.
    pub const MAC_COMMAND: Self = Self(1 << 5);
    /// Frames of the reserved types.
    pub const RESERVED: Self = Self(1 << 6);
    /// Frames of type 4.
    pub const TYPE_4: Self = Self(1 << 7);
    /// Frames of type 5, which include blinks.
    pub const TYPE_5: Self = Self(1 << 8);

    /// Accepts both kinds.
    pub const fn and(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// The kinds as bits: 1 for [`COORDINATOR`](Self::COORDINATOR), 2 to 8 for the others in the order above; 0: no
    /// filter.
    pub const fn bits(self) -> u16 {
        self.0
    }
}

/// Transmit power.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum TxPower {
    /// The value that the module's maker calibrated, or else that of the driver. Short frames are boosted, where the
    /// radio can do this: the limit is a mean power over a millisecond, so it is lawful below one frame a millisecond.
    Smart,
    /// The same without the boost.
    Constant,
    /// As calibrated for this board.
    Calibrated {
        /// The value of the radio's register; the driver documents it.
        register: u32,
        /// Whether short frames are boosted.
        smart: bool,
    },
}

/// The configuration of a node's radio, whatever chip it is. Its driver writes it to the chip.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Config {
    /// The radio configuration of the frames.
    pub phy: PhyConfig,
    /// Transmit power.
    pub tx_power: TxPower,
    /// From the radio's transmit timestamp to the antenna, ticks; `None`: the one measured by the module's maker, or
    /// the driver's default.
    pub tx_antenna_delay: Option<u16>,
    /// From the antenna to the radio's receive timestamp, ticks; likewise.
    pub rx_antenna_delay: Option<u16>,
    /// Crystal trim, in the radio's steps; `None`: the one measured by the module's maker, or the middle.
    pub crystal_trim: Option<u8>,
    /// This node's network.
    pub pan: u16,
    /// This node's short address.
    pub short_address: u16,
    /// This node's EUI-64.
    pub eui: u64,
    /// Which frames are accepted.
    pub filter: FrameFilter,
    /// Whether the radio sleeps in waits in which its node's protocol does not need the clock.
    pub sleeps: bool,
}

impl Config {
    /// A node that receives every frame, with uncalibrated antennas.
    pub const fn new(phy: PhyConfig) -> Self {
        Self {
            phy,
            tx_power: TxPower::Smart,
            tx_antenna_delay: None,
            rx_antenna_delay: None,
            crystal_trim: None,
            pan: 0xFFFF,
            short_address: 0xFFFF,
            eui: 0,
            filter: FrameFilter::OFF,
            sleeps: false,
        }
    }
}
