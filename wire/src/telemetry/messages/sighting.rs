//! A received advertisement.

use core::fmt;

use postcard::experimental::max_size::MaxSize;
use serde::{Deserialize, Serialize};

use crate::telemetry::{Body, Tone};

/// A received advertisement.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Sighting {
    /// Time of reception, since the node started, microseconds.
    pub t_us: u64,
    /// Which beacon.
    pub beacon: BeaconId,
    /// dBm.
    pub rssi_dbm: i8,
    /// The RSSI at 1 m that the beacon reports, dBm.
    pub measured_power_dbm: i8,
}

/// A beacon, identified by what it advertises.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct BeaconId {
    /// The first four bytes of the UUID, big-endian: enough to distinguish networks.
    pub network: u32,
    /// Major number.
    pub major: u16,
    /// Minor number.
    pub minor: u16,
}

/// A beacon's name in files: network, major and minor number.
impl fmt::Display for BeaconId {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{:08x}-{}-{}", self.network, self.major, self.minor)
    }
}

impl fmt::Display for Sighting {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { beacon, rssi_dbm, measured_power_dbm, .. } = self;
        write!(out, "{beacon} {rssi_dbm} dBm ({measured_power_dbm} dBm at 1 m)")
    }
}

impl Body for Sighting {
    const KIND: &'static str = "sighting";
    const LABEL: &'static str = "ble";
    #[cfg(feature = "host")]
    const TABLE: Option<crate::telemetry::Table> = Some(crate::telemetry::Table {
        name: "rssi",
        rows: "sightings",
        counted: "sightings",
        about: "Advertisements heard",
        columns: &["beacon", "rssi_dbm", "measured_power_dbm"],
    });

    fn tone(&self) -> Tone {
        Tone::Quiet
    }

    #[cfg(feature = "host")]
    fn json(&self) -> serde_json::Value {
        serde_json::json!({
            "beacon": std::string::ToString::to_string(&self.beacon),
            "network": self.beacon.network,
            "major": self.beacon.major,
            "minor": self.beacon.minor,
            "rssi_dbm": self.rssi_dbm,
            "measured_power_dbm": self.measured_power_dbm,
        })
    }

    #[cfg(feature = "host")]
    fn fields(&self) -> std::vec::Vec<std::string::String> {
        use std::string::ToString;
        std::vec![self.beacon.to_string(), self.rssi_dbm.to_string(), self.measured_power_dbm.to_string()]
    }
}
