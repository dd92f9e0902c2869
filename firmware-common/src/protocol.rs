//! A node's protocol, whatever its network's mode is: one type for boards whose mode is in the record.

use ranging::exchange::{Action, Event, Guidance, Protocol};
use ranging::native::{Rate, ReplyDelay};
use ranging::radio::Sensors;
use ranging::{Pace, RadioDuration, RadioInstant, StampModel, decaranging, native};
use wire::uwb::native::{Downlink, UserData};

use crate::settings::{ProtocolConfig, Settings};

/// Rounds in 100 s of a DecaRanging tag whose record gives no rate: the rate of such boards with the shortest frames.
const DECARANGING_CHZ: u32 = 2_000;

/// The protocol of a tag.
#[derive(Clone, Debug)]
#[allow(clippy::large_enum_variant, reason = "there is one in a node")]
pub enum TagProtocol {
    /// Native mode.
    Native(native::Tag),
    /// DecaRanging.
    DecaRanging(decaranging::Tag),
    /// Listening to rounds among anchors.
    Listening(native::TdoaTag),
}

/// The protocol of an anchor.
#[derive(Debug)]
#[cfg_attr(not(target_os = "none"), derive(Clone))]
#[allow(clippy::large_enum_variant, reason = "there is one in a node")]
pub enum AnchorProtocol<'m> {
    /// Native mode.
    Native(native::Anchor<'m>),
    /// DecaRanging.
    DecaRanging(decaranging::Anchor),
}

/// The rate of a record: rounds in 100 s. `None` means as many rounds as there are slots.
pub fn rate(chz: Option<u32>) -> Rate {
    chz.map_or(Rate::Greedy, |chz| Rate::Every(period(chz)))
}

/// From one round to the next, at `chz` rounds in 100 s.
pub(crate) fn period(chz: u32) -> RadioDuration {
    RadioDuration::from_micros(100_000_000 / chz.max(1))
}

impl TagProtocol {
    /// The protocol of a tag with these settings.
    #[cold]
    pub fn new(settings: &Settings, tag: &wire::config::Tag) -> Self {
        let network = settings.network;
        match settings.protocol {
            ProtocolConfig::Native => {
                let mut protocol = Self::Native(native::Tag::new(native::TagConfig {
                    address: settings.address,
                    network,
                    anchors: tag.anchors_per_round,
                    rate: rate(tag.rate_chz),
                    scheme: tag.scheme.map_or(native::Scheme::SingleSided, native::Scheme::from),
                    tells: tag.tells,
                    blinks: settings.blinks,
                }));
                if let Self::Native(machine) = &mut protocol {
                    if tag.sleep {
                        machine.doze();
                    }
                    if let Some(spacing) = settings.frame_spacing {
                        machine.space_frames(spacing);
                    }
                }
                protocol
            }
            ProtocolConfig::DecaRanging(variant) => Self::DecaRanging(decaranging::Tag::new(decaranging::TagConfig {
                eui: settings.eui,
                variant,
                phy: network.phy,
                turnaround: network.pinned.unwrap_or(ReplyDelay::START),
                antenna_delay: RadioDuration::ZERO,
                period: period(tag.rate_chz.unwrap_or(DECARANGING_CHZ)),
            })),
            ProtocolConfig::Listening { .. } => Self::Listening(native::TdoaTag::new(native::TdoaTagConfig {
                network,
                period: tag.rate_chz.map(period),
            })),
        }
    }
}

impl<'m> AnchorProtocol<'m> {
    /// The protocol of an anchor with these settings, at this position in metres.
    #[cold]
    pub fn new(settings: &Settings, position_m: Option<[f32; 3]>, tables: native::AnchorTables<'m>) -> Self {
        let network = settings.network;
        let native = |rounds| {
            let antenna_delay = RadioDuration::ZERO;
            let address = settings.address;
            let config = native::AnchorConfig { address, network, antenna_delay, position_m, rounds };
            Self::Native(native::Anchor::new(config, tables))
        };
        match settings.protocol {
            ProtocolConfig::Native => native(None),
            ProtocolConfig::Listening { period } => native(Some(Rate::Every(period))),
            // An anchor answers in the variant that the tag uses.
            ProtocolConfig::DecaRanging(_) => Self::DecaRanging(decaranging::Anchor::new(decaranging::AnchorConfig {
                address: settings.address,
                eui: settings.eui,
                phy: network.phy,
                turnaround: network.pinned.unwrap_or(ReplyDelay::START),
                antenna_delay: RadioDuration::ZERO,
                init_delay: decaranging::INIT_DELAY,
            })),
        }
    }
}

impl Protocol for TagProtocol {
    fn step(&mut self, now: RadioInstant, event: Event<'_>) -> Action<'_> {
        match self {
            Self::Native(tag) => tag.step(now, event),
            Self::DecaRanging(tag) => tag.step(now, event),
            Self::Listening(tag) => tag.step(now, event),
        }
    }

    fn calibrate(&mut self, stamps: &StampModel) {
        match self {
            Self::Native(tag) => tag.calibrate(stamps),
            Self::DecaRanging(tag) => tag.calibrate(stamps),
            Self::Listening(tag) => tag.calibrate(stamps),
        }
    }

    fn sense(&mut self, sensors: Sensors) {
        match self {
            Self::Native(tag) => tag.sense(sensors),
            Self::DecaRanging(tag) => tag.sense(sensors),
            Self::Listening(tag) => tag.sense(sensors),
        }
    }

    fn pace(&mut self, pace: Pace) {
        match self {
            Self::Native(tag) => tag.pace(pace),
            Self::DecaRanging(tag) => tag.pace(pace),
            Self::Listening(tag) => tag.pace(pace),
        }
    }

    fn guide(&mut self, guidance: Guidance) {
        match self {
            Self::Native(tag) => tag.guide(guidance),
            Self::DecaRanging(tag) => tag.guide(guidance),
            Self::Listening(tag) => tag.guide(guidance),
        }
    }

    fn refused_frames(&self) -> u32 {
        match self {
            Self::Native(tag) => tag.refused_frames(),
            Self::DecaRanging(tag) => tag.refused_frames(),
            Self::Listening(tag) => tag.refused_frames(),
        }
    }

    fn carried(&mut self) -> Option<(bool, u8)> {
        if let Self::Native(tag) = self { tag.carried() } else { None }
    }

    fn send_down(&mut self, message: Downlink) {
        if let Self::Native(tag) = self {
            tag.send_down(message);
        }
    }

    // No other mode has frames for them.
    fn carry(&mut self, data: Option<UserData>) {
        if let Self::Native(tag) = self {
            tag.carry(data);
        }
    }

    fn rouse(&mut self, guidance: Guidance) {
        match self {
            Self::Native(tag) => tag.rouse(guidance),
            Self::DecaRanging(tag) => tag.rouse(guidance),
            Self::Listening(tag) => tag.rouse(guidance),
        }
    }
}

impl Protocol for AnchorProtocol<'_> {
    fn step(&mut self, now: RadioInstant, event: Event<'_>) -> Action<'_> {
        match self {
            Self::Native(anchor) => anchor.step(now, event),
            Self::DecaRanging(anchor) => anchor.step(now, event),
        }
    }

    fn calibrate(&mut self, stamps: &StampModel) {
        match self {
            Self::Native(anchor) => anchor.calibrate(stamps),
            Self::DecaRanging(anchor) => anchor.calibrate(stamps),
        }
    }

    fn pace(&mut self, pace: Pace) {
        match self {
            Self::Native(anchor) => anchor.pace(pace),
            Self::DecaRanging(anchor) => anchor.pace(pace),
        }
    }

    fn send_down(&mut self, message: Downlink) {
        if let Self::Native(anchor) = self {
            anchor.send_down(message);
        }
    }

    // No other mode passes on what it hears.
    fn set_host(&mut self, has_host: bool) {
        if let Self::Native(anchor) = self {
            anchor.set_host(has_host);
        }
    }

    fn refused_frames(&self) -> u32 {
        match self {
            Self::Native(anchor) => anchor.refused_frames(),
            Self::DecaRanging(anchor) => anchor.refused_frames(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_periods() {
        assert_eq!(rate(None), Rate::Greedy);
        // 10 Hz: 0.1 s. 0.1 Hz: 10 s.
        assert_eq!(rate(Some(1_000)), Rate::Every(RadioDuration::from_micros(100_000)));
        assert_eq!(rate(Some(10)), Rate::Every(RadioDuration::from_micros(10_000_000)));
        assert_eq!(rate(Some(0)), Rate::Every(RadioDuration::from_micros(100_000_000)));
    }
}
