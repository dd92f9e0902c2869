//! The tables `[bluetooth]` and `[[beacon]]`.

use serde::Deserialize;
use wire::config::{Advertiser, Scan};

use super::values::{decibels, level, not_negative, optional_place, place, positive, probability};
use crate::bluetooth::{BluetoothConfig, Medium};
use crate::scenario::{Beacon, BluetoothSettings, Format, SiteModelFiles, beacon};

/// The UUID of a scenario's beacons. Eddystone uses its first ten bytes as namespace.
const UUID: [u8; 16] = *b"baliza scenario\0";
/// Channels 37, 38, 39.
const CHANNELS: std::ops::RangeInclusive<u8> = 37..=39;

#[derive(Clone, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct BluetoothTable {
    #[serde(deserialize_with = "positive")]
    path_loss_exponent: f64,
    #[serde(deserialize_with = "not_negative")]
    shadowing_db: f64,
    #[serde(deserialize_with = "positive")]
    shadowing_m: f64,
    #[serde(deserialize_with = "not_negative")]
    fading_db: f64,
    #[serde(deserialize_with = "level")]
    sensitivity_dbm: f64,
    #[serde(deserialize_with = "decibels")]
    receiver_offset_db: f64,
    #[serde(deserialize_with = "probability")]
    loss: f64,
    #[serde(deserialize_with = "probability")]
    unknown_rssi: f64,
    unknown_rssi_dbm: i8,
    scan_interval_ms: u16,
    scan_window_ms: u16,
    map: Option<String>,
    rooms: Option<String>,
}

impl Default for BluetoothTable {
    fn default() -> Self {
        let BluetoothSettings { air, scan, files: SiteModelFiles { map, rooms }, site_models: _ } =
            BluetoothSettings::default();
        Self {
            path_loss_exponent: air.medium.exponent,
            shadowing_db: air.medium.shadowing_db,
            shadowing_m: air.medium.shadowing_m,
            fading_db: air.medium.fading_db,
            sensitivity_dbm: air.sensitivity_dbm,
            receiver_offset_db: air.receiver_offset_db,
            loss: air.loss,
            unknown_rssi: air.unknown_rssi,
            unknown_rssi_dbm: air.unknown_rssi_dbm,
            scan_interval_ms: scan.interval_ms,
            scan_window_ms: scan.window_ms,
            map,
            rooms,
        }
    }
}

impl BluetoothTable {
    pub(super) fn settings(&self) -> BluetoothSettings {
        BluetoothSettings {
            air: BluetoothConfig {
                medium: Medium {
                    exponent: self.path_loss_exponent,
                    shadowing_db: self.shadowing_db,
                    shadowing_m: self.shadowing_m,
                    fading_db: self.fading_db,
                },
                loss: self.loss,
                sensitivity_dbm: self.sensitivity_dbm,
                receiver_offset_db: self.receiver_offset_db,
                unknown_rssi: self.unknown_rssi,
                unknown_rssi_dbm: self.unknown_rssi_dbm,
            },
            scan: Scan { interval_ms: self.scan_interval_ms, window_ms: self.scan_window_ms },
            files: SiteModelFiles { map: self.map.clone(), rooms: self.rooms.clone() },
            site_models: None,
        }
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct BeaconTable {
    pub(super) address: Option<u16>,
    #[serde(deserialize_with = "place")]
    at: [f64; 3],
    #[serde(default = "major")]
    major: u16,
    minor: Option<u16>,
    #[serde(default = "rssi_1m", deserialize_with = "level")]
    rssi_1m_dbm: f64,
    measured_power_dbm: Option<i8>,
    #[serde(default = "interval")]
    interval_ms: u16,
    #[serde(default = "all_channels")]
    channels: Vec<u8>,
    #[serde(default = "ibeacon")]
    format: FormatName,
    #[serde(default = "yes")]
    listed: bool,
    #[serde(default, deserialize_with = "optional_place")]
    listed_at: Option<[f64; 3]>,
    listed_rssi_1m_dbm: Option<f32>,
    listed_path_loss_exponent: Option<f32>,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum FormatName {
    Ibeacon,
    EddystoneUid,
    Malformed,
}

fn major() -> u16 {
    1
}

fn rssi_1m() -> f64 {
    -59.0
}

fn interval() -> u16 {
    100
}

fn all_channels() -> Vec<u8> {
    CHANNELS.collect()
}

fn ibeacon() -> FormatName {
    FormatName::Ibeacon
}

fn yes() -> bool {
    true
}

impl BeaconTable {
    /// The beacon with this address. `number` is its index in the file, from 1. The tags' list has what a calibration
    /// would find, unless the file says something else.
    pub(super) fn beacon(&self, address: u16, number: u16, air: &BluetoothConfig) -> Result<Beacon, String> {
        let mut channels = 0;
        for channel in &self.channels {
            if !CHANNELS.contains(channel) {
                return Err(format!("the advertising channels are 37, 38 and 39, not {channel}"));
            }
            channels |= 1 << (channel - CHANNELS.start());
        }
        let (major, minor) = (self.major, self.minor.unwrap_or(number));
        let advertiser = Advertiser {
            uuid: UUID,
            major,
            minor,
            measured_power_dbm: self.measured_power_dbm.unwrap_or(self.rssi_1m_dbm.round() as i8),
            interval_ms: self.interval_ms,
            tx_power_dbm: 0,
            channels,
            rotate_s: 0,
        };
        let listed = wire::config::Beacon {
            major,
            minor,
            position_m: self.listed_at.unwrap_or(self.at).map(|metres| metres as f32),
            rssi_1m_dbm: Some(self.listed_rssi_1m_dbm.unwrap_or(self.rssi_1m_dbm as f32)),
            path_loss_exponent: Some(self.listed_path_loss_exponent.unwrap_or(air.medium.exponent as f32)),
        };
        let beacon = Beacon {
            address,
            at: self.at,
            rssi_1m_dbm: self.rssi_1m_dbm,
            format: match self.format {
                FormatName::Ibeacon => Format::IBeacon,
                FormatName::EddystoneUid => Format::EddystoneUid,
                FormatName::Malformed => Format::Malformed,
            },
            advertiser,
            listed: self.listed.then_some(listed),
        };
        beacon::check(&beacon)?;
        Ok(beacon)
    }
}

/// Checks that tags can have these beacons in a config record's list.
pub(super) fn check_list(beacons: &[Beacon]) -> Result<(), (usize, String)> {
    let mut listed: Vec<wire::config::Beacon> = Vec::new();
    for (place, beacon) in beacons.iter().enumerate() {
        let Some(new) = beacon.listed else { continue };
        if listed.iter().any(|other| (other.major, other.minor) == (new.major, new.minor)) {
            let twice =
                format!("tags are told of two beacons {}-{}: listed = false for one of them", new.major, new.minor);
            return Err((place, twice));
        }
        if listed.len() == wire::config::MAX_BEACONS {
            return Err((place, format!("tags are told of at most {} beacons: listed = false", listed.len())));
        }
        listed.push(new);
    }
    Ok(())
}
