//! The settings of a node's parts, derived from the record in flash once, at the start.

use ranging::RadioDuration;
use ranging::native::{MakeCode, Network, NetworkKey};
use ranging::phy::DataRate;
use ranging::radio::{Config, FrameFilter, TxPower};
use wire::config::{Invalid, LoadError, Mode, Record, Region, Role, Tag, Value};
use wire::telemetry::RecordError;
use wire::uwb::decaranging::Variant;

use crate::protocol;

/// The time over which a transmitter's mean power is limited, microseconds.
const MEAN_POWER_US: u32 = 1000;

/// The settings of a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// EUI-64.
    pub eui: u64,
    /// Short address.
    pub address: u16,
    /// The configuration of the radio.
    pub radio: Config,
    /// How the node's network ranges.
    pub protocol: ProtocolConfig,
    /// Whether a tag blinks instead of ranging.
    pub blinks: bool,
    /// The network's PAN and frames, and the turnaround where the record fixes one.
    pub network: Network,
    /// The least time from the start of one of this node's frames to the start of the next, by the rules of its region.
    ///
    /// The limits are mean powers over a millisecond (47 CFR 15.521 (d), EN 302 065). Smart power puts the power of a
    /// whole millisecond into one short frame, so two frames in a millisecond would exceed the limit (DW1000 User
    /// Manual 2.12, 7.2.31.2).
    pub frame_spacing: Option<RadioDuration>,
    /// The node's role.
    pub role: Role,
}

/// What a board has for frames with a key.
#[derive(Clone, Copy)]
pub struct Cipher {
    /// A number that nobody can foresee, another one at each start.
    pub seed: u64,
    /// Makes the codes of frames with the board's AES.
    pub make_code: MakeCode,
}

/// How a network ranges.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ProtocolConfig {
    /// Native mode.
    Native,
    /// DecaRanging, in this variant.
    DecaRanging(Variant),
    /// Native mode among anchors. Tags only listen.
    Listening {
        /// From one round of an anchor to its next round.
        period: RadioDuration,
    },
}

impl Settings {
    /// The settings of a record. `chip_eui` is the chip's own EUI-64, for records without one.
    ///
    /// # Errors
    /// The radio cannot do what the record says, or the short address is the broadcast address.
    #[cold]
    pub fn of(record: &Record, chip_eui: u64, cipher: Cipher) -> Result<Self, Invalid> {
        let (eui, address) = record.identity.on(chip_eui);
        if address == 0xFFFF {
            let (field, value) = ("identity.address", Value::Absent);
            return Err(Invalid { within: None, field, value, must: "given: the chip's own is everyone's" });
        }
        let key = record.network.key.map(|key| NetworkKey::new(key, cipher.seed, cipher.make_code));
        let network = Network { key, ..Network::try_from(record)? };
        let protocol = match record.network.mode {
            Mode::Native | Mode::Blink => ProtocolConfig::Native,
            Mode::DecaRanging { fast: false } => ProtocolConfig::DecaRanging(Variant::Standard),
            Mode::DecaRanging { fast: true } => ProtocolConfig::DecaRanging(Variant::Fast),
            Mode::Listening { rounds_chz } => ProtocolConfig::Listening { period: protocol::period(rounds_chz) },
        };
        let calibration = &record.calibration;
        let radio = Config {
            tx_power: calibration
                .tx_power
                .map_or(TxPower::Smart, |register| TxPower::Calibrated { register, smart: true }),
            tx_antenna_delay: calibration.antenna_delay,
            rx_antenna_delay: calibration.antenna_delay,
            crystal_trim: calibration.crystal_trim,
            pan: network.pan,
            short_address: address,
            eui,
            filter: match (protocol, &record.role) {
                // The tag listens to answers that are addressed to others.
                (ProtocolConfig::Listening { .. }, Role::Tag(_)) => FrameFilter::OFF,
                // Blinks, and addresses that a tag learns when it is paired: all frames are received.
                (ProtocolConfig::DecaRanging(_), _) => FrameFilter::OFF,
                (ProtocolConfig::Native | ProtocolConfig::Listening { .. }, _) => FrameFilter::DATA,
            },
            sleeps: matches!(record.role, Role::Tag(Tag { sleep: true, .. })),
            ..Config::new(network.phy)
        };
        let boosts = match radio.tx_power {
            TxPower::Smart => true,
            TxPower::Constant => false,
            TxPower::Calibrated { register: _, smart } => smart,
        };
        let spaced = boosts && network.phy.data_rate() == DataRate::Kbps6810 && is_limited(record.network.region);
        Ok(Self {
            eui,
            address,
            radio,
            protocol,
            blinks: record.network.mode == Mode::Blink,
            network,
            frame_spacing: spaced.then(|| RadioDuration::from_micros(MEAN_POWER_US)),
            role: record.role,
        })
    }
}

/// Whether the region limits the mean power over a millisecond. A region that is not given counts as limited.
fn is_limited(region: Option<Region>) -> bool {
    match region {
        None | Some(Region::Eu | Region::Us | Region::Japan | Region::China) => true,
        Some(Region::Unchecked) => false,
    }
}

/// The kind of fault that telemetry reports for a page without a valid record.
pub fn told(fault: &LoadError) -> RecordError {
    match fault {
        LoadError::Missing => RecordError::Missing,
        LoadError::Version(version) => RecordError::Version(*version),
        LoadError::Corrupt => RecordError::Corrupt,
        LoadError::Invalid(_) => RecordError::Invalid,
    }
}

#[cfg(test)]
mod tests {
    use ranging::native::ReplyDelay;

    use super::*;
    use ranging::PhyConfig;
    use wire::config::{Calibration, Identity, Solver};

    const CIPHER: Cipher = Cipher { seed: 1, make_code: wire::uwb::native::software_code };

    fn record() -> Record {
        Record {
            identity: Identity::default(),
            role: Role::Anchor { position_m: None },
            network: wire::config::Network {
                pan: 0xBA12,
                mode: Mode::Native,
                phy: wire::config::Phy { channel: 5, prf_mhz: 64, rate_kbps: 6810, preamble: 128, code: None },
                turnaround: None,
                region: None,
                key: None,
            },
            calibration: Calibration::default(),
            pins: None,
            anchors: Default::default(),
            beacons: Default::default(),
            beacon_key: None,
        }
    }

    #[test]
    fn a_plain_record_gives_the_defaults_and_the_chips_own_identity() {
        let settings = Settings::of(&record(), 0x1122_3344_5566_7788, CIPHER).unwrap();
        assert_eq!((settings.eui, settings.address), (0x1122_3344_5566_7788, 0x7788));
        assert_eq!(settings.network.phy, PhyConfig::FAST);
        assert_eq!(settings.network.pinned, None);
        assert_eq!((settings.radio.pan, settings.radio.short_address), (0xBA12, 0x7788));
        assert_eq!(settings.radio.filter, FrameFilter::DATA);
        // The radio's driver knows the module's.
        assert_eq!((settings.radio.tx_antenna_delay, settings.radio.rx_antenna_delay), (None, None));
    }

    #[test]
    fn a_pinned_reply_delay_is_the_networks() {
        let mut record = record();
        let delay = wire::config::ReplyDelay { answer_us: 250, listen_again_us: 40, transmit_us: 150 };
        record.network.turnaround = Some(delay);
        let [answer, listen_again, transmit] = [250, 40, 150].map(RadioDuration::from_micros);
        let network = ranging::native::Network::try_from(&record).unwrap();
        assert_eq!((network.pan, network.pinned), (0xBA12, Some(ReplyDelay { answer, listen_again, transmit })));
    }

    #[test]
    fn a_reply_delay_longer_than_sync_frames_can_say_is_said_as_the_longest() {
        let mut record = record();
        let delay = wire::config::ReplyDelay { answer_us: 20_000, listen_again_us: 13_000, transmit_us: 150 };
        record.network.turnaround = Some(delay);
        let layout = ranging::native::Network::try_from(&record).unwrap().first_layout();
        // (16 + 15) · 2⁷ = 3968 µs.
        let longest = RadioDuration::from_micros(3968);
        assert_eq!([layout.answer.duration(), layout.listen_again.duration()], [longest; 2]);
    }

    #[test]
    fn what_the_record_says_counts_more_than_defaults() {
        let mut record = record();
        record.identity = Identity { eui: Some(9), address: Some(0x42) };
        record.network.mode = Mode::DecaRanging { fast: true };
        record.network.phy.code = Some(12);
        record.calibration =
            Calibration { antenna_delay: Some(16_500), crystal_trim: Some(17), tx_power: Some(0x1F1F_1F1F) };
        let settings = Settings::of(&record, 1, CIPHER).unwrap();
        assert_eq!((settings.eui, settings.address), (9, 0x42));
        assert_eq!(settings.protocol, ProtocolConfig::DecaRanging(Variant::Fast));
        assert_eq!(settings.network.phy.preamble_code(), 12);
        assert_eq!((settings.radio.tx_antenna_delay, settings.radio.rx_antenna_delay), (Some(16_500), Some(16_500)));
        assert_eq!(settings.radio.crystal_trim, Some(17));
        assert_eq!(settings.radio.tx_power, TxPower::Calibrated { register: 0x1F1F_1F1F, smart: true });
        assert_eq!(settings.radio.filter, FrameFilter::OFF);
    }

    #[test]
    fn a_pinned_turnaround_is_the_networks() {
        let mut record = record();
        let pinned = wire::config::ReplyDelay { answer_us: 600, listen_again_us: 120, transmit_us: 300 };
        record.network.turnaround = Some(pinned);
        let settings = Settings::of(&record, 1, CIPHER).unwrap();
        let [answer, listen_again, transmit] = [600, 120, 300].map(RadioDuration::from_micros);
        let expected = ReplyDelay { answer, listen_again, transmit };
        assert_eq!(settings.network.pinned, Some(expected));
    }

    #[test]
    fn frames_are_a_millisecond_apart_where_smart_power_boosts_them_and_a_region_has_limits() {
        let spacing = |region, rate_kbps| {
            let mut record = record();
            record.network.region = region;
            record.network.phy = wire::config::Phy { rate_kbps, preamble: 1024, ..record.network.phy };
            Settings::of(&record, 1, CIPHER).unwrap().frame_spacing
        };
        let millisecond = Some(RadioDuration::from_micros(1000));
        assert_eq!(spacing(Some(Region::Eu), 6810), millisecond);
        assert_eq!(spacing(Some(Region::Us), 6810), millisecond);
        assert_eq!(spacing(None, 6810), millisecond);
        assert_eq!(spacing(Some(Region::Unchecked), 6810), None);
        // At lower rates the chip does not boost short frames.
        assert_eq!((spacing(Some(Region::Eu), 850), spacing(Some(Region::Eu), 110)), (None, None));
    }

    #[test]
    fn a_listening_tag_hears_answers_to_others_and_an_anchor_only_its_own() {
        let mut record = record();
        record.network.mode = Mode::Listening { rounds_chz: 1_000 };
        let anchor = Settings::of(&record, 1, CIPHER).unwrap();
        let period = RadioDuration::from_micros(100_000);
        assert_eq!((anchor.protocol, anchor.radio.filter), (ProtocolConfig::Listening { period }, FrameFilter::DATA));
        record.role = Role::Tag(Tag {
            height_m: None,
            rate_chz: None,
            still_rate_chz: None,
            sleep: false,
            anchors_per_round: 8,
            tells: wire::config::PollContent::Nothing,
            scan: None,
            report_ranges: false,
            solver: Solver::Track,
            scheme: None,
            height_sigma_m: 0.0,
            area: None,
        });
        assert_eq!(Settings::of(&record, 1, CIPHER).unwrap().radio.filter, FrameFilter::OFF);
    }

    #[test]
    fn what_cannot_be_done_is_named() {
        assert_eq!(Settings::of(&record(), 0xFFFF, CIPHER).unwrap_err().field, "identity.address");
        let mut record = record();
        record.network.phy.channel = 6;
        assert_eq!(Settings::of(&record, 1, CIPHER).unwrap_err().field, "network.phy.channel");
    }
}
