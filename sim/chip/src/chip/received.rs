//! The data of a received frame in the chip.

use crate::air::{Prf, Rate, Reception};

/// The data of one received frame. There are two sets, for double buffering (user manual, 4.3).
pub(super) struct ReceiveSet {
    /// LDEDONE, RXDFR, RXFCG, RXFCE.
    pub(super) status: u64,
    /// Whether the host has not released it yet.
    pub(super) full: bool,
    pub(super) buffer: Box<[u8; 1024]>,
    pub(super) info: [u8; 4],
    pub(super) quality: [u8; 8],
    pub(super) tracking_interval: [u8; 4],
    pub(super) tracking_offset: [u8; 5],
    pub(super) time: [u8; 14],
}

impl ReceiveSet {
    pub(super) fn new() -> Self {
        Self {
            status: 0,
            full: false,
            buffer: Box::new([0; 1024]),
            info: [0; 4],
            quality: [0; 8],
            tracking_interval: [0; 4],
            tracking_offset: [0; 5],
            time: [0; 14],
        }
    }

    pub(super) fn clear(&mut self) {
        *self = Self::new();
    }
}

/// RX_FINFO.
pub(super) fn frame_info(reception: &Reception, length: usize, rxpacc: u16) -> u32 {
    let phy = &reception.phy;
    let rate = match phy.rate {
        Rate::Kbps110 => 0,
        Rate::Kbps850 => 1,
        Rate::Kbps6800 => 2,
    };
    let prf = match phy.prf {
        Prf::Mhz16 => 1,
        Prf::Mhz64 => 2,
    };
    // RXPSR and RXNSPL: 16 × 4^k symbols, and the lengths in between.
    let (repetition, between) = match phy.preamble {
        0..128 => (1, 0),
        128..256 => (1, 1),
        256..512 => (1, 2),
        512..1024 => (1, 3),
        1024..1536 => (2, 0),
        1536..2048 => (2, 1),
        2048..4096 => (2, 2),
        4096.. => (3, 0),
    };
    length as u32
        | between << 11
        | rate << 13
        | u32::from(reception.ranging) << 15
        | prf << 16
        | repetition << 18
        | u32::from(rxpacc) << 20
}
