//! RSSI values over a grid: interpolated between fingerprints, or simulated from beacons and walls.

use baliza_report::{mean, rms};
use positioning_core::ble::path_loss::{PathLoss, Wall};

use super::bound::{Information, Noise, Station};
use super::grid::Grid;
use crate::locate::ble::{means, path_loss};
use recording::beacons::{self, Beacon, Dwell};

/// Attenuation of a wall with no attenuation given, dB: a light partition.
pub const USUAL_WALL_DB: f64 = 4.0;
/// A cell counts as not measured where the nearest fingerprint is farther than this, metres.
const FARTHEST_M: f64 = 3.0;
/// Two positions closer than this count as one, metres.
const NEAREST_M: f64 = 0.1;

/// RSSI values over a grid.
#[derive(Clone, Debug, PartialEq)]
pub struct CoverageMap {
    /// The cells.
    pub grid: Grid,
    /// Names of the beacons.
    pub beacons: Vec<String>,
    /// For each cell one RSSI a beacon, dBm, `None` where the beacon is not received; `None` for a cell that was not
    /// measured.
    pub rssis: Vec<Option<Vec<Option<f64>>>>,
}

/// How far a simulation is from the measurements.
#[derive(Clone, Debug, PartialEq)]
pub struct Fitted {
    /// The beacon.
    pub beacon: String,
    /// Mean of simulated minus measured, dB.
    pub bias_db: f64,
    /// Root of the mean square, dB.
    pub rms_db: f64,
    /// Number of points that receive it.
    pub points: usize,
}

/// Walls as the core represents them; walls of unknown attenuation get `usual_db`.
pub fn walls_of(walls: &[beacons::Wall], usual_db: f64) -> Vec<Wall<f64>> {
    walls.iter().map(|wall| Wall { ends: wall.ends_m, attenuation: wall.attenuation_db.unwrap_or(usual_db) }).collect()
}

impl Station {
    /// The station of a beacon in the file.
    pub fn of(beacon: &Beacon) -> Self {
        let PathLoss { level_1m, exponent, deviation } = path_loss(beacon);
        let path_loss =
            PathLoss { level_1m: f64::from(level_1m), exponent: f64::from(exponent), deviation: f64::from(deviation) };
        Self { at_m: beacon.position_m, path_loss }
    }
}

impl CoverageMap {
    /// Interpolates between fingerprints, with weights by the inverse square of the distance (Shepard). Where the
    /// points that received a beacon have less than half of the weight, the beacon counts as not received.
    pub fn measured(grid: Grid, beacons: &[Beacon], stays: &[Dwell]) -> Self {
        let heard: Vec<_> = stays.iter().map(|stay| (stay.position_m, means(beacons, &stay.samples))).collect();
        let cell = |at: [f64; 2]| {
            let distances = heard.iter().map(|(place, _)| (place[0] - at[0]).hypot(place[1] - at[1]).max(NEAREST_M));
            let distances: Vec<f64> = distances.collect();
            let nearest = distances.iter().copied().fold(f64::INFINITY, f64::min);
            (nearest <= FARTHEST_M).then(|| {
                let rssi = |beacon: usize| {
                    let (mut all, mut weights, mut sum) = (0.0, 0.0, 0.0);
                    for (distance, (_, rssis)) in distances.iter().zip(&heard) {
                        let weight = distance.powi(-2);
                        all += weight;
                        if let Some(rssi) = rssis.get(beacon).copied().flatten() {
                            weights += weight;
                            sum += weight * f64::from(rssi);
                        }
                    }
                    (weights > 0.5 * all).then(|| sum / weights)
                };
                (0..beacons.len()).map(rssi).collect()
            })
        };
        Self { grid, beacons: names(beacons), rssis: grid.middles().map(cell).collect() }
    }

    /// Simulates beacons behind walls; RSSI values below the sensitivity are not received.
    pub fn simulated(grid: Grid, beacons: &[Beacon], walls: &[Wall<f64>], sensitivity_dbm: f64) -> Self {
        let stations: Vec<Station> = beacons.iter().map(Station::of).collect();
        let cell = |at: [f64; 2]| {
            let rssi = |station: &Station| Some(station.rssi(at, walls)).filter(|rssi| *rssi >= sensitivity_dbm);
            Some(stations.iter().map(rssi).collect())
        };
        Self { grid, beacons: names(beacons), rssis: grid.middles().map(cell).collect() }
    }

    /// One number a cell.
    pub fn values(&self, of: impl Fn(&[Option<f64>]) -> Option<f64>) -> Vec<Option<f64>> {
        self.rssis.iter().map(|rssis| rssis.as_deref().and_then(&of)).collect()
    }

    /// The number of beacons received in each cell.
    pub fn heard(&self) -> Vec<Option<f64>> {
        self.values(|rssis| Some(rssis.iter().flatten().count() as f64))
    }

    /// The mean RSSI of all beacons in each cell, with the sensitivity for those that are not received, dBm (figure
    /// 4.4 of A. Linde Cerezo's thesis).
    pub fn mean(&self, sensitivity_dbm: f64) -> Vec<Option<f64>> {
        self.values(|rssis| {
            let sum: f64 = rssis.iter().map(|rssi| rssi.unwrap_or(sensitivity_dbm)).sum();
            Some(sum / rssis.len() as f64)
        })
    }
}

/// The least error of a position in each cell, metres: see [`super::bound`].
pub fn errors_m(grid: Grid, stations: &[Station], walls: &[Wall<f64>], noise: Noise) -> Vec<f64> {
    let [least, greatest] = grid.corners_m();
    let area = Information::of_area([greatest[0] - least[0], greatest[1] - least[1]]);
    let error = |at: [f64; 2]| {
        let told = stations.iter().filter_map(|station| station.information(at, walls, noise));
        told.fold(area, Information::and).error_m()
    };
    grid.middles().map(error).collect()
}

/// How far the path losses of beacons are from the measurements at the points.
pub fn fitted(beacons: &[Beacon], walls: &[Wall<f64>], stays: &[Dwell]) -> Vec<Fitted> {
    let measured: Vec<_> = stays.iter().map(|stay| (stay.position_m, means(beacons, &stay.samples))).collect();
    let of = |(index, beacon): (usize, &Beacon)| {
        let station = Station::of(beacon);
        let errors: Vec<f64> = measured
            .iter()
            .filter_map(|(at, rssis)| Some(station.rssi(*at, walls) - f64::from((*rssis.get(index)?)?)))
            .collect();
        (!errors.is_empty()).then(|| Fitted {
            beacon: beacon.name.clone(),
            bias_db: mean(errors.iter().copied()),
            rms_db: rms(errors.iter().copied()),
            points: errors.len(),
        })
    };
    beacons.iter().enumerate().filter_map(of).collect()
}

fn names(beacons: &[Beacon]) -> Vec<String> {
    beacons.iter().map(|beacon| beacon.name.clone()).collect()
}

#[cfg(test)]
mod tests {
    use positioning_core::ble::path_loss::Wall;

    use super::{CoverageMap, errors_m, fitted};
    use crate::survey::coverage::Grid;
    use crate::survey::coverage::bound::{Noise, Station};
    use recording::beacons::{Beacon, Dwell, Sample};

    fn beacon(name: &str, position_m: [f64; 2]) -> Beacon {
        Beacon {
            name: name.to_owned(),
            position_m,
            height_m: None,
            rssi_1m_dbm: Some(-60.0),
            path_loss_exponent: Some(2.0),
            deviation_db: None,
        }
    }

    fn stay(position_m: [f64; 2], rssis: &[(&str, f64)]) -> Dwell {
        let samples = rssis.iter().map(|(beacon, rssi)| Sample { beacon: (*beacon).into(), rssi_dbm: *rssi, t_s: 0.0 });
        Dwell { point: format!("{position_m:?}"), room: None, position_m, samples: samples.collect() }
    }

    fn grid() -> Grid {
        // Centres at 1, 3 and 9 m.
        Grid { least_m: [0.0, -1.0], cell_m: 2.0, columns: 5, rows: 1 }
    }

    #[test]
    fn between_two_points_a_level_is_interpolated() {
        let beacons = [beacon("a", [0.0, 0.0]), beacon("b", [0.0, 9.0])];
        let map = CoverageMap::measured(
            grid(),
            &beacons,
            &[stay([0.0, 0.0], &[("a", -60.0), ("b", -70.0)]), stay([4.0, 0.0], &[("a", -80.0)])],
        );
        // At 1 m: weights 1 and 1/9: (−60 − 80/9) ⁄ (10/9) = −62; b has 0.9 of the weights. At 3 m it has 0.1.
        let cell = |index: usize| map.rssis[index].clone().expect("measured");
        assert!((cell(0)[0].expect("heard") + 62.0).abs() < 1e-9 && cell(0)[1] == Some(-70.0));
        assert!((cell(1)[0].expect("heard") + 78.0).abs() < 1e-9 && cell(1)[1].is_none());
        assert_eq!(map.rssis[4], None, "5 m from the nearest point");
        assert_eq!(map.heard()[..2], [Some(2.0), Some(1.0)]);
        assert!((map.mean(-90.0)[1].expect("measured") + 84.0).abs() < 1e-9);
    }

    #[test]
    fn a_simulated_level_ends_at_the_sensitivity() {
        let walls = [Wall { ends: [[2.0, -5.0], [2.0, 5.0]], attenuation: 6.0 }];
        let beacons = [beacon("a", [0.0, 0.0])];
        let map = CoverageMap::simulated(grid(), &beacons, &walls, -80.0);
        // −60 at 1 m; −60 − 20 log₁₀ 3 − 6 = −75.542425 at 3 m; −60 − 19.084850 − 6 = −85.08 at 9 m.
        let rssi = |index: usize| map.rssis[index].as_ref().and_then(|rssis| rssis[0]);
        assert!(rssi(0) == Some(-60.0) && (rssi(1).expect("heard") + 75.542_425).abs() < 1e-4 && rssi(4).is_none());
        let fit =
            fitted(&beacons, &walls, &[stay([3.0, 0.0], &[("a", -74.542_425)]), stay([1.0, 0.0], &[("a", -63.0)])]);
        assert!((fit[0].bias_db - 1.0).abs() < 1e-4 && (fit[0].rms_db - 5.0_f64.sqrt()).abs() < 1e-4, "{fit:?}");
        assert_eq!(fit[0].points, 2);
    }

    #[test]
    fn where_nothing_is_heard_the_error_is_that_of_the_area() {
        let stations = [Station::of(&beacon("a", [0.0, 0.0]))];
        let errors = errors_m(grid(), &stations, &[], Noise::Level { sensitivity_dbm: -61.0 });
        // √(10² ⁄ 12 + 2² ⁄ 12) = 2.943920.
        assert!((errors[4] - 2.943_920).abs() < 1e-6 && errors[0] < errors[4]);
    }
}
