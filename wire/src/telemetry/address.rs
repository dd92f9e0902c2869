//! How the short address of a node is written: alike in all lines, tables and JSON objects.

use core::fmt;
use core::num::ParseIntError;
use core::str::FromStr;

/// The short address of a node. It is written as `0x0102`, and read as that or as a decimal number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Address(pub u16);

impl fmt::Display for Address {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "0x{:04X}", self.0)
    }
}

/// A node's own log has the digits alone.
#[cfg(feature = "defmt")]
impl defmt::Format for Address {
    fn format(&self, out: defmt::Formatter<'_>) {
        defmt::write!(out, "{=u16:04x}", self.0);
    }
}

impl FromStr for Address {
    type Err = ParseIntError;

    fn from_str(text: &str) -> Result<Self, ParseIntError> {
        match text.strip_prefix("0x").or_else(|| text.strip_prefix("0X")) {
            Some(digits) => u16::from_str_radix(digits, 16),
            None => text.parse(),
        }
        .map(Self)
    }
}

#[cfg(test)]
mod tests {
    use std::string::ToString;

    use super::Address;

    #[test]
    fn an_address_is_written_one_way_and_read_in_two() {
        assert_eq!([0x00A1, 258, 0xFFFF].map(|address| Address(address).to_string()), ["0x00A1", "0x0102", "0xFFFF"]);
        for text in ["0x0102", "0X102", "258"] {
            assert_eq!(text.parse(), Ok(Address(0x0102)), "{text}");
        }
        for wrong in ["", "0x", "0x10000", "65536", "-1", "102h", "anchor-2"] {
            assert!(wrong.parse::<Address>().is_err(), "{wrong}");
        }
    }
}
