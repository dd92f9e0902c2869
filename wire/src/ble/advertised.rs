//! A tag's view of an advertisement: a beacon of either format, with the numbers by which a config record lists
//! beacons, and with its reported power.

use core::fmt;

use crate::ble::{EddystoneError, EddystoneUid, IBeacon, IBeaconError};

/// A beacon's advertisement of either format.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Advertised {
    /// An iBeacon.
    IBeacon(IBeacon),
    /// An Eddystone-UID.
    EddystoneUid(EddystoneUid),
}

/// The identity of a beacon.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Identity {
    /// The owner of the beacon: the first four bytes of UUID or namespace, big-endian.
    pub network: u32,
    /// Major number; of an Eddystone-UID the third and fourth byte of the instance, big-endian.
    pub major: u16,
    /// Minor number; of an Eddystone-UID the last two bytes of the instance, big-endian.
    pub minor: u16,
}

/// Why an advertisement is not from a beacon: the error of each format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct NoBeacon {
    /// As an iBeacon.
    pub ibeacon: IBeaconError,
    /// As an Eddystone-UID.
    pub eddystone: EddystoneError,
}

impl fmt::Display for NoBeacon {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "no iBeacon: {}; no Eddystone-UID: {}", self.ibeacon, self.eddystone)
    }
}

impl Advertised {
    /// Parses the data of an advertisement. If it has both formats, the iBeacon counts.
    ///
    /// # Errors
    /// If the data is of neither format; [`NoBeacon`] has the reasons.
    pub fn parse(advertising_data: &[u8]) -> Result<Self, NoBeacon> {
        match IBeacon::parse(advertising_data) {
            Ok(beacon) => Ok(Self::IBeacon(beacon)),
            Err(ibeacon) => match EddystoneUid::parse(advertising_data) {
                Ok(uid) => Ok(Self::EddystoneUid(uid)),
                Err(eddystone) => Err(NoBeacon { ibeacon, eddystone }),
            },
        }
    }

    /// The identity of the sender.
    pub fn identity(&self) -> Identity {
        match self {
            Self::IBeacon(IBeacon { uuid: [a, b, c, d, ..], major, minor, .. }) => {
                Identity { network: u32::from_be_bytes([*a, *b, *c, *d]), major: *major, minor: *minor }
            }
            Self::EddystoneUid(EddystoneUid { namespace: [a, b, c, d, ..], instance: [_, _, e, f, g, h], .. }) => {
                Identity {
                    network: u32::from_be_bytes([*a, *b, *c, *d]),
                    major: u16::from_be_bytes([*e, *f]),
                    minor: u16::from_be_bytes([*g, *h]),
                }
            }
        }
    }

    /// The RSSI at 1 m that it reports, dBm.
    pub fn rssi_1m_dbm(&self) -> i8 {
        match self {
            Self::IBeacon(beacon) => beacon.measured_power_dbm,
            Self::EddystoneUid(uid) => uid.rssi_1m_dbm(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hex_literal::hex;
    use std::vec::Vec;

    const IBEACON: [u8; 30] = hex!("02 01 06 1A FF 4C00 02 15 12345678 0000 0000 0000 000000000003 0102 0304 C5");
    const UID: [u8; 31] = hex!("02 01 06 03 03 AAFE 17 16 AAFE 00 EE 12345678000000000000 000001020304 0000");

    #[test]
    fn both_formats_name_a_beacon_and_its_power_alike() {
        let expected = Identity { network: 0x1234_5678, major: 0x0102, minor: 0x0304 };
        for bytes in [&IBEACON[..], &UID] {
            let heard = Advertised::parse(bytes).expect("a beacon");
            // 0xC5 − 256 = −59 at 1 m; 0xEE − 256 = −18 at 0 m is −59 at 1 m.
            assert_eq!((heard.identity(), heard.rssi_1m_dbm()), (expected, -59));
        }
    }

    #[test]
    fn manufacturer_data_of_others_is_refused_and_does_not_hide_a_beacon() {
        // Nordic Semiconductor, Google, Microsoft (its beacon for the swift pairing of devices).
        for other in [&hex!("02 01 06 05 FF 5900 02 15")[..], &hex!("04 FF E000 01"), &hex!("06 FF 0600 03 00 80")] {
            let refused = Advertised::parse(other).expect_err("no beacon");
            assert!(matches!(refused.ibeacon, IBeaconError::OtherMaker(Some(_))), "{refused}");
            assert_eq!(refused.eddystone, EddystoneError::NoServiceData);
            // Their structures come before those of a beacon, without the flags.
            let both: Vec<u8> = other.iter().chain(&UID[3..]).copied().collect();
            assert!(matches!(Advertised::parse(&both), Ok(Advertised::EddystoneUid(_))));
        }
    }

    #[test]
    fn an_advertisement_of_every_malformed_length_is_refused() {
        for whole in [&IBEACON[..], &UID] {
            for length in 0..whole.len() {
                assert!(Advertised::parse(&whole[..length]).is_err(), "cut to {length}");
            }
            // The length byte of the beacon's structure, set to every possible value. After a structure that ends early
            // come bytes that belong to no beacon; 0 ends the data.
            let at = if whole.len() == IBEACON.len() { 3 } else { 7 };
            let right = whole[at];
            for length in (0..=u8::MAX).filter(|length| *length != right) {
                let mut bytes = whole.to_vec();
                bytes[at] = length;
                // A UID without its two reserved bytes is valid, whatever follows.
                let short = at == 7 && length == right - 2;
                assert_eq!(Advertised::parse(&bytes).is_ok(), short, "length {length}");
            }
        }
    }
}
