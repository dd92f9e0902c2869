//! The registers that must have values of the user manual's tables before transmitter or receiver are used.
//!
//! Frames pass with any values; the model only counts. Tables: user manual, 7.2.36 (AGC), 7.2.40 (digital receiver),
//! 7.2.41 (RF), 7.2.43 (pulse generator), 7.2.44 (synthesiser), 7.2.47 (leading edge detection).

use super::bits::config;
use super::registers::file;
use super::transmit::prf;
use super::{Chip, Direction};
use crate::air::{Phy, Prf, SfdKind};

const AGC_CTRL: u8 = 0x23;

/// LDE_REPC by preamble code from 1 on. At 110 kbit/s an eighth of it is used.
const REPLICA_COEFFICIENT: [u32; 24] = [
    0x5998, 0x5998, 0x51EA, 0x428E, 0x451E, 0x2E14, 0x8000, 0x51EA, 0x28F4, 0x3332, 0x3AE0, 0x3D70, 0x3AE0, 0x35C2,
    0x2B84, 0x35C2, 0x3332, 0x35C2, 0x35C2, 0x47AE, 0x3AE0, 0x3850, 0x30A2, 0x3850,
];

/// A register, its address, the number of its bytes that count, and the values that the manual allows.
struct Rule {
    name: &'static str,
    file: u8,
    offset: usize,
    bytes: usize,
    allowed: [u32; 3],
}

const fn rule(name: &'static str, file: u8, offset: usize, bytes: usize, only: u32) -> Rule {
    Rule { name, file, offset, bytes, allowed: [only; 3] }
}

impl Chip {
    /// Names the registers whose contents differ from the user manual's tables for the current mode, for sending and
    /// for receiving. If the receiver cannot know the mode (the rate above 110 kbit/s, the length of the preamble), the
    /// manual's value for any of the modes counts as right.
    pub fn mistuned(&self) -> Vec<&'static str> {
        let mut names: Vec<_> = self.off_table(Direction::Send).chain(self.off_table(Direction::Receive)).collect();
        names.sort_unstable();
        names.dedup();
        names
    }

    pub(super) fn is_mistuned(&self, direction: Direction) -> bool {
        self.off_table(direction).next().is_some()
    }

    fn off_table(&self, direction: Direction) -> impl Iterator<Item = &'static str> + '_ {
        let rules: Vec<Rule> = match direction {
            Direction::Send => self.rules_for_sending(),
            Direction::Receive => self.rules_for_receiving(),
        };
        rules.into_iter().filter(|r| !r.allowed.contains(&self.register(r))).map(|r| r.name)
    }

    fn register(&self, rule: &Rule) -> u32 {
        let mut word = [0; 4];
        word[..rule.bytes].copy_from_slice(&self.memory.file(rule.file)[rule.offset..rule.offset + rule.bytes]);
        u32::from_le_bytes(word)
    }

    fn rules_for_sending(&self) -> Vec<Rule> {
        let channel = (self.memory.u32(file::CHAN_CTRL, 0) & 0xF) as u8;
        let (control, delay) = match channel {
            1 => (0x0000_5C40, 0xC9),
            2 => (0x0004_5CA0, 0xC2),
            3 => (0x0008_6CC0, 0xC5),
            4 => (0x0004_5C80, 0x95),
            7 => (0x001E_7DE0, 0x93),
            // Channel 5.
            _ => (0x001E_3FE0, 0xC0),
        };
        let mut rules =
            vec![rule("RF_TXCTRL", file::RF_CONF, 0x0C, 4, control), rule("TC_PGDELAY", file::TX_CAL, 0x0B, 1, delay)];
        rules.extend(synthesiser(channel));
        rules
    }

    fn rules_for_receiving(&self) -> Vec<Rule> {
        let channels = self.memory.u32(file::CHAN_CTRL, 0);
        let channel = (channels >> 4 & 0xF) as u8;
        let slow = self.configured(config::RXM110K);
        let fast = prf(channels >> 18 & 3) == Some(Prf::Mhz64);
        let of_prf = |sixteen: u32, sixty_four: u32| if fast { sixty_four } else { sixteen };
        let ieee =
            self.sfd(channels & super::bits::channel::RNSSFD != 0, crate::air::Rate::Kbps6800).kind == SfdKind::Ieee;
        // For 110 kbit/s; otherwise for 850 kbit/s and 6.8 Mbit/s.
        let sfd = match (slow, ieee) {
            (true, true) => [0x000A; 3],
            (true, false) => [0x0016; 3],
            (false, true) => [0x0001; 3],
            (false, false) => [0x0006, 0x0002, 0x0002],
        };
        // For 1024 symbols and more at 110 kbit/s; otherwise for up to 1024 symbols, and for 64.
        let length = if slow { [0x0064; 3] } else { [0x0020, 0x0010, 0x0010] };
        let chunks = match (self.memory.u8(file::DRX_CONF, 0x0B) >> 1 & 3, fast) {
            (0, false) => 0x311A_002D,
            (0, true) => 0x313B_006B,
            (1, false) => 0x331A_0052,
            (1, true) => 0x333B_00BE,
            (2, false) => 0x351A_009A,
            (2, true) => 0x353B_015E,
            (_, false) => 0x371A_011D,
            (_, true) => 0x373B_0296,
        };
        let code = (channels >> 27) as usize;
        let coefficient = REPLICA_COEFFICIENT.get(code.wrapping_sub(1)).copied().unwrap_or(0);
        let mut rules = vec![
            rule("AGC_TUNE1", AGC_CTRL, 0x04, 2, of_prf(0x8870, 0x889B)),
            rule("AGC_TUNE2", AGC_CTRL, 0x0C, 4, 0x2502_A907),
            rule("AGC_TUNE3", AGC_CTRL, 0x12, 2, 0x0035),
            Rule { allowed: sfd, ..rule("DRX_TUNE0b", file::DRX_CONF, 0x02, 2, 0) },
            rule("DRX_TUNE1a", file::DRX_CONF, 0x04, 2, of_prf(0x0087, 0x008D)),
            Rule { allowed: length, ..rule("DRX_TUNE1b", file::DRX_CONF, 0x06, 2, 0) },
            rule("DRX_TUNE2", file::DRX_CONF, 0x08, 4, chunks),
            Rule { allowed: [0x0028, 0x0010, 0x0010], ..rule("DRX_TUNE4H", file::DRX_CONF, 0x26, 2, 0) },
            rule("RF_RXCTRLH", file::RF_CONF, 0x0B, 1, if Phy::is_wide(channel) { 0xBC } else { 0xD8 }),
            rule("LDE_CFG2", file::LDE_IF, 0x1806, 2, of_prf(0x1607, 0x0607)),
            rule("LDE_REPC", file::LDE_IF, 0x2804, 2, if slow { coefficient / 8 } else { coefficient }),
        ];
        rules.extend(synthesiser(channel));
        rules
    }
}

fn synthesiser(channel: u8) -> [Rule; 2] {
    let (configuration, tune) = match channel {
        1 => (0x0900_0407, 0x1E),
        2 | 4 => (0x0840_0508, 0x26),
        3 => (0x0840_1009, 0x56),
        // Channels 5 and 7.
        _ => (0x0800_041D, 0xBE),
    };
    [rule("FS_PLLCFG", file::FS_CTRL, 0x07, 4, configuration), rule("FS_PLLTUNE", file::FS_CTRL, 0x0B, 1, tune)]
}
