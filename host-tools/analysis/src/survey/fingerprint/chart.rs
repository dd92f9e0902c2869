//! Exports a process as a map for the node: the expected RSSI values on a lattice, with their deviations.
//!
//! A position's likelihood takes the errors of the beacons at one position for independent. Walls and furniture between
//! surveyed points shade several beacons together, most of all where points are few. The surveyed points, each located by
//! the others, tell by how much positions are farther off than the posterior says.

use std::collections::HashMap;

use positioning_core::ble::fingerprint::{MAX_NODE_POINTS, Map, MapError, Point, Receiver, locate};

use super::process::{LeftOutPoint, Process, apart};
use super::survey::{Survey, to_bytes};

/// How far beyond the surveyed points a receiver may be, metres.
const MARGIN_M: f64 = 0.25;
/// The least step, metres: a finer one adds nothing.
const LEAST_STEP_M: f64 = 0.25;
/// Largest distance of a lattice point from a surveyed one, in multiples of the surveyed points' spacing; what is
/// farther counts as a wall.
const REACH: f64 = 2.0;
/// Least value of that distance, where surveyed points are close to each other, metres.
const LEAST_REACH_M: f64 = 0.5;
/// Points that are left out, at most.
const MOST_LEFT_OUT: usize = 100;

/// The shape of the lattice.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Grid {
    /// Largest number of points; a node has room for [`MAX_NODE_POINTS`], which is the default.
    pub most: Option<usize>,
    /// The step, metres; without it the step is as small as the number of points allows.
    pub step_m: Option<f64>,
}

/// The map of a process over the surveyed area, and by how much the covariances of positions by it are greater than the
/// posterior has them.
///
/// # Errors
/// There are no points, too many beacons, or more lattice points than allowed.
pub fn chart(survey: &Survey, process: &Process, grid: Grid) -> Result<(Vec<u8>, f64), MapError> {
    let most = grid.most.unwrap_or(MAX_NODE_POINTS);
    let area = Area::of(survey.spots.iter().map(|spot| spot.position_m).collect());
    let (step_m, points_m) = match grid.step_m {
        Some(step_m) => (step_m, area.lattice(step_m)),
        None => {
            // Whole millimetres, as in the map.
            let steps = (0..).map(|power| (LEAST_STEP_M * 1.05_f64.powi(power) * 1000.0).round() / 1000.0);
            let mut tried = steps.map(|step_m| (step_m, area.lattice(step_m)));
            tried.find(|(_, points_m)| points_m.len() <= most).ok_or(MapError::Invalid)?
        }
    };
    if points_m.len() > most {
        return Err(MapError::TooLong);
    }
    let lattice = Lattice { survey, step_m, points_m };
    let map = lattice.map(|beacon, point| process.predict(beacon, lattice.points_m[point]))?;
    Ok((map, lattice.excess(process)?))
}

/// The points of a map of a survey.
struct Lattice<'a> {
    survey: &'a Survey,
    step_m: f64,
    points_m: Vec<[f64; 2]>,
}

impl Lattice<'_> {
    /// The map of RSSI values and deviations by beacon and point.
    fn map(&self, predict: impl Fn(usize, usize) -> (f64, f64)) -> Result<Vec<u8>, MapError> {
        let predicted: Vec<(Vec<Option<f64>>, Vec<f64>)> = (0..self.points_m.len())
            .map(|point| {
                let rssis = (0..self.survey.beacons.len()).map(|beacon| predict(beacon, point));
                rssis.map(|(rssi, deviation)| (Some(rssi.clamp(-127.0, -1.0)), deviation)).unzip()
            })
            .collect();
        let points: Vec<Point> = self
            .points_m
            .iter()
            .copied()
            .zip(&predicted)
            .map(|(at_m, (rssis, deviations))| Point { position_m: at_m, rssis, deviations })
            .collect();
        to_bytes(&points, &self.survey.identities(), &self.survey.fallbacks(), Some(self.step_m))
    }

    /// By how much the squared errors of left-out points are greater than the posterior says, at least 1.
    fn excess(&self, process: &Process) -> Result<f64, MapError> {
        let places_m = process.places_m(MOST_LEFT_OUT);
        let beacons = 0..self.survey.beacons.len();
        let left_out: Vec<Vec<LeftOutPoint>> =
            beacons.map(|beacon| process.left_out(beacon, &places_m, &self.points_m)).collect();
        let (mut squares, mut count) = (0.0, 0.0);
        for (cell, place_m) in places_m.iter().enumerate() {
            let bytes = self.map(|beacon, point| left_out[beacon][cell].predicted[point])?;
            let scan: Vec<Option<f64>> = left_out.iter().map(|beacon| beacon[cell].rssi).collect();
            let Ok(found) = locate(&Map::decode(&bytes)?.0, &scan, &Receiver::default()) else { continue };
            let [dx, dy] = [0, 1].map(|axis| found.position[axis] - place_m[axis]);
            let [xx, xy, yy] = found.covariance;
            squares += (dx * dx * yy - 2.0 * dx * dy * xy + dy * dy * xx) / (xx * yy - xy * xy);
            count += 1.0;
        }
        // In two dimensions the mean is 2 where the covariance is right, and the relative deviation of the mean of n squares
        // is n^−½: few points do not excuse a covariance.
        Ok((squares / (2.0 * count) * (1.0 + f64::sqrt(1.0 / count))).max(1.0))
    }
}

/// The surveyed area.
struct Area {
    /// The least and the greatest coordinate along each axis, with the margin, metres.
    sides_m: [[f64; 2]; 2],
    /// How far from a surveyed position a point of the lattice may be, metres.
    reach_m: f64,
    /// The surveyed positions by squares of that side, so that only near ones are looked at.
    squares: HashMap<[i64; 2], Vec<[f64; 2]>>,
}

impl Area {
    fn of(places_m: Vec<[f64; 2]>) -> Self {
        let side = |axis: usize| {
            let along = || places_m.iter().map(move |place_m| place_m[axis]);
            let (low, high) = (along().fold(f64::INFINITY, f64::min), along().fold(f64::NEG_INFINITY, f64::max));
            [low - MARGIN_M, high + MARGIN_M]
        };
        let reach_m = (REACH * spacing(&places_m)).max(LEAST_REACH_M);
        let sides_m = [side(0), side(1)];
        let mut area = Self { sides_m, reach_m, squares: HashMap::new() };
        for place_m in places_m {
            area.squares.entry(area.square(place_m)).or_default().push(place_m);
        }
        area
    }

    fn square(&self, at_m: [f64; 2]) -> [i64; 2] {
        at_m.map(|c| (c / self.reach_m).floor() as i64)
    }

    /// Whether a surveyed position is in reach.
    fn is_near(&self, at_m: [f64; 2]) -> bool {
        let [column, row] = self.square(at_m);
        let near = (column - 1..=column + 1).flat_map(|column| (row - 1..=row + 1).map(move |row| [column, row]));
        near.filter_map(|square| self.squares.get(&square))
            .flatten()
            .any(|place_m| apart(*place_m, at_m) <= self.reach_m)
    }

    /// Points of a lattice around the middle of the area, column by column; fewer than 255 each way.
    fn lattice(&self, step_m: f64) -> Vec<[f64; 2]> {
        let [xs, ys] = self.sides_m.map(|[low, high]| {
            // Each point represents a square of the step's side.
            let count = (((high - low) / step_m).ceil() as usize).clamp(1, 255);
            (0..count)
                .map(move |at| (low + high) / 2.0 + (at as f64 - (count - 1) as f64 / 2.0) * step_m)
                .collect::<Vec<_>>()
        });
        let all = xs.iter().flat_map(|x| ys.iter().map(|y| [*x, *y]));
        all.filter(|at_m| self.is_near(*at_m)).collect()
    }
}

/// The median distance from a position to the next other one, metres; positions that coincide do not count.
fn spacing(places_m: &[[f64; 2]]) -> f64 {
    // Of thousands of positions, some hundreds give the same median.
    let some = places_m.iter().step_by(1 + places_m.len() / 500);
    let mut next: Vec<f64> = some
        .map(|a| places_m.iter().map(|b| apart(*a, *b)).filter(|apart_m| *apart_m > 0.1).fold(f64::INFINITY, f64::min))
        .filter(|next| next.is_finite())
        .collect();
    next.sort_by(f64::total_cmp);
    next.get(next.len() / 2).copied().unwrap_or(1.0)
}
