//! What the station knows: the rows of its store and the objects of its API. Lengths are metres in the anchors' frame,
//! times are [`Utc`].

use std::collections::BTreeMap;

use positioning_core::geodesy;
use serde::de::{DeserializeOwned, Error as _};
use serde::{Deserialize, Deserializer, Serialize};
use utoipa::ToSchema;

use crate::Utc;
use crate::shapes::{PlanePoint, SpacePoint, WallLine};

/// A position of a tag, with its uncertainty.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct TagPosition {
    /// The site in whose frame the coordinates are.
    pub site: String,
    /// The tag: a short address (`0x1001`), or the name by which a terminal calls itself.
    pub tag: String,
    /// When it was there.
    pub t: Utc,
    /// Along the first axis of the site's frame.
    pub x_m: f64,
    /// Along the second axis.
    pub y_m: f64,
    /// None: only known in the plane.
    pub z_m: Option<f64>,
    /// Standard deviation of x.
    pub sigma_x_m: f64,
    /// Standard deviation of y.
    pub sigma_y_m: f64,
    /// Standard deviation of z. None: only known in the plane.
    pub sigma_z_m: Option<f64>,
    /// Covariance of x and y, m².
    pub cov_xy_m2: f64,
    /// The room that it is in: entered when it was probable, and not yet improbable.
    pub room: Option<String>,
    /// The number of ranges or beacons that were used.
    pub used: u8,
    /// What makes it doubtful beyond its deviations.
    #[serde(default)]
    pub doubt: Option<Doubt>,
}

/// What makes a position doubtful beyond its deviations.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(tag = "flag", rename_all = "snake_case")]
pub enum Doubt {
    /// Ranges contradict each other, and those that agree are too few to confirm it.
    Suspect,
    /// The ranges fit another place too.
    Ambiguous {
        /// The other place, metres. The deviations reach from the position to it.
        #[schema(value_type = SpacePoint)]
        alternative_m: [f64; 3],
    },
}

impl Doubt {
    /// Its name in the API and in a recording's column `flag`.
    #[must_use]
    pub const fn flag(&self) -> &'static str {
        match self {
            Self::Suspect => "suspect",
            Self::Ambiguous { .. } => "ambiguous",
        }
    }

    /// The other place: x, y and z, metres.
    #[must_use]
    pub const fn alternative_m(&self) -> Option<[f64; 3]> {
        match *self {
            Self::Suspect => None,
            Self::Ambiguous { alternative_m } => Some(alternative_m),
        }
    }
}

/// A tag or a terminal.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = Tag)]
pub struct TagStatus {
    /// Its address (`0x1001`), or the name by which a terminal calls itself.
    pub tag: String,
    /// The site that it reports in.
    pub site: String,
    /// Its name in the site's file.
    pub name: Option<String>,
    /// When it reported for the first time.
    pub first_seen: Utc,
    /// When it last reported anything.
    pub last_seen: Utc,
    /// Its last position, however old.
    pub last_position: Option<TagPosition>,
    /// Positions a second over the last ten seconds.
    pub rate_hz: f64,
    /// It has not reported for the time after which tags count as silent.
    pub silent: bool,
    /// Why it has no position, where its last round gave none.
    pub reason: Option<String>,
    /// The zones that it is in.
    pub zones: Vec<String>,
    /// The supply voltage of its radio, V.
    pub supply_v: Option<f64>,
}

/// Data that a tag's user has sent.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct TagData {
    /// The site.
    pub site: String,
    /// The tag.
    pub tag: String,
    /// When an anchor received them.
    pub t: Utc,
    /// Counts the tag's data from 0 to 255 and round again. The same number after a long time may be the same data; a
    /// number that is left out was lost.
    pub number: u8,
    /// The bytes, two hexadecimal digits each.
    pub data: String,
}

/// What a node does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
#[schema(as = Role)]
pub enum NodeRole {
    /// It measures ranges with tags, from a surveyed position.
    Anchor,
    /// It is located.
    Tag,
    /// It sends Bluetooth advertisements from a surveyed position.
    Beacon,
    /// A fixed Bluetooth receiver.
    Receiver,
}

/// The health of a node: how its ranges to all tags were over the last minutes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct HealthFigures {
    /// Ranges a second, from all tags.
    pub rate_hz: f64,
    /// The share of the rounds within its usual reach in which it had a range.
    pub success_rate: Option<f64>,
    /// Mean of measured minus expected range, from the position that was solved in the same round.
    pub residual_mean_m: Option<f64>,
    /// Standard deviation of the same.
    pub residual_sigma_m: Option<f64>,
    /// Mean of the first path's power minus the received power, dB: 0 to -6 with line of sight.
    pub first_path_minus_received_db: Option<f64>,
    /// Mean of the rate of its clock relative to the tags' clocks, parts per million. Anchors differ by their crystals:
    /// IEEE 802.15.4 allows each 20 ppm to both sides.
    pub clock_offset_ppm: Option<f64>,
    /// The mean residual has been so far from zero, for so long, that the anchor was probably moved.
    pub moved: bool,
    /// The supply voltage of its radio, V.
    pub supply_v: Option<f64>,
}

/// Reads a struct that stands among the fields of another one. Where a program reads numbers as texts (`serde_json` with
/// `arbitrary_precision`, which decoders of logs ask for), serde by itself finds maps where it wants numbers.
fn flattened<'de, T: DeserializeOwned, D: Deserializer<'de>>(deserializer: D) -> Result<T, D::Error> {
    let fields = serde_json::Map::deserialize(deserializer)?;
    serde_json::from_value(serde_json::Value::Object(fields)).map_err(D::Error::custom)
}

/// An anchor or a beacon, and its health.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = Node)]
pub struct NodeStatus {
    /// Short address (`0x0101`), or major and minor number of a beacon (`1-7`).
    pub node: String,
    /// The site in whose frame it is.
    pub site: String,
    /// Its name in the site's file.
    pub name: Option<String>,
    /// What it does.
    pub role: NodeRole,
    /// Its surveyed position.
    #[schema(value_type = Option<SpacePoint>)]
    pub position_m: Option<[f64; 3]>,
    /// RSSI at one metre, dBm: of a beacon, or of devices at a receiver. None: that of most beacons.
    pub rssi_1m_dbm: Option<f64>,
    /// The path loss exponent of its signals, 2 in free space. None: that of rooms.
    pub path_loss_exponent: Option<f64>,
    /// When a tag last measured to it.
    pub last_seen: Option<Utc>,
    /// How its ranges are.
    #[serde(flatten, deserialize_with = "flattened")]
    pub health: HealthFigures,
}

/// The health of a node in a minute of the past.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct NodeHealth {
    /// The site in whose frame it is.
    pub site: String,
    /// Short address (`0x0101`), major and minor number of a beacon (`1-7`), or the name of a receiver.
    pub node: String,
    /// The beginning of the minute.
    pub t: Utc,
    /// How its ranges were.
    #[serde(flatten, deserialize_with = "flattened")]
    pub health: HealthFigures,
}

/// What the ranges of the last minutes say against a site, as `baliza check` says it of a recording.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = Finding)]
pub struct SiteFinding {
    /// The site.
    pub site: String,
    /// When it was found first.
    pub since: Utc,
    /// What it is, for programs: `anchors-exchanged`, `anchor-moved`.
    pub code: String,
    /// What it is, with numbers and a remedy, for people.
    pub message: String,
    /// The addresses of the anchors that it is about.
    pub subjects: Vec<String>,
    /// The numbers, by names that end with their units.
    pub evidence: BTreeMap<String, f64>,
}

impl SiteFinding {
    /// Whether another one is of the same mistake: its numbers may differ.
    pub fn is_same(&self, other: &Self) -> bool {
        (&self.site, &self.code, &self.subjects) == (&other.site, &other.code, &other.subjects)
    }
}

/// What someone may do. Each role may do what those before it may.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum UserRole {
    /// See everything.
    View,
    /// Draw zones, survey, position terminals.
    Operate,
    /// Change sites: plans and walls.
    Administer,
}

/// A measurement between a tag and a node.
#[derive(Clone, Debug, PartialEq)]
pub struct NodeMeasurement {
    /// The site.
    pub site: String,
    /// The tag, or the device that a receiver received.
    pub tag: String,
    /// The anchor, the beacon or the receiver.
    pub node: String,
    /// The time of the tag's position for which it was made: the end of its round. Where the end did not arrive, the
    /// time of the round's last measurement.
    pub round: Utc,
    /// When it was made.
    pub t: Utc,
    /// What was measured.
    pub what: MeasuredValue,
}

/// What was measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MeasuredValue {
    /// A range.
    Range(RangeMeasurement),
    /// The RSSI of an advertisement, dBm.
    Rssi(f64),
}

/// A range, and how it was received.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RangeMeasurement {
    /// Metres.
    pub range_m: f64,
    /// The received power, dBm.
    pub rx_power_dbm: Option<f64>,
    /// The power of the first path, dBm.
    pub first_path_power_dbm: Option<f64>,
    /// The rate of the anchor's clock relative to the tag's, parts per million.
    pub clock_offset_ppm: Option<f64>,
}

impl RangeMeasurement {
    /// The longest range, metres.
    const LONGEST_M: f64 = 10_000.0;
    /// Received powers, dBm.
    const POWERS_DBM: std::ops::RangeInclusive<f64> = -200.0..=100.0;
    /// The greatest offset of a clock, ppm: more than telemetry can carry.
    const FASTEST_PPM: f64 = 1000.0;

    /// A range of which nothing else is known.
    pub const fn of(range_m: f64) -> Self {
        Self { range_m, rx_power_dbm: None, first_path_power_dbm: None, clock_offset_ppm: None }
    }

    /// Whether its numbers can have been measured.
    pub fn is_sane(&self) -> bool {
        let Self { range_m, rx_power_dbm, first_path_power_dbm, clock_offset_ppm } = self;
        let powers_dbm = [rx_power_dbm, first_path_power_dbm];
        (0.0..=Self::LONGEST_M).contains(range_m)
            && powers_dbm.into_iter().flatten().all(|power_dbm| Self::POWERS_DBM.contains(power_dbm))
            && clock_offset_ppm.is_none_or(|offset_ppm| offset_ppm.abs() <= Self::FASTEST_PPM)
    }
}

/// A node and its place: a beacon or a receiver that a person has placed, or a node as it was last reported.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct PlacedNode {
    /// The site in whose frame it is.
    pub site: String,
    /// Major and minor number of a beacon (`1-7`), or the name of a receiver.
    pub node: String,
    /// Its name for people.
    pub name: Option<String>,
    /// What it does.
    pub role: NodeRole,
    /// Where it is.
    #[schema(value_type = SpacePoint)]
    pub position_m: [f64; 3],
    /// RSSI at one metre, dBm: of the beacon, or of devices at the receiver. None: that of most beacons.
    pub rssi_1m_dbm: Option<f64>,
    /// The path loss exponent of its signals, 2 in free space. None: that of rooms.
    pub path_loss_exponent: Option<f64>,
}

/// What an outline means.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ZoneKind {
    /// A room: a tag is in at most one.
    Room,
    /// A zone: a tag may be in any number.
    Zone,
}

/// A room or a zone.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Zone {
    /// The site in whose frame it is.
    pub site: String,
    /// Unique in the site.
    pub name: String,
    /// What the outline means.
    pub kind: ZoneKind,
    /// The outline's corners in their order.
    #[schema(value_type = Vec<PlanePoint>)]
    pub corners_m: Vec<[f64; 2]>,
    /// An alarm is raised when a tag enters.
    #[serde(default)]
    pub alarm: bool,
}

/// What happened.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "kebab-case")]
pub enum EventKind {
    /// A tag entered a room or a zone.
    Entered,
    /// A tag left a room or a zone; `dwell_s` says after which time.
    Left,
    /// A tag has not reported for some time.
    Silent,
    /// A silent tag reports again.
    Back,
    /// An anchor was probably moved.
    Moved,
    /// A tag's positions became too uncertain to trust: its standard deviation exceeds the limit.
    Uncertain,
    /// The supply voltage of a tag or an anchor is below the limit.
    LowSupply,
    /// A tag refuses many frames that contradict what it knows of the network: somebody may send forged ones.
    Refusals,
}

/// An event.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = Event)]
pub struct StationEvent {
    /// Grows from event to event.
    pub id: i64,
    /// When it happened.
    pub t: Utc,
    /// The site in which it happened.
    pub site: String,
    /// What happened.
    pub kind: EventKind,
    /// The tag or the anchor.
    pub node: String,
    /// The room or the zone.
    pub zone: Option<String>,
    /// How long the tag was there.
    pub dwell_s: Option<f64>,
    /// It is an alarm.
    pub alarm: bool,
}

/// A site: a frame of coordinates with its plan. Six routes call it a scenario.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = Site)]
pub struct SiteMap {
    /// Unique.
    pub name: String,
    /// Walls, each from one end to the other.
    #[serde(default)]
    #[schema(value_type = Vec<WallLine>)]
    pub walls_m: Vec<[[f64; 2]; 2]>,
    /// The picture behind the map.
    #[serde(default)]
    pub plan: Option<FloorPlan>,
    /// Where its frame is on the earth, where that is known.
    #[serde(default)]
    pub geographic_origin: Option<GeographicOrigin>,
}

impl SiteMap {
    /// A site of which only the name is known.
    pub fn new(name: impl Into<String>) -> Self {
        Self { name: name.into(), walls_m: Vec::new(), plan: None, geographic_origin: None }
    }
}

/// Where the origin of a site's frame is on the earth, and how the frame is turned.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct GeographicOrigin(pub geodesy::GeographicOrigin);

/// A picture of a site, and where it is: a point (u, v) of the picture, in pixels from its upper left corner, is at
/// `origin_m + metres_per_pixel * (cos a * u + sin a * v, sin a * u - cos a * v)` with `a` = `rotation_rad`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = Plan)]
pub struct FloorPlan {
    /// Where the upper left corner is.
    #[schema(value_type = PlanePoint)]
    pub origin_m: [f64; 2],
    /// The scale.
    pub metres_per_pixel: f64,
    /// Anticlockwise.
    #[serde(default)]
    pub rotation_rad: f64,
    /// The width of the picture.
    pub width_px: u32,
    /// The height of the picture.
    pub height_px: u32,
    /// `image/png`, `image/jpeg` or `image/webp`.
    pub media_type: String,
}

/// A survey: points, and what a terminal received at each.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Campaign {
    /// Unique.
    pub name: String,
    /// The site.
    pub scenario: String,
    /// When it was made.
    pub created: Utc,
    /// The points to survey.
    pub points: Vec<CampaignPoint>,
}

/// A point of a campaign.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct CampaignPoint {
    /// Unique in the campaign.
    pub id: String,
    /// Along the first axis of the site's frame.
    pub x_m: f64,
    /// Along the second axis.
    pub y_m: f64,
    /// The height, where it matters.
    #[serde(default)]
    pub z_m: Option<f64>,
    /// The room that it is in.
    #[serde(default)]
    pub room: Option<String>,
    /// The number of its samples.
    #[serde(default)]
    pub samples: u64,
}

/// The RSSI of a beacon's advertisement, as a terminal received it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[schema(as = Sample)]
pub struct SurveySample {
    /// The beacon: major and minor number (`1-7`).
    pub beacon: String,
    /// The RSSI.
    pub rssi_dbm: f64,
    /// Seconds of the terminal's own clock.
    pub t_s: f64,
}
