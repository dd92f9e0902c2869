//! The filter: it predicts the track to the time of a measurement, compares the measurement with the track, checks
//! its gate, and takes it in.

use super::anchors::{Links, Source};
use super::gate::{Gate, GateDecision};
use super::motion::{Motion, Surprise};
use super::noise::{Blocked, Noise};
use super::state::{COMMON, POSITION, REFERENCE, STATES, State, VELOCITY, fading};
use super::update::{Innovation, Model, update};
use crate::Real;
use crate::link_error::{Gaussian, LinkPrior, WILD_DENSITY, density};
use crate::measurement::{Range, Tdoa, TdoaModel};

/// The part of the way to a link's new prior that one measurement goes: the error of one link changes what is believed
/// of the others, and they take turns.
const DAMPING: f64 = 0.5;
/// A likelihood of a link's error that is less certain than its prior by this factor does not change the prior.
const VAGUE: f64 = 0.02;
/// A change of a link's prior that changes its error's variance, or its mean in deviations, by less than this part is
/// left out.
const WORTH: f64 = 0.03;
/// A link that was measured within this time tells of the present position, microseconds.
const RECENT_US: u64 = 1_000_000;
/// The number of gates for single numbers: a height, and the rest for new kinds.
const OWN_GATES: usize = 4;

/// The settings of the filter.
#[derive(Clone, Copy, Debug)]
pub struct FilterSettings<T> {
    /// The motion model of the tag.
    pub motion: Motion<T>,
    /// The errors of ranges.
    pub noise: Noise<T>,
    /// The treatment of a missing line of sight.
    pub blocked: Blocked<T>,
    /// Linearisations of one measurement: 1 is the extended Kalman filter; more is the iterated one.
    pub iterations: u8,
    /// A measurement beyond this number of deviations is refused.
    pub gate: T,
    /// Similar measurements of one source that are refused for this time, seconds, reopen its gate. Ranges that are
    /// shorter than the distance to the anchor do not.
    pub patience_s: T,
    /// Deviation of the unknown velocity at the start, metres per second and axis.
    pub speed: T,
}

/// The gate that a number has to pass.
#[derive(Clone, Copy, Debug)]
pub(crate) enum GateOf {
    /// That of a link to an anchor; the link's noise is learnt.
    Link(usize),
    /// That of an axis of positions by beacons.
    Beacons(usize),
    /// A gate of its own.
    Own(usize),
}

/// A link whose error is predicted to the current time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CarriedLink<T> {
    /// Its place in the table.
    pub(crate) place: usize,
    /// The state that is its error.
    pub(crate) state: usize,
    /// The variance of a reception's noise, m².
    pub(crate) white: T,
}

/// The result of a measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum UpdateResult {
    /// Taken in.
    Accepted,
    /// Taken in after its gate had refused its source: its error is assumed to have changed.
    Readmitted,
    /// Refused by its gate, or a wild range.
    Rejected,
    /// There is no place for its link: nearer anchors say more.
    NoPlace,
}

/// A track.
#[derive(Clone, Debug)]
pub(crate) struct Filter<T> {
    pub(crate) state: State<T>,
    pub(crate) links: Links<T>,
    /// The time of the state, microseconds.
    pub(crate) now_us: u64,
    surprise: Surprise<T>,
    /// The reception of the reference anchor whose error is currently a state.
    reference: Option<(u16, u64)>,
    own_gates: [Gate<T>; OWN_GATES],
    /// The height of a tag in the plane: its prior, whose variance is 0 where the height is exact.
    pub(super) height: Option<Gaussian<T>>,
    /// An anchor whose ranges insist on being too short, since this was last taken.
    pub(crate) too_short: Option<u16>,
    /// ln of the likelihood of the ranges since this was last taken.
    pub(crate) log_evidence: T,
}

impl<T: Real> Filter<T> {
    /// A filter at the origin without any uncertainty; it must be started.
    pub(crate) fn new() -> Self {
        Self {
            state: State::new(),
            links: Links::new(),
            now_us: 0,
            surprise: Surprise::none(),
            reference: None,
            own_gates: [Gate::default(); OWN_GATES],
            height: None,
            too_short: None,
            log_evidence: T::ZERO,
        }
    }

    /// Starts at a position with its covariance, in the plane where there is a `height`. The velocity is unknown, within
    /// the deviation of a tag's speed.
    #[inline(never)]
    pub(crate) fn start(
        &mut self,
        now_us: u64,
        position: [T; 3],
        covariance: &[[T; 3]; 3],
        height: Option<Gaussian<T>>,
        settings: &FilterSettings<T>,
    ) {
        self.height = height;
        self.links.clear();
        self.state.forget_links();
        self.reference = None;
        self.surprise = Surprise::none();
        self.now_us = now_us;
        let speed = if settings.motion.moves() { settings.speed.squared() } else { T::ZERO };
        for axis in 0..3 {
            self.state.reset(VELOCITY + axis, T::ZERO, if height.is_some() && axis == 2 { T::ZERO } else { speed });
        }
        self.set_position(position, covariance);
        self.state.reset(COMMON, T::ZERO, settings.noise.common_sigma.squared());
    }

    /// Sets the position and its covariance, independent of all other states.
    pub(crate) fn set_position(&mut self, position: [T; 3], covariance: &[[T; 3]; 3]) {
        for axis in 0..3 {
            let known = self.height.filter(|_| axis == 2);
            let variance = known.map_or(covariance[axis][axis], |height| height.variance);
            self.state.reset(POSITION + axis, position[axis], variance);
            for other in 0..axis {
                let both = if known.is_some() { T::ZERO } else { covariance[axis][other] };
                self.state.set_covariance(POSITION + axis, POSITION + other, both);
            }
        }
    }

    /// Becomes a copy of another track, without its evidence.
    #[inline(never)]
    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.state.copy_from(&other.state);
        self.links.copy_from(&other.links);
        (self.now_us, self.surprise, self.reference) = (other.now_us, other.surprise, other.reference);
        (self.own_gates, self.height, self.log_evidence) = (other.own_gates, other.height, T::ZERO);
    }

    /// The number of links to anchors that were measured within the last second, and how many of them are direct.
    pub(crate) fn measured_and_direct(&self) -> [usize; 2] {
        let recent = self.links.iter().filter(|link| {
            matches!(link.source, Source::Anchor(_)) && self.now_us.saturating_sub(link.measured_us) <= RECENT_US
        });
        recent.fold([0, 0], |[measured, direct], link| [measured + 1, direct + usize::from(link.is_direct())])
    }

    /// Predicts the track to a later time. Earlier times do not change it.
    pub(crate) fn advance(&mut self, now_us: u64, settings: &FilterSettings<T>) {
        let dt = seconds(now_us.saturating_sub(self.now_us));
        if dt > T::ZERO {
            settings.motion.advance(&mut self.state, dt, self.surprise, self.height.is_some());
            self.advance_height(dt);
            self.now_us = now_us;
        }
    }

    /// A link to an anchor with its error predicted to the current time, for differences of arrival. `own` is the
    /// variance of the reception's noise in line of sight, m². `p_nlos` is the probability of being without line of
    /// sight, if it is known. Links count as direct: of two links that make one difference, none shows which is
    /// blocked. `None`: there is no place for it.
    #[inline(never)]
    pub(crate) fn anchor_link(
        &mut self,
        anchor: u16,
        own: T,
        p_nlos: Option<T>,
        settings: &FilterSettings<T>,
    ) -> Option<CarriedLink<T>> {
        let (place, fresh) = self.carry_anchor(anchor, T::ZERO, settings)?;
        if fresh {
            let direct_m2 = settings.noise.direct_sigma.squared();
            self.renew(place, Gaussian { mean: T::ZERO, variance: direct_m2 }, T::ZERO);
        }
        let white = self.links.at(place)?.white(own, p_nlos.unwrap_or(T::ZERO), settings);
        Some(CarriedLink { place, state: Links::<T>::state(place), white })
    }

    /// The place of an anchor's link, with its error predicted to the current time, and whether the link is new. The
    /// error of a new link is zero without uncertainty until it has a prior.
    #[inline(never)]
    fn carry_anchor(&mut self, anchor: u16, distance_m: T, settings: &FilterSettings<T>) -> Option<(usize, bool)> {
        let noise = &settings.noise;
        let (place, fresh) = self.links.place(Source::Anchor(anchor), distance_m, self.now_us)?;
        let link = self.links.at(place)?;
        link.distance_m = distance_m;
        if fresh {
            self.state.reset(Links::<T>::state(place), T::ZERO, T::ZERO);
        } else {
            let site = link.site;
            self.carry(place, site, [noise.link_seconds, noise.link_metres]);
        }
        Some((place, fresh))
    }

    /// Gives a link another error with this prior, whatever it was before.
    #[inline(never)]
    fn renew(&mut self, place: usize, site: Gaussian<T>, blocked: T) {
        if let Some(link) = self.links.at(place) {
            (link.site, link.blocked) = (site, blocked);
            self.state.reset(Links::<T>::state(place), site.mean, site.variance);
        }
    }

    /// Gives the link of a range its prior by the range's residual, without a change of the track.
    #[inline(never)]
    pub(crate) fn prepare_range(&mut self, range: &Range<T>, settings: &FilterSettings<T>) {
        let Some((place, _)) = self.carry_anchor(range.anchor, range.distance_m, settings) else { return };
        let state = Links::<T>::state(place);
        self.state.reset(state, T::ZERO, T::ZERO);
        let innovation = Innovation::of(&self.state, &range.model(state));
        let residual = Gaussian { mean: innovation.value, variance: innovation.predicted + range.own_m2() };
        let posterior = settings.noise.link_prior(range.p_nlos_for(settings)).posterior(residual);
        self.renew(place, posterior.site, posterior.blocked);
    }

    /// Takes a range whose link's error lasts. Three explanations compete: the link is as before; it has another error,
    /// direct or blocked; or the range is wild. Each has its probability and its density, and the likeliest one counts.
    #[inline(never)]
    pub(crate) fn observe_range(&mut self, range: &Range<T>, settings: &FilterSettings<T>) -> UpdateResult {
        let noise = &settings.noise;
        let Some((place, fresh)) = self.carry_anchor(range.anchor, range.distance_m, settings) else {
            return UpdateResult::NoPlace;
        };
        let Some(link) = self.links.at(place) else { return UpdateResult::NoPlace };
        let p_nlos = range.p_nlos_for(settings);
        // What is known of the link by now says more than the diagnostics of one reception.
        let blocked = if noise.lasts() { link.blocked } else { p_nlos.unwrap_or(T::ZERO) };
        let white = link.white(range.own_m2(), blocked, settings);
        let state = Links::<T>::state(place);
        let model = range.model(state);
        if !noise.lasts() {
            return self.observe(&model, white, GateOf::Link(place), settings);
        }
        let prior = noise.link_prior(p_nlos);

        let mut innovation = Innovation::of(&self.state, &model);
        let s = innovation.predicted + white;
        let error = Gaussian { mean: self.state.mean[state], variance: self.state.covariance(state, state) };
        // The residual without the link's error: what the track says of that error by itself.
        let residual = Gaussian {
            mean: innovation.value + error.mean,
            variance: (s - T::of(2.0) * innovation.across(state) + error.variance).at_least(white),
        };
        let posterior = prior.posterior(residual);
        let as_before = if fresh { T::ZERO } else { density(innovation.value.squared(), s) };
        let renewal = if fresh { T::ONE } else { share_of(noise.renewals_per_s, link.age_s) };
        let renewed = renewal * posterior.density;
        let wild = T::of(WILD_DENSITY);
        self.log_evidence += log(as_before + renewed + wild);
        let is_wild = wild > as_before && wild > renewed;
        if is_wild {
            // A wild range that repeats itself is a new error after all, unless it is too short: walls lengthen a
            // range, only a fault or a forgery shortens it.
            let decision = link.gate.check(innovation.value, s, settings.gate, [link.age_s, settings.patience_s]);
            let insists = decision == GateDecision::Reopen && residual.mean > T::ZERO;
            if !insists {
                if decision == GateDecision::Reopen {
                    self.too_short = Some(range.anchor);
                }
                if fresh {
                    self.renew(place, posterior.site, posterior.blocked);
                }
                self.surprise.add(innovation.value.squared() / s);
                return UpdateResult::Rejected;
            }
        } else {
            link.gate = Gate::default();
        }
        let mut result = UpdateResult::Accepted;
        if is_wild || renewed > as_before {
            self.renew(place, posterior.site, posterior.blocked);
            innovation = Innovation::of(&self.state, &model);
            if !fresh {
                result = UpdateResult::Readmitted;
            }
        } else if let Some(link) = self.links.at(place) {
            link.shown.learn(share_of(noise.learning_per_s, link.age_s), innovation.value, innovation.predicted, s);
        }
        self.absorb(&model, &innovation, white, settings);
        self.refresh(place, &prior);
        result
    }

    /// ln of the density of a range at the track's position, where its link is a new one.
    #[inline(never)]
    pub(crate) fn log_density(&self, range: &Range<T>, settings: &FilterSettings<T>) -> T {
        let residual = range.model(STATES).linearise(&self.state.mean).innovation;
        let prior = settings.noise.link_prior(range.p_nlos_for(settings));
        let posterior = prior.posterior(Gaussian { mean: residual, variance: range.own_m2() });
        log(posterior.density + T::of(WILD_DENSITY))
    }

    /// The same for a difference of arrivals, between two direct links.
    pub(crate) fn log_density_of_tdoa(&self, tdoa: &Tdoa<T>, settings: &FilterSettings<T>) -> T {
        let model = TdoaModel { tdoa, link: STATES, reference_link: STATES };
        let residual = model.linearise(&self.state.mean).innovation + self.state.mean[REFERENCE];
        let [reference, own] = tdoa.deviations_m.map(|deviation| deviation.squared());
        let variance = reference + own + T::of(2.0) * settings.noise.direct_sigma.squared();
        log(density(residual.squared(), variance) + T::of(WILD_DENSITY))
    }

    /// Gives the link of a range the prior that the mixture is, seen from all that is known of the link's error by now.
    pub(crate) fn refresh_range(&mut self, range: &Range<T>, settings: &FilterSettings<T>) {
        if let Some((place, false)) = self.links.place(Source::Anchor(range.anchor), range.distance_m, self.now_us) {
            self.refresh(place, &settings.noise.link_prior(range.p_nlos_for(settings)));
        }
    }

    /// One step of expectation propagation: divides a link's error by the Gaussian that stands for its prior, and
    /// multiplies it by the one that stands for it now.
    #[inline(never)]
    pub(crate) fn refresh(&mut self, place: usize, prior: &LinkPrior<T>) {
        let state = Links::<T>::state(place);
        let (mean, variance) = (self.state.mean[state], self.state.covariance(state, state));
        let Some(link) = self.links.at(place) else { return };
        let before = T::ONE / link.site.variance;
        let weight = before * link.site.mean;
        let rest = T::ONE / variance - before;
        if !(rest > T::of(VAGUE) * before) {
            return;
        }
        let likelihood = Gaussian { mean: (mean / variance - weight) / rest, variance: T::ONE / rest };
        let posterior = prior.posterior(likelihood);
        let now = T::ONE / posterior.site.variance;
        let (more, more_weight) =
            (T::of(DAMPING) * (now - before), T::of(DAMPING) * (now * posterior.site.mean - weight));
        // Most links are what they were: a change of a small part of the error's deviation is not worth its cost.
        let (narrows, moves) = (more * variance, more_weight - more * mean);
        if narrows.abs() < T::of(WORTH) && moves.squared() * variance < T::of(WORTH * WORTH) {
            return;
        }
        if self.state.inform(state, more, more_weight) {
            let precision = before + more;
            link.site = Gaussian { mean: (weight + more_weight) / precision, variance: T::ONE / precision };
            link.blocked = posterior.blocked;
        }
    }

    /// The error of positions by beacons along an axis, predicted to the current time. Its variance is the first
    /// number, m²; the second is the largest usual square, m².
    pub(crate) fn beacon_link(
        &mut self,
        axis: u8,
        [variance, usual]: [T; 2],
        settings: &FilterSettings<T>,
    ) -> Option<CarriedLink<T>> {
        let noise = &settings.noise;
        let (place, fresh) = self.links.place(Source::Beacons(axis), T::ZERO, self.now_us)?;
        let state = Links::<T>::state(place);
        let error = self.state.mean.get(state).copied().unwrap_or(T::ZERO);
        // An error as large as this one is not a sample of the usual errors: it will not disappear by itself.
        let variance = if !fresh && error.squared() > usual { error.squared() } else { variance };
        let site = Gaussian { mean: T::ZERO, variance };
        if fresh {
            self.renew(place, site, T::ZERO);
        } else {
            self.carry(place, site, [noise.beacon_seconds, noise.beacon_metres]);
        }
        Some(CarriedLink { place, state, white: T::ZERO })
    }

    /// Sets the reception of the reference anchor for the next differences. Its noise has this variance, m².
    pub(crate) fn set_reference(&mut self, anchor: u16, white: T) {
        if self.reference != Some((anchor, self.now_us)) {
            self.reference = Some((anchor, self.now_us));
            self.state.reset(REFERENCE, T::ZERO, white);
        }
    }

    /// Predicts a link's error to the current time. `after` is the time in seconds and the distance in metres after
    /// which the error is a different one of the same prior.
    #[inline(never)]
    fn carry(&mut self, place: usize, site: Gaussian<T>, after: [T; 2]) {
        let Some(link) = self.links.at(place) else { return };
        let age: T = seconds(self.now_us.saturating_sub(link.measured_us));
        (link.measured_us, link.age_s) = (self.now_us, age);
        if age > T::ZERO && site.variance > T::ZERO {
            let kept = self.state.kept(age, after);
            self.state.renew(Links::<T>::state(place), kept, site);
        }
    }

    /// Compares one number with the track, checks its gate, and takes it in; `white` is the variance of its noise.
    #[inline(never)]
    pub(crate) fn observe(
        &mut self,
        model: &impl Model<T>,
        white: T,
        gate: GateOf,
        settings: &FilterSettings<T>,
    ) -> UpdateResult {
        let innovation = Innovation::of(&self.state, model);
        let (value, predicted) = (innovation.value, innovation.predicted);
        let s = predicted + white;
        let limit = settings.gate;
        let (decision, link) = match gate {
            GateOf::Link(place) | GateOf::Beacons(place) => {
                let state = Links::<T>::state(place);
                let Some(link) = self.links.at(place) else { return UpdateResult::NoPlace };
                let decision = link.gate.check(value, s, limit, [link.age_s, settings.patience_s]);
                if matches!(gate, GateOf::Link(_)) {
                    self.log_evidence += log(density(value.squared(), s) + T::of(WILD_DENSITY));
                }
                if decision == GateDecision::Accept && !matches!(gate, GateOf::Beacons(_)) {
                    let weight = share_of(settings.noise.learning_per_s, link.age_s);
                    link.shown.learn(weight, value, predicted, s);
                }
                (decision, Some(state))
            }
            GateOf::Own(own) => {
                let Some(gate) = self.own_gates.get_mut(own) else { return UpdateResult::Rejected };
                // These have no times of their own: six in a row.
                (gate.check(value, s, limit, [T::of(0.2) * settings.patience_s, settings.patience_s]), None)
            }
        };
        self.take(model, &innovation, white, decision, link, settings)
    }

    /// Takes a measurement into the state.
    #[inline(never)]
    fn absorb(&mut self, model: &impl Model<T>, innovation: &Innovation<T>, white: T, settings: &FilterSettings<T>) {
        let normalised = innovation.value.squared() / (innovation.predicted + white);
        self.surprise.add(normalised);
        let tail = if settings.noise.degrees > T::ZERO { normalised / settings.noise.degrees } else { T::ZERO };
        update(&mut self.state, model, innovation, white * (T::ONE + tail), settings.iterations);
    }

    /// Takes a measurement after the decision of its gate. If the gate reopens, the measurement is let in: the
    /// variance of its link's error is increased, if it has a link, else the uncertainty of the whole track.
    fn take(
        &mut self,
        model: &impl Model<T>,
        innovation: &Innovation<T>,
        white: T,
        decision: GateDecision,
        link: Option<usize>,
        settings: &FilterSettings<T>,
    ) -> UpdateResult {
        let square = innovation.value.squared();
        match decision {
            GateDecision::Reject => UpdateResult::Rejected,
            GateDecision::Accept => {
                self.absorb(model, innovation, white, settings);
                UpdateResult::Accepted
            }
            GateDecision::Reopen => {
                match link {
                    Some(link) => self.state.widen(link, square.at_most(T::of(100.0))),
                    None => (0..3)
                        .filter(|&axis| axis != 2 || self.height.is_none())
                        .for_each(|axis| self.state.widen(POSITION + axis, T::ONE)),
                }
                let again = Innovation::of(&self.state, model);
                update(&mut self.state, model, &again, white, settings.iterations);
                UpdateResult::Readmitted
            }
        }
    }
}

/// The natural logarithm of a density, near enough to compare hypotheses.
fn log<T: Real>(density: T) -> T {
    T::of(core::f64::consts::LN_2) * density.log2_about()
}

/// Microseconds as seconds, at most an hour: longer times have the same effect.
pub(crate) fn seconds<T: Real>(microseconds: u64) -> T {
    T::count(microseconds.min(3_600_000_000) as usize) * T::of(1.0e-6)
}

/// The part that changes in a time, seconds, of what changes at a rate per second.
#[inline(always)]
fn share_of<T: Real>(per_s: T, seconds: T) -> T {
    T::ONE - fading(per_s * seconds)
}
