//! The benchmark of fusion: a walking tag with ranges to anchors and RSSI values of beacons, each alone and both
//! together. It compares the fusion of patent ES 2 397 388 ([`super::Fusion`]) with the tag's locator.
//!
//! [`world`] describes the simulated data. The algorithms know the hall, the tag's height, the positions of anchors
//! and beacons, and the noise of ranges. They do not know which anchors are blocked. Errors are horizontal, from the
//! fifth second of each walk on, of the mean of the filter's posterior.

mod table;
pub mod world;

use baliza_report::{Statistics, mean};
use positioning_core::Area;
use positioning_core::ble::beacon_monitor::Site;
use positioning_core::ble::signal::ListedBeacon;
use positioning_core::engine::{self, Dimensions, Range};
use positioning_core::locator::{self, Locator, Reception};
use positioning_core::nlos::Features;

use crate::fusion::{self, ChannelModel, Fusion, FusionSettings, ON_NODE, Observation, Sources};
use world::{BELIEVED, HALL_M, HEIGHT_M, HallConditions, WalkRound};

pub use table::{sweep_to_markdown, to_markdown};

/// Three anchors, one of them blocked, and five beacons.
pub const BASE: HallConditions =
    HallConditions { anchors: 3, blocked: 1, range_sigma_m: 0.1, excess_m: 1.0, beacons: 5 };
/// Number of hypotheses on a desktop.
pub const ON_HOST: usize = 64;
/// Length of a walk, seconds.
const SECONDS: u32 = 120;
/// Errors count from this time on, microseconds.
const BEGIN_US: u64 = 5_000_000;
/// Number of received nodes, anchors and beacons.
const NODES: usize = 12;
/// States of the fusion: eight beacons and four anchors in the plane.
const STATES: usize = fusion::states(2, 8, 4);

/// Which nodes are used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Inputs {
    /// Anchors alone.
    Uwb,
    /// Beacons alone.
    Ble,
    /// Both.
    Both,
}

impl Inputs {
    /// All, in the order of the tables.
    pub const ALL: [Self; 3] = [Self::Uwb, Self::Ble, Self::Both];

    fn sources(self) -> Sources {
        match self {
            Self::Uwb => Sources::Delay,
            Self::Ble => Sources::Power,
            Self::Both => Sources::Both,
        }
    }
}

/// How positions are computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum FusionAlgorithm {
    /// The fusion with the number of hypotheses of a desktop.
    Fusion,
    /// The fusion with the number of hypotheses of a node.
    FusionOnNode,
    /// The engine's track.
    Engine,
}

impl FusionAlgorithm {
    /// All, in the order of the table.
    pub const ALL: [Self; 3] = [Self::Fusion, Self::FusionOnNode, Self::Engine];
}

/// The errors of one algorithm under one choice of nodes.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct FusionScore {
    /// The algorithm.
    pub algorithm: FusionAlgorithm,
    /// The nodes that were used.
    pub heard: Inputs,
    /// Root mean square error, metres; none without positions.
    pub rmse_m: Option<f64>,
    /// Mean error, metres.
    pub mae_m: Option<f64>,
    /// 90th percentile of the error, metres.
    pub p90_m: Option<f64>,
    /// The share of rounds with a position.
    pub answered: f64,
    /// The mean of the squared error over the covariance; 2 is consistent.
    pub nees: Option<f64>,
    /// The share of errors inside the ellipse of one sigma; 0.39 is consistent.
    pub inside_1_sigma: Option<f64>,
}

/// A position, metres, and its covariance, m².
type Found = ([f64; 2], [[f64; 2]; 2]);

/// A score with the errors behind it, metres.
pub type Scored = (FusionScore, Vec<f64>);

/// The fusion's errors under one set of conditions.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Swept {
    /// Number of anchors.
    pub anchors: usize,
    /// Number of blocked anchors.
    pub blocked: usize,
    /// Noise of a range, metres.
    pub range_sigma_m: f64,
    /// Mean excess of a blocked range, metres.
    pub excess_m: f64,
    /// Number of beacons.
    pub beacons: usize,
    /// Root mean square errors with anchors alone, beacons alone and both, metres; none without positions.
    pub rmse_m: [Option<f64>; 3],
    /// The error with both, divided by the lesser of the other two.
    pub ratio: Option<f64>,
    /// The mean of the squared error over the covariance, with both; 2 is consistent.
    pub nees: Option<f64>,
    /// The share of errors inside one sigma, with both; 0.39 is consistent.
    pub inside_1_sigma: Option<f64>,
}

/// Runs all algorithms on this number of walks under [`BASE`].
pub fn run(walks: u32, seed: u64, progress: impl Fn()) -> Vec<Scored> {
    let drawn = draw(&BASE, walks, seed);
    let mut scores = Vec::new();
    for algorithm in FusionAlgorithm::ALL {
        for heard in Inputs::ALL {
            scores.push(score(algorithm, heard, &BASE, &drawn));
            progress();
        }
    }
    scores
}

/// The conditions of the sweep: two to four anchors, with all in line of sight, with one blocked, with one badly
/// blocked and much noise; few beacons and many.
pub fn conditions() -> impl Iterator<Item = HallConditions> {
    [2, 3, 4].into_iter().flat_map(|anchors| {
        [(0, 0.1, 1.0), (1, 0.1, 1.0), (1, 0.3, 3.0)].into_iter().flat_map(move |(blocked, range_sigma_m, excess_m)| {
            [3, 8].map(|beacons| HallConditions { anchors, blocked, range_sigma_m, excess_m, beacons })
        })
    })
}

/// Runs the fusion under all conditions of the sweep.
pub fn sweep(walks: u32, seed: u64, progress: impl Fn()) -> Vec<Swept> {
    conditions()
        .map(|conditions| {
            let drawn = draw(&conditions, walks, seed);
            let scores = Inputs::ALL.map(|heard| score(FusionAlgorithm::Fusion, heard, &conditions, &drawn).0);
            progress();
            let rmse_m = [0, 1, 2].map(|heard| scores[heard].rmse_m);
            let [uwb, ble, both] = rmse_m;
            let [.., FusionScore { nees, inside_1_sigma, .. }] = scores;
            let better = uwb.unwrap_or(f64::INFINITY).min(ble.unwrap_or(f64::INFINITY));
            let HallConditions { anchors, blocked, range_sigma_m, excess_m, beacons } = conditions;
            let ratio = both.map(|both| both / better);
            Swept { anchors, blocked, range_sigma_m, excess_m, beacons, rmse_m, ratio, nees, inside_1_sigma }
        })
        .collect()
}

fn draw(conditions: &HallConditions, walks: u32, seed: u64) -> Vec<Vec<WalkRound>> {
    (0..walks)
        .map(|walk| world::draw(conditions, SECONDS, seed.wrapping_mul(10_007).wrapping_add(walk.into())))
        .collect()
}

fn score(algorithm: FusionAlgorithm, heard: Inputs, conditions: &HallConditions, walks: &[Vec<WalkRound>]) -> Scored {
    let mut errors = Vec::new();
    let mut squares = Vec::new();
    let mut rounds_counted = 0;
    for (walk, rounds) in walks.iter().enumerate() {
        let found = match algorithm {
            FusionAlgorithm::Fusion => fused::<ON_HOST>(rounds, heard, conditions, walk as u64),
            FusionAlgorithm::FusionOnNode => fused::<ON_NODE>(rounds, heard, conditions, walk as u64),
            FusionAlgorithm::Engine => located(rounds, heard, conditions),
        };
        for (round, found) in rounds.iter().zip(found).filter(|(round, _)| round.t_us >= BEGIN_US) {
            rounds_counted += 1;
            if let Some(([x, y], covariance)) = found {
                let off = [x - round.at_m[0], y - round.at_m[1]];
                errors.push(off[0].hypot(off[1]));
                squares.push(squared_over(&covariance, off));
            }
        }
    }
    let figures = Statistics::of(&errors);
    let answers = errors.len() as f64;
    let score = FusionScore {
        algorithm,
        heard,
        rmse_m: figures.map(|figures| figures.rmse),
        mae_m: figures.map(|figures| figures.mae),
        p90_m: figures.map(|figures| figures.p90),
        answered: answers / f64::from(rounds_counted.max(1)),
        nees: figures.map(|_| mean(squares.iter().copied())),
        inside_1_sigma: figures.map(|_| squares.iter().filter(|square| **square < 1.0).count() as f64 / answers),
    };
    (score, errors)
}

/// dᵀ C⁻¹ d.
fn squared_over([[a, b], [_, c]]: &[[f64; 2]; 2], [x, y]: [f64; 2]) -> f64 {
    (c * x * x - 2.0 * b * x * y + a * y * y) / (a * c - b * b)
}

fn area() -> Area<f32, 3> {
    Area { min: [0.0; 3], max: [HALL_M[0] as f32, HALL_M[1] as f32, 3.0] }
}

fn single(place: [f64; 3]) -> [f32; 3] {
    place.map(|component| component as f32)
}

/// The fusion's position for each round.
fn fused<const H: usize>(
    rounds: &[WalkRound],
    heard: Inputs,
    conditions: &HallConditions,
    seed: u64,
) -> Vec<Option<Found>> {
    let mut settings = FusionSettings::indoors(HEIGHT_M as f32);
    settings.sources = heard.sources();
    settings.area = Some(area());
    settings.delay.noise = conditions.range_sigma_m as f32;
    settings.seed = seed;
    let mut fusion: Box<Fusion<f32, 2, H, NODES, STATES>> = Box::new(Fusion::new(settings));
    let power = ChannelModel::Power { at_1m: BELIEVED[0] as f32, exponent: BELIEVED[1] as f32 };
    rounds
        .iter()
        .map(|round| {
            for &(t_us, beacon, dbm) in &round.powers {
                let place = single(world::beacon_m(beacon));
                fusion.observe(t_us, &Observation { node: beacon as u16, place, channel: power, value: dbm as f32 });
            }
            for &(anchor, metres) in &round.ranges {
                let (node, place, channel) = (anchor as u16, single(world::anchor_m(anchor)), ChannelModel::range());
                fusion.observe(round.t_us, &Observation { node, place, channel, value: metres as f32 });
            }
            let estimate = fusion.step(round.t_us).ok()?;
            Some((estimate.mean.map(f64::from), estimate.covariance.map(|row| row.map(f64::from))))
        })
        .collect()
}

/// The position of a tag's locator for each round.
fn located(rounds: &[WalkRound], heard: Inputs, conditions: &HallConditions) -> Vec<Option<Found>> {
    let engine = engine::Settings::track(Dimensions::Plane { height: HEIGHT_M as f32 });
    let [rssi_1m_dbm, path_loss_exponent] = BELIEVED.map(|believed| Some(believed as f32));
    let list = std::array::from_fn::<_, { world::MOST_BEACONS }, _>(|beacon| {
        let position_m = single(world::beacon_m(beacon));
        ListedBeacon { position_m, rssi_1m_dbm, path_loss_exponent }
    });
    let list: &[ListedBeacon] = &list;
    let settings = locator::Settings {
        site: Some(Site { area: Area { min: [0.0; 2], max: HALL_M.map(|side| side as f32) }, walls: &[] }),
        // Receivers have no offset here.
        receiver_db: 0.0,
        window_us: world::ROUND_US,
        ..locator::Settings::new(engine::Settings { area: Some(area()), ..engine }).with_beacons(&list)
    };
    let mut locator = Box::new(Locator::<{ world::MOST_BEACONS }>::new(settings));
    let unknown = Reception { features: Features::default(), power_dbm: f32::NAN };
    rounds
        .iter()
        .map(|round| {
            for &(t_us, beacon, dbm) in round.powers.iter().filter(|_| heard != Inputs::Uwb) {
                locator.advertisement(t_us, beacon, dbm as f32, BELIEVED[0] as i8);
            }
            let by_beacons = locator.end_window(round.t_us);
            for (index, &(anchor, metres)) in round.ranges.iter().filter(|_| heard != Inputs::Ble).enumerate() {
                let range = Range {
                    anchor: anchor as u16,
                    position_m: single(world::anchor_m(anchor)),
                    distance_m: metres as f32,
                    deviation_m: conditions.range_sigma_m as f32,
                    p_nlos: None,
                    excess_m: None,
                };
                locator.range(round.t_us, index, range, &unknown);
            }
            let update = match heard {
                Inputs::Ble => by_beacons?,
                Inputs::Uwb | Inputs::Both => locator.end_round(round.t_us, round.ranges.len()),
            };
            update.fix.ok().map(|fix| {
                let plane = [0, 1].map(|r| [0, 1].map(|c| f64::from(fix.covariance[r][c])));
                ([fix.position[0], fix.position[1]].map(f64::from), plane)
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_over_a_covariance_is_that_of_its_axes() {
        // Along (1, 1) the variance is 4, across it 1: 3² ⁄ 4 + 2² ⁄ 1 = 6.25.
        let covariance = [[2.5, 1.5], [1.5, 2.5]];
        let root = 0.5_f64.sqrt();
        let square = squared_over(&covariance, [root * (3.0 - 2.0), root * (3.0 + 2.0)]);
        assert!((square - 6.25).abs() < 1e-12, "{square}");
    }

    #[test]
    fn beside_a_blocked_anchor_errors_stay_small_and_the_covariance_nearly_honest() {
        // Walks that were not used to choose constants.
        let drawn = draw(&BASE, 4, 1);
        let both = score(FusionAlgorithm::FusionOnNode, Inputs::Both, &BASE, &drawn).0;
        assert!(both.rmse_m.is_some_and(|rmse| rmse < 0.6), "{both:?}");
        assert!(both.nees.is_some_and(|nees| nees < 6.0), "{both:?}");
        assert!(both.inside_1_sigma.is_some_and(|inside| (0.25..0.55).contains(&inside)), "{both:?}");
    }

    #[test]
    fn beacons_help_where_one_of_three_anchors_is_badly_blocked() {
        let conditions = HallConditions { anchors: 3, blocked: 1, range_sigma_m: 0.3, excess_m: 3.0, beacons: 8 };
        let drawn = draw(&conditions, 4, 1);
        let [uwb, ble, both] =
            Inputs::ALL.map(|heard| score(FusionAlgorithm::Fusion, heard, &conditions, &drawn).0.rmse_m);
        assert!(both < uwb && both < ble, "{both:?} {uwb:?} {ble:?}");
    }
}
