//! The settings of a locator.

use crate::ble::beacon_monitor::Site;
use crate::ble::signal::{BeaconList, ListedBeacon, WINDOW_US};
use crate::engine::{self, Dimensions, NodeMethod, Solvers};
use crate::nlos::Classifier;
use crate::{Noise, Side};

use super::SiteModels;

/// A track by beacons that is more uncertain than this is given up, metres, over all axes.
const LOST_AMONG_BEACONS_M: f32 = 10.0;
/// The standard deviation of a common offset by the tag's receiver and the body that carries it, relative to the
/// beacons' advertised RSSI, dB.
const RECEIVER_DB: f32 = 5.0;

/// An anchor whose position is configured.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct AnchorPosition {
    /// Its short address.
    pub address: u16,
    /// The position, metres.
    pub position_m: [f32; 3],
}

/// The settings of a locator.
#[derive(Clone)]
pub struct Settings<'a> {
    /// The settings of the engine.
    pub engine: engine::Settings<f32>,
    /// Configured positions; they take precedence over the positions that anchors report.
    pub anchors: &'a [AnchorPosition],
    /// The classifier of links; `None`: their received powers are used.
    pub classifier: Option<&'a dyn Classifier>,
    /// The beacons by whose RSSI the tag is also located, if it follows a track in the plane.
    pub beacons: &'a dyn BeaconList,
    /// Where a tag with beacons can be; `None`: in the box around beacons and anchors.
    pub site: Option<Site<'a>>,
    /// The models from a survey of the beacons' RSSI.
    pub site_models: Option<&'a SiteModels<'a>>,
    /// Standard deviation of the receiver's own offset, dB.
    pub receiver_db: f32,
    /// The time from one position by beacons to the next, microseconds.
    pub window_us: u64,
}

impl<'a> Settings<'a> {
    /// For an engine with these settings, without configured anchors and without beacons.
    pub fn new(engine: engine::Settings<f32>) -> Self {
        const NONE: &[ListedBeacon] = &[];
        Self {
            engine,
            anchors: &[],
            classifier: None,
            beacons: &NONE,
            site: None,
            site_models: None,
            receiver_db: RECEIVER_DB,
            window_us: WINDOW_US,
        }
    }

    /// The settings of a tag that follows a track, at this height, metres, or anywhere in space. With a track, a
    /// round with one range still gives a position. Ranges are weighted by their received powers.
    pub fn tag(height_m: Option<f32>) -> Self {
        let dimensions = match height_m {
            Some(height) => Dimensions::Plane { height },
            None => Dimensions::Space { side: Side::Unknown },
        };
        let solvers = Solvers::on_node(NodeMethod::Robust);
        let track = engine::Settings::track(dimensions).with_noise(Noise::indoors());
        Self::new(engine::Settings { solvers, ..track })
    }

    /// The same settings for a tag that solves each round by itself.
    pub fn solving(self, solvers: Solvers<f32>) -> Self {
        let engine::Settings { dimensions, filter, area, height_sigma, .. } = self.engine;
        let engine = engine::Settings::solve(dimensions, solvers).with_noise(filter.noise);
        let engine = engine::Settings { area, height_sigma, ..engine };
        Self { engine, ..self }
    }

    /// The same settings with this classifier of links, if there is one.
    pub fn with_classifier(self, classifier: Option<&'a dyn Classifier>) -> Self {
        Self { classifier, ..self }
    }

    /// The same settings with these beacons. By beacons alone a track has an uncertainty of metres, and is still a
    /// track.
    pub fn with_beacons(self, beacons: &'a dyn BeaconList) -> Self {
        let lost = if beacons.beacon(0).is_some() { LOST_AMONG_BEACONS_M } else { self.engine.lost };
        Self { engine: engine::Settings { lost, ..self.engine }, beacons, ..self }
    }
}
