//! A scenario's `[[network]]`: the table becomes the network of the config records, or an error.

use ranging::PhyConfig;
use serde::Deserialize;
use wire::config::{Mode, Network, Phy, Role};

use super::values::optional_rate;
use crate::scenario::config::{centihertz, phy, record};
use crate::scenario::{LISTENING, NETWORK};

/// `[[network]]`.
#[derive(Clone, Copy, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct NetworkTable {
    mode: ModeName,
    #[serde(deserialize_with = "optional_rate")]
    rounds_hz: Option<f64>,
    pan: Option<u16>,
    evk1000_mode: Option<u8>,
    channel: Option<u8>,
    prf_mhz: Option<u8>,
    rate_kbps: Option<u16>,
    preamble: Option<u16>,
    code: Option<u8>,
}

#[derive(Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum ModeName {
    #[default]
    Native,
    Decaranging,
    DecarangingFast,
    #[serde(alias = "tdoa")]
    Listening,
}

impl NetworkTable {
    /// The network, or an error that says which values do not fit together.
    pub(super) fn network(&self) -> Result<Network, String> {
        let mode = match (self.mode, self.rounds_hz) {
            (ModeName::Native, None) => Mode::Native,
            (ModeName::Decaranging, None) => Mode::DecaRanging { fast: false },
            (ModeName::DecarangingFast, None) => Mode::DecaRanging { fast: true },
            (ModeName::Listening, None) => LISTENING,
            (ModeName::Listening, Some(hz)) => Mode::Listening { rounds_chz: centihertz(hz) },
            (ModeName::Native | ModeName::Decaranging | ModeName::DecarangingFast, Some(_)) => {
                return Err("rounds_hz is for mode = \"listening\": in others, anchors begin no rounds".to_owned());
            }
        };
        let network = Network { mode, pan: self.pan.unwrap_or(NETWORK.pan), phy: self.phy()?, ..NETWORK };
        let any = record(network, Role::Anchor { position_m: None }, None);
        any.validate().map(|()| network).map_err(|invalid| invalid.to_string())
    }

    fn phy(&self) -> Result<Phy, String> {
        let Self { channel, prf_mhz, rate_kbps, preamble, code, .. } = *self;
        match self.evk1000_mode.map(|mode| (mode, PhyConfig::evk1000_mode(mode))) {
            None => Ok(Phy {
                channel: channel.unwrap_or(NETWORK.phy.channel),
                prf_mhz: prf_mhz.unwrap_or(NETWORK.phy.prf_mhz),
                rate_kbps: rate_kbps.unwrap_or(NETWORK.phy.rate_kbps),
                preamble: preamble.unwrap_or(NETWORK.phy.preamble),
                code,
            }),
            Some(_) if [channel, prf_mhz, code] != [None; 3] || rate_kbps.or(preamble).is_some() => {
                Err("evk1000_mode says it all: no channel, prf_mhz, rate_kbps, preamble or code beside it".to_owned())
            }
            Some((_, Some(config))) => Ok(phy(&config)),
            Some((mode, None)) => Err(format!("evk1000_mode is 1 to 8, not {mode}")),
        }
    }
}
