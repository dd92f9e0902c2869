//! Input events: positions, ranges, sightings, nodes. A source makes them, the [`Hub`](crate::Hub) takes them.

use wire::telemetry::Arrival;
use wire::uwb::native::Answer;

use crate::Utc;
use crate::model::{Doubt, NodeRole, PlacedNode, RangeMeasurement};

/// A report of a source.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceReport {
    /// When it was received, or when it is valid.
    pub t: Utc,
    /// The site whose frame its coordinates are in.
    pub site: String,
    /// Its content.
    pub what: ReportKind,
}

/// The content of a report.
#[derive(Clone, Debug, PartialEq)]
pub enum ReportKind {
    /// A node of the site: from its file, or as it says of itself.
    Node {
        /// Short address, or major and minor number of a beacon.
        node: String,
        /// Its name in the site's file.
        name: Option<String>,
        /// What it does.
        role: NodeRole,
        /// Where it is, metres.
        position_m: Option<[f64; 3]>,
    },
    /// The end of a tag's round, with a position.
    Position {
        /// The tag.
        tag: String,
        /// The number of the round, where the tag numbers its rounds.
        round: Option<u16>,
        /// Metres; without z: only known in the plane.
        position_m: [f64; 2],
        /// Metres.
        z_m: Option<f64>,
        /// Standard deviations of x and y, metres, and their covariance, m².
        sigma_m: [f64; 2],
        /// Metres.
        sigma_z_m: Option<f64>,
        /// m².
        cov_xy_m2: f64,
        /// The number of ranges or beacons that were used.
        used: u8,
        /// What it was computed from.
        solved_from: SolvedFrom,
        /// What makes it doubtful.
        doubt: Option<Doubt>,
    },
    /// The end of a tag's round, without a position.
    NoPosition {
        /// The tag.
        tag: String,
        /// The number of the round, where the tag numbers its rounds.
        round: Option<u16>,
        /// Why.
        reason: String,
    },
    /// A range.
    Range {
        /// The tag.
        tag: String,
        /// The number of the tag's round. None: it belongs to the round that ends with the tag's next position.
        round: Option<u16>,
        /// The anchor.
        anchor: String,
        /// What was measured.
        range: RangeMeasurement,
    },
    /// A node's radio has measured its supply voltage.
    Supply {
        /// A tag or an anchor.
        node: String,
        /// Volts.
        supply_v: f64,
    },
    /// A tag's user has sent data.
    Data {
        /// The tag.
        tag: String,
        /// Counts the tag's data, wrapping: data that come again have the same number.
        number: u8,
        /// The bytes, at most 24.
        data: Vec<u8>,
    },
    /// A tag has answered a message.
    Answer {
        /// Short address of the tag.
        tag: u16,
        /// The number of the message.
        number: u8,
        /// The answer.
        answer: Answer,
    },
    /// A tag has counted what it received whole and refused, because it contradicts what the tag knows of the network.
    Refusals {
        /// The tag.
        tag: String,
        /// Frames since its start, wrapping.
        frames: u32,
    },
    /// A tag is carried at this height.
    Height {
        /// The tag.
        tag: String,
        /// Metres.
        height_m: f64,
    },
    /// A frame arrived at an anchor: a tag's blink, or a sync frame, which tells how the clocks of anchors run.
    Arrival {
        /// The short address of the anchor.
        anchor: u16,
        /// As it reported it.
        arrival: Arrival,
    },
    /// A tag received a beacon's advertisement.
    Sighting {
        /// The tag.
        tag: String,
        /// Major and minor number.
        beacon: String,
        /// dBm.
        rssi_dbm: f64,
    },
    /// A fixed receiver at a known place received a device's advertisement.
    ReceiverSighting {
        /// The receiver: a node of the site.
        receiver: String,
        /// The device, as it is to be listed among the tags.
        device: String,
        /// dBm.
        rssi_dbm: f64,
        /// What receivers measure at one metre from the device, where the device or a calibration says so, dBm.
        rssi_1m_dbm: Option<f64>,
    },
    /// A report that comes late. A position is written to the store, and changes nothing of the current state; data of a
    /// tag's user are passed on with their time; others are left.
    Late(Box<ReportKind>),
    /// The path loss of a beacon's or a receiver's signals; what is not said is what it usually is.
    PathLoss {
        /// The node, which has been reported.
        node: String,
        /// RSSI at one metre, dBm: of the beacon, or of devices at this receiver.
        rssi_1m_dbm: Option<f64>,
        /// 2 in free space.
        path_loss_exponent: Option<f64>,
    },
}

/// What a position was computed from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SolvedFrom {
    /// Ranges, or differences of ranges; centimetres to decimetres.
    Ranges,
    /// RSSI values alone; metres.
    Rssi,
}

impl PlacedNode {
    /// The reports of it for the live state.
    pub fn reports(&self, t: Utc) -> [SourceReport; 2] {
        let Self { node, name, role, position_m, rssi_1m_dbm, path_loss_exponent, .. } = self.clone();
        let place = ReportKind::Node { node: node.clone(), name, role, position_m: Some(position_m) };
        let path_loss = ReportKind::PathLoss { node, rssi_1m_dbm, path_loss_exponent };
        [place, path_loss].map(|what| SourceReport { t, site: self.site.clone(), what })
    }
}
