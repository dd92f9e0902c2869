//! The locator. Input: all measurements of a tag with their times. Output: the tag's positions. The tag's task, the
//! replays of recordings and the simulation's tag all call this one type.
//!
//! Ranges and differences of arrival come with the diagnostics of their reception. The NLOS detector converts these
//! to probabilities. The [`Engine`] computes a position at the end of the round ([`Locator::end_round`]).
//! Advertisements of listed beacons are smoothed. They go into the same track once per window
//! ([`Locator::end_window`]): by a fingerprint map if there is one, else by path losses.

mod beacons;
mod outcome;
mod settings;
mod site_models;

pub use outcome::{Position, TagUpdate};
pub use settings::{AnchorPosition, Settings};
pub use site_models::{ForBeacons, RoomUpdate, SiteModels};

use crate::engine::{Engine, Hypothesis, Measurement, Range, Tdoa, Verdict};
use crate::nlos::{Feature, Features, NlosDetector};
use crate::{Alternative, Real};
use beacons::Beacons;
use outcome::Used;

/// The receiver's diagnostics of one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reception {
    /// The powers, and the shape of the impulse response if it was read.
    pub features: Features,
    /// Received power, dBm; NaN where it is not known.
    pub power_dbm: f32,
}

/// Locates one tag with up to `BEACONS` listed beacons; 0 leaves out all code for beacons.
#[derive(Clone)]
pub struct Locator<'a, const BEACONS: usize> {
    engine: Engine<f32>,
    anchors: &'a [AnchorPosition],
    detector: NlosDetector<'a>,
    /// The tag's position at the end of the last round or window, metres, if it is known.
    last_m: Option<[f32; 3]>,
    /// The reference anchor of this round's differences, and the probability that its link is without line of sight.
    reference: Option<(u16, Option<f32>)>,
    used: Used,
    beacons: Beacons<'a, BEACONS>,
}

impl<'a, const BEACONS: usize> Locator<'a, BEACONS> {
    /// A locator without measurements.
    pub fn new(settings: Settings<'a>) -> Self {
        Self {
            engine: Engine::new(settings.engine),
            anchors: settings.anchors,
            detector: NlosDetector::new(settings.classifier),
            last_m: None,
            reference: None,
            used: Used::default(),
            beacons: Beacons::new(&settings),
        }
    }

    /// Whether the impulse responses of frames are used.
    pub fn wants_response(&self) -> bool {
        self.detector.wants_response()
    }

    /// Whether a feature of receptions is used.
    pub fn asks(&self, feature: Feature) -> bool {
        self.detector.asks(feature)
    }

    /// Changes the height of a tag in the plane, metres.
    pub fn set_height(&mut self, height_m: f32) {
        self.engine.set_height(height_m);
    }

    /// Predicts the track to a time, microseconds, as the next measurement of that time would do first.
    pub fn advance(&mut self, t_us: u64) {
        self.engine.advance(t_us);
    }

    /// The track, if there is one, and the second hypothesis with its probability, if there are two.
    pub fn hypotheses(&self) -> [Option<(Hypothesis<'_, f32>, f32)>; 2] {
        self.engine.hypotheses()
    }

    /// The configured position of an anchor; without one, the position that the anchor reports, metres.
    pub fn anchor_m(&self, address: u16, own_m: Option<[f32; 3]>) -> Option<[f32; 3]> {
        let configured = self.anchors.iter().find(|anchor| anchor.address == address);
        configured.map(|anchor| anchor.position_m).or(own_m)
    }

    /// The other of two places that explain the ranges.
    pub fn alternative(&self) -> Option<Alternative<f32, 3>> {
        self.engine.alternative()
    }

    /// Takes the round's range of this index. Its anchor's position is that of [`anchor_m`](Self::anchor_m). Its
    /// probability of being without line of sight comes from the reception.
    pub fn range(&mut self, t_us: u64, index: usize, range: Range<f32>, reception: &Reception) -> Verdict {
        let ends_m = self.last_m.map(|last_m| [last_m, range.position_m]);
        let p_nlos = self.p_nlos(t_us, range.anchor, range.distance_m, ends_m, reception);
        let verdict = self.engine.step_on_node(t_us, &Measurement::Range(Range { p_nlos, ..range })).verdict;
        self.used.range(index, verdict);
        verdict
    }

    /// Takes the round's difference of arrivals of this index. It contains the positions that the anchors report;
    /// configured ones are used instead. The receptions are that of the reference anchor, which counts once per
    /// round, and that of the anchor.
    pub fn tdoa(&mut self, t_us: u64, index: usize, tdoa: Tdoa<f32>, receptions: [&Reception; 2]) -> Verdict {
        let reference = self.reference.filter(|(anchor, _)| *anchor == tdoa.reference);
        let (_, reference_p) = reference
            .unwrap_or_else(|| (tdoa.reference, self.p_nlos(t_us, tdoa.reference, f32::NAN, None, receptions[0])));
        self.reference = Some((tdoa.reference, reference_p));
        let p_nlos = [reference_p, self.p_nlos(t_us, tdoa.anchor, f32::NAN, None, receptions[1])];
        let configured = |address, own_m| self.anchor_m(address, None).unwrap_or(own_m);
        let reference_m = configured(tdoa.reference, tdoa.reference_m);
        let position_m = configured(tdoa.anchor, tdoa.position_m);
        let difference_m = between(&tdoa, [reference_m, position_m]);
        let tdoa = Tdoa { position_m, reference_m, difference_m, p_nlos, ..tdoa };
        let verdict = self.engine.step_on_node(t_us, &Measurement::Tdoa(tdoa)).verdict;
        self.used.count(1_u16.checked_shl(index as u32).unwrap_or(0), verdict);
        verdict
    }

    /// The position at the end of a round with this number of measurements.
    pub fn end_round(&mut self, t_us: u64, measured: usize) -> TagUpdate {
        let update = self.conclude(t_us, measured);
        self.reference = None;
        self.beacons.note_anchors(&update);
        update
    }

    fn conclude(&mut self, t_us: u64, measured: usize) -> TagUpdate {
        let end = self.engine.step_on_node(t_us, &Measurement::RoundEnd);
        self.last_m = end.fix.as_ref().ok().map(|fix| fix.position);
        let used = core::mem::take(&mut self.used).of(&end);
        TagUpdate { fix: end.fix, alternative: self.alternative(), used, measured }
    }

    fn p_nlos(
        &mut self,
        t_us: u64,
        anchor: u16,
        range_m: f32,
        ends_m: Option<[[f32; 3]; 2]>,
        reception: &Reception,
    ) -> Option<f32> {
        let Reception { features, power_dbm } = *reception;
        self.detector.blocked(t_us, anchor, &crate::nlos::Reception { features, range_m, power_dbm, ends_m })
    }
}

/// The difference between anchors at these positions, metres. It was computed with the distance between the positions
/// that the anchors report.
fn between(tdoa: &Tdoa<f32>, positions_m: [[f32; 3]; 2]) -> f32 {
    let own_m = [tdoa.reference_m, tdoa.position_m];
    if own_m == positions_m {
        return tdoa.difference_m;
    }
    let apart = |[a, b]: [[f32; 3]; 2]| Real::sqrt(a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f32>());
    tdoa.difference_m + apart(own_m) - apart(positions_m)
}
