//! `baliza track`: sends a recording through the tag's own locator, one epoch after another in the order of time, in
//! the tag's own `f32`.
//!
//! The input is the ranges with their times. The diagnostics of a reception give the probability that the link is
//! without line of sight (p_nlos), by a trained model or by its powers. The output is the position at the end of every
//! epoch.

use std::borrow::Cow;

use positioning_core::Side;
use positioning_core::engine::{Dimensions, Mode, Range, Settings, Solvers, Tdoa};
use positioning_core::locator::{self, Locator, Reception};
use positioning_core::nlos::{Features, Model};
use positioning_core::{Area, Blocked};

use crate::locate::solve::{Setup, double, middle_m};
use recording::{Anchor, Coordinates, Diagnostics, Epoch, Epochs, Measured, MeasuredDifference, by_time};
use recording::{Half, Height, NoPosition, Position, Solved, Space};

/// Standard deviation of the noise of a DW1000 range in line of sight, metres. The engine models all other range
/// errors.
const DEVIATION_M: f32 = 0.03;
/// The assumed interval between epochs without recorded times, seconds.
const USUAL_S: f64 = 0.1;
/// The engine's time of the first epoch, seconds. It is large so that slightly earlier times are not negative.
const BEGIN_S: f64 = 3600.0;

/// How the powers are used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Weighting {
    /// They move the prior probability that a link is blocked.
    Weigh,
    /// Ranges whose link is more probably blocked than not are left out, but at least four ranges are kept.
    Ignore,
    /// Not at all: all ranges have equal weight.
    Alike,
}

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
        let origin = middle_m(&anchors);
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
        Self { anchors, setup, locator, follows, origin, times_s: None }
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

    fn position(&mut self, epoch: &Epoch) -> Result<Position, NoPosition> {
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
                let Diagnostics { features, power_dbm, .. } = measured.diagnostics;
                let t_us = measured.t_s.map_or(now_us, |t_s| self.clock_us(t_s));
                self.locator.range(t_us, index, range, &Reception { features, power_dbm });
            }
        }
        self.differences(now_us, epoch);
        let measured = epoch.ranges.len() + epoch.differences.len();
        let update = self.locator.end_round(now_us, measured);
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
        let reception = |of: &MeasuredDifference| {
            let Diagnostics { features, power_dbm, .. } = of.diagnostics;
            Reception { features, power_dbm }
        };
        let own =
            |reference: usize| epoch.differences.iter().find(|of| of.anchor == reference && of.reference == reference);
        for (index, difference) in epoch.differences.iter().enumerate() {
            let &MeasuredDifference { reference, anchor, difference_m, .. } = &difference;
            let places = self.local_m(reference).zip(self.local_m(anchor));
            let (Some((reference_m, position_m)), true) = (places, reference != anchor) else { continue };
            let (Ok(reference_address), Ok(anchor)) = (u16::try_from(reference), u16::try_from(anchor)) else {
                continue;
            };
            let tdoa = Tdoa {
                anchor,
                position_m,
                reference: reference_address,
                reference_m,
                difference_m: difference_m as f32,
                deviations_m: [DEVIATION_M; 2],
                p_nlos: [None; 2],
            };
            let unknown = Reception { features: Features::default(), power_dbm: f32::NAN };
            let of_reference = own(reference).map_or(unknown, |of| reception(&of));
            self.locator.tdoa(now_us, index, tdoa, [&of_reference, &reception(&difference)]);
        }
    }

    /// The time of an epoch, on the engine's clock.
    fn microseconds(&mut self, epoch: &Epoch) -> u64 {
        let (first, last) = self.times_s.unwrap_or_else(|| {
            let begin = epoch.t_s.unwrap_or(0.0);
            (begin, begin - USUAL_S)
        });
        let now = epoch.t_s.unwrap_or(last + USUAL_S);
        self.times_s = Some((first, now));
        self.clock_us(now)
    }

    /// A time of the recording, seconds, on the engine's clock.
    fn clock_us(&self, t_s: f64) -> u64 {
        let first_s = self.times_s.map_or(t_s, |(first_s, _)| first_s);
        // The conversion saturates: a float that is too large or negative becomes the largest or the least integer.
        ((t_s - first_s + BEGIN_S) * 1.0e6) as u64
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
        let (anchor, distance_m) = (u16::try_from(measured.anchor).ok()?, measured.range_m as f32);
        Some(Range { anchor, position_m, distance_m, deviation_m: DEVIATION_M, p_nlos: None, excess_m: None })
    }
}
