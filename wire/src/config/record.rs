//! The config record of a node: its identity, its role, its network, its calibration.

use heapless::Vec;
use serde::{Deserialize, Serialize};

/// The greatest number of anchors whose positions a tag may have configured.
pub const MAX_ANCHORS: usize = 24;
/// The greatest number of beacons that a tag may have configured.
pub const MAX_BEACONS: usize = 24;

/// Anchors with configured positions.
pub type Anchors = Vec<Anchor, MAX_ANCHORS>;
/// Beacons that a tag has configured.
pub type Beacons = Vec<Beacon, MAX_BEACONS>;

/// The config record of one node.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Record {
    /// Its identity.
    pub identity: Identity,
    /// Its role.
    pub role: Role,
    /// The network that it is part of.
    pub network: Network,
    /// What was calibrated on this board.
    pub calibration: Calibration,
    /// The wiring of the DW1000, if the board leaves it open (ESP32); `None`: the board's default.
    pub pins: Option<Pins>,
    /// Positions of anchors that do not report theirs, or report a wrong one.
    pub anchors: Anchors,
    /// Beacons that a tag knows.
    pub beacons: Beacons,
    /// The key with which beacons hide their identity from others. With it, the site's own tags find the identity.
    pub beacon_key: Option<[u8; 16]>,
}

/// The identity of a node.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Identity {
    /// EUI-64; `None`: the chip's own.
    pub eui: Option<u64>,
    /// Short address, not 0xFFFF; `None`: the lowest 16 bits of the EUI-64.
    pub address: Option<u16>,
}

/// The role of a node.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Role {
    /// Computes its own position.
    Tag(Tag),
    /// Stays at one position and answers.
    Anchor {
        /// Its position, metres, once surveyed; it is sent on the air.
        position_m: Option<[f32; 3]>,
    },
    /// Advertises.
    Advertiser(Advertiser),
    /// Receives what beacons advertise, and tells a station. It has no UWB chip. An image that does not know this role takes a
    /// record with it for a damaged one.
    Scanner,
}

/// How a tag works.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Tag {
    /// The height at which the tag is carried, metres. If given, only x and y are estimated.
    pub height_m: Option<f32>,
    /// Rounds a second, 0.01 Hz; `None`: as many as there are slots.
    pub rate_chz: Option<u32>,
    /// Rounds a second while it lies still, 0.01 Hz; `None`: the same.
    pub still_rate_chz: Option<u32>,
    /// Whether the UWB chip sleeps between rounds.
    pub sleep: bool,
    /// Anchors a round, 1 to 8.
    pub anchors_per_round: u8,
    /// What its polls tell the anchors.
    pub tells: PollContent,
    /// Bluetooth scan: interval and window; `None`: no scan.
    pub scan: Option<Scan>,
    /// Whether the tag reports each range to the host in addition to the fixes.
    pub report_ranges: bool,
    /// The solver of its positions. From version 2 on: `page` writes it after the other fields.
    #[serde(skip)]
    pub solver: Solver,
    /// How it measures its distances in native mode; `None`: the image's default. From version 2 on.
    #[serde(skip)]
    pub scheme: Option<Scheme>,
    /// Standard deviation of `height_m`, metres; 0: it is exact. From version 3 on, as the area.
    #[serde(skip)]
    pub height_sigma_m: f32,
    /// Where the tag can be; `None`: everywhere.
    #[serde(skip)]
    pub area: Option<TagArea>,
}

/// What a tag's polls tell the anchors, beside whom they ask. An image that does not know the last one takes a record with
/// it for a damaged one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum PollContent {
    /// Nothing.
    #[default]
    Nothing,
    /// The last distances, for anchors that report or show them.
    Distances,
    /// The last position, for anchors that report it to their hosts.
    Position,
    /// The same, and the tag advertises each position by Bluetooth.
    Advertised,
}

impl PollContent {
    /// Whether polls carry the last position.
    pub const fn has_position(self) -> bool {
        matches!(self, Self::Position | Self::Advertised)
    }
}

/// The box in which a tag can be: the outline of a building, floor and ceiling. Infinite coordinates are not known.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TagArea {
    /// The least coordinate of each axis, metres.
    pub least_m: [f32; 3],
    /// The greatest coordinate of each axis, metres.
    pub greatest_m: [f32; 3],
}

impl TagArea {
    /// The least and the greatest coordinate along x, y and z, metres.
    pub fn bounds_m(&self) -> [[f32; 2]; 3] {
        core::array::from_fn(|axis| [self.least_m[axis], self.greatest_m[axis]])
    }
}

/// The solver of a tag's positions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Solver {
    /// A tracking filter, which every range updates.
    #[default]
    Track,
    /// Each round alone: maximum a posteriori with direct and blocked ranges.
    Robust,
    /// Each round alone: linear least squares weighted by the bounding box.
    BWls,
    /// The same, repeated with weights from its own result.
    BWlsR,
    /// Each round alone: the centre of the bounding box.
    BoundingBox,
}

impl Solver {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Track, Self::Robust, Self::BWls, Self::BWlsR, Self::BoundingBox];

    /// Its name in files and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Track => "track",
            Self::Robust => "robust",
            Self::BWls => "b-wls",
            Self::BWlsR => "b-wls-r",
            Self::BoundingBox => "bounding-box",
        }
    }

    /// The one of this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|solver| solver.name() == name)
    }
}

/// How a tag measures its distances to the anchors of a round in native mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Scheme {
    /// A poll and N responses; the clocks' rates are estimated by tracking.
    SingleSided,
    /// A poll, N responses and a final: the clocks' rates cancel out.
    DoubleSided,
}

impl Scheme {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::SingleSided, Self::DoubleSided];

    /// Its name in files and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::SingleSided => "single-sided",
            Self::DoubleSided => "double-sided",
        }
    }

    /// The one of this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|scheme| scheme.name() == name)
    }
}

/// How a tag scans.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Scan {
    /// From one window to the next, milliseconds.
    pub interval_ms: u16,
    /// How long a window is, milliseconds, at most the interval.
    pub window_ms: u16,
}

/// What a beacon advertises.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Advertiser {
    /// Proximity UUID.
    pub uuid: [u8; 16],
    /// Major number.
    pub major: u16,
    /// Minor number.
    pub minor: u16,
    /// RSSI at 1 m, dBm.
    pub measured_power_dbm: i8,
    /// From one advertisement to the next, milliseconds, 20 to 10,240.
    pub interval_ms: u16,
    /// Transmit power, dBm.
    pub tx_power_dbm: i8,
    /// Channels 37, 38, 39 as bits 0, 1, 2.
    pub channels: u8,
    /// A new identifier every `rotate_s` seconds, with `beacon_key`; 0: never.
    pub rotate_s: u16,
}

/// The network that a node is part of; equal in all its nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Network {
    /// PAN identifier.
    pub pan: u16,
    /// How nodes range.
    pub mode: Mode,
    /// The radio configuration of the frames.
    pub phy: Phy,
    /// The reply delay of the slowest board, if it is pinned: the superframe's slots follow from it. `None`: nodes
    /// measure their own.
    #[serde(with = "measured_as_zeros")]
    pub turnaround: Option<ReplyDelay>,
    /// The region whose rules apply to transmissions; `None`: not given. From version 2 on: `page` writes it after the
    /// other fields.
    #[serde(skip)]
    pub region: Option<Region>,
    /// The key of native mode's frames; `None`: they are not authenticated. From version 4 on.
    #[serde(skip)]
    pub key: Option<[u8; 16]>,
}

/// The region whose rules apply to transmissions: `docs/use/regulation.md`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Region {
    /// European Union: Decision (EU) 2019/785.
    Eu,
    /// United States: 47 CFR part 15, subpart F.
    Us,
    /// Japan: ARIB STD-T91.
    Japan,
    /// No rules apply: frames do not leave a shielded room or cable, or there is a licence for them.
    Unchecked,
    /// China: MIIT No. 77 (2024), in force since August 2025.
    China,
}

impl Region {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Eu, Self::Us, Self::Japan, Self::China, Self::Unchecked];

    /// Its name in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Eu => "eu",
            Self::Us => "us",
            Self::Japan => "japan",
            Self::China => "china",
            Self::Unchecked => "none",
        }
    }

    /// The one of this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|region| region.name() == name)
    }
}

/// How nodes range.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Mode {
    /// N + 1 frames a fix in a superframe.
    Native,
    /// As with EVK1000 boards.
    DecaRanging {
        /// The variant with short payloads, of `crate::uwb::decaranging`.
        fast: bool,
    },
    /// In the superframe of native mode, anchors range to each other; any number of tags only listen.
    Listening {
        /// Rounds a second that each anchor begins, 0.01 Hz.
        rounds_chz: u32,
    },
    /// Native mode; but a tag with this record blinks, and a station computes its positions. An image that does not know it
    /// takes a record with it for a damaged one.
    Blink,
}

/// The radio configuration of the frames, in the numbers of the standard.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Phy {
    /// 1, 2, 3, 4, 5 or 7.
    pub channel: u8,
    /// 16 or 64 MHz.
    pub prf_mhz: u8,
    /// 110, 850 or 6810 kbit/s.
    pub rate_kbps: u16,
    /// 64 to 4096 symbols.
    pub preamble: u16,
    /// The preamble code; `None`: the channel's first.
    pub code: Option<u8>,
}

/// `ranging::native::ReplyDelay`, microseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ReplyDelay {
    /// From the end of a received frame to the first pulse of the answer.
    pub answer_us: u16,
    /// From the end of a received frame to the next frame that can be received.
    pub listen_again_us: u16,
    /// From a decision to transmit to the first pulse.
    pub transmit_us: u16,
}

impl ReplyDelay {
    /// The values of a DWM1001 according to the counts of `ranging::native::ReplyDelay::DWM1001`. Version 1 used them
    /// if its file had no values.
    pub const DWM1001: Self = Self { answer_us: 250, listen_again_us: 40, transmit_us: 150 };
}

/// In the bytes, three zeros represent a reply delay that is not pinned. No real delay is zero.
mod measured_as_zeros {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    use super::ReplyDelay;

    const MEASURED: ReplyDelay = ReplyDelay { answer_us: 0, listen_again_us: 0, transmit_us: 0 };

    pub(super) fn serialize<S: Serializer>(pinned: &Option<ReplyDelay>, to: S) -> Result<S::Ok, S::Error> {
        pinned.unwrap_or(MEASURED).serialize(to)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Option<ReplyDelay>, D::Error> {
        let pinned = ReplyDelay::deserialize(from)?;
        Ok((pinned != MEASURED).then_some(pinned))
    }
}

/// What was calibrated on a board.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Calibration {
    /// Antenna delay in each direction, ticks of 15.65 ps; `None`: the default of DWM1000-like boards.
    pub antenna_delay: Option<u16>,
    /// Crystal trim, 0 to 31; `None`: the module maker's, or the middle.
    pub crystal_trim: Option<u8>,
    /// TX_POWER; `None`: the reference design's.
    pub tx_power: Option<u32>,
}

/// The wiring of the DW1000, by numbers of the processor's pins.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[allow(missing_docs, reason = "they are the signals' names")]
pub struct Pins {
    pub sck: u8,
    pub mosi: u8,
    pub miso: u8,
    pub cs: u8,
    pub irq: u8,
    pub reset: u8,
}

/// The position of an anchor.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Anchor {
    /// Short address.
    pub address: u16,
    /// Metres.
    pub position_m: [f32; 3],
}

/// A beacon that a tag knows.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Beacon {
    /// Major number.
    pub major: u16,
    /// Minor number.
    pub minor: u16,
    /// Metres.
    pub position_m: [f32; 3],
    /// RSSI at 1 m, dBm; `None`: the value that the beacon reports.
    pub rssi_1m_dbm: Option<f32>,
    /// Path-loss exponent; `None`: 2.
    pub path_loss_exponent: Option<f32>,
}
