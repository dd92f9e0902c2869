//! The beacons that a tag knows, either by their numbers or by their rotating identifiers.

use positioning_core::ble::signal::{BeaconList, ListedBeacon};
use wire::ble::{Advertised, RotatingId};
use wire::config::{Beacon, Record};
use wire::telemetry::BeaconId;

/// The beacons that a tag knows.
#[derive(Clone)]
pub struct KnownBeacons<'r> {
    beacons: &'r [Beacon],
    /// The key of their rotating identifiers. It is expanded for each advertisement: this takes time, which is less
    /// scarce than RAM.
    key: Option<&'r [u8; 16]>,
}

/// A beacon that a node knows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct KnownBeacon {
    /// Its name.
    pub id: BeaconId,
    /// Its index in the list, if it is listed.
    pub place: Option<usize>,
}

impl<'r> KnownBeacons<'r> {
    /// The beacons of a record.
    pub fn of(record: &'r Record) -> Self {
        Self::new(&record.beacons, record.beacon_key.as_ref())
    }

    /// These beacons, and all beacons whose rotating identifiers match this key. With an empty list every beacon is
    /// known, and none has an index.
    pub fn new(beacons: &'r [Beacon], key: Option<&'r [u8; 16]>) -> Self {
        Self { beacons, key }
    }

    /// The beacons whose positions are known.
    pub(crate) fn listed(&self) -> &'r [Beacon] {
        self.beacons
    }

    /// Identifies the sender of an advertisement, if the tag knows it.
    pub fn identify(&self, heard: &Advertised) -> Option<KnownBeacon> {
        let revealed = match (heard, self.key) {
            (Advertised::IBeacon(beacon), Some(key)) => RotatingId::new(key).reveal(beacon),
            (Advertised::IBeacon(_), None) | (Advertised::EddystoneUid(_), _) => None,
        };
        let told = heard.identity();
        let (major, minor) = revealed.map_or((told.major, told.minor), |true_one| (true_one.major, true_one.minor));
        let place = self.beacons.iter().position(|beacon| (beacon.major, beacon.minor) == (major, minor));
        // The UUID of a rotating identifier has no meaning.
        let network = if revealed.is_some() { 0 } else { told.network };
        let known = KnownBeacon { id: BeaconId { network, major, minor }, place };
        (place.is_some() || self.beacons.is_empty()).then_some(known)
    }
}

impl BeaconList for KnownBeacons<'_> {
    fn beacon(&self, index: usize) -> Option<ListedBeacon> {
        let Beacon { position_m, rssi_1m_dbm, path_loss_exponent, .. } = *self.beacons.get(index)?;
        Some(ListedBeacon { position_m, rssi_1m_dbm, path_loss_exponent })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wire::ble::{EddystoneUid, Fresh, IBeacon};

    const KEY: [u8; 16] = [7; 16];

    fn ibeacon(major: u16, minor: u16) -> IBeacon {
        let mut uuid = [0; 16];
        uuid[..4].copy_from_slice(&[0x12, 0x34, 0x56, 0x78]);
        IBeacon { uuid, major, minor, measured_power_dbm: -59 }
    }

    fn listed(major: u16, minor: u16) -> Beacon {
        Beacon { major, minor, position_m: [0.0; 3], rssi_1m_dbm: None, path_loss_exponent: None }
    }

    #[test]
    fn listed_beacons_are_known_and_others_are_not() {
        let list = [listed(1, 1), listed(1, 2)];
        let known = KnownBeacons::new(&list, None);
        let id = BeaconId { network: 0x1234_5678, major: 1, minor: 2 };
        let one = Advertised::IBeacon(ibeacon(1, 2));
        assert_eq!(known.identify(&one), Some(KnownBeacon { id, place: Some(1) }));
        assert_eq!(known.identify(&Advertised::IBeacon(ibeacon(1, 3))), None);
        let all = KnownBeacons::new(&[], None);
        assert_eq!(all.identify(&one), Some(KnownBeacon { id, place: None }));
    }

    #[test]
    fn an_eddystone_is_known_by_the_last_bytes_of_its_instance() {
        let list = [listed(0x0102, 0x0304)];
        let heard = EddystoneUid { namespace: [0x12; 10], instance: [9, 9, 1, 2, 3, 4], power_0m_dbm: -18 };
        let known = KnownBeacons::new(&list, Some(&KEY)).identify(&Advertised::EddystoneUid(heard));
        let id = BeaconId { network: 0x1212_1212, major: 0x0102, minor: 0x0304 };
        assert_eq!(known, Some(KnownBeacon { id, place: Some(0) }));
    }

    #[test]
    fn a_rotating_identifier_is_revealed_with_the_key_only() {
        let rotating_id = RotatingId::new(&KEY);
        let fresh = Fresh { salt: [1, 2, 3, 4], major: 900, minor: 901 };
        let rotated = Advertised::IBeacon(rotating_id.rotate(&ibeacon(1, 2), fresh));
        let list = [listed(1, 2)];
        let id = BeaconId { network: 0, major: 1, minor: 2 };
        assert_eq!(KnownBeacons::new(&list, Some(&KEY)).identify(&rotated), Some(KnownBeacon { id, place: Some(0) }));
        assert_eq!(KnownBeacons::new(&list, Some(&[8; 16])).identify(&rotated), None);
    }
}
