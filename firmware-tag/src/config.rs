//! How a tag makes positions: the locator's settings by its record.

use heapless::Vec;
use positioning_core::engine::{NodeMethod, Solvers};
use positioning_core::locator::{AnchorPosition, Settings, SiteModels};
use positioning_core::nlos::Classifier;
use wire::config::Solver;

use crate::{HEARS_BEACONS, KnownBeacons};

/// How a tag makes positions.
#[derive(Clone)]
pub struct LocatorConfig<'a> {
    /// How its locator works; the beacons beside are added to it.
    pub settings: Settings<'a>,
    /// What that is called.
    pub solver: Solver,
    /// Beacons by whose RSSI it finds itself as well, where it follows a track.
    pub beacons: KnownBeacons<'a>,
}

/// The method by which a tag with this solver solves each round by itself; `None`: it follows a track.
pub const fn method(solver: Solver) -> Option<NodeMethod> {
    match solver {
        Solver::Track => None,
        Solver::Robust => Some(NodeMethod::Robust),
        Solver::BWls => Some(NodeMethod::BWls),
        Solver::BWlsR => Some(NodeMethod::BWlsR),
        Solver::BoundingBox => Some(NodeMethod::BoundingBox),
    }
}

/// The positions of the anchors of a record.
pub fn anchor_positions(record: &wire::config::Record) -> Vec<AnchorPosition, { wire::config::MAX_ANCHORS }> {
    let position =
        |anchor: &wire::config::Anchor| AnchorPosition { address: anchor.address, position_m: anchor.position_m };
    record.anchors.iter().map(position).collect()
}

impl<'a> LocatorConfig<'a> {
    /// That of a tag at this height, metres, or anywhere in space, with these configured anchors.
    ///
    /// A track is followed, so that a round with one range still gives a position; [`by`](Self::by) chooses otherwise.
    pub fn new(height_m: Option<f32>, anchors: &'a [AnchorPosition]) -> Self {
        let settings = Settings { anchors, ..Settings::tag(height_m) };
        Self { settings, solver: Solver::Track, beacons: KnownBeacons::new(&[], None) }
    }

    /// The same, by this solver.
    pub fn by(self, solver: Solver) -> Self {
        let config = match method(solver) {
            None => self,
            Some(method) => self.solving(Solvers::on_node(method)),
        };
        Self { solver, ..config }
    }

    /// The same, that solves each round by itself.
    pub fn solving(self, solvers: Solvers<f32>) -> Self {
        Self { settings: self.settings.solving(solvers), ..self }
    }

    /// That of a tag with this record.
    pub fn of(tag: &wire::config::Tag, record: &'a wire::config::Record, anchors: &'a [AnchorPosition]) -> Self {
        let config = Self::new(tag.height_m, anchors).by(tag.solver);
        if HEARS_BEACONS { config.with_beacons(KnownBeacons::of(record)) } else { config }
    }

    /// The same, where this classifier, if there is one, rates links.
    pub fn with_model(self, model: Option<&'a impl Classifier>) -> Self {
        Self { settings: self.settings.with_classifier(model.map(|model| model as _)), ..self }
    }

    /// The same, with what a survey has learnt of beacons' RSSI.
    pub fn with_site_models(self, site_models: &'a SiteModels<'a>) -> Self {
        Self { settings: Settings { site_models: Some(site_models), ..self.settings }, ..self }
    }

    /// The same, that listens for these beacons.
    pub fn with_beacons(self, beacons: KnownBeacons<'a>) -> Self {
        Self { beacons, ..self }
    }

    /// A tracker with this configuration, for ever.
    #[cfg(test)]
    pub(crate) fn tracker(self) -> crate::Tracker<'a> {
        let Self { settings, solver, beacons } = self;
        crate::Tracker::new(settings, solver, std::boxed::Box::leak(std::boxed::Box::new(beacons)))
    }
}
