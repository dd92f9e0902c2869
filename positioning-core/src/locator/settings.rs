//! How a locator works.

use crate::ble::beacon_monitor::Site;
use crate::ble::signal::{BeaconList, ListedBeacon, WINDOW_US};
use crate::engine::{self, Dimensions, NodeMethod, Solvers};
use crate::nlos::Classifier;
use crate::{Noise, Side};

use super::SiteModels;

/// A track by beacons that has become more uncertain than this is given up, metres, all axes together.
const LOST_AMONG_BEACONS_M: f32 = 10.0;
/// How far a tag's receiver, and the body that carries it, may be off from what beacons say of themselves, all alike, dB.
const RECEIVER_DB: f32 = 5.0;

/// An anchor whose position is configured.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct AnchorPosition {
    /// Its short address.
    pub address: u16,
    /// Metres.
    pub position_m: [f32; 3],
}

/// How a locator works.
#[derive(Clone)]
pub struct Settings<'a> {
    /// How the engine works.
    pub engine: engine::Settings<f32>,
    /// Configured positions; they count more than what anchors say of themselves.
    pub anchors: &'a [AnchorPosition],
    /// What rates links; `None`: their received powers.
    pub classifier: Option<&'a dyn Classifier>,
    /// Beacons by whose RSSI the tag finds itself as well, where it follows a track in the plane.
    pub beacons: &'a dyn BeaconList,
    /// Where a tag by beacons can be; `None`: in the box around beacons and anchors.
    pub site: Option<Site<'a>>,
    /// What a survey has learnt of the beacons' RSSI.
    pub site_models: Option<&'a SiteModels<'a>>,
    /// Standard deviation of the receiver's own offset, dB.
    pub receiver_db: f32,
    /// From one position by beacons to the next, microseconds.
    pub window_us: u64,
}

impl<'a> Settings<'a> {
    /// For an engine that works so, with neither configured anchors nor beacons.
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

    /// Those of a tag at this height, metres, or anywhere in space, that follows a track: so a round with one range still gives a
    /// position. Ranges are weighted by their received powers.
    pub fn tag(height_m: Option<f32>) -> Self {
        let dimensions = match height_m {
            Some(height) => Dimensions::Plane { height },
            None => Dimensions::Space { side: Side::Unknown },
        };
        let solvers = Solvers::on_node(NodeMethod::Robust);
        let track = engine::Settings::track(dimensions).with_noise(Noise::by_powers());
        Self::new(engine::Settings { solvers, ..track })
    }

    /// The same, that solves each round by itself.
    pub fn solving(self, solvers: Solvers<f32>) -> Self {
        let engine::Settings { dimensions, filter, .. } = self.engine;
        let engine = engine::Settings::solve(dimensions, solvers).with_noise(filter.noise);
        Self { engine, ..self }
    }

    /// The same, where this classifier, if there is one, rates links.
    pub fn with_classifier(self, classifier: Option<&'a dyn Classifier>) -> Self {
        let engine = if classifier.is_some() { self.engine.with_noise(Noise::by_model()) } else { self.engine };
        Self { engine, classifier, ..self }
    }

    /// The same, with these beacons. By them alone a track is uncertain by metres, and no less a track.
    pub fn with_beacons(self, beacons: &'a dyn BeaconList) -> Self {
        let lost = if beacons.beacon(0).is_some() { LOST_AMONG_BEACONS_M } else { self.engine.lost };
        Self { engine: engine::Settings { lost, ..self.engine }, beacons, ..self }
    }
}
