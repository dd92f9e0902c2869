//! The benchmark of V. Barral et al., *Environmental Cross-Validation of NLOS Machine Learning
//! Classification/Mitigation with Low-Cost UWB Positioning Systems* (Sensors 19, 2019): five anchors, nine points of
//! a grid, and the configurations of tables 4 and 5, with the iterated filter and with least squares.
//!
//! The recordings and the positions of the anchors are not available; [`hall`] describes the simulated data instead.
//! Its classifiers and mitigators are given by their error rates. The benchmark compares what a positioning engine
//! makes of them.

pub mod hall;
mod table;

use baliza_report::Statistics;
use positioning_core::engine::{Dimensions, Engine, Measurement, Range, Settings, Solvers};
use positioning_core::{Blocked, Method, Motion};

use hall::{ANCHORS_M, HallRound};

pub use table::to_markdown;

/// How positions are computed from the ranges.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum HallAlgorithm {
    /// The iterated extended Kalman filter (section 4.2).
    Iekf,
    /// Nonlinear least squares (section 4.1); where there is no new position the last one is kept.
    Nls,
    /// This project's engine in tracking, with its errors of links and its gates.
    Engine,
}

/// How blocked ranges are treated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Configuration {
    /// All ranges as they are.
    NoIgnore,
    /// Ranges classified as blocked are left out.
    Ignore,
    /// The same, but at least four ranges are kept.
    IgnoreMin4,
    /// Blocked ranges are left out, and the others are corrected.
    IgnoreMitigate,
    /// Blocked ranges are left out down to four, and the used ones are corrected.
    IgnoreMin4Mitigate,
    /// All ranges, each corrected.
    Mitigate,
    /// All ranges, weighted by the probability of being blocked.
    Weigh,
}

/// The rows of tables 4 and 5 (k-NN and Gaussian process), as measured and as simulated by the authors, metres.
pub const ROWS: [(HallAlgorithm, Configuration, Option<[f64; 2]>); 12] = [
    (HallAlgorithm::Iekf, Configuration::NoIgnore, Some([0.381, 0.228])),
    (HallAlgorithm::Iekf, Configuration::Ignore, Some([0.084, 0.071])),
    (HallAlgorithm::Iekf, Configuration::IgnoreMitigate, Some([0.136, 0.051])),
    (HallAlgorithm::Iekf, Configuration::Mitigate, Some([0.413, 0.310])),
    (HallAlgorithm::Nls, Configuration::NoIgnore, Some([0.379, 0.227])),
    (HallAlgorithm::Nls, Configuration::Ignore, Some([0.778, 0.175])),
    (HallAlgorithm::Nls, Configuration::IgnoreMin4, Some([0.155, 0.063])),
    (HallAlgorithm::Nls, Configuration::IgnoreMitigate, Some([0.789, 0.161])),
    (HallAlgorithm::Nls, Configuration::IgnoreMin4Mitigate, Some([0.330, 0.056])),
    (HallAlgorithm::Nls, Configuration::Mitigate, None),
    (HallAlgorithm::Engine, Configuration::NoIgnore, None),
    (HallAlgorithm::Engine, Configuration::Weigh, None),
];

/// The errors of one row.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct HallScore {
    /// The algorithm.
    pub algorithm: HallAlgorithm,
    /// The treatment of blocked ranges.
    pub configuration: Configuration,
    /// Mean error, metres.
    pub mae_m: f64,
    /// 90th percentile of the error, metres.
    pub p90_m: f64,
    /// The tables' mean error on measured ranges, metres.
    pub printed_measured_m: Option<f64>,
    /// The tables' mean error on ranges that the authors simulated, metres.
    pub printed_simulated_m: Option<f64>,
}

/// The result of a row: the score, and the errors in order, metres.
pub type Row = (HallScore, Vec<f64>);

/// Runs all rows in this number of halls.
pub fn run(halls: u32, seed: u64) -> Vec<Row> {
    let halls: Vec<Vec<HallRound>> =
        (0..halls).map(|hall| hall::draw(seed.wrapping_mul(10_007).wrapping_add(hall.into()))).collect();
    ROWS.into_iter()
        .map(|(algorithm, configuration, printed)| {
            let errors: Vec<f64> = halls.iter().flat_map(|rounds| errors_m(rounds, algorithm, configuration)).collect();
            let figures = Statistics::of(&errors);
            let score = HallScore {
                algorithm,
                configuration,
                mae_m: figures.map_or(f64::NAN, |figures| figures.mae),
                p90_m: figures.map_or(f64::NAN, |figures| figures.p90),
                printed_measured_m: printed.map(|[measured, _]| measured),
                printed_simulated_m: printed.map(|[_, simulated]| simulated),
            };
            (score, errors)
        })
        .collect()
}

/// The settings of a row.
fn settings(algorithm: HallAlgorithm, configuration: Configuration) -> Settings<f32> {
    let ignore = |at_least| Blocked::Ignore { threshold: 0.5, at_least };
    let blocked = match configuration {
        Configuration::NoIgnore | Configuration::Mitigate => Blocked::Alike,
        Configuration::Ignore | Configuration::IgnoreMitigate => ignore(0),
        Configuration::IgnoreMin4 | Configuration::IgnoreMin4Mitigate => ignore(4),
        Configuration::Weigh => Blocked::Weigh,
    };
    let mitigate = match configuration {
        Configuration::Mitigate | Configuration::IgnoreMitigate | Configuration::IgnoreMin4Mitigate => true,
        Configuration::NoIgnore | Configuration::Ignore | Configuration::IgnoreMin4 | Configuration::Weigh => false,
    };
    let dimensions = Dimensions::Plane { height: hall::HEIGHT_M as f32 };
    let motion = Motion::ConstantVelocity { acceleration: hall::ACCELERATION };
    let base = match algorithm {
        HallAlgorithm::Iekf => {
            Settings { solvers: Solvers::of(Method::Nls), ..Settings::plain(dimensions, motion, blocked, 5) }
        }
        HallAlgorithm::Nls => Settings::solve(dimensions, Solvers::of(Method::Nls)).with_blocked(blocked),
        HallAlgorithm::Engine => Settings::track(dimensions).with_blocked(blocked),
    };
    Settings { mitigate, ..base }
}

fn errors_m(rounds: &[HallRound], algorithm: HallAlgorithm, configuration: Configuration) -> Vec<f64> {
    let mut engine = Engine::new(settings(algorithm, configuration));
    let mut last = None;
    let mut errors = Vec::new();
    for round in rounds {
        for (anchor, heard) in round.ranges.iter().enumerate() {
            let range = Range {
                anchor: anchor as u16,
                position_m: ANCHORS_M[anchor].map(|c| c as f32),
                distance_m: heard.range_m as f32,
                deviation_m: hall::DIRECT_SIGMA_M as f32,
                p_nlos: Some(heard.blocked_score as f32),
                excess_m: Some(heard.excess_m as f32),
            };
            engine.step(round.t_us, &Measurement::Range(range));
        }
        let fix = engine.step(round.t_us, &Measurement::RoundEnd).fix;
        last = fix.ok().map(|fix| fix.position).or(last);
        // Before the first position there is no error.
        if let (Some(position), true) = (last, round.counts) {
            let square: f64 = position.iter().zip(round.at_m).map(|(p, t)| (f64::from(*p) - t).powi(2)).sum();
            errors.push(square.sqrt());
        }
    }
    errors
}
