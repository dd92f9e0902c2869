//! The expected RSSI values before anything is measured nearby: the mean, or path loss through walls (equations 1 and
//! 2 of A. Linde Cerezo's thesis).

use baliza_report::mean;
use positioning_core::ble::path_loss::{PathLoss, Wall, attenuation};

use super::process::apart;
use super::survey::Survey;
use recording::beacons;

/// Height of beacons above or below the receiver where it is not given, metres: no RSSI rises any more nearer than
/// this.
const ABOVE_M: f64 = 1.0;
/// Prior of the exponent: mean and deviation.
const EXPONENT: (f64, f64) = (2.0, 1.0);
/// Deviation of RSSI values about path loss, dB; the exponent's prior is weighed against it.
const SHADOWS_DB: f64 = 4.0;
/// The greatest attenuation that is tried for an unknown wall, dB.
const MOST_DB: u32 = 15;

/// What is known of a site before it is surveyed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plan {
    /// Beacons with known positions.
    pub beacons: Vec<beacons::Beacon>,
    /// The floor plan.
    pub walls: Vec<beacons::Wall>,
}

impl Plan {
    /// The same plan shifted by this, metres.
    pub fn moved(&self, by_m: [f64; 2]) -> Self {
        let mut moved = self.clone();
        let ends = moved.walls.iter_mut().flat_map(|wall| &mut wall.ends_m);
        for place_m in ends.chain(moved.beacons.iter_mut().map(|beacon| &mut beacon.position_m)) {
            *place_m = [place_m[0] + by_m[0], place_m[1] + by_m[1]];
        }
        moved
    }
}

/// The trend of a beacon's RSSI values.
#[derive(Clone, Debug, PartialEq)]
pub enum Trend {
    /// The same everywhere, dBm.
    Level(f64),
    /// Path loss from a known position through known walls.
    Rays {
        /// The beacon's position, metres.
        place_m: [f64; 2],
        /// Its path loss.
        path_loss: PathLoss<f64>,
        /// The floor plan.
        walls: Vec<Wall<f64>>,
    },
}

impl Trend {
    /// The trend at a position, dBm.
    pub fn at(&self, at_m: [f64; 2]) -> f64 {
        match self {
            Self::Level(rssi) => *rssi,
            Self::Rays { place_m, path_loss, walls } => {
                path_loss.level_through(distance(*place_m, at_m), attenuation(walls, *place_m, at_m))
            }
        }
    }

    /// Every beacon's mean RSSI.
    pub fn rssis(survey: &Survey) -> Vec<Self> {
        let fallbacks = survey.fallbacks();
        let mean = |(beacon, fallback): (usize, f64)| {
            let rssis: Vec<f64> = survey.spots.iter().filter_map(|spot| spot.rssis[beacon]).collect();
            Self::Level(if rssis.is_empty() { fallback } else { mean(rssis.iter().copied()) })
        };
        fallbacks.into_iter().enumerate().map(mean).collect()
    }

    /// Path losses that fit the survey, for beacons with known positions; the others keep their mean. Walls without
    /// an attenuation all get the same one, which fits all RSSI values best.
    pub fn rays(survey: &Survey, plan: &Plan) -> Vec<Self> {
        let Plan { beacons, walls } = plan;
        let unknown = walls.iter().any(|wall| wall.attenuation_db.is_none());
        let steps = if unknown { 2 * MOST_DB } else { 0 };
        let tried = (0..=steps).map(|step| {
            let usual_db = f64::from(step) / 2.0;
            let wall =
                |wall: &beacons::Wall| Wall { ends: wall.ends_m, attenuation: wall.attenuation_db.unwrap_or(usual_db) };
            Self::rays_through(survey, beacons, &walls.iter().map(wall).collect::<Vec<_>>())
        });
        tried.min_by(|(_, a), (_, b)| a.total_cmp(b)).map_or_else(|| Self::rssis(survey), |(trends, _)| trends)
    }

    /// The trends through these walls, and the sum of the squared residuals, dB².
    fn rays_through(survey: &Survey, beacons: &[beacons::Beacon], walls: &[Wall<f64>]) -> (Vec<Self>, f64) {
        let mut left = 0.0;
        let trend = |((index, name), usual): ((usize, &String), Self)| {
            let beacon = beacons.iter().find(|beacon| beacon.name == *name)?;
            let place_m = beacon.position_m;
            // RSSI = A − n x, x = 10 lg d, with the attenuation of walls put back.
            let samples: Vec<(f64, f64)> = survey
                .spots
                .iter()
                .filter_map(|spot| {
                    let rssi = spot.rssis[index]? + attenuation(walls, place_m, spot.position_m);
                    Some((10.0 * distance(place_m, spot.position_m).log10(), rssi))
                })
                .collect();
            if samples.is_empty() {
                return Some(usual);
            }
            let count = samples.len() as f64;
            let (x, y) = samples.iter().fold((0.0, 0.0), |(x, y), sample| (x + sample.0 / count, y + sample.1 / count));
            let belief = (SHADOWS_DB / EXPONENT.1).powi(2);
            let (xx, xy) = samples.iter().fold((belief, -belief * EXPONENT.0), |(xx, xy), sample| {
                (xx + (sample.0 - x).powi(2), xy + (sample.0 - x) * (sample.1 - y))
            });
            let exponent = (-xy / xx).max(0.1);
            let level_1m = y + exponent * x;
            left += samples.iter().map(|(x, rssi)| (rssi - level_1m + exponent * x).powi(2)).sum::<f64>();
            let path_loss = PathLoss { level_1m, exponent, ..PathLoss::default() };
            Some(Self::Rays { place_m, path_loss, walls: walls.to_vec() })
        };
        let mut trend = trend;
        let trends = survey.beacons.iter().enumerate().zip(Self::rssis(survey));
        let trends =
            trends.map(|((index, name), usual)| trend(((index, name), usual.clone())).unwrap_or(usual)).collect();
        (trends, left)
    }
}

fn distance(place_m: [f64; 2], at_m: [f64; 2]) -> f64 {
    apart(place_m, at_m).hypot(ABOVE_M)
}

#[cfg(test)]
mod tests {
    use super::super::survey::Spot;
    use super::*;

    #[test]
    fn walls_and_path_loss_are_found_again() {
        // −40 dBm and n = 3 of a beacon at the origin, 6 dB of a wall at x = 5, RSSI values by (2) over √(d² + 1).
        let spot = |x: f64, y: f64| {
            let rssi = -40.0 - 15.0 * (x * x + y * y + 1.0).log10() - if x > 5.0 { 6.0 } else { 0.0 };
            Spot { position_m: [x, y], rssis: vec![Some(rssi)] }
        };
        let spots: Vec<Spot> = (1..20).map(|i| spot(f64::from(i) * 0.7, f64::from(i % 4) - 1.5)).collect();
        let survey = Survey { beacons: vec!["a".to_owned()], spots };
        let beacon = beacons::Beacon {
            name: "a".to_owned(),
            position_m: [0.0, 0.0],
            height_m: None,
            rssi_1m_dbm: None,
            path_loss_exponent: None,
            deviation_db: None,
        };
        let walls = [beacons::Wall { ends_m: [[5.0, -20.0], [5.0, 20.0]], attenuation_db: None }];
        let trends = Trend::rays(&survey, &Plan { beacons: vec![beacon], walls: walls.to_vec() });
        let [Trend::Rays { path_loss, walls: found, .. }] = &trends[..] else { panic!("{trends:?}") };
        // The prior of the exponent pulls a little toward 2.
        assert!((path_loss.exponent - 3.0).abs() < 0.15 && (path_loss.level_1m + 40.0).abs() < 1.5, "{path_loss:?}");
        assert!((found[0].attenuation - 6.0).abs() <= 1.0, "{found:?}");
        // Without its position there is only the mean.
        let mean = survey.spots.iter().filter_map(|spot| spot.rssis[0]).sum::<f64>() / 19.0;
        let Trend::Level(rssi) = Trend::rays(&survey, &Plan { beacons: Vec::new(), walls: walls.to_vec() })[0] else {
            panic!("no place")
        };
        assert!((rssi - mean).abs() < 1e-9);
    }
}
