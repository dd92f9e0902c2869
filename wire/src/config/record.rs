//! What a node is told: who it is, what it does, its network, its calibration.

use heapless::Vec;
use serde::{Deserialize, Serialize};

/// Most anchors that a tag may be told the places of.
pub const MAX_ANCHORS: usize = 24;
/// Most beacons that a tag may be told of.
pub const MAX_BEACONS: usize = 24;

/// Anchors that a tag is told the places of.
pub type Anchors = Vec<Anchor, MAX_ANCHORS>;
/// Beacons that a tag is told of.
pub type Beacons = Vec<Beacon, MAX_BEACONS>;

/// The record of one node.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Record {
    /// Who it is.
    pub identity: Identity,
    /// What it does.
    pub role: Role,
    /// The network that it is part of.
    pub network: Network,
    /// What was calibrated on this board.
    pub calibration: Calibration,
    /// Where the DW1000 is wired, where the board leaves that open (ESP32); else the board's default.
    pub pins: Option<Pins>,
    /// Where anchors stand that do not tell it themselves, or not rightly.
    pub anchors: Anchors,
    /// Beacons that a tag knows.
    pub beacons: Beacons,
    /// By which beacons hide their identity from others, and our tags find it.
    pub beacon_key: Option<[u8; 16]>,
}

/// Who a node is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Identity {
    /// EUI-64; else the chip's own.
    pub eui: Option<u64>,
    /// Short address, not 0xFFFF; else the lowest 16 bits of the EUI-64.
    pub address: Option<u16>,
}

/// What a node does.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Role {
    /// Positions itself.
    Tag(Tag),
    /// Stands and answers.
    Anchor {
        /// Where it stands, metres, once surveyed: told on the air.
        position_m: Option<[f32; 3]>,
    },
    /// Advertises.
    Advertiser(Advertiser),
}

/// How a tag works.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Tag {
    /// The height at which it is carried, metres: only x and y are found then.
    pub height_m: Option<f32>,
    /// Rounds a second, 0.01 Hz; `None`: as many as there are slots for.
    pub rate_chz: Option<u32>,
    /// Rounds a second while it lies still, 0.01 Hz; `None`: the same.
    pub still_rate_chz: Option<u32>,
    /// Whether the UWB chip sleeps between rounds.
    pub sleep: bool,
    /// Anchors a round, 1 to 8.
    pub anchors_per_round: u8,
    /// Whether anchors are told their distances.
    pub tell_distances: bool,
    /// Bluetooth scan: interval and window, 0.625 ms; `None`: no scan.
    pub scan: Option<Scan>,
    /// Whether each range is told to the host beside the fixes.
    pub report_ranges: bool,
    /// What makes its positions. Of version 2: `page` writes it behind the others.
    #[serde(skip)]
    pub solver: Solver,
    /// How it measures its distances in native mode; `None`: as the image does by itself. Of version 2.
    #[serde(skip)]
    pub scheme: Option<Scheme>,
}

/// What makes a tag's positions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Solver {
    /// A track, which every range changes.
    #[default]
    Track,
    /// Each round by itself: maximum a posteriori under direct and blocked ranges.
    Robust,
    /// Each round by itself: linear least squares weighted by the bounding box.
    BWls,
    /// The same, repeated with the weights of its own answer.
    BWlsR,
    /// Each round by itself: the centre of the bounding box.
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
    /// A poll and N responses; the clocks' rates are known by tracking.
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
    /// A new identifier every so many seconds, with `beacon_key`; 0: never.
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
    /// How frames are put on the air.
    pub phy: Phy,
    /// The quickness of the slowest board, from which the superframe's slots follow, where it is pinned; `None`: nodes measure
    /// their own.
    #[serde(with = "measured_as_zeros")]
    pub turnaround: Option<ReplyDelay>,
    /// By whose rules nodes transmit; `None`: nobody said. Of version 2: `page` writes it behind the others.
    #[serde(skip)]
    pub region: Option<Region>,
}

/// By whose rules nodes transmit: `docs/regulation.md`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Region {
    /// European Union: Decision (EU) 2019/785.
    Eu,
    /// United States: 47 CFR part 15, subpart F.
    Us,
    /// Japan: ARIB STD-T91.
    Japan,
    /// Nobody's: frames leave no shielded room or cable, or there is a licence for them.
    Unchecked,
}

impl Region {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Eu, Self::Us, Self::Japan, Self::Unchecked];

    /// Its name in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Eu => "eu",
            Self::Us => "us",
            Self::Japan => "japan",
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
    /// As EVK1000 boards do.
    DecaRanging {
        /// The variant with short payloads, of `crate::uwb::decaranging`.
        fast: bool,
    },
    /// In the superframe of native mode, anchors ask each other; tags only listen, any number of them.
    Listening {
        /// Rounds a second that each anchor begins, 0.01 Hz.
        rounds_chz: u32,
    },
}

/// How frames are put on the air, in the numbers of the standard.
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
    /// From the end of a frame heard to the first pulse of the answer.
    pub answer_us: u16,
    /// From the end of a frame heard to the next that can be heard.
    pub listen_again_us: u16,
    /// From a decision to transmit to the first pulse.
    pub transmit_us: u16,
}

impl ReplyDelay {
    /// A DWM1001's by the counts of `ranging::native::ReplyDelay::DWM1001`: what version 1 had where its file said nothing.
    pub const DWM1001: Self = Self { answer_us: 250, listen_again_us: 40, transmit_us: 150 };
}

/// In the bytes, a turnaround that is not pinned is three zeros, which are none that can be.
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

/// Where the DW1000 is wired, numbers of the processor's pins.
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

/// Where an anchor stands.
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
    /// RSSI at 1 m, dBm; `None`: what the beacon says.
    pub rssi_1m_dbm: Option<f32>,
    /// Path-loss exponent; `None`: 2.
    pub path_loss_exponent: Option<f32>,
}
