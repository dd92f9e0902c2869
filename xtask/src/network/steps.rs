//! Where instructions are executed: between two requests of an image, such as two transactions on its bus.

use std::collections::BTreeMap;
use std::fmt;

use qemu_link::{Asked, Request, Spent};

/// Number of printed rows.
const SHOWN: usize = 24;

/// The kind of a request, as far as the code differs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stage {
    /// The start, the bus clock, the reset line.
    #[default]
    Start,
    /// A register of the DW1000 is read: its file, and the offset within.
    Read(u8, u16),
    /// The same, written.
    Write(u8, u16),
    /// A wait, with nothing to do.
    Wait,
    /// Telemetry.
    Telemetry,
}

/// Instructions between each two kinds of requests.
#[derive(Default)]
pub struct Steps {
    last: Stage,
    between: BTreeMap<(Stage, Stage), Count>,
}

#[derive(Clone, Copy, Default)]
struct Count {
    times: u64,
    ranging: u64,
    background: u64,
}

impl Stage {
    fn of(request: &Request<'_>) -> Self {
        match request {
            Request::Start | Request::Clock { .. } | Request::Reset { .. } => Self::Start,
            Request::Transaction { sent, .. } => Self::of_header(sent),
            Request::Wait { .. } => Self::Wait,
            Request::Telemetry(_) => Self::Telemetry,
        }
    }

    /// DW1000 user manual, 2.2.1.2: bit 7 is write, bit 6 means that an offset follows; bit 7 of the offset means
    /// that it has eight more bits.
    fn of_header(sent: &[u8]) -> Self {
        let [first, rest @ ..] = sent else { return Self::Start };
        let (file, has_offset) = (first & 0x3F, first & 0x40 != 0);
        let offset = match rest {
            [low, high, ..] if has_offset && low & 0x80 != 0 => u16::from(*low & 0x7F) | u16::from(*high) << 7,
            [low, ..] if has_offset => u16::from(*low & 0x7F),
            _ => 0,
        };
        if first & 0x80 != 0 { Self::Write(file, offset) } else { Self::Read(file, offset) }
    }
}

impl fmt::Display for Stage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Start => f.write_str("start"),
            Self::Read(file, offset) => write!(f, "read {file:02X}:{offset:02X}"),
            Self::Write(file, offset) => write!(f, "write {file:02X}:{offset:02X}"),
            Self::Wait => f.write_str("wait"),
            Self::Telemetry => f.write_str("telemetry"),
        }
    }
}

impl Steps {
    /// Counts a request.
    pub fn add(&mut self, asked: &Asked<'_>) {
        let place = Stage::of(&asked.request());
        let Spent { ranging, background } = asked.spent;
        let count = self.between.entry((self.last, place)).or_default();
        count.times += 1;
        count.ranging += u64::from(ranging);
        count.background += u64::from(background);
        self.last = place;
    }

    /// A table of the most expensive ones.
    pub fn table(&self) -> String {
        let mut steps: Vec<_> = self.between.iter().collect();
        steps.sort_by_key(|(_, count)| std::cmp::Reverse(count.ranging + count.background));
        let mut text = format!("{:12} {:12} {:>7} {:>8} {:>10}\n", "from", "to", "times", "ranging", "background");
        for ((from, to), count) in steps.into_iter().take(SHOWN) {
            let [ranging, background] = [count.ranging, count.background].map(|all| all / count.times.max(1));
            let (from, to) = (from.to_string(), to.to_string());
            text += &format!("{from:12} {to:12} {:7} {ranging:8} {background:10}\n", count.times);
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_are_read_as_the_manual_has_them() {
        // Figures 3 to 5 of the user manual: no offset, seven bits, fifteen bits.
        assert_eq!(Stage::of_header(&[0x00, 0, 0]), Stage::Read(0x00, 0));
        assert_eq!(Stage::of_header(&[0x40 | 0x0F, 0x02]), Stage::Read(0x0F, 2));
        assert_eq!(Stage::of_header(&[0xC0 | 0x36, 0x03, 0xF0]), Stage::Write(0x36, 3));
        assert_eq!(Stage::of_header(&[0xC0 | 0x21, 0x80 | 0x05, 0x01]), Stage::Write(0x21, 0x85));
        assert_eq!(Stage::of_header(&[]), Stage::Start);
    }
}
