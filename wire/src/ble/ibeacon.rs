//! iBeacon: 30 bytes of advertising data, flags and one structure of manufacturer data (Proximity Beacon Specification,
//! R1).
//!
//! | byte | what | value |
//! |---|---|---|
//! | 0–2 | AD structure: flags | `02 01 06` |
//! | 3–4 | length and type of the second structure: manufacturer data | `1A FF` |
//! | 5–6 | the maker, Apple, little-endian | `4C 00` |
//! | 7–8 | its kind of data, and that one's length | `02 15` |
//! | 9–24 | proximity UUID | |
//! | 25–26 | major number, big-endian | |
//! | 27–28 | minor number, big-endian | |
//! | 29 | RSSI at 1 m, dBm, two's complement | |

use core::fmt;

use crate::ble::structure::{Structures, Truncated};

/// Bytes of an iBeacon's advertising data.
pub const LENGTH: usize = 30;

/// AD types.
const FLAGS: u8 = 0x01;
const MANUFACTURER_DATA: u8 = 0xFF;
/// Generally discoverable, no Bluetooth Classic.
const DISCOVERABLE_LE_ONLY: u8 = 0x06;
const APPLE: [u8; 2] = [0x4C, 0x00];
/// Apple's number for a proximity beacon, and the number of bytes that follow the length.
const PROXIMITY: u8 = 0x02;
const PROXIMITY_LENGTH: u8 = 0x15;
/// Bytes of the manufacturer data: maker, kind, length, and the 21 bytes of the beacon.
const DATA_LENGTH: usize = 4 + PROXIMITY_LENGTH as usize;

/// Why advertising data is not that of an iBeacon.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum IBeaconError {
    /// An AD structure is cut short.
    Truncated(Truncated),
    /// It has no manufacturer data.
    NoManufacturerData,
    /// Its manufacturer data is from this maker, or too short to contain a maker.
    OtherMaker(Option<u16>),
    /// It is Apple's, but of this kind, or too short to contain a kind.
    OtherKind(Option<u8>),
    /// Its kind is iBeacon, but it has this wrong number of bytes of manufacturer data; an iBeacon has 25.
    Length(usize),
    /// It has an iBeacon's length, but its length field has this other value.
    InnerLength(u8),
}

impl fmt::Display for IBeaconError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Truncated(truncated) => truncated.fmt(f),
            Self::NoManufacturerData => f.write_str("there is no manufacturer data"),
            Self::OtherMaker(Some(maker)) => write!(f, "the maker is {maker:#06x}, not Apple"),
            Self::OtherMaker(None) => f.write_str("the manufacturer data names no maker"),
            Self::OtherKind(Some(kind)) => write!(f, "Apple's data of kind {kind:#04x}, not an iBeacon"),
            Self::OtherKind(None) => f.write_str("Apple's data of no kind"),
            Self::Length(length) => {
                write!(f, "an iBeacon in {length} bytes of manufacturer data instead of {DATA_LENGTH}")
            }
            Self::InnerLength(length) => write!(f, "an iBeacon of {length} bytes instead of {PROXIMITY_LENGTH}"),
        }
    }
}

impl From<Truncated> for IBeaconError {
    fn from(truncated: Truncated) -> Self {
        Self::Truncated(truncated)
    }
}

/// A view over the manufacturer data of an iBeacon. Its frame has been checked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Payload<'a>(&'a [u8; DATA_LENGTH]);

impl<'a> Payload<'a> {
    /// Finds it in advertising data. Flags and other structures may come before and after it. If there are several
    /// structures of manufacturer data, the error is that of the last one.
    ///
    /// # Errors
    /// If the data has no iBeacon; [`IBeaconError`] has the reason.
    pub fn find(advertising_data: &'a [u8]) -> Result<Self, IBeaconError> {
        let mut refusal = IBeaconError::NoManufacturerData;
        for structure in Structures::new(advertising_data) {
            let structure = structure?;
            if structure.kind == MANUFACTURER_DATA {
                match Self::of_manufacturer_data(structure.data) {
                    Ok(found) => return Ok(found),
                    Err(other) => refusal = other,
                }
            }
        }
        Err(refusal)
    }

    /// A view over manufacturer data as a Bluetooth stack may return it: from the maker's number on.
    ///
    /// # Errors
    /// If the data is not that of an iBeacon; [`IBeaconError`] has the reason.
    pub fn of_manufacturer_data(data: &'a [u8]) -> Result<Self, IBeaconError> {
        let Some((&maker, rest)) = data.split_first_chunk() else {
            return Err(IBeaconError::OtherMaker(None));
        };
        if maker != APPLE {
            return Err(IBeaconError::OtherMaker(Some(u16::from_le_bytes(maker))));
        }
        match rest.first() {
            Some(&PROXIMITY) => {}
            other => return Err(IBeaconError::OtherKind(other.copied())),
        }
        let whole: &[u8; DATA_LENGTH] = data.try_into().map_err(|_| IBeaconError::Length(data.len()))?;
        match whole[3] {
            PROXIMITY_LENGTH => Ok(Self(whole)),
            other => Err(IBeaconError::InnerLength(other)),
        }
    }

    /// Proximity UUID.
    pub fn uuid(&self) -> [u8; 16] {
        core::array::from_fn(|i| self.0[4 + i])
    }

    /// Major number.
    pub fn major(&self) -> u16 {
        u16::from_be_bytes([self.0[20], self.0[21]])
    }

    /// Minor number.
    pub fn minor(&self) -> u16 {
        u16::from_be_bytes([self.0[22], self.0[23]])
    }

    /// RSSI at 1 m, dBm.
    pub fn measured_power_dbm(&self) -> i8 {
        i8::from_be_bytes([self.0[24]])
    }
}

/// The contents of an iBeacon. Every value of every field can be sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct IBeacon {
    /// Proximity UUID.
    pub uuid: [u8; 16],
    /// Major number.
    pub major: u16,
    /// Minor number.
    pub minor: u16,
    /// RSSI at 1 m, dBm.
    pub measured_power_dbm: i8,
}

impl IBeacon {
    /// Parses the data of an advertisement.
    ///
    /// # Errors
    /// If the data has no iBeacon; [`IBeaconError`] has the reason.
    pub fn parse(advertising_data: &[u8]) -> Result<Self, IBeaconError> {
        Payload::find(advertising_data).map(Self::from)
    }

    /// The data of its advertisement: the flags and the manufacturer data.
    pub fn emit(&self) -> [u8; LENGTH] {
        let mut data = [0; LENGTH];
        data[..9].copy_from_slice(&[
            2,
            FLAGS,
            DISCOVERABLE_LE_ONLY,
            1 + DATA_LENGTH as u8,
            MANUFACTURER_DATA,
            APPLE[0],
            APPLE[1],
            PROXIMITY,
            PROXIMITY_LENGTH,
        ]);
        data[9..25].copy_from_slice(&self.uuid);
        data[25..27].copy_from_slice(&self.major.to_be_bytes());
        data[27..29].copy_from_slice(&self.minor.to_be_bytes());
        data[29..].copy_from_slice(&self.measured_power_dbm.to_be_bytes());
        data
    }
}

impl From<Payload<'_>> for IBeacon {
    fn from(payload: Payload<'_>) -> Self {
        Self {
            uuid: payload.uuid(),
            major: payload.major(),
            minor: payload.minor(),
            measured_power_dbm: payload.measured_power_dbm(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hex_literal::hex;
    use proptest::prelude::*;
    use std::string::ToString;
    use std::vec::Vec;

    /// Table 2.1 of a thesis on positioning with iBeacons, byte by byte, with its own UUID (all zeros but the beacon's
    /// number, here 3), its zeros for major and minor, and −59 = 0xC5 − 256.
    const TABLE: [u8; 30] = hex!("02 01 06 1A FF 4C00 02 15 00000000 0000 0000 0000 000000000003 0000 0000 C5");

    fn of_table() -> IBeacon {
        let mut uuid = [0; 16];
        uuid[15] = 3;
        IBeacon { uuid, major: 0, minor: 0, measured_power_dbm: -59 }
    }

    #[test]
    fn the_table_of_the_thesis_is_read_and_written() {
        assert_eq!(IBeacon::parse(&TABLE), Ok(of_table()));
        assert_eq!(of_table().emit(), TABLE);
    }

    #[test]
    fn numbers_are_big_endian() {
        let beacon = IBeacon {
            uuid: hex!("f7826da6 4fa2 4e98 8024 bc5b71e0893e"),
            major: 0x0102,
            minor: 0x0304,
            measured_power_dbm: -128,
        };
        let bytes = hex!("020106 1AFF4C000215 f7826da64fa24e988024bc5b71e0893e 0102 0304 80");
        assert_eq!(beacon.emit(), bytes);
        assert_eq!(IBeacon::parse(&bytes), Ok(beacon));
    }

    #[test]
    fn flags_are_not_needed_and_others_may_stand_around() {
        assert_eq!(IBeacon::parse(&TABLE[3..]), Ok(of_table()));
        // The transmit power before it, the name "b" after it.
        let around: Vec<u8> = [&hex!("02 0A 00")[..], &TABLE, &hex!("02 09 62")].concat();
        assert_eq!(IBeacon::parse(&around), Ok(of_table()));
        // Another maker's data before it.
        let second: Vec<u8> = [&hex!("03 FF 5900")[..], &TABLE[3..]].concat();
        assert_eq!(IBeacon::parse(&second), Ok(of_table()));
    }

    #[test]
    fn what_is_no_ibeacon_is_refused_with_the_reason() {
        let refusal = |bytes: &[u8]| IBeacon::parse(bytes).expect_err("no iBeacon");
        assert_eq!(refusal(&[]), IBeaconError::NoManufacturerData);
        assert_eq!(refusal(&hex!("02 01 06")), IBeaconError::NoManufacturerData);
        // Nordic Semiconductor is 0x0059.
        assert_eq!(refusal(&hex!("02 01 06 05 FF 5900 02 15")), IBeaconError::OtherMaker(Some(0x0059)));
        assert_eq!(refusal(&hex!("02 FF 4C")), IBeaconError::OtherMaker(None));
        // Apple's "nearby info" is kind 0x10.
        assert_eq!(refusal(&hex!("02 01 06 08 FF 4C00 10 03 010203")), IBeaconError::OtherKind(Some(0x10)));
        assert_eq!(refusal(&hex!("03 FF 4C00")), IBeaconError::OtherKind(None));
        // One byte too few: 24 of 25 bytes of manufacturer data.
        let mut short = TABLE;
        short[3] = 0x19;
        assert_eq!(refusal(&short[..29]), IBeaconError::Length(24));
        // One byte too many.
        let mut long = TABLE.to_vec();
        long[3] = 0x1B;
        long.push(0);
        assert_eq!(refusal(&long), IBeaconError::Length(26));
        let mut inner = TABLE;
        inner[8] = 0x16;
        assert_eq!(refusal(&inner), IBeaconError::InnerLength(0x16));
        assert_eq!(
            refusal(&TABLE[..29]).to_string(),
            // 0x1A = 26 announced; 29 − 4 = 25 there.
            "an AD structure of 26 bytes is cut after 25"
        );
    }

    fn any_beacon() -> impl Strategy<Value = IBeacon> {
        (any::<[u8; 16]>(), any::<u16>(), any::<u16>(), any::<i8>()).prop_map(|(uuid, major, minor, power)| IBeacon {
            uuid,
            major,
            minor,
            measured_power_dbm: power,
        })
    }

    proptest! {
        #[test]
        fn every_beacon_comes_back(beacon in any_beacon()) {
            prop_assert_eq!(IBeacon::parse(&beacon.emit()), Ok(beacon));
        }

        /// Accepted data always contains the beacon's 27 bytes: the parser invents nothing.
        #[test]
        fn random_bytes_are_refused_or_hold_the_beacon(bytes in proptest::collection::vec(any::<u8>(), 0..64)) {
            if let Ok(beacon) = IBeacon::parse(&bytes) {
                let sought = beacon.emit();
                prop_assert!(bytes.windows(27).any(|window| window == &sought[3..]));
            }
        }

        /// With one byte changed, the data is refused or is another beacon, unless the byte is the type or the value of
        /// the flags: other structures may come before the beacon, whatever they are.
        #[test]
        fn a_changed_byte_is_never_the_same_beacon(beacon in any_beacon(), at in 0_usize..30, flip in 1_u8..) {
            let mut bytes = beacon.emit();
            bytes[at] ^= flip;
            let ignored = at == 1 || at == 2;
            prop_assert_eq!(IBeacon::parse(&bytes) == Ok(beacon), ignored);
        }

        /// A beacon cut anywhere is refused.
        #[test]
        fn a_cut_beacon_is_refused(beacon in any_beacon(), length in 0_usize..30) {
            prop_assert!(IBeacon::parse(&beacon.emit()[..length]).is_err());
        }
    }
}
