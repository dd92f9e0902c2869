//! `[network]`, the settings that all nodes of a site share, and `[[simulation.network]]`, those of its neighbours.

use radio::phy::PhyConfig;
use serde::de::{Deserialize, Deserializer, Error as _};
use wire::config::{Mode, Network, Phy, Region, ReplyDelay};

use crate::document::{Hex, KeyLines, SiteError, choice};

/// The network of a simulation whose file has none. Simulated frames stay in the simulation, so no radio regulations
/// apply.
pub const SIMULATED_NETWORK: Network = Network {
    pan: 0xBA12,
    mode: Mode::Native,
    phy: Phy { channel: 5, prf_mhz: 64, rate_kbps: 6810, preamble: 128, code: None },
    turnaround: None,
    region: Some(Region::Unchecked),
    key: None,
};

/// Tags listen to anchors that range among each other once in each superframe, ten times a second.
pub const LISTENING: Mode = Mode::Listening { rounds_chz: 1000 };

/// The ranging modes.
const MODES: [Mode; 4] = [Mode::Native, Mode::DecaRanging { fast: false }, Mode::DecaRanging { fast: true }, LISTENING];

/// The name of a mode in the file.
pub const fn mode_name(mode: Mode) -> &'static str {
    match mode {
        // A tag that blinks has a mode of its own in a native network.
        Mode::Native | Mode::Blink => "native",
        Mode::DecaRanging { fast: false } => "decaranging",
        Mode::DecaRanging { fast: true } => "decaranging-fast",
        Mode::Listening { rounds_chz: _ } => "listening",
    }
}

/// A rate in Hz as in the record, in units of 0.01 Hz. A value outside the range saturates, and the check of the record
/// refuses it.
pub(crate) fn centihertz(hertz: f64) -> u32 {
    (hertz * 100.0).round() as u32
}

/// The text in place of a hidden key.
pub const HIDDEN: &str = "hidden";

/// `[network]`.
#[derive(Clone, Debug, Default, serde::Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct NetworkTable {
    pub(crate) pan: Option<u16>,
    #[serde(deserialize_with = "region")]
    region: Option<Region>,
    #[serde(deserialize_with = "mode")]
    mode: Option<Mode>,
    rounds_hz: Option<f64>,
    channel: Option<u8>,
    prf_mhz: Option<u8>,
    rate_kbps: Option<u16>,
    preamble_symbols: Option<u16>,
    preamble_code: Option<u8>,
    evk1000_mode: Option<u8>,
    answer_us: Option<u16>,
    listen_again_us: Option<u16>,
    transmit_us: Option<u16>,
    #[serde(deserialize_with = "network_key")]
    key: Option<[u8; 16]>,
    #[serde(deserialize_with = "beacon_key")]
    beacon_key: Option<[u8; 16]>,
}

/// The key of the network's frames.
fn network_key<'de, D: Deserializer<'de>>(from: D) -> Result<Option<[u8; 16]>, D::Error> {
    key(from, "key")
}

/// The key of the beacons' rotating identifiers.
fn beacon_key<'de, D: Deserializer<'de>>(from: D) -> Result<Option<[u8; 16]>, D::Error> {
    key(from, "beacon_key")
}

fn key<'de, D: Deserializer<'de>>(from: D, name: &str) -> Result<Option<[u8; 16]>, D::Error> {
    match Hex::from_text(&String::deserialize(from)?) {
        Ok(Hex(key)) => Ok(Some(key)),
        Err(text) if text == HIDDEN => {
            let what = "put the key there, or show the record with --show-keys";
            Err(D::Error::custom(format!("{name} is hidden: {what}")))
        }
        Err(text) => Err(Hex::<16>::refuse(&text)),
    }
}

impl NetworkTable {
    /// The network of a record. What the table leaves out is as in `default`.
    pub(crate) fn network(&self, default: Network, lines: &KeyLines) -> Result<Network, SiteError> {
        let turnaround = match (self.answer_us, self.listen_again_us, self.transmit_us) {
            (None, None, None) => None,
            (Some(answer_us), Some(listen_again_us), Some(transmit_us)) => {
                Some(ReplyDelay { answer_us, listen_again_us, transmit_us })
            }
            (answer, listen_again, _) => {
                let key = match (answer, listen_again) {
                    (Some(_), _) => "answer_us",
                    (None, Some(_)) => "listen_again_us",
                    (None, None) => "transmit_us",
                };
                let what = "answer_us, listen_again_us and transmit_us are pinned together";
                return Err(SiteError::at(lines.of(key), format!("{key} alone: {what}")));
            }
        };
        let mode = match (self.mode.unwrap_or(Mode::Native), self.rounds_hz) {
            (Mode::Listening { .. }, Some(hertz)) => Mode::Listening { rounds_chz: centihertz(hertz) },
            (Mode::Native | Mode::Blink | Mode::DecaRanging { .. }, Some(_)) => {
                let what = "rounds_hz is for mode = \"listening\": in others, anchors begin no rounds";
                return Err(SiteError::at(lines.of("rounds_hz"), what));
            }
            (mode, None) => mode,
        };
        let phy = self.phy(default.phy).map_err(|what| SiteError::at(lines.of("evk1000_mode"), what))?;
        let (pan, region) = (self.pan.unwrap_or(default.pan), self.region.or(default.region));
        let key = own_key(self.key, "key", lines)?;
        Ok(Network { pan, mode, phy, turnaround, region, key })
    }

    fn phy(&self, default: Phy) -> Result<Phy, String> {
        let Self { channel, prf_mhz, rate_kbps, preamble_symbols, preamble_code, .. } = *self;
        match self.evk1000_mode.map(|mode| (mode, PhyConfig::evk1000_mode(mode))) {
            None => Ok(Phy {
                channel: channel.unwrap_or(default.channel),
                prf_mhz: prf_mhz.unwrap_or(default.prf_mhz),
                rate_kbps: rate_kbps.unwrap_or(default.rate_kbps),
                preamble: preamble_symbols.unwrap_or(default.preamble),
                code: preamble_code,
            }),
            Some(_) if [channel, prf_mhz, preamble_code] != [None; 3] || rate_kbps.or(preamble_symbols).is_some() => {
                let keys = "channel, prf_mhz, rate_kbps, preamble_symbols or preamble_code";
                Err(format!("evk1000_mode says it all: no {keys} beside it"))
            }
            Some((_, Some(config))) => Ok(phy(&config)),
            Some((mode, None)) => Err(format!("evk1000_mode is 1 to 8, not {mode}")),
        }
    }

    /// The beacons' key.
    pub(crate) fn beacon_key(&self, lines: &KeyLines) -> Result<Option<[u8; 16]>, SiteError> {
        own_key(self.beacon_key, "beacon_key", lines)
    }
}

/// A key that not everyone knows.
fn own_key(key: Option<[u8; 16]>, name: &str, lines: &KeyLines) -> Result<Option<[u8; 16]>, SiteError> {
    match key.and_then(known_key) {
        Some(why) => {
            let what = format!("{name} is {why}: make one of your own by openssl rand -hex 16");
            Err(SiteError::at(lines.of(name), what))
        }
        None => Ok(key),
    }
}

/// The PHY settings, as a config record has them.
fn phy(config: &PhyConfig) -> Phy {
    Phy {
        channel: config.channel().number(),
        prf_mhz: config.prf().mhz(),
        rate_kbps: config.data_rate().kbps(),
        preamble: config.preamble_length().symbols(),
        code: Some(config.preamble_code()),
    }
}

/// Why everyone knows a key, where everyone does.
fn known_key(key: [u8; 16]) -> Option<&'static str> {
    /// The key of FIPS 197's examples, which this project's examples and tests use.
    const PRINTED: [u8; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];
    match key {
        PRINTED => Some("the one that is printed in the examples"),
        _ if key.iter().all(|byte| *byte == key[0]) => Some("the same byte sixteen times"),
        _ => None,
    }
}

fn region<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Region>, D::Error> {
    choice(from, &Region::ALL, Region::name).map(Some)
}

fn mode<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Mode>, D::Error> {
    choice(from, &MODES, mode_name).map(Some)
}

#[cfg(test)]
mod tests {
    use wire::config::{Calibration, Identity, Record, Role};

    use super::*;

    #[test]
    fn records_have_the_modes_of_the_evk1000() {
        for mode in 1..=8 {
            let config = PhyConfig::evk1000_mode(mode).expect("a mode");
            let table = NetworkTable { evk1000_mode: Some(mode), ..NetworkTable::default() };
            let network = table.network(SIMULATED_NETWORK, &KeyLines::default()).expect("a network");
            let record = Record {
                identity: Identity::default(),
                role: Role::Anchor { position_m: None },
                network,
                calibration: Calibration::default(),
                pins: None,
                anchors: Default::default(),
                beacons: Default::default(),
                beacon_key: None,
            };
            assert_eq!(record.phy(), Ok(config));
        }
    }
}
