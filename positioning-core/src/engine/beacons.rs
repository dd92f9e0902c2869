//! Levels of beacons: how a round of them becomes a position.
//!
//! Their distances are good to a factor of two, so that a filter that took them one by one, each straightened about where it believes
//! the tag to be, ends beside a mirror image as often as not. They are solved together instead, by their logarithms, and the track
//! gets the position, which is straight, with an error that lasts as shadows do: a state of its own for each axis. That is in the
//! plane; in space, where beacons at about one height tell little, they are taken one by one.

use super::Engine;
use super::measurement::{BeaconPosition, BleRange};
use super::round::Round;
use super::settings::{Dimensions, Settings};
use crate::ble::multilateration::{self, Heard};
use crate::ble::path_loss::PathLoss;
use crate::{AnchorSet, Area, Constraints, Fix, MAX_ANCHORS, NoFix, Real, Side};
use heapless::Vec;

/// dB of a natural logarithm of power.
const DB: f64 = 10.0 / core::f64::consts::LN_10;

/// How far all levels may be off by one amount, dB for each unit of a path-loss exponent: 6 dB at an exponent of 2, of which another
/// receiver is some 4, and the rest the body that carries it and the walls around. A position that has to explain it by itself goes
/// astray: 2.5 m instead of 2.0 m in the simulated room of `examples/beacons.toml`, 4.1 m instead of 2.8 m where two walls are in
/// the way.
const COMMON_DB: f64 = 3.0;

/// Of so many beacons or more, one may be left out: one that was moved, or is louder than it says.
const TO_SPARE: usize = 5;
/// Where levels agree by less than this, 0 to 1, one of them is looked for that spoils it.
const DOUBTFUL: f64 = 0.75;

/// A round's position by beacons, or why there is none.
type Solve<T> = fn(&Round<T>, &Settings<T>) -> Result<Fix<T, 3>, NoFix>;

/// How levels of beacons are heeded. Functions, as in [`Solvers`](super::Solvers): an image without Bluetooth holds none of them.
#[derive(Clone, Copy, Debug)]
pub struct Beacons<T> {
    pub(super) solve: Solve<T>,
    pub(super) admit: fn(&mut Engine<T>),
}

impl Beacons<f32> {
    /// [`heeded`](Self::heeded), compiled in this crate, as [`Engine::step_on_node`] is.
    #[inline(never)]
    pub fn on_node() -> Self {
        Self::heeded()
    }
}

impl<T: Real> Beacons<T> {
    /// They make positions where nothing else does, and go into the track.
    pub fn heeded() -> Self {
        Self {
            solve: |round, settings| round.solve_beacons(settings).map(|by_beacons| by_beacons.fix),
            admit: Engine::admit_beacons,
        }
    }
}

/// A round's position by beacons.
#[derive(Clone, Copy, Debug)]
pub(super) struct ByBeacons<T> {
    pub(super) fix: Fix<T, 3>,
    /// The share of the variances that stays with the place.
    pub(super) lasting: T,
}

impl<T: Real> BleRange<T> {
    /// The standard deviation of the distance's logarithm, all its errors together.
    fn deviation(&self) -> T {
        (self.relative_deviation.squared() + self.lasting_deviation.squared()).sqrt()
    }

    /// As a level: that of a beacon with 0 dBm at 1 m and an exponent of 1.
    fn heard(&self, height: T) -> Heard<T, 2> {
        let db = T::of(DB);
        let path_loss = PathLoss { level_1m: T::ZERO, exponent: T::ONE, deviation: db * self.deviation() };
        let level = path_loss.level(self.distance);
        Heard { place: [self.place[0], self.place[1]], above: self.place[2] - height, level, path_loss }
    }
}

impl<T: Real> BeaconPosition<T> {
    /// Of a tag at this height. Whoever located it has judged the levels.
    fn at(&self, height: T) -> ByBeacons<T> {
        let ([x, y], [xx, xy, yy], zero) = (self.position, self.covariance, T::ZERO);
        let fix = Fix {
            position: [x, y, height],
            covariance: [[xx, xy, zero], [xy, yy, zero], [zero; 3]],
            dilution_of_precision: [zero; 3],
            used: AnchorSet(0),
            quality: T::ONE,
        };
        ByBeacons { fix, lasting: self.lasting }
    }
}

impl<T: Real> Round<T> {
    /// The position by beacons alone.
    #[inline(never)]
    pub(super) fn solve_beacons(&self, settings: &Settings<T>) -> Result<ByBeacons<T>, NoFix> {
        if let (Some(located), Dimensions::Plane { height }) = (&self.by_beacons, settings.dimensions) {
            return Ok(located.at(height));
        }
        let (mut lasting, mut all) = (T::ZERO, T::ZERO);
        for beacon in &self.beacons {
            lasting += beacon.lasting_deviation.squared();
            all += beacon.deviation().squared();
        }
        let fix = match settings.dimensions {
            Dimensions::Plane { height } => self.beacons_in_plane(settings, height)?,
            Dimensions::Space { .. } => self.beacons_as_ranges(settings)?,
        };
        Ok(ByBeacons { fix, lasting: lasting / all.at_least(T::EPSILON) })
    }

    fn beacons_in_plane(&self, settings: &Settings<T>, height: T) -> Result<Fix<T, 3>, NoFix> {
        let heard: Vec<Heard<T, 2>, MAX_ANCHORS> = self.beacons.iter().map(|beacon| beacon.heard(height)).collect();
        let area = settings.area.map(|area| Area { min: [area.min[0], area.min[1]], max: [area.max[0], area.max[1]] });
        let constraints = Constraints { side: Side::Unknown, area };
        let solve = |heard: &[Heard<T, 2>]| multilateration::nonlinear(heard, T::of(COMMON_DB), &constraints);
        let mut fix = solve(&heard)?;
        if heard.len() >= TO_SPARE && fix.quality < T::of(DOUBTFUL) {
            // What the levels agree in all: whoever disagrees with more than it adds is left out.
            let mut agreement = fix.quality * T::count(heard.len());
            for left_out in 0..heard.len() {
                let others = heard.iter().enumerate().filter(|(place, _)| *place != left_out);
                let others: Vec<Heard<T, 2>, MAX_ANCHORS> = others.map(|(_, heard)| *heard).collect();
                if let Ok(other) = solve(&others)
                    && other.quality * T::count(others.len()) > agreement
                {
                    agreement = other.quality * T::count(others.len());
                    fix = other;
                }
            }
        }
        let [x, y] = fix.position;
        let mut covariance = [[T::ZERO; 3]; 3];
        for (row, of) in covariance.iter_mut().zip(&fix.covariance) {
            [row[0], row[1]] = *of;
        }
        let [dx, dy] = fix.dilution_of_precision;
        let dilution_of_precision = [dx, dy, T::ZERO];
        let Fix { used, quality, .. } = fix;
        Ok(Fix { position: [x, y, height], covariance, dilution_of_precision, used, quality })
    }
}
