//! The configuration of a tag's locator, by its record.

use heapless::Vec;
use positioning_core::Area;
use positioning_core::engine::{self, NodeMethod, Solvers};
use positioning_core::locator::{AnchorPosition, Settings, SiteModels};
use positioning_core::nlos::Classifier;
use wire::config::Solver;

use crate::KnownBeacons;

/// How a tag computes positions.
#[derive(Clone)]
pub struct LocatorConfig<'a> {
    /// The settings of its locator. The beacons below are added to them.
    pub settings: Settings<'a>,
    /// The solver that the settings describe.
    pub solver: Solver,
    /// Beacons whose RSSI also contributes to the position of a tag that follows a track.
    pub beacons: KnownBeacons<'a>,
    /// Whether the tag's polls carry its positions.
    pub tells_position: bool,
}

/// The method by which a tag with this solver solves each round by itself. `None` means that the tag follows a track.
pub const fn method(solver: Solver) -> Option<NodeMethod> {
    match solver {
        Solver::Track => None,
        Solver::Robust => Some(NodeMethod::Robust),
        Solver::BWls => Some(NodeMethod::BWls),
        Solver::BWlsR => Some(NodeMethod::BWlsR),
        Solver::BoundingBox => Some(NodeMethod::BoundingBox),
    }
}

/// The positions of the anchors in a record.
pub fn anchor_positions(record: &wire::config::Record) -> Vec<AnchorPosition, { wire::config::MAX_ANCHORS }> {
    let position =
        |anchor: &wire::config::Anchor| AnchorPosition { address: anchor.address, position_m: anchor.position_m };
    record.anchors.iter().map(position).collect()
}

impl<'a> LocatorConfig<'a> {
    /// The configuration of a tag at this height in metres, or in space without a height, with these configured
    /// anchors.
    ///
    /// The tag follows a track, so that a round with one range still gives a position. [`by`](Self::by) chooses another
    /// solver.
    pub fn new(height_m: Option<f32>, anchors: &'a [AnchorPosition]) -> Self {
        let settings = Settings { anchors, ..Settings::tag(height_m) };
        Self { settings, solver: Solver::Track, beacons: KnownBeacons::new(&[], None), tells_position: false }
    }

    /// The same, with this solver.
    pub fn by(self, solver: Solver) -> Self {
        let config = match method(solver) {
            None => self,
            Some(method) => self.solving(Solvers::on_node(method)),
        };
        Self { solver, ..config }
    }

    /// The same, with what a tag's record knows of its place.
    pub fn within(self, tag: &wire::config::Tag) -> Self {
        let area = tag.area.map(|area| Area { min: area.least_m, max: area.greatest_m });
        let height_sigma = tag.height_sigma_m;
        let engine = engine::Settings { area, height_sigma, ..self.settings.engine };
        Self { settings: Settings { engine, ..self.settings }, ..self }
    }

    /// The same, but each round is solved by itself.
    pub fn solving(self, solvers: Solvers<f32>) -> Self {
        Self { settings: self.settings.solving(solvers), ..self }
    }

    /// The configuration of a tag with this record.
    pub fn of(tag: &wire::config::Tag, record: &'a wire::config::Record, anchors: &'a [AnchorPosition]) -> Self {
        let tells_position = tag.tells.has_position();
        let config = Self { tells_position, ..Self::new(tag.height_m, anchors) };
        config.within(tag).by(tag.solver).with_beacons(KnownBeacons::of(record))
    }

    /// The same, with this classifier of links, if there is one.
    pub fn with_model(self, model: Option<&'a impl Classifier>) -> Self {
        Self { settings: self.settings.with_classifier(model.map(|model| model as _)), ..self }
    }

    /// The same, with the survey's models of the beacons' RSSI.
    pub fn with_site_models(self, site_models: &'a SiteModels<'a>) -> Self {
        Self { settings: Settings { site_models: Some(site_models), ..self.settings }, ..self }
    }

    /// The same, with these beacons.
    pub fn with_beacons(self, beacons: KnownBeacons<'a>) -> Self {
        Self { beacons, ..self }
    }

    /// A tracker with this configuration. It lives for ever.
    #[cfg(test)]
    pub(crate) fn tracker<const BEACONS: usize>(self) -> crate::Tracker<'a, BEACONS> {
        let Self { settings, solver, beacons, tells_position: _ } = self;
        crate::Tracker::new(settings, solver, std::boxed::Box::leak(std::boxed::Box::new(beacons)))
    }
}
