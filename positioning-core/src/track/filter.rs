//! The filter: it predicts the track to the time of a measurement, compares the measurement with the track, checks
//! its gate, and takes it in.

use super::anchors::{Links, Source};
use super::gate::{Gate, GateDecision};
use super::motion::{Motion, Surprise};
use super::noise::{Blocked, Noise, Variances};
use super::state::{COMMON, POSITION, REFERENCE, State, VELOCITY};
use super::update::{Innovation, Model, update};
use crate::Real;

/// The greatest speed that counts for the forgetting of a link's error, metres per second: people indoors are not
/// faster.
const FASTEST: f64 = 10.0;
/// A link's error is unusual beyond this number of its deviations …
const UNUSUAL: f64 = 1.7;
/// … and beyond this, metres.
const UNUSUAL_M: f64 = 0.2;
/// The number of gates for single numbers: a height, the three of a position, and the rest for new kinds.
const OWN_GATES: usize = 8;

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
    /// This number of similar refused measurements of one source reopens its gate. Ranges that are shorter than the
    /// distance to the anchor do not.
    pub patience: u8,
    /// Deviation of the unknown velocity at the start, metres per second and axis.
    pub speed: T,
}

/// The gate that a number has to pass.
#[derive(Clone, Copy, Debug)]
pub(crate) enum GateOf {
    /// That of a range's link, by its place in the table; the link's noise is learnt.
    Range(usize),
    /// That of a difference's link; the link's noise is learnt.
    Tdoa(usize),
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
    /// Refused by its gate.
    Rejected,
}

/// A track.
#[derive(Clone, Debug)]
pub(crate) struct Filter<T> {
    pub(crate) state: State<T>,
    links: Links<T>,
    /// The time of the state, microseconds.
    pub(crate) now_us: u64,
    surprise: Surprise<T>,
    /// The reception of the reference anchor whose error is currently a state.
    reference: Option<(u16, u64)>,
    own_gates: [Gate<T>; OWN_GATES],
    /// Whether the height is known.
    flat: bool,
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
            flat: false,
        }
    }

    /// Starts at a position with its covariance, in the plane where `flat`. The velocity is unknown, within the
    /// deviation of a tag's speed.
    #[inline(never)]
    pub(crate) fn start(
        &mut self,
        now_us: u64,
        position: [T; 3],
        covariance: &[[T; 3]; 3],
        flat: bool,
        settings: &FilterSettings<T>,
    ) {
        self.flat = flat;
        self.links.clear();
        self.state.forget_links();
        self.reference = None;
        self.surprise = Surprise::none();
        self.now_us = now_us;
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

    /// Predicts the track to a later time. Earlier times do not change it.
    pub(crate) fn advance(&mut self, now_us: u64, settings: &FilterSettings<T>) {
        let dt = seconds(now_us.saturating_sub(self.now_us));
        if dt > T::ZERO {
            settings.motion.advance(&mut self.state, dt, self.surprise, self.flat);
            self.now_us = now_us;
        }
    }

    /// A link to an anchor, with its error predicted to the current time. `own` is the variance of the reception's
    /// noise in line of sight, m². `p_nlos` is the probability of being without line of sight, if it is known.
    pub(crate) fn anchor_link(
        &mut self,
        anchor: u16,
        own: T,
        p_nlos: Option<T>,
        settings: &FilterSettings<T>,
    ) -> CarriedLink<T> {
        let noise = &settings.noise;
        let (place, fresh) = self.links.place(Source::Anchor(anchor), self.now_us);
        let state = Links::<T>::state(place);
        let Some(link) = self.links.at(place) else { return CarriedLink { place, state, white: own } };
        let variances = match settings.blocked {
            Blocked::TwoVariances { threshold, direct_m2, blocked_m2 } => {
                let white = if p_nlos.is_some_and(|p_nlos| p_nlos >= threshold) { blocked_m2 } else { direct_m2 };
                Variances { white, link: noise.link_sigma.squared() }
            }
            Blocked::Alike => link.shown.variances(noise, own, None),
            Blocked::Ignore { .. } | Blocked::Weigh => link.shown.variances(noise, own, p_nlos),
        };
        let usual = (T::of(UNUSUAL * UNUSUAL) * variances.link).at_least(T::of(UNUSUAL_M * UNUSUAL_M));
        self.carry(place, fresh, [variances.link, usual], [noise.link_seconds, noise.link_metres]);
        CarriedLink { place, state, white: variances.white }
    }

    /// The error of positions by beacons along an axis, predicted to the current time. Its variance is the first
    /// number, m²; the second is the largest usual square, m².
    pub(crate) fn beacon_link(
        &mut self,
        axis: u8,
        variance_and_usual: [T; 2],
        settings: &FilterSettings<T>,
    ) -> CarriedLink<T> {
        let noise = &settings.noise;
        let (place, fresh) = self.links.place(Source::Beacons(axis), self.now_us);
        self.carry(place, fresh, variance_and_usual, [noise.beacon_seconds, noise.beacon_metres]);
        CarriedLink { place, state: Links::<T>::state(place), white: T::ZERO }
    }

    /// Sets the reception of the reference anchor for the next differences. Its noise has this variance, m².
    pub(crate) fn set_reference(&mut self, anchor: u16, white: T) {
        if self.reference != Some((anchor, self.now_us)) {
            self.reference = Some((anchor, self.now_us));
            self.state.reset(REFERENCE, T::ZERO, white);
        }
    }

    /// Predicts a link's error with this variance to the current time; `usual` is its largest usual square. `after`
    /// is the time in seconds and the distance in metres after which the error is a different one.
    fn carry(&mut self, place: usize, fresh: bool, [mut variance, usual]: [T; 2], after: [T; 2]) {
        let state = Links::<T>::state(place);
        let Some(link) = self.links.at(place) else { return };
        let error = self.state.mean.get(state).copied().unwrap_or(T::ZERO);
        // An error as large as this link's is not a sample of the usual errors: it will not disappear by itself.
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

    /// Compares one number with the track, checks its gate, and takes it in; `white` is the variance of its noise.
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
        let (limit, patience) = (settings.gate, settings.patience);
        let (decision, link) = match gate {
            GateOf::Range(place) | GateOf::Tdoa(place) | GateOf::Beacons(place) => {
                let state = Links::<T>::state(place);
                let excess = value + self.state.mean.get(state).copied().unwrap_or(T::ZERO);
                let Some(link) = self.links.at(place) else { return UpdateResult::Rejected };
                let decision = match gate {
                    GateOf::Range(_) => link.gate.judge_range(value, excess, s, limit, patience),
                    GateOf::Tdoa(_) | GateOf::Beacons(_) | GateOf::Own(_) => link.gate.check(value, s, limit, patience),
                };
                if decision == GateDecision::Accept && !matches!(gate, GateOf::Beacons(_)) {
                    link.shown.learn(&settings.noise, value, predicted, s);
                }
                (decision, Some(state))
            }
            GateOf::Own(own) => {
                let Some(gate) = self.own_gates.get_mut(own) else { return UpdateResult::Rejected };
                (gate.check(value, s, limit, patience), None)
            }
        };
        self.take(model, &innovation, white, decision, link, settings)
    }

    /// Sets the known height.
    pub(crate) fn set_height(&mut self, height: T) {
        self.state.mean[POSITION + 2] = height;
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
                        .filter(|&axis| axis != 2 || !self.flat)
                        .for_each(|axis| self.state.widen(POSITION + axis, T::ONE)),
                }
                let again = Innovation::of(&self.state, model);
                update(&mut self.state, model, &again, white, settings.iterations);
                UpdateResult::Readmitted
            }
        }
    }
}

/// Microseconds as seconds, at most an hour: longer times have the same effect.
fn seconds<T: Real>(microseconds: u64) -> T {
    T::count(microseconds.min(3_600_000_000) as usize) * T::of(1.0e-6)
}

/// e⁻ˣ for x ≥ 0, approximately, by (1 + x ⁄ 8)⁻⁸. It is 1 for 0, falls, stays above 0, and is within 1 % up to x =
/// 0.4. It needs no table and no branch.
fn fading<T: Real>(x: T) -> T {
    (T::ONE / (T::ONE + T::of(0.125) * x)).squared().squared().squared()
}
