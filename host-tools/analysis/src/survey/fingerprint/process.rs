//! RSSI values between surveyed points: one Gaussian process a beacon, with one kernel for all of them.
//!
//! The input is RSSI values at points. The output is the expected RSSI at any position, and its deviation. The kernel
//! is Matérn's with ν = 3⁄2: its functions have a slope but no curvature, like the shadows of walls. The three
//! parameters of the kernel maximise the likelihood of all beacons' RSSI values together (Rasmussen and Williams,
//! *Gaussian Processes for Machine Learning*, 2006, algorithm 2.1 and section 5.4.1). Points of one cell count as
//! one; its uncertainty falls with the number of dwells. The differences between dwells of a cell are the scatter of
//! a visit.

use std::collections::BTreeMap;

use super::survey::Survey;
use super::trend::Trend;
use crate::regression::Regression;

/// The side of a cell, metres, and the number of cells beyond which cells grow: the work is cubic in that number.
const CELL_M: f64 = 0.3;
const MOST_CELLS: usize = 150;
/// Prior of the kernel's parameters: the median, and the spread of the logarithm. It is weak and matters only for a
/// small survey.
const USUAL: [(f64, f64); 3] = [(5.0, 0.7), (2.0, 0.7), (3.0, 0.5)];
/// A point's own fading is different at each visit, so that its variance counts twice: for the survey's visit and for
/// the next.
const VISITS: f64 = 2.0;

/// The kernel's parameters.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kernel {
    /// Deviation of the RSSI values over the area, dB.
    pub signal_db: f64,
    /// Correlation length of RSSI values, metres.
    pub length_m: f64,
    /// Deviation of the part that is a point's own, dB.
    pub noise_db: f64,
}

impl Kernel {
    fn at(&self, apart_m: f64) -> f64 {
        let r = 3.0_f64.sqrt() * apart_m / self.length_m;
        self.signal_db.powi(2) * (1.0 + r) * (-r).exp()
    }

    fn logarithms(self) -> [f64; 3] {
        [self.signal_db.ln(), self.length_m.ln(), self.noise_db.ln()]
    }

    fn of(logarithms: [f64; 3]) -> Self {
        let [signal_db, length_m, noise_db] = logarithms.map(f64::exp);
        Self { signal_db, length_m, noise_db }
    }
}

/// Points of one cell.
#[derive(Clone, Debug)]
struct Cell {
    at_m: [f64; 2],
    /// For each beacon the mean RSSI and the number of dwells that received it.
    rssis: Vec<Option<(f64, f64)>>,
}

/// A beacon's RSSI values over the area.
#[derive(Clone, Debug)]
struct Field {
    /// The cells that received it.
    places_m: Vec<[f64; 2]>,
    /// Their RSSI values minus the trend.
    residuals: Vec<f64>,
    /// Regression of RSSI values minus the trend.
    rssis: Regression,
}

/// The processes of all beacons.
#[derive(Clone, Debug)]
pub struct Process {
    kernel: Kernel,
    trends: Vec<Trend>,
    fields: Vec<Field>,
    /// Deviation between dwells of a cell, dB, of each beacon.
    scatter_db: Vec<f64>,
    /// The logarithm of the likelihood of each beacon's RSSI values, without a constant.
    likelihoods: Vec<f64>,
}

impl Process {
    /// Fits the process about these trends, or about those `instead` for the beacons whose RSSI values they do not
    /// make more likely: a listed position that is wrong explains no RSSI. The trends have a parameter more, which
    /// counts as in the Bayesian information criterion (G. Schwarz, Annals of Statistics 6(2), 1978).
    pub fn fit_likelier(
        survey: &Survey,
        trends: Vec<Trend>,
        instead: Vec<Trend>,
        guess: Option<Kernel>,
    ) -> Option<Self> {
        let simple = Self::fit(survey, instead, guess)?;
        let process = Self::fit(survey, trends, guess)?;
        let likelier = |beacon: usize| {
            let points = process.fields[beacon].places_m.len().max(1) as f64;
            process.likelihoods[beacon] - 0.5 * points.ln() > simple.likelihoods[beacon]
        };
        let chosen: Vec<bool> = (0..process.trends.len()).map(likelier).collect();
        if chosen.iter().all(|chosen| *chosen) {
            return Some(process);
        }
        if !chosen.contains(&true) {
            return Some(simple);
        }
        let Self { trends, kernel, .. } = process;
        let both = trends.into_iter().zip(simple.trends).zip(chosen);
        let trends = both.map(|((trend, instead), chosen)| if chosen { trend } else { instead }).collect();
        Self::fit(survey, trends, Some(kernel))
    }

    /// Fits the process of a survey about trends, one a beacon, with the kernel of the greatest likelihood; the
    /// search begins at `guess`. `None` where no point received anything.
    pub fn fit(survey: &Survey, trends: Vec<Trend>, guess: Option<Kernel>) -> Option<Self> {
        let (cells, scatter_db) = cells(survey);
        let beacons: Vec<Beacon> = (0..survey.beacons.len())
            .map(|beacon| Beacon::of(&cells, beacon, &trends[beacon], scatter_db[beacon]))
            .collect();
        if beacons.iter().all(|beacon| beacon.places_m.is_empty()) {
            return None;
        }
        let cost = |logarithms: [f64; 3]| {
            let kernel = Kernel::of(logarithms);
            let prior =
                logarithms.iter().zip(USUAL).map(|(value, (median, spread))| ((value - median.ln()) / spread).powi(2));
            let fit: Option<f64> = beacons.iter().map(|beacon| beacon.field(&kernel).map(|(_, cost)| cost)).sum();
            fit.map_or(f64::INFINITY, |fit| fit + prior.sum::<f64>() / 2.0)
        };
        let usual = Kernel::of(USUAL.map(|(median, _)| median.ln()));
        let step = if guess.is_some() { 0.2 } else { 0.6 };
        let kernel = Kernel::of(descend(guess.unwrap_or(usual).logarithms(), step, cost));
        Self::with(&beacons, trends, scatter_db, kernel)
    }

    fn with(beacons: &[Beacon], trends: Vec<Trend>, scatter_db: Vec<f64>, kernel: Kernel) -> Option<Self> {
        let fields: Option<Vec<(Field, f64)>> = beacons.iter().map(|beacon| beacon.field(&kernel)).collect();
        let (fields, likelihoods) = fields?.into_iter().map(|(field, cost)| (field, -cost)).unzip();
        Some(Self { kernel, trends, fields, scatter_db, likelihoods })
    }

    /// The kernel.
    pub fn kernel(&self) -> Kernel {
        self.kernel
    }

    /// The expected RSSI of a beacon at a visit to a position, and its deviation, dBm and dB.
    pub fn predict(&self, beacon: usize, at_m: [f64; 2]) -> (f64, f64) {
        let near = self.near(beacon, at_m);
        let (rssi, variance) = self.expect(beacon, at_m, &near);
        (rssi, variance.sqrt())
    }

    /// The covariances of the RSSI there with those of the cells.
    fn near(&self, beacon: usize, at_m: [f64; 2]) -> Vec<f64> {
        self.fields[beacon].places_m.iter().map(|place_m| self.kernel.at(apart(*place_m, at_m))).collect()
    }

    /// The expected RSSI and its variance.
    fn expect(&self, beacon: usize, at_m: [f64; 2], near: &[f64]) -> (f64, f64) {
        let (field, trend) = (&self.fields[beacon], &self.trends[beacon]);
        let variance = (self.kernel.at(0.0) - field.rssis.explained(near)).max(0.0)
            + VISITS * self.kernel.noise_db.powi(2)
            + self.scatter_db[beacon].powi(2);
        (trend.at(at_m) + field.rssis.mean(near), variance)
    }

    /// The cells of the survey, at most this number of them.
    pub fn places_m(&self, most: usize) -> Vec<[f64; 2]> {
        let mut places_m: Vec<[f64; 2]> = self.fields.iter().flat_map(|field| field.places_m.clone()).collect();
        places_m.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
        places_m.dedup();
        let every = places_m.len().div_ceil(most).max(1);
        places_m.into_iter().step_by(every).collect()
    }

    /// For each of these cells the RSSI of a beacon there, and what [`predict`](Self::predict) gives at some points if
    /// the cell is left out of the survey.
    pub fn left_out(&self, beacon: usize, places_m: &[[f64; 2]], points_m: &[[f64; 2]]) -> Vec<LeftOutPoint> {
        let field = &self.fields[beacon];
        let changes = field.rssis.left_out();
        let expected = points_m.iter().map(|at_m| {
            let near = self.near(beacon, *at_m);
            (self.expect(beacon, *at_m, &near), field.rssis.weights(&near))
        });
        let expected: Vec<_> = expected.collect();
        let of = |place_m: &[f64; 2]| {
            let cell = field.places_m.iter().position(|other| other == place_m);
            let predicted = expected.iter().map(|((rssi, variance), weights)| match cell {
                Some(cell) => {
                    let (weight, [mean, more]) = (weights[cell], changes[cell]);
                    (rssi - weight * mean, (variance + weight * weight * more).sqrt())
                }
                None => (*rssi, variance.sqrt()),
            });
            let rssi = cell.map(|cell| self.trends[beacon].at(*place_m) + field.residuals[cell]);
            LeftOutPoint { rssi, predicted: predicted.collect() }
        };
        places_m.iter().map(of).collect()
    }
}

/// A beacon at a cell that is left out.
pub struct LeftOutPoint {
    /// Its RSSI, dBm; `None` where it was not received.
    pub rssi: Option<f64>,
    /// What the other cells predict at points: RSSI and deviation, dBm and dB.
    pub predicted: Vec<(f64, f64)>,
}

/// The data of a beacon.
struct Beacon {
    places_m: Vec<[f64; 2]>,
    /// Distances between the cells.
    apart_m: Vec<Vec<f64>>,
    /// RSSI values minus the trend.
    residuals: Vec<f64>,
    /// Variances of the cells' means.
    variances: Vec<f64>,
}

impl Beacon {
    fn of(cells: &[Cell], beacon: usize, trend: &Trend, scatter_db: f64) -> Self {
        let heard: Vec<([f64; 2], f64, f64)> =
            cells.iter().filter_map(|cell| cell.rssis[beacon].map(|(rssi, stays)| (cell.at_m, rssi, stays))).collect();
        let places_m: Vec<[f64; 2]> = heard.iter().map(|(at_m, ..)| *at_m).collect();
        let apart_m = places_m.iter().map(|a| places_m.iter().map(|b| apart(*a, *b)).collect()).collect();
        let residuals = heard.iter().map(|(at_m, rssi, _)| rssi - trend.at(*at_m)).collect();
        let variances = heard.iter().map(|(.., stays)| scatter_db.powi(2) / stays).collect();
        Self { places_m, apart_m, residuals, variances }
    }

    /// The field with this kernel, and the negative logarithm of its likelihood without the constant.
    fn field(&self, kernel: &Kernel) -> Option<(Field, f64)> {
        let rssis = Regression::new(&self.residuals, |i, j| {
            let noise = if i == j { kernel.noise_db.powi(2) + self.variances[i] } else { 0.0 };
            kernel.at(self.apart_m[i][j]) + noise
        })?;
        let cost = -rssis.log_likelihood;
        Some((Field { places_m: self.places_m.clone(), residuals: self.residuals.clone(), rssis }, cost))
    }
}

/// Minimises along one axis after the other, with ever smaller steps.
fn descend(start: [f64; 3], step: f64, cost: impl Fn([f64; 3]) -> f64) -> [f64; 3] {
    let (mut best, mut step) = (start, step);
    let mut least = cost(best);
    while step > 0.02 {
        let mut moved = false;
        for axis in 0..3 {
            for side in [-step, step] {
                let mut tried = best;
                tried[axis] += side;
                let value = cost(tried);
                if value < least {
                    (best, least, moved) = (tried, value, true);
                    break;
                }
            }
        }
        if !moved {
            step /= 2.0;
        }
    }
    best
}

/// Merges the points that share a cell; also the deviation of RSSI values within cells, dB, of each beacon.
fn cells(survey: &Survey) -> (Vec<Cell>, Vec<f64>) {
    let mut side_m = CELL_M;
    let groups = loop {
        let mut groups: BTreeMap<[i64; 2], Vec<usize>> = BTreeMap::new();
        for (index, spot) in survey.spots.iter().enumerate() {
            groups.entry(spot.position_m.map(|x| (x / side_m).floor() as i64)).or_default().push(index);
        }
        if groups.len() <= MOST_CELLS {
            break groups;
        }
        side_m *= 1.2;
    };
    let mut squares = vec![(0.0, 0.0); survey.beacons.len()];
    let cell = |members: &Vec<usize>| {
        let count = members.len() as f64;
        let at_m =
            [0, 1].map(|axis| members.iter().map(|&spot| survey.spots[spot].position_m[axis]).sum::<f64>() / count);
        let mut rssi = |beacon: usize| {
            let rssis: Vec<f64> = members.iter().filter_map(|&spot| survey.spots[spot].rssis[beacon]).collect();
            let count = rssis.len() as f64;
            let mean = rssis.iter().sum::<f64>() / count;
            if !rssis.is_empty() {
                squares[beacon].0 += rssis.iter().map(|rssi| (rssi - mean).powi(2)).sum::<f64>();
                squares[beacon].1 += count - 1.0;
            }
            (!rssis.is_empty()).then_some((mean, count))
        };
        Cell { at_m, rssis: (0..survey.beacons.len()).map(&mut rssi).collect() }
    };
    let cells = groups.values().map(cell).collect();
    let scatter =
        squares.into_iter().map(|(square, freedom)| if freedom > 0.0 { (square / freedom).sqrt() } else { 0.0 });
    (cells, scatter.collect())
}

/// Distance between two positions, metres.
pub fn apart(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

#[cfg(test)]
mod tests {
    use super::super::survey::Spot;
    use super::*;

    fn survey() -> Survey {
        let spot = |i: u32| {
            let i = f64::from(i);
            let position_m = [(i * 1.3).sin() * 4.0 + 5.0, (i * 0.7).cos() * 3.0 + 4.0];
            let other = if i < 6.0 { Some(-80.0 + i) } else { None };
            Spot { position_m, rssis: vec![Some(-60.0 + 8.0 * (i * 0.9).sin()), other] }
        };
        Survey { beacons: vec!["a".to_owned(), "b".to_owned()], spots: (0..12).map(spot).collect() }
    }

    #[test]
    fn levels_and_deviations_are_those_of_scikit_learn() {
        // GaussianProcessRegressor(36·Matern(length_scale=2.5, nu=1.5), alpha=4.0, optimizer=None), RSSI values minus
        // their mean; deviations √(predicted variance + 2 · 4). The survey has no two points in one cell.
        let survey = survey();
        let kernel = Kernel { signal_db: 6.0, length_m: 2.5, noise_db: 2.0 };
        let (cells, scatter_db) = cells(&survey);
        assert_eq!(cells.len(), 12);
        let trends = Trend::rssis(&survey);
        let beacons: Vec<Beacon> = (0..2).map(|b| Beacon::of(&cells, b, &trends[b], scatter_db[b])).collect();
        let cost: f64 = beacons.iter().map(|beacon| beacon.field(&kernel).expect("a root").1).sum();
        let process = Process::with(&beacons, trends, scatter_db, kernel).expect("a root");
        for (beacon, at_m, rssi, deviation) in [
            (0, [5.0, 4.0], -60.261_719_27, 4.739_419_56),
            (0, [2.0, 6.5], -53.465_749_34, 3.287_261_64),
            (0, [20.0, 20.0], -58.848_596_50, 6.633_249_57),
            (1, [5.0, 4.0], -77.583_876_59, 5.276_066_92),
            (1, [2.0, 6.5], -78.255_274_05, 6.170_324_86),
        ] {
            let found = process.predict(beacon, at_m);
            assert!((found.0 - rssi).abs() < 1e-6 && (found.1 - deviation).abs() < 1e-6, "{found:?}");
        }
        // −log_marginal_likelihood_value_ of both − 18 ⁄ 2 ln 2π.
        assert!((cost - 37.735_776_5).abs() < 1e-6, "{cost}");
    }

    #[test]
    fn a_cell_that_is_left_out_is_predicted_by_a_survey_without_it() {
        let (survey, kernel) = (survey(), Kernel { signal_db: 6.0, length_m: 2.5, noise_db: 2.0 });
        let trends = Trend::rssis(&survey);
        let process = |survey: &Survey| {
            let (cells, scatter_db) = cells(survey);
            let beacons: Vec<Beacon> = (0..2).map(|b| Beacon::of(&cells, b, &trends[b], scatter_db[b])).collect();
            Process::with(&beacons, trends.clone(), scatter_db, kernel).expect("a root")
        };
        let (all, points_m) = (process(&survey), [[5.0, 4.0], [2.0, 6.5], survey.spots[3].position_m]);
        // The second beacon was not received at spot 8.
        for (beacon, spot) in [(0, 3), (1, 3), (1, 8)] {
            let place_m = survey.spots[spot].position_m;
            let others = process(&survey.only(|other| other != spot));
            let LeftOutPoint { rssi, predicted } = all.left_out(beacon, &[place_m], &points_m).remove(0);
            assert_eq!(rssi.is_some(), survey.spots[spot].rssis[beacon].is_some());
            assert!(rssi.zip(survey.spots[spot].rssis[beacon]).is_none_or(|(a, b)| (a - b).abs() < 1e-9));
            for (found, at_m) in predicted.into_iter().zip(points_m) {
                let expected = others.predict(beacon, at_m);
                assert!((found.0 - expected.0).abs() < 1e-9 && (found.1 - expected.1).abs() < 1e-9, "{found:?}");
            }
        }
        assert_eq!((all.places_m(100).len(), all.places_m(5).len()), (12, 4));
    }

    #[test]
    fn stays_at_one_place_are_one_cell_and_tell_their_scatter() {
        // Two dwells 2 dB apart: mean −61, scatter √(2 · 1² ⁄ 1) = 1.414; the single one adds nothing.
        let spot = |x: f64, rssi: f64| Spot { position_m: [x, 0.1], rssis: vec![Some(rssi)] };
        let spots = vec![spot(0.1, -60.0), spot(0.1, -62.0), spot(3.0, -70.0)];
        let survey = Survey { beacons: vec!["a".to_owned()], spots };
        let (cells, scatter_db) = cells(&survey);
        assert_eq!((cells.len(), cells[0].rssis[0]), (2, Some((-61.0, 2.0))));
        assert!((scatter_db[0] - 2.0_f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn the_likeliest_kernel_tells_noise_from_shape() {
        let field = |noise_db: f64| {
            let spot = |i: u32| {
                let (x, i) = (f64::from(i) * 0.5, f64::from(i));
                Spot {
                    position_m: [x, 0.0],
                    rssis: vec![Some(-60.0 + 8.0 * (x * 0.8).sin() + noise_db * (i * i * 0.37).sin())],
                }
            };
            let survey = Survey { beacons: vec!["a".to_owned()], spots: (0..40).map(spot).collect() };
            Process::fit(&survey, Trend::rssis(&survey), None).expect("a process").kernel()
        };
        let (quiet, noisy) = (field(0.1), field(5.0));
        assert!(quiet.noise_db < 1.5 && noisy.noise_db > 2.0 * quiet.noise_db, "{quiet:?} {noisy:?}");
        let nothing =
            Survey { beacons: vec!["a".to_owned()], spots: vec![Spot { position_m: [0.0; 2], rssis: vec![None] }] };
        assert!(Process::fit(&nothing, Trend::rssis(&nothing), None).is_none());
    }

    #[test]
    fn a_wrong_position_of_a_beacon_explains_nothing() {
        // Two beacons at (0, 0) and (10, 8), of which the second is listed at (0, 8).
        let rssi = |at: [f64; 2], beacon: [f64; 2]| -45.0 - 12.5 * (apart(at, beacon).powi(2) + 1.0).log10();
        let spot = |i: u32| {
            let position_m = [f64::from(i % 6) * 2.0, f64::from(i / 6) * 2.0];
            let wiggle = f64::from(i * i).sin();
            let rssis = [[0.0, 0.0], [10.0, 8.0]].map(|beacon| Some(rssi(position_m, beacon) + wiggle));
            Spot { position_m, rssis: rssis.to_vec() }
        };
        let survey = Survey { beacons: vec!["a".to_owned(), "b".to_owned()], spots: (0..30).map(spot).collect() };
        let beacon = |name: &str, position_m| recording::beacons::Beacon {
            name: name.to_owned(),
            position_m,
            height_m: None,
            rssi_1m_dbm: None,
            path_loss_exponent: None,
            deviation_db: None,
        };
        let plan = super::super::trend::Plan {
            beacons: vec![beacon("a", [0.0, 0.0]), beacon("b", [0.0, 8.0])],
            walls: Vec::new(),
        };
        let (rays, levels) = (Trend::rays(&survey, &plan), Trend::rssis(&survey));
        let process = Process::fit_likelier(&survey, rays, levels, None).expect("a process");
        assert!(matches!(process.trends[..], [Trend::Rays { .. }, Trend::Level(_)]), "{:?}", process.trends);
    }

    #[test]
    fn thousands_of_points_become_few_cells() {
        let spot = |i: u32| Spot {
            position_m: [f64::from(i % 71) * 0.31, f64::from(i / 71) * 0.31],
            rssis: vec![Some(-60.0)],
        };
        let survey = Survey { beacons: vec!["a".to_owned()], spots: (0..5000).map(spot).collect() };
        assert!(cells(&survey).0.len() <= MOST_CELLS);
    }
}
