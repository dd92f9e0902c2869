//! The identity of the sender.

use postcard::experimental::max_size::MaxSize;
use serde::{Deserialize, Serialize};

use super::or_default;
use crate::config::Board;
use crate::telemetry::text::text;
use crate::telemetry::{Address, Body};

/// The identity of the sender.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
pub struct Hello {
    /// Since the node started, microseconds.
    pub t_us: u64,
    /// The chip's EUI-64, or that of the config record.
    pub eui: u64,
    /// Short address.
    pub address: u16,
    /// Its role.
    pub role: Role,
    /// Its board.
    pub board: Board,
    /// The build: derived from the commit and the sources when the image is built. An ELF file has the same bytes in
    /// its section `.baliza.build`.
    pub build: [u8; 8],
    /// Whether its UWB frames have integrity codes, and it takes no others. No in frames of older nodes, which do not have
    /// it.
    #[serde(deserialize_with = "or_default")]
    pub keyed: bool,
}

text!(Hello, |this| (this.role, this.build);
    (role, [a, b, c, d, e, f, g, h]) => (
        "{} {} on {}, EUI {:08x}{:08x}, build {:02x}{:02x}{:02x}{:02x}{:02x}{:02x}{:02x}{:02x}{}",
        role.as_str(),
        Address(this.address),
        this.board.name(),
        (this.eui >> 32) as u32,
        this.eui as u32,
        a, b, c, d, e, f, g, h,
        if this.keyed { ", authenticated" } else { "" }
    ),
);

impl Body for Hello {
    const KIND: &'static str = "hello";

    #[cfg(feature = "host")]
    fn json(&self) -> serde_json::Value {
        serde_json::json!({
            "eui": std::format!("{:016x}", self.eui),
            "address": std::string::ToString::to_string(&Address(self.address)),
            "role": self.role.as_str(),
            "board": self.board.name(),
            "build": std::format!("{:016x}", u64::from_be_bytes(self.build)),
            "keyed": self.keyed,
        })
    }
}

/// The role of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Role {
    /// Computes its own position.
    Tag,
    /// Stays at one position and answers.
    Anchor,
    /// Advertises.
    Beacon,
    /// Receives what beacons advertise, and tells a station.
    Scanner,
}

impl Role {
    /// `tag`, `anchor`, `beacon`.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Tag => "tag",
            Self::Anchor => "anchor",
            Self::Beacon => "beacon",
            Self::Scanner => "scanner",
        }
    }
}

#[cfg(test)]
mod tests {
    use std::format;
    use std::string::ToString;

    use super::*;

    #[test]
    fn who_is_speaking() {
        let hello = Hello {
            t_us: 0,
            eui: 0xDECA_0000_0000_1234,
            address: 0x1234,
            role: Role::Tag,
            board: Board::Dwm1001,
            build: [0xDD, 0x7E, 0x67, 0xA0, 1, 2, 3, 0xFF],
            keyed: false,
        };
        let expected = "tag 0x1234 on dwm1001, EUI deca000000001234, build dd7e67a0010203ff";
        assert_eq!(hello.to_string(), expected);
        assert_eq!(Hello { keyed: true, ..hello }.to_string(), format!("{expected}, authenticated"));
    }
}
