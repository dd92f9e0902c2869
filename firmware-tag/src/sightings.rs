//! From iBeacons heard to sightings of beacons that the tag knows: by their numbers, or through their disguise.

use core::convert::Infallible;

use advertising::{Disguise, IBeacon};
use embassy_sync::blocking_mutex::raw::RawMutex;
use node_record::{Beacon, Record};
use telemetry::{BeaconId, Sighting};

use crate::{Handover, Sink};

/// The beacons that a tag knows.
pub struct KnownBeacons<'r> {
    beacons: &'r [Beacon],
    disguise: Option<Disguise>,
}

impl<'r> KnownBeacons<'r> {
    /// Those of a record.
    pub fn of(record: &'r Record) -> Self {
        Self { beacons: &record.beacons, disguise: record.beacon_key.as_ref().map(Disguise::new) }
    }

    /// Who it is, if it is one of ours. With an empty list every beacon is.
    fn identify(&self, heard: &IBeacon) -> Option<BeaconId> {
        let revealed = self.disguise.as_ref().and_then(|disguise| disguise.see_through(heard));
        let (major, minor) = revealed.map_or((heard.major, heard.minor), |true_one| (true_one.major, true_one.minor));
        let known = self.beacons.iter().any(|beacon| (beacon.major, beacon.minor) == (major, minor));
        let [a, b, c, d, ..] = heard.uuid;
        // The UUID of a disguise says nothing.
        let network = if revealed.is_some() { 0 } else { u32::from_be_bytes([a, b, c, d]) };
        (known || self.beacons.is_empty()).then_some(BeaconId { network, major, minor })
    }
}

/// Tells the sightings of known beacons, for ever; runs in the engine's task.
pub async fn tell_sightings<M: RawMutex>(
    handover: &Handover<M>,
    known: KnownBeacons<'_>,
    sink: &impl Sink,
) -> Infallible {
    loop {
        let heard = handover.next_sighting().await;
        if let Some(beacon) = known.identify(&heard.beacon) {
            let (rssi, measured_power) = (heard.rssi_dbm, heard.beacon.measured_power_dbm);
            sink.sighting(Sighting { t_us: heard.t_us, beacon, rssi, measured_power });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use advertising::Fresh;

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
        let known = KnownBeacons { beacons: &[listed(1, 2)], disguise: None };
        let id = BeaconId { network: 0x1234_5678, major: 1, minor: 2 };
        assert_eq!(known.identify(&ibeacon(1, 2)), Some(id));
        assert_eq!(known.identify(&ibeacon(1, 3)), None);
        let all = KnownBeacons { beacons: &[], disguise: None };
        assert_eq!(all.identify(&ibeacon(1, 3)), Some(BeaconId { minor: 3, ..id }));
    }

    #[test]
    fn a_disguise_is_seen_through_with_the_key_only() {
        let disguise = Disguise::new(&KEY);
        let disguised = disguise.put_on(&ibeacon(1, 2), Fresh { salt: [1, 2, 3, 4], major: 900, minor: 901 });
        let known = KnownBeacons { beacons: &[listed(1, 2)], disguise: Some(Disguise::new(&KEY)) };
        assert_eq!(known.identify(&disguised), Some(BeaconId { network: 0, major: 1, minor: 2 }));
        let blind = KnownBeacons { beacons: &[listed(1, 2)], disguise: Some(Disguise::new(&[8; 16])) };
        assert_eq!(blind.identify(&disguised), None);
    }
}
