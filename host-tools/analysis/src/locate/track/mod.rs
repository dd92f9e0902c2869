//! `baliza track`: sends a recording through the tag's own locator, one epoch after another in the order of time, in
//! the tag's own `f32`.
//!
//! The input is the ranges with their times. The diagnostics of a reception give the probability that the link is
//! without line of sight (p_nlos), by a trained model or by its powers. The output is the position at the end of every
//! epoch.

mod offsets;
mod rts;
mod smoother;

use std::borrow::Cow;

use positioning_core::Side;
use positioning_core::engine::{Dimensions, Mode, Range, Settings, Solvers, Tdoa, Verdict};
use positioning_core::locator::{self, Locator, Reception};
use positioning_core::nlos::Model;
use positioning_core::{Area, Blocked, Flag};

use self::smoother::{History, Smoothed};
use crate::locate::solve::{Setup, double, middle_m};
pub use recording::folder::Weighting;
use recording::{Anchor, Coordinates, Diagnostics, Epoch, Epochs, Measured, MeasuredDifference, by_time};
use recording::{Half, Height, NoPosition, Position, Solved, Space};

/// Standard deviation of the noise of a DW1000 range in line of sight, metres, where the recording has none. The engine
/// models all other range errors.
const DEVIATION_M: f32 = 0.03;
/// The assumed interval between epochs without recorded times, seconds.
const USUAL_S: f64 = 0.1;
/// The engine's time of the first epoch, seconds. It is large so that slightly earlier times are not negative.
const BEGIN_S: f64 = 3600.0;

/// The engine's settings for a recording.
pub fn settings(setup: &Setup, weighting: Weighting) -> Settings<f32> {
    let dimensions = match setup.space {
        Space::Plane(_) => Dimensions::Plane { height: 0.0 },
        Space::Full(half) => Dimensions::Space {
            side: match half {
                None => Side::Unknown,
                Some(Half::Below) => Side::Of([0.0, 0.0, -1.0e4]),
                Some(Half::Above) => Side::Of([0.0, 0.0, 1.0e4]),
            },
        },
    };
    let blocked = match weighting {
        Weighting::Weigh => Blocked::Weigh,
        Weighting::Ignore => Blocked::Ignore { threshold: 0.5, at_least: 4 },
        Weighting::Alike => Blocked::Alike,
    };
    let height_sigma = setup.height_sigma_m as f32;
    Settings { height_sigma, ..Settings::track(dimensions).with_blocked(blocked) }
}

/// The engine's settings for a recording of differences without memory between the epochs: each position is where the
/// hyperbolas meet.
pub fn settings_of_single_epochs(setup: &Setup) -> Settings<f32> {
    let Settings { dimensions, height_sigma, .. } = settings(setup, Weighting::Weigh);
    Settings { height_sigma, ..Settings::solve(dimensions, Solvers::robust()) }
}

/// Follows a tag through a recording.
pub struct Tracker<'a> {
    anchors: Cow<'a, [Anchor]>,
    setup: Setup,
    locator: Locator<'a, 0>,
    /// Whether the engine follows a track, and so knows a velocity.
    follows: bool,
    /// The locator's origin of coordinates, metres.
    origin: [f64; 3],
    /// The times of the first and of the last epoch, seconds.
    times_s: Option<(f64, f64)>,
    /// What a smoother needs.
    history: Option<History>,
    /// By anchor: what is subtracted from its ranges, metres; none where the vector ends.
    offsets_m: Vec<f64>,
}

impl<'a> Tracker<'a> {
    /// A tracker that begins with the next epoch. Without a model, the powers give the probability of a blocked link.
    pub fn new(
        anchors: impl Into<Cow<'a, [Anchor]>>,
        setup: Setup,
        mut settings: Settings<f32>,
        model: Option<&'a Model<'a>>,
    ) -> Self {
        let anchors = anchors.into();
        let origin = origin_m(&anchors);
        settings.area = setup.area_m.map(|[least, greatest]| {
            let local = |axis: usize, coordinate: f64| (coordinate - origin[axis]) as f32;
            Area {
                min: [local(0, least[0]), local(1, least[1]), f32::NEG_INFINITY],
                max: [local(0, greatest[0]), local(1, greatest[1]), f32::INFINITY],
            }
        });
        let follows = settings.mode == Mode::Track;
        let classifier = model.map(|model| model as _);
        let locator = Locator::new(locator::Settings { classifier, ..locator::Settings::new(settings) });
        Self { anchors, setup, locator, follows, origin, times_s: None, history: None, offsets_m: Vec::new() }
    }

    /// The position at the end of the next epoch, and its error where the true position is known.
    pub fn follow(&mut self, epoch: &Epoch) -> Solved {
        Solved::of(self.position(epoch), epoch.truth)
    }

    /// The positions of epochs, in their order. The epochs are taken in the order of time; `step` is called after each.
    pub fn follow_all(&mut self, epochs: &Epochs, step: impl Fn()) -> Vec<Solved> {
        let order = by_time(epochs.times_s());
        let mut solved: Vec<(usize, Solved)> = Vec::with_capacity(epochs.len());
        for at in order {
            let Some(epoch) = epochs.get(at) else { continue };
            solved.push((at, self.follow(&epoch)));
            step();
        }
        solved.sort_by_key(|(at, _)| *at);
        solved.into_iter().map(|(_, solved)| solved).collect()
    }

    /// The positions of epochs by the filter, and by a smoother behind it: each by the measurements of the whole
    /// recording. They are in the order of the epochs; `step` is called after each.
    ///
    /// The smoother goes through the recording twice. The residuals at its first positions give each anchor an error
    /// that lasts for the whole recording, and the second time the ranges are without it (one step of expectation and
    /// maximisation).
    pub fn smooth_all(&mut self, epochs: &Epochs, step: impl Fn()) -> [Vec<Solved>; 2] {
        let begin = self.locator.clone();
        let [filtered, first] = self.smooth_once(epochs, step);
        self.offsets_m = offsets::of_anchors(&self.anchors, epochs, &self.setup, &first);
        if self.offsets_m.iter().all(|offset_m| *offset_m == 0.0) {
            return [filtered, first];
        }
        (self.locator, self.times_s) = (begin, None);
        let [_, smoothed] = self.smooth_once(epochs, || ());
        // An epoch has either both positions or none.
        let both = filtered.iter().zip(smoothed).zip(first);
        let smoothed = both.map(|((filtered, second), first)| match (filtered.outcome, second.outcome) {
            (Ok(_), Ok(_)) => second,
            (Ok(_), Err(_)) => first,
            (Err(_), _) => *filtered,
        });
        let smoothed = smoothed.collect();
        [filtered, smoothed]
    }

    fn smooth_once(&mut self, epochs: &Epochs, step: impl Fn()) -> [Vec<Solved>; 2] {
        self.history = self.follows.then(History::default);
        let filtered = self.follow_all(epochs, step);
        let mut both = filtered.clone();
        let states = self.history.take().map_or_else(Vec::new, |history| history.smoothed(&self.locator));
        for (at, state) in by_time(epochs.times_s()).into_iter().zip(states) {
            if let (Some(solved), Some(epoch), Some(state)) = (both.get_mut(at), epochs.get(at), state) {
                *solved = Solved::of(solved.outcome.map(|position| self.smoothed(&position, &state)), epoch.truth);
            }
        }
        [filtered, both]
    }

    /// The smoothed position of an epoch, where the filter had this one.
    fn smoothed(&self, filtered: &Position, state: &Smoothed) -> Position {
        let [x_m, y_m, z_m] = std::array::from_fn(|axis| state.position[axis] + self.origin[axis]);
        let covariance = &state.covariance;
        let [sigma_x, sigma_y, mut sigma_z] = [0, 1, 2].map(|axis: usize| covariance[axis][axis].max(0.0).sqrt());
        // A height that ranges do not determine is no more certain than a solved round, however many there are.
        if let Some(reported) = filtered.sigma.z_m.filter(|sigma| sigma * sigma > 1.001 * state.filtered_zz) {
            sigma_z = sigma_z.max(reported);
        }
        let [vx, vy, vz] = state.velocity;
        let in_space = filtered.place.z_m.is_some();
        let of_place = |x_m, y_m, z_m| Coordinates { x_m, y_m, z_m: in_space.then_some(z_m) };
        Position {
            place: of_place(x_m, y_m, z_m),
            sigma: of_place(sigma_x, sigma_y, sigma_z),
            covariance_xy: covariance[0][1],
            covariance_z: in_space.then(|| [covariance[0][2], covariance[1][2]]),
            velocity_m_s: Some(of_place(vx, vy, vz)),
            used: filtered.used,
            alternative: state.alternative,
            flag: match state.alternative {
                Some(_) => Some(Flag::Ambiguous),
                None => filtered.flag.filter(|flag| *flag == Flag::Suspect),
            },
        }
    }

    fn position(&mut self, epoch: &Epoch) -> Result<Position, NoPosition> {
        self.history.iter_mut().for_each(History::begin_epoch);
        let now_us = self.microseconds(epoch);
        let in_space = match self.setup.space {
            Space::Full(_) => true,
            Space::Plane(height) => {
                let height_m = match height {
                    Height::Unknown => self.origin[2],
                    Height::Fixed(z) => z,
                    Height::FromTruth => epoch.truth.and_then(|truth| truth.z_m).ok_or(NoPosition::HeightUnknown)?,
                };
                self.locator.set_height((height_m - self.origin[2]) as f32);
                false
            }
        };
        // Asynchronous ranges have times of their own.
        for index in by_time(epoch.ranges.iter().map(|measured| measured.t_s)) {
            let Some(measured) = epoch.ranges.get(index) else { continue };
            if let Some(range) = self.range(&measured) {
                let t_us = measured.t_s.map_or(now_us, |t_s| self.clock_us(t_s - epoch.age_s));
                self.observe(t_us, |locator| locator.range(t_us, index, range, &reception(&measured.diagnostics)));
            }
        }
        self.differences(now_us, epoch);
        let measured = epoch.ranges.len() + epoch.differences.len();
        let update = match &mut self.history {
            Some(history) => history.end_round(&mut self.locator, now_us, measured),
            None => self.locator.end_round(now_us, measured),
        };
        let fix = update.fix.map_err(NoPosition::Missing)?;
        let [x_m, y_m, z_m] = std::array::from_fn(|axis| f64::from(fix.position[axis]) + self.origin[axis]);
        let [sigma_x, sigma_y, sigma_z] = fix.sigma().map(f64::from);
        Ok(Position {
            place: Coordinates { x_m, y_m, z_m: in_space.then_some(z_m) },
            sigma: Coordinates { x_m: sigma_x, y_m: sigma_y, z_m: in_space.then_some(sigma_z) },
            covariance_xy: fix.covariance[0][1].into(),
            covariance_z: in_space.then(|| [fix.covariance[0][2], fix.covariance[1][2]].map(f64::from)),
            velocity_m_s: self.follows.then(|| {
                let [x_m, y_m, z_m] = fix.velocity.map(f64::from);
                Coordinates { x_m, y_m, z_m: in_space.then_some(z_m) }
            }),
            used: update.used.count_ones() as usize,
            alternative: self.locator.alternative().map(double),
            flag: fix.flag,
        })
    }

    /// Gives the differences of an epoch to the locator, each with the receptions of its two anchors.
    fn differences(&mut self, now_us: u64, epoch: &Epoch) {
        let own =
            |reference: usize| epoch.differences.iter().find(|of| of.anchor == reference && of.reference == reference);
        for (index, difference) in epoch.differences.iter().enumerate() {
            let &MeasuredDifference { reference, anchor, difference_m, .. } = &difference;
            let places = self.local_m(reference).zip(self.local_m(anchor));
            let (Some((reference_m, position_m)), true) = (places, reference != anchor) else { continue };
            let (Ok(reference_address), Ok(anchor)) = (u16::try_from(reference), u16::try_from(anchor)) else {
                continue;
            };
            let of_reference = own(reference).map(|of| of.diagnostics).unwrap_or_default();
            let tdoa = Tdoa {
                anchor,
                position_m,
                reference: reference_address,
                reference_m,
                difference_m: difference_m as f32,
                deviations_m: [&of_reference, &difference.diagnostics].map(deviation_m),
                p_nlos: [None; 2],
            };
            let receptions = [&of_reference, &difference.diagnostics].map(reception);
            self.observe(now_us, |locator| locator.tdoa(now_us, index, tdoa, [&receptions[0], &receptions[1]]));
        }
    }

    /// Gives a measurement to the locator.
    fn observe(&mut self, t_us: u64, measure: impl FnOnce(&mut Locator<'a, 0>) -> Verdict) {
        match &mut self.history {
            Some(history) => history.observe(&mut self.locator, t_us, measure),
            None => drop(measure(&mut self.locator)),
        }
    }

    /// The time of an epoch, on the engine's clock.
    fn microseconds(&mut self, epoch: &Epoch) -> u64 {
        let (first, last) = self.times_s.unwrap_or_else(|| {
            let begin = epoch.t_s.map_or(0.0, |t_s| t_s - epoch.age_s);
            (begin, begin - USUAL_S)
        });
        let now = epoch.t_s.map_or(last + USUAL_S, |t_s| t_s - epoch.age_s);
        self.times_s = Some((first, now));
        self.clock_us(now)
    }

    /// A time of the recording, seconds, on the engine's clock.
    fn clock_us(&self, t_s: f64) -> u64 {
        let first_s = self.times_s.map_or(t_s, |(first_s, _)| first_s);
        // The conversion saturates: a float that is too large or negative becomes the largest or the least integer.
        ((t_s - first_s + BEGIN_S) * 1.0e6).round() as u64
    }

    /// The position of an anchor relative to the origin, metres.
    fn local_m(&self, anchor: usize) -> Option<[f32; 3]> {
        let place = &self.anchors.get(anchor)?.place;
        let flat = self.setup.space == Space::Plane(Height::Unknown);
        let z_m = if flat { self.origin[2] } else { place.z_m? };
        let local = |axis: usize, coordinate: f64| (coordinate - self.origin[axis]) as f32;
        Some([local(0, place.x_m), local(1, place.y_m), local(2, z_m)])
    }

    fn range(&self, measured: &Measured) -> Option<Range<f32>> {
        let position_m = self.local_m(measured.anchor)?;
        let offset_m = self.offsets_m.get(measured.anchor).copied().unwrap_or(0.0);
        let (anchor, distance_m) = (u16::try_from(measured.anchor).ok()?, (measured.range_m - offset_m) as f32);
        let deviation_m = deviation_m(&measured.diagnostics);
        Some(Range { anchor, position_m, distance_m, deviation_m, p_nlos: None, excess_m: None })
    }
}

/// The origin of the locator's coordinates, metres: that of the site, as on a node, where `f32` has hundredths of a
/// millimetre there, else the middle of the anchors.
fn origin_m(anchors: &[Anchor]) -> [f64; 3] {
    /// The greatest coordinate of a site that keeps its origin, metres.
    const NEAR_M: f64 = 128.0;
    let near = |Coordinates { x_m, y_m, z_m }: &Coordinates| {
        [*x_m, *y_m, z_m.unwrap_or(0.0)].iter().all(|coordinate| coordinate.abs() <= NEAR_M)
    };
    if anchors.iter().all(|anchor| near(&anchor.place)) { [0.0; 3] } else { middle_m(anchors) }
}

/// The expected standard deviation of a measurement, metres.
fn deviation_m(diagnostics: &Diagnostics) -> f32 {
    if diagnostics.deviation_m.is_nan() { DEVIATION_M } else { diagnostics.deviation_m }
}

fn reception(diagnostics: &Diagnostics) -> Reception {
    let Diagnostics { features, power_dbm, .. } = *diagnostics;
    Reception { features, power_dbm }
}
