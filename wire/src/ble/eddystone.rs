//! Eddystone-UID as a view over its bytes and as a representation, according to Google's public specification of the
//! frame (<https://github.com/google/eddystone/tree/master/eddystone-uid>).
//!
//! It is service data of the 16-bit UUID 0xFEAA: a frame type, the power at 0 m, a namespace of ten bytes, an instance
//! of six bytes, and two reserved bytes that some beacons leave out. The other frames (URL, TLM, EID) contain nothing
//! that positioning needs.

use core::fmt;

use crate::ble::structure::{Structures, Truncated};

/// Bytes of an Eddystone-UID's advertising data.
pub const EDDYSTONE_LENGTH: usize = 31;

/// AD types (Bluetooth).
const FLAGS: u8 = 0x01;
const COMPLETE_LIST_OF_UUIDS: u8 = 0x03;
const SERVICE_DATA: u8 = 0x16;
/// Generally discoverable, no Bluetooth Classic.
const DISCOVERABLE_LE_ONLY: u8 = 0x06;
/// The service's UUID, the lowest byte first.
const EDDYSTONE: [u8; 2] = [0xAA, 0xFE];
/// The frame type of a UID.
const UID: u8 = 0x00;
/// Bytes of the service data: UUID, type, power, namespace, instance. Two more bytes are reserved.
const DATA_LENGTH: usize = 20;
const RESERVED: usize = 2;
/// The power at 0 m exceeds that at 1 m by this, dB, according to the specification.
const FIRST_METRE_DB: i8 = 41;

/// Why advertising data is not that of an Eddystone-UID.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum EddystoneError {
    /// An AD structure is cut short.
    Truncated(Truncated),
    /// It has no service data of Eddystone.
    NoServiceData,
    /// It is a frame of this other type, or too short to contain a type.
    OtherFrame(Option<u8>),
    /// Its type is UID, but it has this wrong number of bytes of service data; a UID has 20 or 22.
    Length(usize),
}

impl fmt::Display for EddystoneError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Truncated(truncated) => truncated.fmt(f),
            Self::NoServiceData => f.write_str("there is no service data of Eddystone"),
            Self::OtherFrame(Some(kind)) => write!(f, "an Eddystone frame of type {kind:#04x}, not a UID"),
            Self::OtherFrame(None) => f.write_str("an Eddystone frame of no type"),
            Self::Length(length) => {
                write!(
                    f,
                    "a UID in {length} bytes of service data instead of {DATA_LENGTH} or {}",
                    DATA_LENGTH + RESERVED
                )
            }
        }
    }
}

impl From<Truncated> for EddystoneError {
    fn from(truncated: Truncated) -> Self {
        Self::Truncated(truncated)
    }
}

/// A view over the service data of an Eddystone-UID. Its frame has been checked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UidPayload<'a>(&'a [u8; DATA_LENGTH]);

impl<'a> UidPayload<'a> {
    /// Finds it in advertising data, which may contain other structures. If there are several frames of Eddystone, the
    /// error is that of the last one.
    ///
    /// # Errors
    /// If the data has no Eddystone-UID; [`EddystoneError`] has the reason.
    pub fn find(advertising_data: &'a [u8]) -> Result<Self, EddystoneError> {
        let mut refusal = EddystoneError::NoServiceData;
        for structure in Structures::new(advertising_data) {
            let structure = structure?;
            if structure.kind == SERVICE_DATA && structure.data.starts_with(&EDDYSTONE) {
                match Self::of_service_data(structure.data) {
                    Ok(found) => return Ok(found),
                    Err(other) => refusal = other,
                }
            }
        }
        Err(refusal)
    }

    /// A view over service data that begins with Eddystone's UUID.
    fn of_service_data(data: &'a [u8]) -> Result<Self, EddystoneError> {
        match data.get(EDDYSTONE.len()) {
            Some(&UID) => {}
            other => return Err(EddystoneError::OtherFrame(other.copied())),
        }
        match data.split_first_chunk() {
            Some((frame, [] | [_, _])) => Ok(Self(frame)),
            Some(_) | None => Err(EddystoneError::Length(data.len())),
        }
    }

    /// RSSI at 0 m, dBm.
    pub fn power_0m_dbm(&self) -> i8 {
        i8::from_be_bytes([self.0[3]])
    }

    /// Namespace: the owner of the beacon.
    pub fn namespace(&self) -> [u8; 10] {
        core::array::from_fn(|i| self.0[4 + i])
    }

    /// Instance: the beacon among those of its owner.
    pub fn instance(&self) -> [u8; 6] {
        core::array::from_fn(|i| self.0[14 + i])
    }
}

/// The contents of an Eddystone-UID. Every value of every field can be sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct EddystoneUid {
    /// Namespace: the owner of the beacon.
    pub namespace: [u8; 10],
    /// Instance: the beacon among those of its owner.
    pub instance: [u8; 6],
    /// RSSI at 0 m, dBm.
    pub power_0m_dbm: i8,
}

impl EddystoneUid {
    /// Parses the data of an advertisement.
    ///
    /// # Errors
    /// If the data has no Eddystone-UID; [`EddystoneError`] has the reason.
    pub fn parse(advertising_data: &[u8]) -> Result<Self, EddystoneError> {
        UidPayload::find(advertising_data).map(Self::from)
    }

    /// RSSI at 1 m, dBm: 41 dB below that at 0 m.
    pub fn rssi_1m_dbm(&self) -> i8 {
        self.power_0m_dbm.saturating_sub(FIRST_METRE_DB)
    }

    /// The power at 0 m for an RSSI at 1 m, dBm.
    pub fn power_0m_of(rssi_1m_dbm: i8) -> i8 {
        rssi_1m_dbm.saturating_add(FIRST_METRE_DB)
    }

    /// The data of its advertisement: flags, the list of services, and the service data.
    pub fn emit(&self) -> [u8; EDDYSTONE_LENGTH] {
        let mut data = [0; EDDYSTONE_LENGTH];
        let [low, high] = EDDYSTONE;
        data[..12].copy_from_slice(&[
            2,
            FLAGS,
            DISCOVERABLE_LE_ONLY,
            3,
            COMPLETE_LIST_OF_UUIDS,
            low,
            high,
            (1 + DATA_LENGTH + RESERVED) as u8,
            SERVICE_DATA,
            low,
            high,
            UID,
        ]);
        data[12] = self.power_0m_dbm.to_be_bytes()[0];
        data[13..23].copy_from_slice(&self.namespace);
        data[23..29].copy_from_slice(&self.instance);
        data
    }
}

impl From<UidPayload<'_>> for EddystoneUid {
    fn from(payload: UidPayload<'_>) -> Self {
        Self { namespace: payload.namespace(), instance: payload.instance(), power_0m_dbm: payload.power_0m_dbm() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hex_literal::hex;
    use proptest::prelude::*;
    use std::string::ToString;
    use std::vec::Vec;

    /// Byte by byte as in the specification's table: length, flags, flags' value; length, complete list, UUID; length,
    /// service data, UUID, frame type, power (−18 = 0xEE − 256), namespace, instance, reserved.
    const FRAME: [u8; 31] = hex!("02 01 06 03 03 AAFE 17 16 AAFE 00 EE 00010203040506070809 0A0B0C0D0E0F 0000");

    fn of_frame() -> EddystoneUid {
        EddystoneUid { namespace: hex!("00010203040506070809"), instance: hex!("0A0B0C0D0E0F"), power_0m_dbm: -18 }
    }

    #[test]
    fn the_frame_of_the_specification_is_read_and_written() {
        assert_eq!(EddystoneUid::parse(&FRAME), Ok(of_frame()));
        assert_eq!(of_frame().emit(), FRAME);
        // −18 − 41.
        assert_eq!(of_frame().rssi_1m_dbm(), -59);
        assert_eq!(EddystoneUid::power_0m_of(-59), -18);
    }

    #[test]
    fn the_reserved_bytes_may_be_left_out() {
        let mut short = FRAME[..29].to_vec();
        short[7] = 0x15;
        assert_eq!(EddystoneUid::parse(&short), Ok(of_frame()));
    }

    #[test]
    fn what_is_no_uid_is_refused_with_the_reason() {
        let refusal = |bytes: &[u8]| EddystoneUid::parse(bytes).expect_err("no UID");
        assert_eq!(refusal(&[]), EddystoneError::NoServiceData);
        // A heart-rate service's data.
        assert_eq!(refusal(&hex!("02 01 06 04 16 0D18 40")), EddystoneError::NoServiceData);
        // A URL, a telemetry frame, nothing.
        assert_eq!(refusal(&hex!("06 16 AAFE 10 EE 01")), EddystoneError::OtherFrame(Some(0x10)));
        assert_eq!(refusal(&hex!("04 16 AAFE 20")), EddystoneError::OtherFrame(Some(0x20)));
        assert_eq!(refusal(&hex!("03 16 AAFE")), EddystoneError::OtherFrame(None));
        // One reserved byte of two: 2 + 1 + 1 + 16 + 1 = 21.
        let mut odd = FRAME[..30].to_vec();
        odd[7] = 0x16;
        assert_eq!(refusal(&odd), EddystoneError::Length(21));
        assert_eq!(refusal(&hex!("04 16 AAFE 00")), EddystoneError::Length(3));
        assert_eq!(refusal(&FRAME[..30]).to_string(), "an AD structure of 23 bytes is cut after 22");
    }

    fn any_uid() -> impl Strategy<Value = EddystoneUid> {
        (any::<[u8; 10]>(), any::<[u8; 6]>(), any::<i8>())
            .prop_map(|(namespace, instance, power_0m_dbm)| EddystoneUid { namespace, instance, power_0m_dbm })
    }

    proptest! {
        #[test]
        fn every_uid_comes_back(uid in any_uid()) {
            prop_assert_eq!(EddystoneUid::parse(&uid.emit()), Ok(uid));
        }

        /// Accepted data always contains the frame's bytes: the parser invents nothing.
        #[test]
        fn random_bytes_are_refused_or_hold_the_frame(bytes in proptest::collection::vec(any::<u8>(), 0..64)) {
            if let Ok(uid) = EddystoneUid::parse(&bytes) {
                let sought = uid.emit();
                prop_assert!(bytes.windows(20).any(|window| window == &sought[9..29]));
            }
        }

        /// A frame cut anywhere is refused.
        #[test]
        fn a_cut_frame_is_refused(uid in any_uid(), length in 0_usize..31) {
            let cut: Vec<u8> = uid.emit()[..length].to_vec();
            prop_assert!(EddystoneUid::parse(&cut).is_err());
        }
    }
}
