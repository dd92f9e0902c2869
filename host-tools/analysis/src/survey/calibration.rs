//! Path loss of every beacon from RSSI values at known points: what `baliza calibrate path-loss` does.
//!
//! The input is dwells at known points, or a walk cut into pieces of a metre. Each point counts once, with the mean
//! of its RSSI values (section 4.3.1). The output is the RSSI at one metre and the exponent of every beacon, by
//! regression on (1). The numbers of sections, tables and equations are those of A. Linde Cerezo's thesis.
//!
//! The regression is robust against points in a shadow (Huber's weights). Its prior is so wide that it matters only
//! for a handful of points. The output also has what a node at known positions learns, point by point in their order
//! ([`OnlinePathLoss`]).

use std::collections::HashMap;

use baliza_report::mean;
use positioning_core::ble::path_loss::{OnlinePathLoss, PathLoss, Wall, attenuation};

use recording::beacons::{self as files, Beacon, Capture, Dwell, rssis_by_beacon};

/// Shorter distances count as this one, metres.
const NEAREST_M: f64 = 0.1;
/// Bounds of an exponent.
const EXPONENTS: (f64, f64) = (0.5, 6.0);
/// Prior: standard deviations of the exponent, and of the RSSI at one metre, dB.
const PRIOR: (f64, f64) = (2.0, 30.0);
/// Prior of a node for a beacon it has not received yet: standard deviations of the RSSI at one metre, dB, and of the
/// exponent.
const UNKNOWN: (f64, f64) = (8.0, 0.7);
/// A piece of a walk, metres.
const PIECE_M: f64 = 1.0;
/// The prior of the deviation counts as this number of points.
const BELIEF: f64 = 2.0;
/// A residual of more than this number of deviations weighs less (P. Huber, *Robust Statistics*, 1981).
const HUBER: f64 = 1.5;
/// How many attenuations of a wall are tried, in steps of half a dB.
pub const WALL_STEPS: u32 = 31;
/// Rounds of weighing.
const ROUNDS: usize = 20;

/// RSSI of a beacon at one point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RssiAtDistance {
    /// Metres.
    pub distance_m: f64,
    /// Mean RSSI, dBm, with the attenuation of walls put back.
    pub rssi_dbm: f64,
    /// Standard deviation of the distance, metres.
    pub distance_sigma_m: f64,
}

/// A path loss that was learnt point by point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Learnt {
    /// The path loss; its deviation is the root mean square of how far the points are from it.
    pub path_loss: PathLoss<f64>,
    /// Standard deviations of the RSSI at one metre, dB, and of the exponent.
    pub sigma: [f64; 2],
}

/// RSSI values at a position, and the standard deviation of the position, metres.
pub type Placed = (Dwell, f64);

/// A position of a walk.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Step {
    /// Metres.
    pub position_m: [f64; 2],
    /// Standard deviation of an axis, metres.
    pub sigma_m: f64,
}

/// The path loss of one beacon.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibrated {
    /// The beacon.
    pub beacon: String,
    /// Points at which it was received.
    pub points: Vec<RssiAtDistance>,
    /// Its path loss; `None` where it was never received.
    pub path_loss: Option<PathLoss<f64>>,
    /// Standard deviations of the RSSI at one metre, dB, and of the exponent.
    pub sigma: [f64; 2],
    /// What a node learns point by point; `None` where the beacon was never received.
    pub online: Option<Learnt>,
}

/// Cuts a walk into pieces of a metre of way. RSSI values received without moving share a shadow, so that they count
/// once. Captures without a position are left out.
pub fn pieces(captures: &[Capture], step: impl Fn(&Capture) -> Option<Step>) -> Vec<Placed> {
    let mut pieces: Vec<Placed> = Vec::new();
    // Where the last piece began, and the number of positions in its mean.
    let (mut began, mut count) = ([f64::NAN; 2], 0.0);
    for (capture, step) in captures.iter().filter_map(|capture| Some((capture, step(capture)?))) {
        let [x, y] = step.position_m;
        let goes_on = (began[0] - x).hypot(began[1] - y) < PIECE_M;
        match pieces.last_mut().filter(|_| goes_on) {
            Some((piece, sigma_m)) => {
                count += 1.0;
                for (mean, at) in piece.position_m.iter_mut().zip(step.position_m) {
                    *mean += (at - *mean) / count;
                }
                piece.samples.extend(capture.samples.iter().cloned());
                *sigma_m = sigma_m.max(step.sigma_m);
            }
            None => {
                (began, count) = (step.position_m, 1.0);
                let (point, samples) = (capture.name.clone(), capture.samples.clone());
                // The RSSI values of a piece come from half a metre around its position.
                let sigma_m = step.sigma_m.hypot(PIECE_M / 4.0);
                pieces.push((Dwell { point, room: None, position_m: step.position_m, samples }, sigma_m));
            }
        }
    }
    pieces
}

/// Calibrates every beacon, in their order. Heights of beacons count where the height of the tag is known. The
/// attenuation of the given walls is put back into the RSSI values (2); a wall of unknown attenuation counts
/// `wall_db`.
pub fn calibrate(
    beacons: &[Beacon],
    stays: &[Placed],
    height_m: Option<f64>,
    walls: &[files::Wall],
    wall_db: f64,
) -> Vec<Calibrated> {
    let links = links(beacons, stays, height_m, walls);
    let calibrated = |(beacon, links): (&Beacon, &Vec<Link>)| {
        let points: Vec<RssiAtDistance> = links.iter().map(|link| link.behind(wall_db)).collect();
        let fitted = fit(&points);
        Calibrated {
            beacon: beacon.name.clone(),
            online: learn(&points),
            points,
            path_loss: fitted.map(|(path_loss, _)| path_loss),
            sigma: fitted.map_or([0.0; 2], |(_, sigma)| sigma),
        }
    };
    beacons.iter().zip(&links).map(calibrated).collect()
}

/// Attenuation of a wall, dB, in steps of half a decibel: the most likely one given all RSSI values.
pub fn wall_attenuation(
    beacons: &[Beacon],
    stays: &[Placed],
    height_m: Option<f64>,
    walls: &[files::Wall],
    step: impl Fn(),
) -> f64 {
    let links = links(beacons, stays, height_m, walls);
    let likelihood = |half: u32| {
        step();
        let of_one = |links: &Vec<Link>| {
            let points: Vec<RssiAtDistance> = links.iter().map(|link| link.behind(f64::from(half) / 2.0)).collect();
            fit(&points).map(|(path_loss, _)| -(points.len() as f64) * path_loss.deviation.ln())
        };
        links.iter().filter_map(of_one).sum::<f64>()
    };
    let most = (0..WALL_STEPS).map(|half| (half, likelihood(half))).max_by(|a, b| a.1.total_cmp(&b.1));
    most.map_or(0.0, |(half, _)| f64::from(half) / 2.0)
}

/// What was received of a beacon at one point.
struct Link {
    /// Without the attenuation of walls whose attenuation is not known.
    received: RssiAtDistance,
    /// The number of these walls.
    unknown_walls: f64,
}

impl Link {
    /// The RSSI without any wall, if a wall of unknown attenuation takes `wall_db`.
    fn behind(&self, wall_db: f64) -> RssiAtDistance {
        RssiAtDistance { rssi_dbm: self.received.rssi_dbm + self.unknown_walls * wall_db, ..self.received }
    }
}

/// The links to each beacon, in the order of the points.
fn links(beacons: &[Beacon], stays: &[Placed], height_m: Option<f64>, walls: &[files::Wall]) -> Vec<Vec<Link>> {
    let of_walls = |attenuation: fn(&files::Wall) -> f64| -> Vec<Wall<f64>> {
        walls.iter().map(|wall| Wall { ends: wall.ends_m, attenuation: attenuation(wall) }).collect()
    };
    let known = of_walls(|wall| wall.attenuation_db.unwrap_or(0.0));
    let unknown = of_walls(|wall| if wall.attenuation_db.is_none() { 1.0 } else { 0.0 });
    let places: HashMap<&str, usize> = beacons.iter().enumerate().map(|(at, b)| (b.name.as_str(), at)).collect();
    let mut links: Vec<Vec<Link>> = beacons.iter().map(|_| Vec::new()).collect();
    for (stay, distance_sigma_m) in stays {
        for (name, rssis) in rssis_by_beacon(&stay.samples) {
            let Some(&at) = places.get(name) else { continue };
            let beacon = &beacons[at];
            let up = beacon.height_m.zip(height_m).map_or(0.0, |(beacon, tag)| beacon - tag);
            let [x, y] = [0, 1].map(|axis: usize| stay.position_m[axis] - beacon.position_m[axis]);
            let distance_m = (x * x + y * y + up * up).sqrt().max(NEAREST_M);
            let through = |walls: &[Wall<f64>]| attenuation(walls, beacon.position_m, stay.position_m);
            let rssi_dbm = mean(rssis.iter().copied()) + through(&known);
            let received = RssiAtDistance { distance_m, rssi_dbm, distance_sigma_m: *distance_sigma_m };
            links[at].push(Link { received, unknown_walls: through(&unknown) });
        }
    }
    links
}

/// What the node's own estimator learns from points in their order; `None` without points.
fn learn(points: &[RssiAtDistance]) -> Option<Learnt> {
    let mut online = OnlinePathLoss::<f64>::new(PathLoss::default(), UNKNOWN.0, UNKNOWN.1);
    for point in points {
        online.learn(point.rssi_dbm, point.distance_m, point.distance_sigma_m);
    }
    let found = *online.model();
    let squares = points.iter().map(|point| (point.rssi_dbm - found.rssi(point.distance_m)).powi(2)).sum::<f64>();
    let deviation = (squares / points.len() as f64).sqrt();
    (!points.is_empty()).then(|| Learnt { path_loss: PathLoss { deviation, ..found }, sigma: online.deviations() })
}

/// Regression of RSSI values on 10 log₁₀ d; `None` without points.
pub fn fit(points: &[RssiAtDistance]) -> Option<(PathLoss<f64>, [f64; 2])> {
    if points.is_empty() {
        return None;
    }
    let usual = PathLoss::<f64>::default();
    let mut model = usual;
    let mut sigma = [0.0; 2];
    let mut weights = vec![1.0; points.len()];
    for _ in 0..ROUNDS {
        // Normal equations of RSSI₁ − n x, about the prior.
        let variance = model.deviation.powi(2);
        let (exponent, rssi) = (variance / PRIOR.0.powi(2), variance / PRIOR.1.powi(2));
        let (mut sum, mut x, mut xx) = (rssi, 0.0, exponent);
        let (mut z, mut xz) = (rssi * usual.level_1m, -exponent * usual.exponent);
        for (point, weight) in points.iter().zip(&weights) {
            let log = 10.0 * point.distance_m.log10();
            sum += weight;
            x += weight * log;
            xx += weight * log * log;
            z += weight * point.rssi_dbm;
            xz += weight * log * point.rssi_dbm;
        }
        let determinant = sum * xx - x * x;
        let slope = (sum * xz - x * z) / determinant;
        model.exponent = (-slope).clamp(EXPONENTS.0, EXPONENTS.1);
        model.level_1m = (z + model.exponent * x) / sum;
        sigma = [(variance * xx / determinant).sqrt(), (variance * sum / determinant).sqrt()];
        let residuals: Vec<f64> = points.iter().map(|point| point.rssi_dbm - model.rssi(point.distance_m)).collect();
        let squares: f64 = residuals.iter().zip(&weights).map(|(residual, weight)| weight * residual * residual).sum();
        // The fit uses two degrees of freedom, where there are enough points.
        let freedom = (points.len() as f64 - 2.0).max(0.0);
        model.deviation = ((squares + BELIEF * usual.deviation.powi(2)) / (freedom + BELIEF)).sqrt();
        let most = HUBER * model.deviation;
        weights = residuals.iter().map(|residual| most / residual.abs().max(most)).collect();
    }
    Some((model, sigma))
}

/// The file of beacons with their path loss: `beacon,x_m,y_m,z_m,rssi_1m_dbm,path_loss_exponent,deviation_db`.
/// Beacons that were never received keep their values.
///
/// # Errors
/// The CSV writer fails; writing to memory does not fail otherwise.
pub fn to_csv(beacons: &[Beacon], calibrated: &[Calibrated]) -> csv::Result<Vec<u8>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(["beacon", "x_m", "y_m", "z_m", "rssi_1m_dbm", "path_loss_exponent", "deviation_db"])?;
    for (beacon, calibrated) in beacons.iter().zip(calibrated) {
        let hundredths = |value: f64| format!("{value:.2}");
        let known = |value: Option<f64>| value.map_or_else(String::new, |value| value.to_string());
        let [x_m, y_m] = beacon.position_m.map(|coordinate| coordinate.to_string());
        let [rssi, exponent, deviation] = match &calibrated.path_loss {
            Some(found) => [found.level_1m, found.exponent, found.deviation].map(hundredths),
            None => [beacon.rssi_1m_dbm, beacon.path_loss_exponent, beacon.deviation_db].map(known),
        };
        writer.write_record([&beacon.name, &x_m, &y_m, &known(beacon.height_m), &rssi, &exponent, &deviation])?;
    }
    writer.into_inner().map_err(|error| error.into_error().into())
}

#[cfg(test)]
mod tests {
    use super::{RssiAtDistance, fit};

    fn points(rssis: &[(f64, f64)]) -> Vec<RssiAtDistance> {
        rssis
            .iter()
            .map(|&(distance_m, rssi_dbm)| RssiAtDistance { distance_m, rssi_dbm, distance_sigma_m: 0.0 })
            .collect()
    }

    #[test]
    fn exact_levels_give_their_path_loss() {
        // Beacon 3 of table 5.4: −47.78 − 31.7 log₁₀ d; the prior is worth less than a point.
        let exact: Vec<_> =
            (1..=20).map(|step| f64::from(step) * 0.6).map(|d| (d, -47.78 - 31.7 * d.log10())).collect();
        let (found, sigma) = fit(&points(&exact)).expect("points");
        assert!((found.exponent - 3.17).abs() < 0.01 && (found.level_1m + 47.78).abs() < 0.1, "{found:?}");
        assert!(found.deviation < 2.5 && sigma[1] < 0.3, "{found:?} {sigma:?}");
    }

    #[test]
    fn a_point_in_a_shadow_pulls_less_than_in_plain_regression() {
        let mut rssis: Vec<_> = (1..=10).map(f64::from).map(|d| (d, -50.0 - 20.0 * d.log10())).collect();
        rssis[9].1 -= 30.0;
        let (found, _) = fit(&points(&rssis)).expect("points");
        // Plain regression, by hand: x = 10 log₁₀ d has mean 6.5598 and Σ (x − x̄)² = 91.211; the last point's x − x̄ =
        // 3.4402 adds 30 · 3.4402 ⁄ 91.211 = 1.132 to the exponent of 2.
        assert!(found.exponent > 1.9 && found.exponent < 2.9, "{found:?}");
    }

    #[test]
    fn few_points_stay_sensible() {
        assert_eq!(fit(&[]), None);
        // One point: its RSSI counts, the exponent is that of the prior.
        let (found, sigma) = fit(&points(&[(1.0, -45.0)])).expect("a point");
        assert!((found.exponent - 2.4).abs() < 1e-9 && (found.level_1m + 45.0).abs() < 1.0, "{found:?}");
        assert!(sigma[1] > 1.5, "{sigma:?}");
        // Points at one distance, and RSSI values that grow with the distance.
        let (found, _) = fit(&points(&[(3.0, -60.0), (3.0, -62.0), (3.0, -61.0)])).expect("points");
        assert!(found.is_sane() && (found.rssi(3.0) + 61.0).abs() < 1.0, "{found:?}");
        let (found, _) = fit(&points(&[(1.0, -80.0), (2.0, -70.0), (4.0, -60.0), (8.0, -50.0)])).expect("points");
        assert!(found.is_sane() && found.exponent == 0.5, "{found:?}");
    }
}
