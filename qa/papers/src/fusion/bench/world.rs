//! The simulated data: a hall of 12 m × 8 m, a tag that walks in it at 1 m/s from one random position to the next,
//! anchors and beacons on the walls, and the tag's measurements, five times a second.
//!
//! - Range of a direct link: distance, the residual error of calibration for the whole walk, N(0, 0.03²) m, and noise
//!   N(0, σ²).
//! - Range of a blocked link: the same, and an excess. The distribution of the excess is exponential, of mean 1 m in
//!   the base case. The excess changes with the position, with a correlation length of 2 m (through a Gaussian field
//!   and its distribution function).
//! - RSSI: log-distance, p₁ − 10 n log₁₀ d. The receiver assumes −59 dBm and n = 2; each beacon has p₁ of N(−59, 2²)
//!   dBm and n of N(2, 0.15²). Shadowing is a Gaussian field over the position for each beacon, 3 dB, with a
//!   correlation length of 2 m. Fading N(0, 2.5²) dB is new with each advert, ten a second, of which one in five is
//!   lost. A value is in whole dBm.
//! - A range is lost with a probability of 0.05, over a blocked link of 0.2.

use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

use accuracy::draw::{normal, uniform};
use accuracy::field::Field;

/// The hall, metres.
pub const HALL_M: [f64; 2] = [12.0, 8.0];
/// The tag's height, metres: known.
pub const HEIGHT_M: f64 = 1.2;
/// The receiver's assumption for every beacon: RSSI at one metre, dBm, and path loss exponent.
pub const BELIEVED: [f64; 2] = [-59.0, 2.0];
/// Time between two rounds, microseconds.
pub const ROUND_US: u64 = 200_000;
/// Positions of anchors, metres; the first n of them are used.
const ANCHORS_M: [[f64; 3]; 4] = [[0.0, 0.0, 2.6], [12.0, 1.0, 2.4], [5.0, 8.0, 2.8], [12.0, 8.0, 2.2]];
/// Number of beacons with a position.
pub const MOST_BEACONS: usize = 8;
/// Positions of beacons, metres; the first n of them are used.
const BEACONS_M: [[f64; 3]; MOST_BEACONS] = [
    [3.0, 0.0, 2.2],
    [9.0, 0.0, 2.2],
    [0.0, 5.0, 2.2],
    [12.0, 5.0, 2.2],
    [7.0, 8.0, 2.2],
    [2.0, 8.0, 2.2],
    [6.0, 0.0, 2.2],
    [10.0, 8.0, 2.2],
];
/// Correlation length of fields, metres.
const LENGTH_M: f64 = 2.0;
const SHADOWING_DB: f64 = 3.0;
const FADING_DB: f64 = 2.5;
/// Deviations of the RSSI at one metre, dB, and of the exponent.
const CHANNEL_ERRORS: [f64; 2] = [2.0, 0.15];
const LINK_SIGMA_M: f64 = 0.03;
/// Adverts between two rounds, and the probability that one is lost.
const ADVERTS: usize = 2;
const ADVERT_LOSS: f64 = 0.2;
/// Probabilities that a range is lost over a direct and over a blocked link.
const RANGE_LOSS: [f64; 2] = [0.05, 0.2];
const SPEED_M_S: f64 = 1.0;
/// Time constant of the velocity, which follows the wanted velocity, seconds.
const TURNING_S: f64 = 0.5;
/// A goal counts as reached within this distance, metres.
const NEAR_M: f64 = 0.5;
/// Least distance of a goal from a wall, metres.
const MARGIN_M: f64 = 1.0;

/// The installed nodes and the errors of their measurements.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HallConditions {
    /// Number of anchors, up to 4.
    pub anchors: usize,
    /// Number of blocked anchors: the last ones.
    pub blocked: usize,
    /// Noise of a range, metres.
    pub range_sigma_m: f64,
    /// Mean excess of a blocked range, metres.
    pub excess_m: f64,
    /// Number of beacons, up to 8.
    pub beacons: usize,
}

/// One round.
#[derive(Clone, Debug, PartialEq)]
pub struct WalkRound {
    /// Its time, microseconds.
    pub t_us: u64,
    /// The tag's position, metres.
    pub at_m: [f64; 3],
    /// Anchor, and range in metres.
    pub ranges: Vec<(usize, f64)>,
    /// Time in microseconds, beacon, and RSSI in dBm.
    pub powers: Vec<(u64, usize, f64)>,
}

/// The position of an anchor, metres.
pub fn anchor_m(anchor: usize) -> [f64; 3] {
    ANCHORS_M[anchor % ANCHORS_M.len()]
}

/// The position of a beacon, metres.
pub fn beacon_m(beacon: usize) -> [f64; 3] {
    BEACONS_M[beacon % BEACONS_M.len()]
}

struct Link {
    error_m: f64,
    blocked: bool,
    field: Field<2>,
}

struct Beacon {
    at_1m: f64,
    exponent: f64,
    field: Field<2>,
}

/// Draws a walk of this number of seconds.
pub fn draw(conditions: &HallConditions, seconds: u32, seed: u64) -> Vec<WalkRound> {
    let random = &mut Pcg64Mcg::seed_from_u64(seed);
    let links: Vec<Link> = (0..conditions.anchors.min(ANCHORS_M.len()))
        .map(|anchor| Link {
            error_m: LINK_SIGMA_M * normal(random),
            blocked: anchor + conditions.blocked >= conditions.anchors,
            field: Field::draw(random, LENGTH_M),
        })
        .collect();
    let beacons: Vec<Beacon> = (0..conditions.beacons.min(BEACONS_M.len()))
        .map(|_| Beacon {
            at_1m: BELIEVED[0] + CHANNEL_ERRORS[0] * normal(random),
            exponent: BELIEVED[1] + CHANNEL_ERRORS[1] * normal(random),
            field: Field::draw(random, LENGTH_M),
        })
        .collect();
    let mut at_m = goal(random);
    let mut towards = goal(random);
    let mut velocity = [0.0; 3];
    let step_s = ROUND_US as f64 * 1e-6 / ADVERTS as f64;
    let rounds = u64::from(seconds) * 1_000_000 / ROUND_US;
    (1..=rounds)
        .map(|number| {
            let t_us = number * ROUND_US;
            let mut powers = Vec::new();
            for advert in 1..=ADVERTS {
                while distance(&at_m, &towards) < NEAR_M {
                    towards = goal(random);
                }
                let wanted = SPEED_M_S / distance(&at_m, &towards);
                for axis in 0..3 {
                    velocity[axis] += (wanted * (towards[axis] - at_m[axis]) - velocity[axis]) * step_s / TURNING_S;
                    at_m[axis] += velocity[axis] * step_s;
                }
                let heard_us = t_us - ROUND_US + ROUND_US * advert as u64 / ADVERTS as u64;
                for (number, beacon) in beacons.iter().enumerate() {
                    let power = beacon.power(random, &at_m, &beacon_m(number));
                    if !random.random_bool(ADVERT_LOSS) {
                        powers.push((heard_us, number, power));
                    }
                }
            }
            let ranges = links.iter().enumerate().filter_map(|(number, link)| {
                let range = link.range(random, conditions, &at_m, &anchor_m(number));
                let lost = random.random_bool(RANGE_LOSS[usize::from(link.blocked)]);
                (!lost).then_some((number, range))
            });
            WalkRound { t_us, at_m, ranges: ranges.collect(), powers }
        })
        .collect()
}

impl Link {
    fn range(&self, random: &mut impl Rng, conditions: &HallConditions, at_m: &[f64; 3], anchor_m: &[f64; 3]) -> f64 {
        // The distribution function of a normal number makes it uniform, and the logarithm makes that exponential.
        let share = 0.5 * libm::erfc(self.field.at(&[at_m[0], at_m[1]]) / std::f64::consts::SQRT_2);
        let excess = -conditions.excess_m * share.max(f64::MIN_POSITIVE).ln();
        let noise = conditions.range_sigma_m * normal(random);
        distance(at_m, anchor_m) + self.error_m + noise + if self.blocked { excess } else { 0.0 }
    }
}

impl Beacon {
    fn power(&self, random: &mut impl Rng, at_m: &[f64; 3], beacon_m: &[f64; 3]) -> f64 {
        let loss = 10.0 * self.exponent * distance(at_m, beacon_m).log10();
        (self.at_1m - loss + SHADOWING_DB * self.field.at(&[at_m[0], at_m[1]]) + FADING_DB * normal(random)).round()
    }
}

fn goal(random: &mut impl Rng) -> [f64; 3] {
    let [x, y] = HALL_M.map(|width| MARGIN_M + (width - 2.0 * MARGIN_M) * uniform(random));
    [x, y, HEIGHT_M]
}

/// The distance, metres.
pub fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Three anchors, one of them blocked, and five beacons.
    const CONDITIONS: HallConditions =
        HallConditions { anchors: 3, blocked: 1, range_sigma_m: 0.1, excess_m: 1.0, beacons: 5 };

    #[test]
    fn the_errors_have_the_statistics_that_are_stated() {
        let walks: Vec<WalkRound> = (0..60).flat_map(|seed| draw(&CONDITIONS, 60, seed)).collect();
        let error = |of: usize| {
            let errors = walks.iter().flat_map(move |round| {
                let ranges = round.ranges.iter().filter(move |(anchor, _)| *anchor == of);
                ranges.map(|(anchor, range)| range - distance(&round.at_m, &anchor_m(*anchor)))
            });
            errors.collect::<Vec<f64>>()
        };
        let mean = |set: &[f64]| set.iter().sum::<f64>() / set.len() as f64;
        let [direct, blocked] = [error(0), error(2)];
        let square = direct.iter().map(|e| e * e).sum::<f64>() / direct.len() as f64;
        // 0.1² + 0.03²; an exponential of mean 1 m, at some 900 independent positions: ± 0.03 m.
        assert!((square - 0.0109).abs() < 0.001, "{square}");
        assert!((mean(&blocked) - 1.0).abs() < 0.12, "{}", mean(&blocked));
        // Lost: 5 % and 20 %.
        let share = |set: &[f64]| set.len() as f64 / walks.len() as f64;
        assert!((share(&direct) - 0.95).abs() < 0.01 && (share(&blocked) - 0.8).abs() < 0.015);
        // 3² shadowing, 2.5² fading, 2² and (0.15 · 10 log₁₀ 6 m = 1.2 dB)² for the beacon, and rounding's 1 ⁄ 12: 21
        // dB².
        let powers: Vec<f64> = walks
            .iter()
            .flat_map(|round| round.powers.iter().map(move |(_, beacon, power)| (round, *beacon, *power)))
            .map(|(round, beacon, power)| {
                let expected = distance(&round.at_m, &beacon_m(beacon)).log10() * -10.0 * BELIEVED[1] + BELIEVED[0];
                power - expected
            })
            .collect();
        let square = powers.iter().map(|e| e * e).sum::<f64>() / powers.len() as f64;
        assert!((square - 21.0).abs() < 4.0, "{square}");
    }

    #[test]
    fn equal_seeds_draw_equal_walks() {
        assert_eq!(draw(&CONDITIONS, 5, 7), draw(&CONDITIONS, 5, 7));
        assert_ne!(draw(&CONDITIONS, 5, 7), draw(&CONDITIONS, 5, 8));
    }
}
