//! The PHY of a configuration, as the air has it.

use ranging::PhyConfig;
use ranging::phy::{DataRate, Prf as PhyPrf, Sfd as PhySfd};

use crate::air::{Phy, Prf, Rate, RxSettings, Sfd, SfdKind};
use crate::clock::TICKS_PER_PS;

/// Radiated power: the regulatory limit, −41.3 dBm/MHz over 500 MHz. Below: how much short frames are boosted (smart
/// power, DW1000 user manual, 7.2.31.2).
const RADIATED_DBM: f64 = -14.3;
const BOOSTS: [(f64, f64); 3] = [(125.0, 9.0), (250.0, 6.0), (500.0, 3.0)];

/// The power of a frame of some bytes on the air.
pub(crate) fn radiated_dbm(phy: &Phy, bytes: usize) -> f64 {
    let micros = phy.frame_ticks(bytes) as f64 / TICKS_PER_PS * 1e-6;
    let boost = BOOSTS.iter().find(|(shorter_than, _)| phy.rate == Rate::Kbps6800 && micros < *shorter_than);
    RADIATED_DBM + boost.map_or(0.0, |(_, decibels)| *decibels)
}

/// The PHY of the driver's configuration, as the air has it.
pub(crate) fn air_phy(phy: &PhyConfig) -> Phy {
    let kind = match phy.sfd() {
        PhySfd::Standard => SfdKind::Ieee,
        PhySfd::Decawave => SfdKind::Decawave,
    };
    Phy {
        channel: phy.channel().number(),
        code: phy.preamble_code(),
        prf: match phy.prf() {
            PhyPrf::Mhz16 => Prf::Mhz16,
            PhyPrf::Mhz64 => Prf::Mhz64,
        },
        rate: match phy.data_rate() {
            DataRate::Kbps110 => Rate::Kbps110,
            DataRate::Kbps850 => Rate::Kbps850,
            DataRate::Kbps6810 => Rate::Kbps6800,
        },
        preamble: phy.preamble_length().symbols(),
        sfd: Sfd { kind, symbols: phy.sfd_symbols() },
        long_frames: false,
    }
}

/// What a receiver with this configuration waits for.
pub(super) fn settings(phy: &PhyConfig, air: &Phy) -> RxSettings {
    RxSettings {
        channel: air.channel,
        code: air.code,
        prf: air.prf,
        sfd: air.sfd,
        slow: air.rate == Rate::Kbps110,
        long_frames: false,
        pac: phy.pac().symbols(),
        // Preamble, delimiter and one more symbol, minus one chunk (DW1000 user manual, 4.1.3).
        sfd_timeout: air.preamble + 1 + air.sfd.symbols - phy.pac().symbols(),
    }
}
