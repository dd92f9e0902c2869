//! The prior-predictive set: recordings of ranges that are drawn from broad distributions, and not from what the
//! project's engine assumes. No setting was chosen on them. A case is drawn from its number and a seed.
//!
//! U is an even distribution, logU one whose logarithm is even, N a normal one. A *field* is a Gaussian field over the
//! tag's position, of correlation exp(−d² ⁄ 2 l²); each link has its own.
//!
//! - Room: length logU(5, 40) m; width U(0.3, 1) of it and at least 4 m; height U(2.4, 4) m, above 15 m of length up to
//!   4 m more.
//! - Anchors: U{4 … 12}; *many anchors*: U{13 … 19}; *3D*: U{5 … 12}; *collinear*: U{4 … 8}.
//! - Their layout: spread around the walls (0.8) or along one wall (0.2), inset U(0.05, 0.3) or U(0.05, 0.5) m;
//!   *collinear*: along a line in the near half of the room, off it by N(0, s²), s of U(0.01, 0.05) m; in seven of ten
//!   cases, the last one on a wall somewhere else.
//! - Their heights: U(1.5 m, room − 0.2 m); *3D*: U(0.2 m, room − 0.2 m).
//! - Movement: walk (0.7) or rest (0.3); *walk*, *rest*, *teleport*: that one.
//! - Walk: from one random position to the next at U(0.3, 1.5) m/s, turning within 0.5 s; at three of ten positions a
//!   stop of U(1, 6) s.
//! - Rest: three stays at random positions, a minute of silence between.
//! - Teleport: a walk or a rest at one place, with one or two jumps to a random position at least 3 m away, in a small
//!   room 0.4 of its diagonal.
//! - Tag's height: U(0.3, 1.8) m, known; *3D*: changes with the walk, U(0.3, 2) m.
//! - Rounds: logU(2, 50) Hz, *asynchronous*: logU(2, 10) Hz; for U(40, 80) s, at most 1500 rounds or 4000 single
//!   ranges.
//! - Lost ranges: U(0, 0.25); of a blocked link 0.1 more.
//! - Error common to all ranges: N(0, 0.1²) m.
//! - Lasting error of a link: a field of U(0.2, 1) m, rms U(0.03, 0.12) m, new for each link.
//! - White error: N(0, s²), s of U(0.02, 0.08) m.
//! - Blocked regions: a share of U(0, 0.4) of the positions, new for each link, by a field of U(1, 4) m.
//! - Excess of a blocked link: logU(0.2, 1.5) m, by a field of the same length; half of the links are *noisy*: each
//!   range is longer by the size of a number of N(0, s²), s of U(0.1, 0.5) m.
//! - Wild ranges: a share of U(0, 0.03): 1 m and an exponential of mean 3 m too long (0.8) or too short (0.2).
//! - Powers: see [`Powers`].
//!
//! *Asynchronous*: the anchors of a round come one after the other, each range an epoch of its own.

mod conditions;
mod files;
mod link;
mod movement;

use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

pub(crate) use conditions::on_the_walls;
pub use conditions::{CaseConditions, Group, Layout, Movement, Powers};
pub use files::{index, texts};

use link::Link;

/// The usual number of cases.
pub const CASES: usize = 140;

/// One recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// Its number in the set.
    pub number: usize,
    /// What it is drawn from.
    pub conditions: CaseConditions,
    /// The anchors' positions, metres.
    pub anchors_m: Vec<[f64; 3]>,
    /// The epochs in the order of time.
    pub epochs: Vec<CaseEpoch>,
}

/// The ranges that come at one time.
#[derive(Clone, Debug, PartialEq)]
pub struct CaseEpoch {
    /// The time, seconds.
    pub t_s: f64,
    /// The tag's true position, metres.
    pub at_m: [f64; 3],
    /// The ranges that are not lost.
    pub ranges: Vec<CaseRange>,
}

/// A range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CaseRange {
    /// The anchor's index.
    pub anchor: usize,
    /// The range, metres, in whole millimetres.
    pub range_m: f64,
    /// Received power and first-path power, dBm, where the receiver gives them.
    pub powers_dbm: Option<[f64; 2]>,
    /// Whether the direct path is blocked.
    pub blocked: bool,
    /// Whether the range is wild.
    pub wild: bool,
}

impl Case {
    /// Its name: number and group.
    pub fn name(&self) -> String {
        format!("{:02}-{}", self.number, self.conditions.group.as_str())
    }
}

/// Draws a case. Its group follows from its number: the groups take turns.
pub fn draw(number: usize, seed: u64) -> Case {
    let random = &mut Pcg64Mcg::seed_from_u64(seed.wrapping_mul(1_000_003).wrapping_add(number as u64));
    let group = Group::ALL[number % Group::ALL.len()];
    let conditions = CaseConditions::draw(random, group);
    let anchors_m = conditions.anchors(random);
    let links: Vec<Link> = anchors_m.iter().map(|_| Link::draw(random, &conditions)).collect();
    let times_s = conditions.times_s(anchors_m.len());
    let places_m = movement::places_m(random, &conditions, &times_s);
    let epochs = times_s.into_iter().zip(places_m).enumerate().map(|(at, (t_s, at_m))| {
        let measured = |anchor: usize, random: &mut Pcg64Mcg| {
            let range = links.get(anchor)?.range(random, &conditions, &at_m, anchors_m.get(anchor)?);
            range.map(|range| CaseRange { anchor, ..range })
        };
        let ranges = if group == Group::Asynchronous {
            measured(at % anchors_m.len(), random).into_iter().collect()
        } else {
            (0..anchors_m.len()).filter_map(|anchor| measured(anchor, random)).collect()
        };
        CaseEpoch { t_s, at_m, ranges }
    });
    let epochs = epochs.collect();
    Case { number, conditions, anchors_m, epochs }
}

/// Whether an event of this probability happens.
fn happens(random: &mut impl Rng, probability: f64) -> bool {
    random.random_bool(probability.clamp(0.0, 1.0))
}

/// The distance, metres.
fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests;
