//! The parts of the PHY of IEEE 802.15.4 UWB that the air needs: durations, bands, and which receivers can receive a
//! frame.
//!
//! Durations are in ticks of the sender's clock (1 chip = 128 ticks). Sources: IEEE 802.15.4-2011, clause 14, and the
//! DW1000 user manual, 9.2 and 9.4.

/// Ticks of a chip. A chip is 1/499.2 MHz.
pub const TICKS_PER_CHIP: u64 = 128;

/// Mean pulse repetition frequency.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Prf {
    /// 16 MHz: preamble codes of 31 symbols.
    Mhz16,
    /// 64 MHz: preamble codes of 127 symbols.
    Mhz64,
}

/// Data rate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Rate {
    /// 110 kbit/s.
    Kbps110,
    /// 850 kbit/s.
    Kbps850,
    /// 6.81 Mbit/s.
    Kbps6800,
}

/// The start-of-frame delimiter. A receiver detects only the delimiter that it is set to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Sfd {
    /// Which sequence.
    pub kind: SfdKind,
    /// Its length in symbols.
    pub symbols: u16,
}

/// The delimiter sequences that a DW1000 supports.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SfdKind {
    /// The sequence of the standard.
    Ieee,
    /// Decawave's own.
    Decawave,
    /// A sequence written into USR_SFD.
    User,
}

/// The PHY settings of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Phy {
    /// Channel number: 1-5, 7.
    pub channel: u8,
    /// Preamble code.
    pub code: u8,
    /// Pulse repetition frequency.
    pub prf: Prf,
    /// Data rate.
    pub rate: Rate,
    /// Preamble symbols.
    pub preamble: u16,
    /// Delimiter.
    pub sfd: Sfd,
    /// Whether the PHY header follows Decawave's long-frame mode (up to 1023 bytes).
    pub long_frames: bool,
}

impl Prf {
    /// Ticks per preamble symbol: 496 chips (993.59 ns) or 508 chips (1017.63 ns).
    pub const fn symbol_ticks(self) -> u64 {
        match self {
            Self::Mhz16 => 496 * TICKS_PER_CHIP,
            Self::Mhz64 => 508 * TICKS_PER_CHIP,
        }
    }
}

impl Rate {
    /// Ticks per bit of the payload: 64, 512 or 4096 chips.
    pub const fn bit_ticks(self) -> u64 {
        match self {
            Self::Kbps110 => 4096 * TICKS_PER_CHIP,
            Self::Kbps850 => 512 * TICKS_PER_CHIP,
            Self::Kbps6800 => 64 * TICKS_PER_CHIP,
        }
    }

    /// Ticks per bit of the PHY header. At 6.81 Mbit/s it is sent at 850 kbit/s.
    pub const fn header_bit_ticks(self) -> u64 {
        match self {
            Self::Kbps110 => 4096 * TICKS_PER_CHIP,
            Self::Kbps850 | Self::Kbps6800 => 512 * TICKS_PER_CHIP,
        }
    }

    /// The power at which one frame in ten is lost, dBm (DW1000 data sheet, table 9: 500 MHz, 20 bytes).
    pub const fn sensitivity_dbm(self) -> f64 {
        match self {
            Self::Kbps110 => -106.0,
            Self::Kbps850 => -101.0,
            Self::Kbps6800 => -93.0,
        }
    }
}

impl Phy {
    /// Ticks from the first preamble symbol to the RMARKER.
    pub const fn shr_ticks(&self) -> u64 {
        (self.preamble as u64 + self.sfd.symbols as u64) * self.prf.symbol_ticks()
    }

    /// Ticks of the PHY header: 19 bits and two tail bits.
    pub const fn phr_ticks(&self) -> u64 {
        21 * self.rate.header_bit_ticks()
    }

    /// Ticks of `bytes` bytes of payload (with check bytes), with 48 parity bits for each block of up to 330 bits.
    pub const fn payload_ticks(&self, bytes: usize) -> u64 {
        let bits = bytes as u64 * 8;
        (bits + 48 * bits.div_ceil(330)) * self.rate.bit_ticks()
    }

    /// Ticks from the first preamble symbol to the last bit.
    pub const fn frame_ticks(&self, bytes: usize) -> u64 {
        self.shr_ticks() + self.phr_ticks() + self.payload_ticks(bytes)
    }

    /// Centre frequency of a channel, Hz (user manual, 10.5).
    pub const fn centre_hz(channel: u8) -> f64 {
        match channel {
            1 => 3494.4e6,
            2 | 4 => 3993.6e6,
            3 => 4492.8e6,
            // Channels 5 and 7. The chip accepts no others.
            _ => 6489.6e6,
        }
    }

    /// Whether the channel is one of the two wide ones, whose pulse has 900 MHz instead of 500 MHz.
    pub const fn is_wide(channel: u8) -> bool {
        matches!(channel, 4 | 7)
    }

    /// Whether two channels share spectrum: 2 lies within 4, and 5 within 7.
    pub const fn share_band(a: u8, b: u8) -> bool {
        a == b || matches!((a, b), (2, 4) | (4, 2) | (5, 7) | (7, 5))
    }

    /// The weakest preamble that a receiver finds, dBm: −98 dBm with 128 symbols, 3 dB less for each doubling. This is
    /// an estimate from the data sheet's longest ranges, in which the preamble does not limit the link.
    pub fn preamble_sensitivity_dbm(&self) -> f64 {
        -98.0 - 10.0 * (f64::from(self.preamble) / 128.0).log10()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn phy(rate: Rate, prf: Prf, preamble: u16, sfd: u16) -> Phy {
        let sfd = Sfd { kind: SfdKind::Ieee, symbols: sfd };
        Phy { channel: 5, code: 9, prf, rate, preamble, sfd, long_frames: false }
    }

    fn micros(ticks: u64) -> f64 {
        ticks as f64 / 63_897.6
    }

    #[test]
    fn airtime_of_27_bytes_matches_the_published_figures() {
        // Figures from public sources for PRF 64, in µs, with delimiters of 8, 8 and 64 symbols. The sources round
        // them.
        for (rate, preamble, sfd, published) in [
            (Rate::Kbps6800, 64, 8, 129.0),
            (Rate::Kbps6800, 128, 8, 194.0),
            (Rate::Kbps6800, 1024, 8, 1106.0),
            (Rate::Kbps850, 64, 8, 366.0),
            (Rate::Kbps850, 128, 8, 431.0),
            (Rate::Kbps850, 1024, 8, 1343.0),
            (Rate::Kbps110, 1024, 64, 3446.0),
        ] {
            let computed = micros(phy(rate, Prf::Mhz64, preamble, sfd).frame_ticks(27));
            assert!((computed - published).abs() < 2.0, "{rate:?} {preamble}: {computed} against {published}");
        }
    }

    #[test]
    fn parts_of_a_frame_by_hand() {
        let p = phy(Rate::Kbps6800, Prf::Mhz16, 128, 8);
        // 136 symbols of 993.59 ns; 21 bits of 1025.64 ns; 12 bytes: 96 + 48 bits of 128.21 ns.
        assert!((micros(p.shr_ticks()) - 135.128).abs() < 0.001);
        assert!((micros(p.phr_ticks()) - 21.538).abs() < 0.001);
        assert!((micros(p.payload_ticks(12)) - 18.462).abs() < 0.001);
        // 42 bytes are 336 bits and need a second block of parity.
        assert_eq!(p.payload_ticks(42) - p.payload_ticks(41), (8 + 48) * p.rate.bit_ticks());
    }
}
