//! TX_POWER: the power with which a frame is radiated (user manual, 7.2.31).

use super::Chip;
use super::bits::config;
use super::registers::file;
use crate::air::{Phy, Prf, Rate};

/// The power that the recommended gains give: −41.3 dBm/MHz over 500 MHz.
const REFERENCE_DBM: f64 = -14.3;

impl Chip {
    /// Radiated power without the antenna's gain. The recommended gain for channel and PRF gives the legal limit.
    pub(super) fn radiated_dbm(&self, phy: &Phy, length: usize) -> f64 {
        let register = self.memory.u32(file::TX_POWER, 0);
        let micros = phy.frame_ticks(length) as f64 / 63_897.6;
        let smart = !self.configured(config::DIS_STXP) && phy.rate == Rate::Kbps6800;
        // Smart: BOOSTNORM, BOOSTP500, BOOSTP250, BOOSTP125 by the frame's length. Manual: TXPOWPHR (and TXPOWSD).
        let byte = match (smart, micros) {
            (true, m) if m < 125.0 => 3,
            (true, m) if m < 250.0 => 2,
            (true, m) if m < 500.0 => 1,
            (true, _) => 0,
            (false, _) => 2,
        };
        let gain = gain_db((register >> (8 * byte)) as u8);
        let wide_db = if Phy::is_wide(phy.channel) { 2.6 } else { 0.0 };
        REFERENCE_DBM + wide_db + gain - gain_db(recommended_gain(phy.channel, phy.prf))
    }
}

/// The gain of a byte of TX_POWER: the upper three bits are steps of 3 dB down from 18 dB (111: off), the lower five
/// are half decibels up.
fn gain_db(byte: u8) -> f64 {
    match byte >> 5 {
        7 => -60.0,
        coarse => 18.0 - 3.0 * f64::from(coarse) + 0.5 * f64::from(byte & 0x1F),
    }
}

/// TX_POWER without smart power: one of its equal bytes (user manual, table 20).
const fn recommended_gain(channel: u8, prf: Prf) -> u8 {
    match (channel, prf) {
        (1 | 2, Prf::Mhz16) => 0x75,
        (1 | 2, Prf::Mhz64) => 0x67,
        (3, Prf::Mhz16) => 0x6F,
        (3, Prf::Mhz64) => 0x8B,
        (4, Prf::Mhz16) => 0x5F,
        (4, Prf::Mhz64) => 0x9A,
        (7, Prf::Mhz16) => 0x92,
        (7, Prf::Mhz64) => 0xD1,
        (_, Prf::Mhz16) => 0x48,
        (_, Prf::Mhz64) => 0x85,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smart_power_adds_three_decibels_a_step() {
        // User manual, table 19, channel 5: 0x0E082848 at PRF 16, 0x25456585 at PRF 64; compared with the manual
        // setting.
        for (register, reference) in [(0x0E08_2848u32, 0x48), (0x2545_6585, 0x85)] {
            let above: Vec<f64> = (0..4).map(|i| gain_db((register >> (8 * i)) as u8) - gain_db(reference)).collect();
            assert_eq!(above, [0.0, 3.0, 6.0, 9.0]);
        }
    }
}
