//! Sites of one kind of geometry, for which an engine's deviations are compared with its errors. They are drawn as an
//! outside review drew them, from distributions that no setting was chosen on; nothing is wrong with their survey.
//!
//! - Room: length logU(5, 40) m; width U(0.3, 1) of it and at least 4 m; height U(2.4, 5) m.
//! - Anchors: 3 to 12 in the plane, 4 to 12 in space, surveyed to N(0, 0.02²) m a coordinate. *Line*: off a wall by
//!   U(0, 0.3) m, or off a line through the middle by N(0, 0.05²) m. Others: around the walls or on the ceiling; in space
//!   half of them at heights from the floor to the ceiling.
//! - Movement: at rest or from one place to the next, in space also up and down; *outside*: by 0.2 to 0.8 of the length.
//! - Rounds: 10 Hz for 40 s, or 1 Hz for 200 s. A share of U(0, 0.2) of the ranges is lost.
//! - Errors: common N(0, 0.05²) m; lasting, a field of U(0.2, 1) m and rms U(0.03, 0.1) m a link; white, U(0.02, 0.06) m.
//! - Blocked: a share of a link's places, by a field of 2.5 m, or a share of the links for good; logU(0.2, 1.5) m longer,
//!   with a field of a third of that, half of them noisy.
//! - A third of the sites has 2 % of wild ranges, half of them have powers.

use std::f64::consts::TAU;

use rand::seq::IndexedRandom as _;
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64Mcg;

use crate::draw::{between, log_between, normal, uniform};
use crate::field::Field;
use crate::prior::{CaseEpoch, CaseRange, on_the_walls};

/// A kind of site.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SiteClass {
    /// Its name on the command line.
    pub name: &'static str,
    /// Whether the height is unknown.
    pub in_space: bool,
    /// Whether the anchors are near a line or on one wall.
    on_line: bool,
    /// Whether the tag is outside of the anchors' hull.
    outside: bool,
    /// The share of blocked places or links, percent.
    blocked: u8,
    /// Whether a blocked link is blocked everywhere.
    for_good: bool,
}

/// All kinds.
pub const CLASSES: [SiteClass; 10] = [
    SiteClass { in_space: false, on_line: true, ..spread("line") },
    SiteClass { on_line: true, ..spread("line-space") },
    SiteClass { in_space: false, ..spread("plane") },
    SiteClass { in_space: false, blocked: 20, ..spread("plane-blocked") },
    SiteClass { in_space: false, blocked: 50, for_good: true, ..spread("plane-half-blocked") },
    SiteClass { in_space: false, outside: true, ..spread("plane-outside") },
    spread("space"),
    SiteClass { blocked: 20, ..spread("space-blocked") },
    SiteClass { blocked: 50, for_good: true, ..spread("space-half-blocked") },
    SiteClass { outside: true, ..spread("space-outside") },
];

/// A class in space of anchors that are spread around tags, without blocked links.
const fn spread(name: &'static str) -> SiteClass {
    SiteClass { name, in_space: true, on_line: false, outside: false, blocked: 0, for_good: false }
}

/// A site with the ranges of a tag.
pub struct DrawnSite {
    /// The anchors' surveyed positions, metres.
    pub anchors_m: Vec<[f64; 3]>,
    /// The rounds in the order of time.
    pub epochs: Vec<CaseEpoch>,
}

/// Draws a site of a class.
pub fn draw(class: SiteClass, number: usize, seed: u64) -> DrawnSite {
    let random = &mut Pcg64Mcg::seed_from_u64(seed.wrapping_mul(1_000_003).wrapping_add(number as u64));
    let length = log_between(random, 5.0, 40.0);
    let room_m = [length, (length * between(random, 0.3, 1.0)).max(4.0), between(random, 2.4, 5.0)];
    let true_m = anchors_m(random, class, room_m);
    let (rate_hz, seconds) = if random.random_bool(0.67) { (10.0, 40.0) } else { (1.0, 200.0) };
    let places = places_m(random, class, room_m, rate_hz, (rate_hz * seconds) as usize);
    let links: Vec<Link> = true_m.iter().map(|_| Link::draw(random, class)).collect();
    let powers = random.random_bool(0.5);
    let errors = SharedErrors {
        common_m: 0.05 * normal(random),
        white_m: between(random, 0.02, 0.06),
        wild: if random.random_bool(0.33) { 0.02 } else { 0.0 },
    };
    let loss = between(random, 0.0, 0.2);
    let epochs = places.into_iter().enumerate().map(|(round, at_m)| {
        let ranges = links.iter().zip(&true_m).enumerate().filter_map(|(anchor, (link, anchor_m))| {
            let range = link.range(random, &errors, powers, &at_m, anchor_m);
            (!random.random_bool(loss)).then_some(CaseRange { anchor, ..range })
        });
        CaseEpoch { t_s: round as f64 / rate_hz, ranges: ranges.collect(), at_m }
    });
    let epochs = epochs.collect();
    let surveyed = true_m.iter().map(|place| place.map(|coordinate| coordinate + 0.02 * normal(random)));
    DrawnSite { anchors_m: surveyed.collect(), epochs }
}

fn anchors_m(random: &mut impl Rng, class: SiteClass, [length, width, height]: [f64; 3]) -> Vec<[f64; 3]> {
    let counts: &[usize] = if class.in_space { &[4, 4, 5, 6, 8, 12] } else { &[3, 3, 4, 4, 5, 6, 8, 12] };
    let count = counts.choose(random).copied().unwrap_or(4);
    let [one_wall, on_ceiling, any_height] = [0.5, 0.33, 0.5].map(|share| random.random_bool(share));
    let place = |at: usize| {
        let share = (at as f64 + 0.5) / count as f64;
        if class.on_line {
            let y = if one_wall { between(random, 0.0, 0.3) } else { 0.5 * width + 0.05 * normal(random) };
            return [share * length, y, between(random, 1.6, height - 0.2)];
        }
        if on_ceiling {
            return [between(random, 0.5, length - 0.5), between(random, 0.0, width), height - 0.1];
        }
        let along = (share + between(random, -0.3, 0.3) / count as f64).rem_euclid(1.0) * 2.0 * (length + width);
        let [x, y] = on_the_walls([length, width], along, 0.0);
        [x, y, between(random, if class.in_space && any_height { 0.2 } else { 1.6 }, height - 0.2)]
    };
    (0..count).map(place).collect()
}

/// The tag's positions at its rounds, metres.
fn places_m(
    random: &mut impl Rng,
    class: SiteClass,
    [length, width, height]: [f64; 3],
    rate_hz: f64,
    rounds: usize,
) -> Vec<[f64; 3]> {
    let goal = |random: &mut _| {
        if !class.outside {
            return [between(random, 0.3, length - 0.3), between(random, 0.3, width - 0.3)];
        }
        let (angle, away) = (uniform(random) * TAU, between(random, 0.2, 0.8) * length);
        [0.5 * length + angle.cos() * (0.5 * length + away), 0.5 * width + angle.sin() * (0.5 * width + away)]
    };
    let [rests, flies] = [0.2, 0.33].map(|share| random.random_bool(share));
    let speed = between(random, 0.4, 1.5) / rate_hz;
    let (low, phase) = (between(random, 0.3, 1.8), uniform(random) * TAU);
    let (mut at, mut next) = (goal(random), goal(random));
    let step = |round: usize| {
        let [dx, dy] = [next[0] - at[0], next[1] - at[1]];
        let left = dx.hypot(dy);
        if left < speed {
            (at, next) = (next, goal(random));
        } else if !rests {
            at = [at[0] + dx * speed / left, at[1] + dy * speed / left];
        }
        let swing = (0.5 * height - 0.3) * (phase + 0.3 * round as f64 / rate_hz).sin();
        let z = if class.in_space && flies { 0.5 * height + swing } else { low };
        [at[0], at[1], z]
    };
    (0..rounds).map(step).collect()
}

/// The errors that are alike for all links.
struct SharedErrors {
    common_m: f64,
    white_m: f64,
    wild: f64,
}

struct Link {
    lasting: Field<3>,
    lasting_m: f64,
    blocked: Field<3>,
    /// The share of places where it is blocked.
    share: f64,
    excess_m: f64,
    excess: Field<3>,
    noisy_m: f64,
}

impl Link {
    fn draw(random: &mut impl Rng, class: SiteClass) -> Self {
        let share = f64::from(class.blocked) / 100.0;
        let share = if class.for_good { f64::from(random.random_bool(share)) } else { share };
        let length_m = between(random, 0.2, 1.0);
        Self {
            lasting: Field::draw(random, length_m),
            lasting_m: between(random, 0.03, 0.1),
            blocked: Field::draw(random, 2.5),
            share,
            excess_m: log_between(random, 0.2, 1.5),
            excess: Field::draw(random, 2.5),
            noisy_m: if random.random_bool(0.5) { 0.25 } else { 0.0 },
        }
    }

    /// A range to the anchor with index 0.
    fn range(
        &self,
        random: &mut impl Rng,
        errors: &SharedErrors,
        powers: bool,
        at_m: &[f64; 3],
        anchor_m: &[f64; 3],
    ) -> CaseRange {
        let distance_m = at_m.iter().zip(anchor_m).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
        let blocked = self.blocked.share_at(at_m) < self.share;
        let direct_m = errors.common_m + self.lasting_m * self.lasting.at(at_m) + errors.white_m * normal(random);
        let excess_m = (self.excess_m * (1.0 + 0.3 * self.excess.at(at_m))).max(0.05);
        let excess_m = if blocked { excess_m + (self.noisy_m * normal(random)).abs() } else { 0.0 };
        let wild = random.random_bool(errors.wild);
        let wild_m = if wild { 1.0 - 3.0 * uniform(random).ln() } else { 0.0 };
        let range_m = (distance_m + direct_m + excess_m + wild_m).max(0.05);
        let received_dbm = -60.0 - 20.0 * distance_m.max(0.5).log10() + normal(random) - 6.0 * f64::from(blocked);
        let difference_db = if blocked { 9.0 + 3.0 * normal(random) } else { 4.0 + 1.5 * normal(random) }.abs();
        let powers_dbm = powers.then_some([received_dbm, received_dbm - difference_db]);
        CaseRange { anchor: 0, range_m: (range_m * 1e3).round() / 1e3, powers_dbm, blocked, wild }
    }
}

#[cfg(test)]
mod tests {
    use super::{CLASSES, draw};

    #[test]
    fn sites_are_as_their_class_says() {
        for class in CLASSES {
            for number in 0..20 {
                let site = draw(class, number, 3);
                assert!((3..=12).contains(&site.anchors_m.len()) && site.epochs.len() >= 200, "{}", class.name);
                let ranges = || site.epochs.iter().flat_map(|epoch| &epoch.ranges);
                assert!(class.blocked > 0 || ranges().all(|range| !range.blocked), "{}", class.name);
                // A line of anchors is within 0.3 m, and 2 cm of survey, of its middle.
                let ys = || site.anchors_m.iter().map(|place| place[1]);
                let wide = ys().fold(f64::MIN, f64::max) - ys().fold(f64::MAX, f64::min);
                assert!(!class.on_line || wide < 0.5, "{}: {wide}", class.name);
            }
        }
    }

    #[test]
    fn half_of_the_links_are_blocked_for_good() {
        let half = CLASSES.iter().find(|class| class.name == "space-half-blocked").copied().expect("a class");
        let (mut blocked, mut all) = (0, 0);
        for number in 0..60 {
            let site = draw(half, number, 1);
            for anchor in 0..site.anchors_m.len() {
                let of = site.epochs.iter().flat_map(|epoch| &epoch.ranges).filter(|range| range.anchor == anchor);
                let states: Vec<bool> = of.map(|range| range.blocked).collect();
                assert!(states.iter().all(|state| *state == states[0]));
                (blocked, all) = (blocked + u32::from(states[0]), all + 1);
            }
        }
        // Of some 390 links, half within three deviations of 10.
        assert!((f64::from(blocked) / f64::from(all) - 0.5).abs() < 0.08, "{blocked} of {all}");
    }
}
