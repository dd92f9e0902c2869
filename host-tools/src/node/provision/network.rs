//! `[network]`: what all nodes of a site have in common.

use std::collections::HashMap;

use wire::config::{Mode, Network, Phy, Region, ReplyDelay};

use super::document::{Section, nearest};
use crate::UserError;

/// The keys of `[network]`.
const KEYS: [&str; 13] = [
    "pan",
    "region",
    "mode",
    "rounds_hz",
    "channel",
    "prf_mhz",
    "rate_kbps",
    "preamble_symbols",
    "preamble_code",
    "answer_us",
    "listen_again_us",
    "transmit_us",
    "beacon_key",
];

/// Those of them that pin the turnaround.
const TURNAROUND_KEYS: [&str; 3] = ["answer_us", "listen_again_us", "transmit_us"];

/// How nodes range, as the file says it.
const MODES: [&str; 4] = ["native", "decaranging", "decaranging-fast", "listening"];
/// Rounds a second of an anchor that tags listen to, where the file says nothing, 0.01 Hz: one a superframe.
const ROUNDS_CHZ: u32 = 1000;

/// A mode as the file says it.
pub(super) const fn name(mode: Mode) -> &'static str {
    match mode {
        Mode::Native => "native",
        Mode::DecaRanging { fast: false } => "decaranging",
        Mode::DecaRanging { fast: true } => "decaranging-fast",
        Mode::Listening { rounds_chz: _ } => "listening",
    }
}

/// A rate in Hz as the record has it, 0.01 Hz. What does not fit saturates, and is refused as a rate.
pub(super) fn centihertz(hertz: f32) -> u32 {
    (f64::from(hertz) * 100.0).round() as u32
}

/// What stands in the place of a key that is not shown.
pub(super) const HIDDEN: &str = "hidden";

/// The lines that fields of a record come from, by the record's names.
pub(super) type Lines = HashMap<String, u64>;

/// A site's network.
#[derive(Clone, Debug)]
pub(super) struct Shared {
    pub(super) network: Network,
    pub(super) beacon_key: Option<[u8; 16]>,
    pub(super) lines: Lines,
}

impl Shared {
    pub(super) fn read(section: &Section<'_>) -> Result<Self, UserError> {
        section.with_keys(&KEYS, |_| None)?;
        let mut lines = Lines::new();
        let mut number = |key: &'static str, field: &str, default: u16, most: u16| {
            let given = section.optional(key);
            lines.insert(field.to_owned(), given.map_or(section.line, |given| given.line));
            let Some(given) = given else { return Ok(default) };
            let value = given.integer::<u16>("a whole number, 0 to 65535")?;
            if value > most { Err(given.refuse(&format!("{most} at most"))) } else { Ok(value) }
        };
        let byte = u16::from(u8::MAX);
        let phy = Phy {
            channel: number("channel", "network.phy.channel", 5, byte)? as u8,
            prf_mhz: number("prf_mhz", "network.phy.prf_mhz", 64, byte)? as u8,
            rate_kbps: number("rate_kbps", "network.phy.rate_kbps", 6810, u16::MAX)?,
            preamble: number("preamble_symbols", "network.phy.preamble", 128, u16::MAX)?,
            code: match section.optional("preamble_code") {
                Some(_) => Some(number("preamble_code", "network.phy.code", 0, byte)? as u8),
                None => None,
            },
        };
        let turnaround = match TURNAROUND_KEYS.map(|key| section.optional(key)) {
            [None, None, None] => None,
            [Some(_), Some(_), Some(_)] => Some(ReplyDelay {
                answer_us: number("answer_us", "network.turnaround.answer_us", 0, u16::MAX)?,
                listen_again_us: number("listen_again_us", "network.turnaround.listen_again_us", 0, u16::MAX)?,
                transmit_us: number("transmit_us", "network.turnaround.transmit_us", 0, u16::MAX)?,
            }),
            [Some(given), ..] | [None, Some(given), _] | [None, None, Some(given)] => {
                let [answer, listen_again, transmit] = TURNAROUND_KEYS;
                let what = format!("{} alone: {answer}, {listen_again} and {transmit} are pinned together", given.key);
                return Err(given.wrong(what));
            }
        };
        section.required("pan")?;
        let pan = number("pan", "network.pan", 0, u16::MAX)?;
        let mode = mode(section)?;
        if let Some(given) = section.optional("rounds_hz") {
            lines.insert("network.rounds_hz".to_owned(), given.line);
        }
        let region = section.optional("region").map(|given| given.choice(&Region::ALL, Region::name)).transpose()?;
        let network = Network { pan, mode, phy, turnaround, region };
        let beacon_key = beacon_key(section)?;
        Ok(Self { network, beacon_key, lines })
    }
}

fn mode(section: &Section<'_>) -> Result<Mode, UserError> {
    let rounds = section.optional("rounds_hz");
    let must = format!("\"{}\"", MODES.join("\", \""));
    let mode = match section.optional("mode") {
        None => Mode::Native,
        Some(given) => match given.text(&must)? {
            "native" => Mode::Native,
            "decaranging" => Mode::DecaRanging { fast: false },
            "decaranging-fast" => Mode::DecaRanging { fast: true },
            "listening" => Mode::Listening {
                rounds_chz: rounds.map(|given| given.real().map(centihertz)).transpose()?.unwrap_or(ROUNDS_CHZ),
            },
            other => {
                return Err(match nearest(other, &MODES) {
                    Some(near) => given.refuse(&format!("{must}; {near} is near it")),
                    None => given.refuse(&must),
                });
            }
        },
    };
    match (mode, rounds) {
        (Mode::Listening { .. }, _) | (_, None) => Ok(mode),
        (Mode::Native | Mode::DecaRanging { .. }, Some(given)) => {
            Err(given.wrong("rounds_hz is for mode = \"listening\": in others, anchors begin no rounds"))
        }
    }
}

fn beacon_key(section: &Section<'_>) -> Result<Option<[u8; 16]>, UserError> {
    let Some(given) = section.optional("beacon_key") else { return Ok(None) };
    if given.text("32 hexadecimal digits in quotation marks")? == HIDDEN {
        return Err(given.wrong("beacon_key is hidden: put the key there, or show the record with --show-keys"));
    }
    given.bytes().map(Some)
}
