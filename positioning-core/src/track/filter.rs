//! The filter: carries the track to the time of a measurement, weighs the measurement, asks its gate, and takes it in.

use super::anchors::{Links, Source};
use super::gate::{Gate, GateDecision};
use super::model::height::HeightModel;
use super::model::position::components;
use super::model::range::RangeModel;
use super::model::tdoa::TdoaModel;
use super::motion::Surprise;
use super::state::{COMMON, POSITION, REFERENCE, State, VELOCITY};
use super::update::{Innovation, Model, update};
use crate::Real;
use crate::engine::{Dimensions, Range, Settings, Tdoa};

/// No measurement counts as better than this, metres: `f32` keeps the covariance of ten metres beside it.
const LEAST_SIGMA_M: f64 = 0.01;
/// The velocity beyond which a link's error forgets no faster, metres a second: nobody runs faster indoors.
const FASTEST: f64 = 10.0;

/// A link's error is not a usual one beyond so many of its deviations …
const UNUSUAL: f64 = 1.7;
/// … and beyond this, metres.
const UNUSUAL_M: f64 = 0.2;
/// A beacon's is not beyond so many of its deviations.
const UNUSUAL_BEACON: f64 = 3.0;

/// What became of a measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum UpdateResult {
    /// Taken in.
    Accepted,
    /// Taken in, after its gate had been shut: its error is believed to have changed.
    Readmitted,
    /// Its gate is shut.
    Rejected,
}

/// A track.
#[derive(Clone, Debug)]
pub(crate) struct Filter<T> {
    pub(crate) state: State<T>,
    links: Links<T>,
    /// The time that the state is of, microseconds.
    pub(crate) now_us: u64,
    surprise: Surprise<T>,
    /// The reception of the reference anchor whose error is a state now.
    reference: Option<(u16, u64)>,
    height_gate: Gate<T>,
    position_gates: [Gate<T>; 3],
}

impl<T: Real> Filter<T> {
    /// At the origin, knowing everything: to be started.
    pub(crate) fn new() -> Self {
        Self {
            state: State::new(),
            links: Links::new(),
            now_us: 0,
            surprise: Surprise::none(),
            reference: None,
            height_gate: Gate::default(),
            position_gates: [Gate::default(); 3],
        }
    }

    /// Starts at a position with its covariance; nothing is known of the velocity but that it is a tag's.
    #[inline(never)]
    pub(crate) fn start(&mut self, now_us: u64, position: [T; 3], covariance: &[[T; 3]; 3], settings: &Settings<T>) {
        self.links.clear();
        self.state.forget_links();
        self.reference = None;
        self.surprise = Surprise::none();
        self.now_us = now_us;
        let flat = settings.dimensions.height().is_some();
        let speed = if settings.motion.moves() { settings.speed.squared() } else { T::ZERO };
        for axis in 0..3 {
            let known = flat && axis == 2;
            self.state.reset(POSITION + axis, position[axis], if known { T::ZERO } else { covariance[axis][axis] });
            self.state.reset(VELOCITY + axis, T::ZERO, if known { T::ZERO } else { speed });
            for other in 0..axis {
                let both = if known { T::ZERO } else { covariance[axis][other] };
                self.state.set_covariance(POSITION + axis, POSITION + other, both);
            }
        }
        self.state.reset(COMMON, T::ZERO, settings.noise.common_sigma.squared());
    }

    /// Carries the track forward; times before its own leave it where it is.
    pub(crate) fn advance(&mut self, now_us: u64, settings: &Settings<T>) {
        let dt = seconds(now_us.saturating_sub(self.now_us));
        if dt > T::ZERO {
            settings.motion.advance(&mut self.state, dt, self.surprise, settings.dimensions.height().is_some());
            self.now_us = now_us;
        }
    }

    /// A range to an anchor, blocked with probability `blocked`, where somebody knows.
    pub(crate) fn range(&mut self, range: &Range<T>, blocked: Option<T>, settings: &Settings<T>) -> UpdateResult {
        let own = range.deviation.at_least(T::of(LEAST_SIGMA_M)).squared();
        let (place, white) = self.link(range.anchor, own, blocked, settings);
        let model = RangeModel { anchor: range.place, range: range.distance, link: Links::<T>::state(place) };
        let innovation = Innovation::of(&self.state, &model);
        let s = innovation.predicted + white;
        let (value, predicted) = (innovation.value, innovation.predicted);
        let excess = value + self.state.mean.get(Links::<T>::state(place)).copied().unwrap_or(T::ZERO);
        let Some(link) = self.links.at(place) else { return UpdateResult::Rejected };
        let passage = link.gate.judge_range(value, excess, s, settings.gate, settings.patience);
        if passage == GateDecision::Accept {
            link.shown.learn(&settings.noise, value, predicted, s);
        }
        self.take(&model, &innovation, white, passage, Some(Links::<T>::state(place)), settings)
    }

    /// The place of a link, its error carried to now, and the white variance of a range over it.
    fn link(&mut self, anchor: u16, own: T, blocked: Option<T>, settings: &Settings<T>) -> (usize, T) {
        let (place, fresh) = self.links.place(Source::Anchor(anchor), self.now_us);
        let Some(link) = self.links.at(place) else { return (place, own) };
        let variances = match settings.blocked {
            super::Blocked::TwoVariances { threshold, direct_m2, blocked_m2 } => {
                let white = if blocked.is_some_and(|blocked| blocked >= threshold) { blocked_m2 } else { direct_m2 };
                super::noise::Variances { white, link: settings.noise.link_sigma.squared() }
            }
            super::Blocked::Alike => link.shown.variances(&settings.noise, own, None),
            super::Blocked::Ignore { .. } | super::Blocked::Weigh => {
                link.shown.variances(&settings.noise, own, blocked)
            }
        };
        let usual = (T::of(UNUSUAL * UNUSUAL) * variances.link).at_least(T::of(UNUSUAL_M * UNUSUAL_M));
        self.carry(place, fresh, [variances.link, usual], [settings.noise.link_seconds, settings.noise.link_metres]);
        (place, variances.white)
    }

    /// Carries a link's error of this variance to now, which is `usual` up to this square; it is another `after` so many seconds, or
    /// metres of way.
    fn carry(&mut self, place: usize, fresh: bool, [mut variance, usual]: [T; 2], after: [T; 2]) {
        let state = Links::<T>::state(place);
        let Some(link) = self.links.at(place) else { return };
        let error = self.state.mean.get(state).copied().unwrap_or(T::ZERO);
        // An error as large as this link's is no draw of what links usually err by: it will not go away by itself.
        if !fresh && error.squared() > usual {
            variance = error.squared();
        }
        if fresh {
            self.state.reset(state, T::ZERO, variance);
        } else if variance > T::ZERO {
            let age: T = seconds(self.now_us.saturating_sub(link.measured_us));
            let velocity = self.state.velocity();
            let square = velocity[0].squared() + velocity[1].squared() + velocity[2].squared();
            let speed = square.at_most(T::of(FASTEST * FASTEST)).sqrt();
            let lapse = age * (T::ONE / after[0] + speed / after[1]);
            self.state.renew(state, fading(lapse), variance);
        }
        link.measured_us = self.now_us;
    }

    /// A difference of two arrivals.
    pub(crate) fn tdoa(&mut self, tdoa: &Tdoa<T>, blocked: [Option<T>; 2], settings: &Settings<T>) -> UpdateResult {
        let own = tdoa.deviations.map(|sigma| sigma.at_least(T::of(LEAST_SIGMA_M)).squared());
        let (reference, reference_white) = self.link(tdoa.reference, own[0], blocked[0], settings);
        let (place, white) = self.link(tdoa.anchor, own[1], blocked[1], settings);
        if self.reference != Some((tdoa.reference, self.now_us)) {
            self.reference = Some((tdoa.reference, self.now_us));
            self.state.reset(REFERENCE, T::ZERO, reference_white);
        }
        let model = TdoaModel {
            anchor: tdoa.place,
            reference: tdoa.reference_place,
            difference: tdoa.difference,
            link: Links::<T>::state(place),
            reference_link: Links::<T>::state(reference),
        };
        let innovation = Innovation::of(&self.state, &model);
        let s = innovation.predicted + white;
        let Some(link) = self.links.at(place) else { return UpdateResult::Rejected };
        let passage = link.gate.check(innovation.value, s, settings.gate, settings.patience);
        if passage == GateDecision::Accept {
            link.shown.learn(&settings.noise, innovation.value, innovation.predicted, s);
        }
        self.take(&model, &innovation, white, passage, Some(Links::<T>::state(place)), settings)
    }

    /// A position in the plane by beacons, of whose variance the share `lasting` stays with the place.
    pub(crate) fn by_beacons(
        &mut self,
        position: [T; 3],
        covariance: &[[T; 3]; 3],
        lasting: T,
        settings: &Settings<T>,
    ) -> UpdateResult {
        let mut fate = UpdateResult::Accepted;
        let components = components(position, covariance, T::of(LEAST_SIGMA_M * LEAST_SIGMA_M));
        for (axis, (model, variance)) in (0_u8..2).zip(components) {
            let (place, fresh) = self.links.place(Source::Beacons(axis), self.now_us);
            let (shadow, noise) = (lasting * variance, &settings.noise);
            let usual = T::of(UNUSUAL_BEACON * UNUSUAL_BEACON) * shadow;
            self.carry(place, fresh, [shadow, usual], [noise.beacon_seconds, noise.beacon_metres]);
            let white = (variance - shadow).at_least(T::of(LEAST_SIGMA_M * LEAST_SIGMA_M));
            let link = Links::<T>::state(place);
            let model = model.with_link(link);
            let innovation = Innovation::of(&self.state, &model);
            let Some(followed) = self.links.at(place) else { return UpdateResult::Rejected };
            let s = innovation.predicted + white;
            let passage = followed.gate.check(innovation.value, s, settings.gate, settings.patience);
            let taken = self.take(&model, &innovation, white, passage, Some(link), settings);
            if taken != UpdateResult::Accepted {
                fate = taken;
            }
        }
        fate
    }

    /// A height and its deviation.
    pub(crate) fn height(&mut self, height: T, deviation: T, settings: &Settings<T>) -> UpdateResult {
        let model = HeightModel { height };
        let innovation = Innovation::of(&self.state, &model);
        let variance = deviation.at_least(T::of(LEAST_SIGMA_M)).squared();
        let s = innovation.predicted + variance;
        let passage = self.height_gate.check(innovation.value, s, settings.gate, settings.patience);
        self.take(&model, &innovation, variance, passage, None, settings)
    }

    /// A position with its covariance.
    pub(crate) fn position(
        &mut self,
        position: [T; 3],
        covariance: &[[T; 3]; 3],
        settings: &Settings<T>,
    ) -> UpdateResult {
        let mut fate = UpdateResult::Accepted;
        let components = components(position, covariance, T::of(LEAST_SIGMA_M * LEAST_SIGMA_M));
        for (place, (model, variance)) in components.into_iter().enumerate() {
            let innovation = Innovation::of(&self.state, &model);
            let s = innovation.predicted + variance;
            let Some(gate) = self.position_gates.get_mut(place) else { continue };
            let passage = gate.check(innovation.value, s, settings.gate, settings.patience);
            let taken = self.take(&model, &innovation, variance, passage, None, settings);
            if taken != UpdateResult::Accepted {
                fate = taken;
            }
        }
        fate
    }

    /// Sets the height that is known.
    pub(crate) fn set_height(&mut self, height: T) {
        self.state.mean[POSITION + 2] = height;
    }

    /// Takes a measurement that its gate has judged. What insists is let in: by the error of its link, where it has one, else
    /// by the doubt of the whole track.
    fn take(
        &mut self,
        model: &impl Model<T>,
        innovation: &Innovation<T>,
        white: T,
        passage: GateDecision,
        link: Option<usize>,
        settings: &Settings<T>,
    ) -> UpdateResult {
        let square = innovation.value.squared();
        match passage {
            GateDecision::Reject => UpdateResult::Rejected,
            GateDecision::Accept => {
                let normalised = square / (innovation.predicted + white);
                self.surprise.add(normalised);
                let tail = if settings.noise.degrees > T::ZERO { normalised / settings.noise.degrees } else { T::ZERO };
                update(&mut self.state, model, innovation, white * (T::ONE + tail), settings.iterations);
                UpdateResult::Accepted
            }
            GateDecision::Reopen => {
                match link {
                    Some(link) => self.state.widen(link, square.at_most(T::of(100.0))),
                    None => (0..3)
                        .filter(|&axis| axis != 2 || settings.dimensions.height().is_none())
                        .for_each(|axis| self.state.widen(POSITION + axis, T::ONE)),
                }
                let again = Innovation::of(&self.state, model);
                update(&mut self.state, model, &again, white, settings.iterations);
                UpdateResult::Readmitted
            }
        }
    }
}

impl<T: Copy> Dimensions<T> {
    /// The height, where it is known.
    pub(crate) fn height(&self) -> Option<T> {
        match self {
            Self::Plane { height } => Some(*height),
            Self::Space { .. } => None,
        }
    }
}

/// Microseconds as seconds; an hour is as good as ever.
pub(crate) fn seconds<T: Real>(microseconds: u64) -> T {
    T::count(microseconds.min(3_600_000_000) as usize) * T::of(1.0e-6)
}

/// e⁻ˣ for x ≥ 0, by (1 + x ⁄ 8)⁻⁸: 1 for 0, falling, above 0, and within 1 % up to x = 0.4; no table, no branch.
fn fading<T: Real>(x: T) -> T {
    (T::ONE / (T::ONE + T::of(0.125) * x)).squared().squared().squared()
}
