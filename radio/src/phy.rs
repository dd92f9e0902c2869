//! The radio configuration of frames: channel, pulse rate, data rate, preamble, start-of-frame delimiter. Also the
//! frames' durations.
//!
//! A [`PhyConfig`] is valid by construction: its parts agree with each other as IEEE 802.15.4-2015 (clause 16) and the
//! DW1000 user manual require. Times are exact in ticks, because the standard counts every symbol in chips of 1/499.2
//! MHz, and a tick is 1/128 of a chip.

use crate::RadioDuration;

/// Ticks of the radio's clock in a chip of 1/499.2 MHz.
const TICKS_PER_CHIP: i64 = 128;
/// Symbols of the PHY header: 13 bits, 6 check bits, 2 bits that flush the convolutional code (802.15.4-2015, 16.2.7).
const PHR_SYMBOLS: i64 = 21;
/// Data bits of a Reed-Solomon block, and the check bits that each block adds, full or not (16.3.3.1).
const REED_SOLOMON_DATA_BITS: i64 = 330;
const REED_SOLOMON_CHECK_BITS: i64 = 48;

/// A UWB channel of the DW1000.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Channel {
    /// 3494.4 MHz, 499.2 MHz wide.
    Ch1,
    /// 3993.6 MHz, 499.2 MHz wide.
    Ch2,
    /// 4492.8 MHz, 499.2 MHz wide.
    Ch3,
    /// 3993.6 MHz, 900 MHz wide in this chip.
    Ch4,
    /// 6489.6 MHz, 499.2 MHz wide.
    Ch5,
    /// 6489.6 MHz, 900 MHz wide in this chip.
    Ch7,
}

impl Channel {
    /// The channel with this number, if the chip has it.
    pub const fn from_number(number: u8) -> Option<Self> {
        Some(match number {
            1 => Self::Ch1,
            2 => Self::Ch2,
            3 => Self::Ch3,
            4 => Self::Ch4,
            5 => Self::Ch5,
            7 => Self::Ch7,
            _ => return None,
        })
    }

    /// The number in the standard.
    pub const fn number(self) -> u8 {
        match self {
            Self::Ch1 => 1,
            Self::Ch2 => 2,
            Self::Ch3 => 3,
            Self::Ch4 => 4,
            Self::Ch5 => 5,
            Self::Ch7 => 7,
        }
    }

    /// Centre frequency, Hz.
    pub const fn centre_frequency_hz(self) -> f64 {
        match self {
            Self::Ch1 => 3_494.4e6,
            Self::Ch2 | Self::Ch4 => 3_993.6e6,
            Self::Ch3 => 4_492.8e6,
            Self::Ch5 | Self::Ch7 => 6_489.6e6,
        }
    }

    /// Whether the chip uses 900 MHz of it instead of 500 (which matters to tuning and range bias).
    pub const fn is_wide(self) -> bool {
        match self {
            Self::Ch4 | Self::Ch7 => true,
            Self::Ch1 | Self::Ch2 | Self::Ch3 | Self::Ch5 => false,
        }
    }

    /// The preamble codes of this channel in the standard, for a pulse rate (802.15.4-2015, tables 16-6 to 16-8; DW1000
    /// user manual, table 61). DecaRanging boards use the first one.
    pub const fn preamble_codes(self, prf: Prf) -> &'static [u8] {
        match (prf, self) {
            (Prf::Mhz16, Self::Ch1) => &[1, 2],
            (Prf::Mhz16, Self::Ch2 | Self::Ch5) => &[3, 4],
            (Prf::Mhz16, Self::Ch3) => &[5, 6],
            (Prf::Mhz16, Self::Ch4 | Self::Ch7) => &[7, 8],
            (Prf::Mhz64, Self::Ch1 | Self::Ch2 | Self::Ch3 | Self::Ch5) => &[9, 10, 11, 12],
            (Prf::Mhz64, Self::Ch4 | Self::Ch7) => &[17, 18, 19, 20],
        }
    }
}

/// Mean pulse repetition frequency.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Prf {
    /// 16 MHz: codes of 31 pulses.
    Mhz16,
    /// 64 MHz: codes of 127 pulses.
    Mhz64,
}

impl Prf {
    /// The frequency for a number of MHz, 16 or 64.
    pub const fn from_mhz(mhz: u8) -> Option<Self> {
        match mhz {
            16 => Some(Self::Mhz16),
            64 => Some(Self::Mhz64),
            _ => None,
        }
    }

    /// Its nominal frequency in megahertz.
    pub const fn mhz(self) -> u8 {
        match self {
            Self::Mhz16 => 16,
            Self::Mhz64 => 64,
        }
    }

    /// Chips in a preamble symbol: 993.59 ns, 1017.63 ns.
    const fn preamble_symbol_chips(self) -> i64 {
        match self {
            Self::Mhz16 => 496,
            Self::Mhz64 => 508,
        }
    }
}

/// Bit rate of a frame's payload.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum DataRate {
    /// 110 kbit/s.
    Kbps110,
    /// 850 kbit/s.
    Kbps850,
    /// 6.81 Mbit/s.
    Kbps6810,
}

impl DataRate {
    /// The rate for a number of kbit/s, 110, 850 or 6810.
    pub const fn from_kbps(kbps: u16) -> Option<Self> {
        match kbps {
            110 => Some(Self::Kbps110),
            850 => Some(Self::Kbps850),
            6810 => Some(Self::Kbps6810),
            _ => None,
        }
    }

    /// Its nominal kilobits per second.
    pub const fn kbps(self) -> u16 {
        match self {
            Self::Kbps110 => 110,
            Self::Kbps850 => 850,
            Self::Kbps6810 => 6810,
        }
    }

    /// Chips in a payload symbol (one bit before Reed-Solomon coding): 8205.1, 1025.6, 128.2 ns.
    const fn data_symbol_chips(self) -> i64 {
        match self {
            Self::Kbps110 => 4096,
            Self::Kbps850 => 512,
            Self::Kbps6810 => 64,
        }
    }

    /// Chips in a symbol of the PHY header, which is never faster than 850 kbit/s.
    const fn phr_symbol_chips(self) -> i64 {
        match self {
            Self::Kbps110 => 4096,
            Self::Kbps850 | Self::Kbps6810 => 512,
        }
    }
}

/// Symbols of the preamble.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u16)]
pub enum PreambleLength {
    /// 64 symbols.
    Symbols64 = 64,
    /// 128 symbols.
    Symbols128 = 128,
    /// 256 symbols.
    Symbols256 = 256,
    /// 512 symbols.
    Symbols512 = 512,
    /// 1024 symbols.
    Symbols1024 = 1024,
    /// 1536 symbols.
    Symbols1536 = 1536,
    /// 2048 symbols.
    Symbols2048 = 2048,
    /// 4096 symbols.
    Symbols4096 = 4096,
}

impl PreambleLength {
    /// The length for a number of symbols, if the chip supports it.
    pub const fn from_symbols(symbols: u16) -> Option<Self> {
        Some(match symbols {
            64 => Self::Symbols64,
            128 => Self::Symbols128,
            256 => Self::Symbols256,
            512 => Self::Symbols512,
            1024 => Self::Symbols1024,
            1536 => Self::Symbols1536,
            2048 => Self::Symbols2048,
            4096 => Self::Symbols4096,
            _ => return None,
        })
    }

    /// The number of symbols.
    pub const fn symbols(self) -> u16 {
        self as u16
    }
}

/// Start-of-frame delimiter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Sfd {
    /// The delimiter of the standard: 8 symbols, 64 at 110 kbit/s.
    Standard,
    /// Decawave's own, more robust: 64 symbols at 110 kbit/s, 16 at 850; the manual defines none at 6.81 Mbit/s.
    Decawave,
}

/// Preamble acquisition chunk: the preamble symbols that the receiver correlates at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(u16)]
pub enum Pac {
    /// 8 symbols.
    Symbols8 = 8,
    /// 16 symbols.
    Symbols16 = 16,
    /// 32 symbols.
    Symbols32 = 32,
    /// 64 symbols.
    Symbols64 = 64,
}

impl Pac {
    /// The number of symbols.
    pub const fn symbols(self) -> u16 {
        self as u16
    }

    /// The chunk for a preamble length (DW1000 user manual, table 6).
    const fn recommended(preamble: PreambleLength) -> Self {
        match preamble {
            PreambleLength::Symbols64 | PreambleLength::Symbols128 => Self::Symbols8,
            PreambleLength::Symbols256 | PreambleLength::Symbols512 => Self::Symbols16,
            PreambleLength::Symbols1024 => Self::Symbols32,
            PreambleLength::Symbols1536 | PreambleLength::Symbols2048 | PreambleLength::Symbols4096 => Self::Symbols64,
        }
    }
}

/// Why a configuration is refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum PhyError {
    /// The channel does not have this preamble code at this pulse rate.
    PreambleCode(u8),
    /// At 110 kbit/s the receiver needs a preamble of at least 1024 symbols.
    PreambleTooShort(PreambleLength),
    /// The chip defines no Decawave delimiter at 6.81 Mbit/s.
    SfdUndefined,
    /// The acquisition chunk is longer than an eighth of the preamble: too few chunks to find it.
    PacTooLong(Pac),
}

/// A radio configuration of frames. Both ends of a link must have the same.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PhyConfig {
    channel: Channel,
    prf: Prf,
    data_rate: DataRate,
    preamble_length: PreambleLength,
    preamble_code: u8,
    sfd: Sfd,
    pac: Pac,
}

impl PhyConfig {
    /// Channel 5, 64 MHz, 6.81 Mbit/s, 128 preamble symbols: the shortest frames with margin. The figures of this
    /// project are for this mode. Equal to EVK1000 mode 8.
    pub const FAST: Self = Self::recommended(Channel::Ch5, Prf::Mhz64, DataRate::Kbps6810, PreambleLength::Symbols128);

    /// A configuration with the recommended delimiter (DW1000 user manual, table 21), acquisition chunk (table 6) and
    /// the channel's first preamble code.
    ///
    /// # Errors
    /// [`PhyError::PreambleTooShort`] at 110 kbit/s with fewer than 1024 preamble symbols.
    pub const fn new(
        channel: Channel,
        prf: Prf,
        data_rate: DataRate,
        preamble_length: PreambleLength,
    ) -> Result<Self, PhyError> {
        if matches!(data_rate, DataRate::Kbps110) && preamble_length.symbols() < 1024 {
            return Err(PhyError::PreambleTooShort(preamble_length));
        }
        Ok(Self::recommended(channel, prf, data_rate, preamble_length))
    }

    const fn recommended(channel: Channel, prf: Prf, data_rate: DataRate, preamble_length: PreambleLength) -> Self {
        let sfd = match data_rate {
            DataRate::Kbps110 | DataRate::Kbps850 => Sfd::Decawave,
            DataRate::Kbps6810 => Sfd::Standard,
        };
        Self {
            channel,
            prf,
            data_rate,
            preamble_length,
            preamble_code: channel.preamble_codes(prf)[0],
            sfd,
            pac: Pac::recommended(preamble_length),
        }
    }

    /// The mode of an EVK1000 with DecaRanging for its switches S1-5, S1-6, S1-7 (`true` is on). Table 5-1 of P. M. de
    /// Rojas Malpartida's thesis (Universidad de Sevilla, 2021) lists these modes as 1 to 8.
    pub const fn from_evk1000_switches(s1_5: bool, s1_6: bool, s1_7: bool) -> Self {
        let (data_rate, preamble_length) = if s1_5 {
            (DataRate::Kbps6810, PreambleLength::Symbols128)
        } else {
            (DataRate::Kbps110, PreambleLength::Symbols1024)
        };
        let prf = if s1_6 { Prf::Mhz64 } else { Prf::Mhz16 };
        let channel = if s1_7 { Channel::Ch5 } else { Channel::Ch2 };
        Self::recommended(channel, prf, data_rate, preamble_length)
    }

    /// EVK1000 mode 1 to 8 (P. M. de Rojas Malpartida's thesis, 2021, table 5-1).
    pub const fn evk1000_mode(mode: u8) -> Option<Self> {
        match mode {
            1..=8 => {
                let switches = mode - 1;
                Some(Self::from_evk1000_switches(switches & 1 != 0, switches & 2 != 0, switches & 4 != 0))
            }
            _ => None,
        }
    }

    /// The same with another of the channel's preamble codes, so that neighbouring networks receive less of each other.
    ///
    /// # Errors
    /// [`PhyError::PreambleCode`] if the channel does not have this code at this pulse rate.
    pub fn with_preamble_code(self, code: u8) -> Result<Self, PhyError> {
        if self.channel.preamble_codes(self.prf).contains(&code) {
            Ok(Self { preamble_code: code, ..self })
        } else {
            Err(PhyError::PreambleCode(code))
        }
    }

    /// The same with another start-of-frame delimiter.
    ///
    /// # Errors
    /// [`PhyError::SfdUndefined`] for Decawave's delimiter at 6.81 Mbit/s.
    pub const fn with_sfd(self, sfd: Sfd) -> Result<Self, PhyError> {
        match (sfd, self.data_rate) {
            (Sfd::Decawave, DataRate::Kbps6810) => Err(PhyError::SfdUndefined),
            (Sfd::Decawave, DataRate::Kbps110 | DataRate::Kbps850) | (Sfd::Standard, _) => Ok(Self { sfd, ..self }),
        }
    }

    /// The same with another preamble acquisition chunk, of at most an eighth of the preamble.
    ///
    /// # Errors
    /// [`PhyError::PacTooLong`] if the chunk is longer than an eighth of the preamble.
    pub const fn with_pac(self, pac: Pac) -> Result<Self, PhyError> {
        if pac.symbols() * 8 > self.preamble_length.symbols() {
            Err(PhyError::PacTooLong(pac))
        } else {
            Ok(Self { pac, ..self })
        }
    }

    /// The channel.
    pub const fn channel(&self) -> Channel {
        self.channel
    }

    /// The pulse repetition frequency.
    pub const fn prf(&self) -> Prf {
        self.prf
    }

    /// The payload's rate.
    pub const fn data_rate(&self) -> DataRate {
        self.data_rate
    }

    /// The preamble's length.
    pub const fn preamble_length(&self) -> PreambleLength {
        self.preamble_length
    }

    /// The preamble code, 1 to 20.
    pub const fn preamble_code(&self) -> u8 {
        self.preamble_code
    }

    /// The start-of-frame delimiter.
    pub const fn sfd(&self) -> Sfd {
        self.sfd
    }

    /// The preamble acquisition chunk.
    pub const fn pac(&self) -> Pac {
        self.pac
    }

    /// Symbols of the start-of-frame delimiter.
    pub const fn sfd_symbols(&self) -> u16 {
        match (self.data_rate, self.sfd) {
            (DataRate::Kbps110, Sfd::Standard | Sfd::Decawave) => 64,
            (DataRate::Kbps850, Sfd::Decawave) => 16,
            (DataRate::Kbps850, Sfd::Standard) | (DataRate::Kbps6810, Sfd::Standard | Sfd::Decawave) => 8,
        }
    }

    /// From the frame's first pulse to its RMARKER, the first pulse of the PHY header: preamble and delimiter.
    pub const fn time_to_rmarker(&self) -> RadioDuration {
        let symbols = self.preamble_length.symbols() as i64 + self.sfd_symbols() as i64;
        RadioDuration::from_ticks(symbols * self.prf.preamble_symbol_chips() * TICKS_PER_CHIP)
    }

    /// From the RMARKER to the end of a frame of `frame_bytes` bytes, including the two check bytes.
    pub const fn time_after_rmarker(&self, frame_bytes: u16) -> RadioDuration {
        let bits = frame_bytes as i64 * 8;
        let blocks = (bits + REED_SOLOMON_DATA_BITS - 1) / REED_SOLOMON_DATA_BITS;
        let chips = PHR_SYMBOLS * self.data_rate.phr_symbol_chips()
            + (bits + blocks * REED_SOLOMON_CHECK_BITS) * self.data_rate.data_symbol_chips();
        RadioDuration::from_ticks(chips * TICKS_PER_CHIP)
    }

    /// From the first pulse to the last of a frame of `frame_bytes` bytes, including the two check bytes.
    pub const fn airtime(&self, frame_bytes: u16) -> RadioDuration {
        RadioDuration::from_ticks(self.time_to_rmarker().ticks() + self.time_after_rmarker(frame_bytes).ticks())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn airtime_us(data_rate: DataRate, preamble: PreambleLength, sfd: Sfd) -> f64 {
        let phy = PhyConfig::new(Channel::Ch5, Prf::Mhz64, data_rate, preamble).unwrap().with_sfd(sfd).unwrap();
        phy.airtime(27).ticks() as f64 / 63_897.6
    }

    #[test]
    fn airtimes_of_a_27_byte_frame_are_those_published() {
        // Published figures for PRF 64, rounded to the microsecond, with the delimiter of 8 symbols (64 at 110 kbit/s).
        use PreambleLength::{Symbols64, Symbols128, Symbols1024};
        let cases = [
            (DataRate::Kbps6810, Symbols64, 129.0),
            (DataRate::Kbps6810, Symbols128, 194.0),
            (DataRate::Kbps6810, Symbols1024, 1106.0),
            (DataRate::Kbps850, Symbols64, 366.0),
            (DataRate::Kbps850, Symbols128, 431.0),
            (DataRate::Kbps850, Symbols1024, 1343.0),
            (DataRate::Kbps110, Symbols1024, 3446.0),
        ];
        for (rate, preamble, published) in cases {
            let ours = airtime_us(rate, preamble, Sfd::Standard);
            assert!((ours - published).abs() < 0.6, "{rate:?} {preamble:?}: {ours} against {published}");
        }
    }

    #[test]
    fn airtime_is_exact_in_ticks() {
        // Mode 8, 12 bytes: (128 + 8)·508 chips, 21·512 chips, (96 + 48)·64 chips; 69088 + 10752 + 9216 = 89056 chips.
        assert_eq!(PhyConfig::FAST.airtime(12).ticks(), 89_056 * 128);
        // 42 bytes are 336 bits: two Reed-Solomon blocks. 21·512 + (336 + 96)·64 = 38400 chips.
        assert_eq!(PhyConfig::FAST.time_after_rmarker(42).ticks(), 38_400 * 128);
        // 41 bytes are 328 bits: one. 21·512 + (328 + 48)·64 = 34816 chips.
        assert_eq!(PhyConfig::FAST.time_after_rmarker(41).ticks(), 34_816 * 128);
        // Mode 5 to the RMARKER: (1024 + 64)·496 chips.
        assert_eq!(PhyConfig::evk1000_mode(5).unwrap().time_to_rmarker().ticks(), 1088 * 496 * 128);
        // 850 kbit/s with Decawave's delimiter: 16 symbols.
        let slow = PhyConfig::new(Channel::Ch2, Prf::Mhz16, DataRate::Kbps850, PreambleLength::Symbols256).unwrap();
        assert_eq!(slow.time_to_rmarker().ticks(), 272 * 496 * 128);
    }

    #[test]
    fn the_eight_modes_are_those_of_table_5_1() {
        // P. M. de Rojas Malpartida's thesis (2021), table 5-1: mode, channel, rate, PRF, preamble.
        let table = [
            (1, 2, DataRate::Kbps110, Prf::Mhz16, 1024),
            (2, 2, DataRate::Kbps6810, Prf::Mhz16, 128),
            (3, 2, DataRate::Kbps110, Prf::Mhz64, 1024),
            (4, 2, DataRate::Kbps6810, Prf::Mhz64, 128),
            (5, 5, DataRate::Kbps110, Prf::Mhz16, 1024),
            (6, 5, DataRate::Kbps6810, Prf::Mhz16, 128),
            (7, 5, DataRate::Kbps110, Prf::Mhz64, 1024),
            (8, 5, DataRate::Kbps6810, Prf::Mhz64, 128),
        ];
        for (mode, channel, rate, prf, preamble) in table {
            let phy = PhyConfig::evk1000_mode(mode).unwrap();
            let seen = (phy.channel().number(), phy.data_rate(), phy.prf(), phy.preamble_length().symbols());
            assert_eq!(seen, (channel, rate, prf, preamble), "mode {mode}");
            // DecaRanging: PAC 32 and Decawave's delimiter at 110 kbit/s; PAC 8 and the standard's delimiter at 6.81
            // Mbit/s.
            let (pac, sfd) = match rate {
                DataRate::Kbps110 => (Pac::Symbols32, Sfd::Decawave),
                DataRate::Kbps850 | DataRate::Kbps6810 => (Pac::Symbols8, Sfd::Standard),
            };
            assert_eq!((phy.pac(), phy.sfd()), (pac, sfd), "mode {mode}");
            assert_eq!(phy.preamble_code(), if prf == Prf::Mhz16 { 3 } else { 9 }, "mode {mode}");
        }
        // The thesis measured in mode 5: switches off, off, on.
        assert_eq!(PhyConfig::from_evk1000_switches(false, false, true), PhyConfig::evk1000_mode(5).unwrap());
        assert_eq!(PhyConfig::evk1000_mode(0), None);
        assert_eq!(PhyConfig::evk1000_mode(9), None);
        assert_eq!(PhyConfig::evk1000_mode(8), Some(PhyConfig::FAST));
    }

    #[test]
    fn combinations_that_no_receiver_hears_are_refused() {
        let short = PhyConfig::new(Channel::Ch2, Prf::Mhz64, DataRate::Kbps110, PreambleLength::Symbols512);
        assert_eq!(short, Err(PhyError::PreambleTooShort(PreambleLength::Symbols512)));
        assert_eq!(PhyConfig::FAST.with_sfd(Sfd::Decawave), Err(PhyError::SfdUndefined));
        assert_eq!(PhyConfig::FAST.with_pac(Pac::Symbols32), Err(PhyError::PacTooLong(Pac::Symbols32)));
        assert_eq!(PhyConfig::FAST.with_preamble_code(3), Err(PhyError::PreambleCode(3)));
        assert_eq!(PhyConfig::FAST.with_preamble_code(12).unwrap().preamble_code(), 12);
        assert_eq!(Channel::from_number(6), None);
    }
}
