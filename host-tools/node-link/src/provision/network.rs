//! `[network]`: the settings that all nodes of a site share.

use serde::de::{Deserialize, Deserializer, Error as _};
use wire::config::{Mode, Network, Phy, Region, ReplyDelay};

use super::document::{Document, Hex, Lines, choice};
use recording::UserError;

/// The ranging modes. For listening tags, the default rate of an anchor's rounds is one in a superframe, in units of
/// 0.01 Hz.
const MODES: [Mode; 4] = [
    Mode::Native,
    Mode::DecaRanging { fast: false },
    Mode::DecaRanging { fast: true },
    Mode::Listening { rounds_chz: 1000 },
];

/// The name of a mode in the file.
pub(super) const fn name(mode: Mode) -> &'static str {
    match mode {
        Mode::Native => "native",
        Mode::DecaRanging { fast: false } => "decaranging",
        Mode::DecaRanging { fast: true } => "decaranging-fast",
        Mode::Listening { rounds_chz: _ } => "listening",
    }
}

/// A rate in Hz as in the record, in units of 0.01 Hz. A value outside the range saturates, and the check of the record
/// refuses it.
pub(super) fn centihertz(hertz: f32) -> u32 {
    (f64::from(hertz) * 100.0).round() as u32
}

/// The text in place of a hidden key.
pub(super) const HIDDEN: &str = "hidden";

/// `[network]`.
#[derive(Clone, Debug, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct NetworkTable {
    pan: u16,
    #[serde(default, deserialize_with = "region")]
    region: Option<Region>,
    #[serde(default, deserialize_with = "mode")]
    mode: Option<Mode>,
    rounds_hz: Option<f32>,
    #[serde(default = "channel")]
    channel: u8,
    #[serde(default = "prf_mhz")]
    prf_mhz: u8,
    #[serde(default = "rate_kbps")]
    rate_kbps: u16,
    #[serde(default = "preamble_symbols")]
    preamble_symbols: u16,
    preamble_code: Option<u8>,
    answer_us: Option<u16>,
    listen_again_us: Option<u16>,
    transmit_us: Option<u16>,
    beacon_key: Option<BeaconKey>,
}

/// The key of the beacons' rotating identifiers.
#[derive(Clone, Copy, Debug)]
pub(super) struct BeaconKey(pub(super) [u8; 16]);

impl<'de> Deserialize<'de> for BeaconKey {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        match Hex::from_text(&String::deserialize(from)?) {
            Ok(Hex(key)) => Ok(Self(key)),
            Err(text) if text == HIDDEN => {
                Err(D::Error::custom("beacon_key is hidden: put the key there, or show the record with --show-keys"))
            }
            Err(text) => Err(Hex::<16>::refuse(&text)),
        }
    }
}

impl NetworkTable {
    /// The network of a record, and the beacons' key.
    pub(super) fn network(
        &self,
        document: Document<'_>,
        lines: &Lines,
    ) -> Result<(Network, Option<[u8; 16]>), UserError> {
        let phy = Phy {
            channel: self.channel,
            prf_mhz: self.prf_mhz,
            rate_kbps: self.rate_kbps,
            preamble: self.preamble_symbols,
            code: self.preamble_code,
        };
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
                return Err(document.wrong(lines.of(key), format!("{key} alone: {what}")));
            }
        };
        let mode = match (self.mode.unwrap_or(Mode::Native), self.rounds_hz) {
            (Mode::Listening { .. }, Some(hertz)) => Mode::Listening { rounds_chz: centihertz(hertz) },
            (Mode::Native | Mode::DecaRanging { .. }, Some(_)) => {
                let what = "rounds_hz is for mode = \"listening\": in others, anchors begin no rounds";
                return Err(document.wrong(lines.of("rounds_hz"), what));
            }
            (mode, None) => mode,
        };
        if let Some(why) = self.beacon_key.and_then(|BeaconKey(key)| known_key(key)) {
            let what = format!("beacon_key is {why}: make one of your own by openssl rand -hex 16");
            return Err(document.wrong(lines.of("beacon_key"), what));
        }
        let network = Network { pan: self.pan, mode, phy, turnaround, region: self.region };
        Ok((network, self.beacon_key.map(|BeaconKey(key)| key)))
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
    choice(from, &Region::ALL, Region::name)
}

fn mode<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Mode>, D::Error> {
    choice(from, &MODES, name)
}

fn channel() -> u8 {
    5
}

fn prf_mhz() -> u8 {
    64
}

fn rate_kbps() -> u16 {
    6810
}

fn preamble_symbols() -> u16 {
    128
}
