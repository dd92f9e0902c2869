//! The simulated data: a hall of 12 m × 8 m with five anchors on its walls at different heights. A tag stays for a
//! minute at each of nine points of a grid and walks between them. Five ranges are measured in turn, 25 ranges a
//! second, so that a round takes 0.2 s.
//!
//! - Direct: a constant error of the link at the point, N(0, 0.04²) m, and noise N(0, 0.04²) m.
//! - Blocked: an excess of the link at the point, 0.3 m + exponential of mean 0.6 m, and noise 0.15 m. Each link is
//!   blocked at a point with probability 0.35, but never more than two of the five.
//! - Classifier: a probability of being blocked, which is on the right side of ½ in 97 % of all cases and is
//!   calibrated. It is 0.94 to 1 for ranges classified as blocked, and the complement for the rest (the paper finds
//!   its two sets "clearly separated").
//! - Mitigator, trained in another building: for a direct range it estimates an excess of N(0.1, 0.05²) m, for a
//!   blocked one half of the true excess plus N(0.6, 0.4²) m. The estimate is constant for a link at a point, like
//!   its inputs.

use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

use accuracy::draw::normal;

/// Positions of the anchors, metres.
pub const ANCHORS_M: [[f64; 3]; 5] =
    [[0.0, 0.0, 2.9], [12.0, 0.5, 0.9], [11.5, 8.0, 2.7], [0.5, 7.5, 0.7], [6.0, 8.0, 1.9]];
/// Deviation of a direct range's noise, metres.
pub const DIRECT_SIGMA_M: f64 = 0.04;
/// Root of the density of the filter's acceleration, m/s² in √Hz.
pub const ACCELERATION: f32 = 0.05;
/// Deviation of a direct link's constant error, metres.
const DIRECT_LINK_SIGMA_M: f64 = 0.04;
/// Probability that a link is blocked.
const BLOCKED_SHARE: f64 = 0.35;
/// At most this number of the five links are blocked.
const MOST_BLOCKED: usize = 2;
/// Least excess of a blocked link, and the mean of the exponential part, metres.
const EXCESS_M: [f64; 2] = [0.3, 0.6];
/// Deviation of a blocked range's noise, metres.
const BLOCKED_SIGMA_M: f64 = 0.15;
/// How often the classifier is right.
const RIGHT: f64 = 0.97;
/// The grid, metres.
const GRID_M: [[f64; 3]; 2] = [[3.0, 6.0, 9.0], [2.0, 4.0, 6.0]];
/// The tag's height, metres: known, so that only x and y are estimated.
pub const HEIGHT_M: f64 = 1.2;
/// Rounds at a point: a minute.
const ROUNDS: usize = 300;
/// Rounds from one point to the next: at most 3 m at 0.6 m/s.
const WALK: usize = 25;
/// Time between two rounds, microseconds.
const ROUND_US: u64 = 200_000;

/// One range, with the outputs of classifier and mitigator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Received {
    /// Metres.
    pub range_m: f64,
    /// Probability that the range is blocked: 0 direct, 1 blocked.
    pub blocked_score: f64,
    /// The excess estimated by the mitigator, metres.
    pub excess_m: f64,
}

/// One round.
#[derive(Clone, Debug, PartialEq)]
pub struct HallRound {
    /// Its time, microseconds.
    pub t_us: u64,
    /// The tag's position, metres.
    pub at_m: [f64; 3],
    /// Whether the tag is at a point of the grid.
    pub counts: bool,
    /// One range an anchor.
    pub ranges: [Received; ANCHORS_M.len()],
}

/// The properties of a link that are constant while the tag is at a point.
#[derive(Clone, Copy, Debug)]
struct Link {
    blocked: bool,
    error_m: f64,
    believed_m: f64,
}

/// Draws the nine minutes and the walks between.
pub fn draw(seed: u64) -> Vec<HallRound> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    let mut rounds: Vec<HallRound> = Vec::new();
    let mut last: Option<[f64; 3]> = None;
    for point in grid_m() {
        let links = links(&mut random);
        if let Some(from) = last {
            for k in 1..WALK {
                let part = k as f64 / WALK as f64;
                let at_m = std::array::from_fn(|axis| from[axis] + part * (point[axis] - from[axis]));
                rounds.push(round(&mut random, rounds.len(), at_m, &links, false));
            }
        }
        for _ in 0..ROUNDS {
            rounds.push(round(&mut random, rounds.len(), point, &links, true));
        }
        last = Some(point);
    }
    rounds
}

/// The points, row after row, to and fro, metres.
pub fn grid_m() -> impl Iterator<Item = [f64; 3]> {
    GRID_M[1].iter().enumerate().flat_map(|(row, &y)| {
        let xs = GRID_M[0];
        let order = if row % 2 == 0 { [0, 1, 2] } else { [2, 1, 0] };
        order.map(|i| [xs[i], y, HEIGHT_M])
    })
}

fn links(random: &mut impl Rng) -> [Link; ANCHORS_M.len()] {
    let mut blocked = [false; ANCHORS_M.len()];
    loop {
        blocked.fill_with(|| random.random_bool(BLOCKED_SHARE));
        if blocked.iter().filter(|blocked| **blocked).count() <= MOST_BLOCKED {
            break;
        }
    }
    blocked.map(|blocked| {
        let direct_m = DIRECT_LINK_SIGMA_M * normal(random);
        if blocked {
            let excess_m = EXCESS_M[0] - EXCESS_M[1] * random.random_range(f64::MIN_POSITIVE..1.0_f64).ln();
            let believed_m = 0.5 * excess_m + 0.6 + 0.4 * normal(random);
            Link { blocked, error_m: excess_m, believed_m }
        } else {
            Link { blocked, error_m: direct_m, believed_m: 0.1 + 0.05 * normal(random) }
        }
    })
}

fn round(random: &mut impl Rng, number: usize, at_m: [f64; 3], links: &[Link; 5], counts: bool) -> HallRound {
    let ranges = std::array::from_fn(|i| {
        let distance: f64 = at_m.iter().zip(ANCHORS_M[i]).map(|(t, a)| (t - a).powi(2)).sum::<f64>().sqrt();
        let link = links[i];
        let sigma = if link.blocked { BLOCKED_SIGMA_M } else { DIRECT_SIGMA_M };
        let told = link.blocked == random.random_bool(RIGHT);
        let sure: f64 = random.random_range(2.0 * RIGHT - 1.0..1.0);
        Received {
            range_m: distance + link.error_m + sigma * normal(random),
            blocked_score: if told { sure } else { 1.0 - sure },
            excess_m: link.believed_m,
        }
    });
    HallRound { t_us: ROUND_US * (number as u64 + 1), at_m, counts, ranges }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ranges_have_the_statistics_that_are_stated() {
        let rounds: Vec<HallRound> = (0..160).flat_map(draw).filter(|round| round.counts).collect();
        let heard = rounds.iter().flat_map(|round| {
            round.ranges.iter().enumerate().map(|(i, heard)| {
                let distance = round.at_m.iter().zip(ANCHORS_M[i]).map(|(t, a)| (t - a).powi(2)).sum::<f64>().sqrt();
                (heard.range_m - distance, heard.blocked_score)
            })
        });
        let (blocked, direct): (Vec<_>, Vec<_>) = heard.partition(|(_, score)| *score > 0.5);
        let mean = |set: &[(f64, f64)]| set.iter().map(|(error, _)| error).sum::<f64>() / set.len() as f64;
        // At most two of five with p = 0.35: Σ k C(5,k) p^k q^(5−k) ⁄ Σ C(5,k) p^k q^(5−k), k ≤ 2, over 5 = (0.3124 +
        // 2 · 0.3364) ⁄ 0.7648 ⁄ 5 = 0.2576. Classified as blocked: 0.97 of them and 0.03 of the others, 0.272.
        let share = blocked.len() as f64 / (blocked.len() + direct.len()) as f64;
        assert!((share - 0.272).abs() < 0.02, "{share}");
        // 0.3 + 0.6 m in (0.2576 · 0.97) ⁄ 0.272 of those classified as blocked, nothing in the rest: 0.827 m; 0.9 ·
        // 0.2576 · 0.03 ⁄ 0.728 = 0.0096 m.
        assert!((mean(&blocked) - 0.827).abs() < 0.08, "{}", mean(&blocked));
        assert!((mean(&direct) - 0.0096).abs() < 0.01, "{}", mean(&direct));
    }

    #[test]
    fn equal_seeds_draw_equal_ranges() {
        assert_eq!(draw(7), draw(7));
        assert_ne!(draw(7), draw(8));
    }
}
