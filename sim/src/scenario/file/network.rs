//! A scenario's `[[network]]`: mode and radio configuration by their numbers in, a [`Network`] or what is wrong out.

use ranging::phy::{Channel, DataRate, PreambleLength, Prf};
use ranging::{PhyConfig, RadioDuration};
use serde::Deserialize;
use wire::uwb::decaranging::Variant;

use super::values::optional_rate;
use crate::scenario::{Mode, Network};

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
    Listening,
}

impl NetworkTable {
    /// The network that is meant, or what does not go together.
    pub(super) fn network(&self) -> Result<Network, String> {
        let mode = match self.mode {
            ModeName::Native => Mode::Native,
            ModeName::Decaranging => Mode::DecaRanging(Variant::Standard),
            ModeName::DecarangingFast => Mode::DecaRanging(Variant::Fast),
            ModeName::Listening => match self.rounds_hz {
                Some(hz) => Mode::Listening { period: RadioDuration::from_micros((1e6 / hz) as u32) },
                None => Mode::LISTENING,
            },
        };
        match (mode, self.rounds_hz) {
            (Mode::Native | Mode::DecaRanging(_), Some(_)) => {
                return Err("rounds_hz is for mode = \"listening\": in others, anchors begin no rounds".to_owned());
            }
            (Mode::Listening { .. }, _) | (_, None) => {}
        }
        Ok(Network { mode, pan: self.pan.unwrap_or(Network::default().pan), phy: self.phy()?, ..Network::default() })
    }

    fn phy(&self) -> Result<PhyConfig, String> {
        if let Some(mode) = self.evk1000_mode {
            return match PhyConfig::evk1000_mode(mode) {
                Some(_)
                    if [self.channel, self.prf_mhz, self.code] != [None; 3]
                        || self.rate_kbps.or(self.preamble).is_some() =>
                {
                    Err("evk1000_mode says it all: no channel, prf_mhz, rate_kbps, preamble or code beside it"
                        .to_owned())
                }
                Some(phy) => Ok(phy),
                None => Err(format!("evk1000_mode is 1 to 8, not {mode}")),
            };
        }
        let (channel, mhz) = (self.channel.unwrap_or(5), self.prf_mhz.unwrap_or(64));
        let (kbps, symbols) = (self.rate_kbps.unwrap_or(6810), self.preamble.unwrap_or(128));
        let channel =
            Channel::from_number(channel).ok_or_else(|| format!("channel is 1, 2, 3, 4, 5 or 7, not {channel}"))?;
        let prf = Prf::from_mhz(mhz).ok_or_else(|| format!("prf_mhz is 16 or 64, not {mhz}"))?;
        let rate = DataRate::from_kbps(kbps).ok_or_else(|| format!("rate_kbps is 110, 850 or 6810, not {kbps}"))?;
        let preamble = PreambleLength::from_symbols(symbols)
            .ok_or_else(|| format!("preamble is 64, 128, 256, 512, 1024, 1536, 2048 or 4096, not {symbols}"))?;
        let phy = PhyConfig::new(channel, prf, rate, preamble)
            .map_err(|_| format!("at 110 kbit/s the preamble has at least 1024 symbols, not {symbols}"))?;
        match self.code {
            None => Ok(phy),
            Some(code) => phy.with_preamble_code(code).map_err(|_| {
                format!(
                    "the preamble codes of this channel and pulse rate are {:?}, not {code}",
                    channel.preamble_codes(prf)
                )
            }),
        }
    }
}
