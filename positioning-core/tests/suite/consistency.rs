//! Tests that the errors of tracks agree with their covariance: squared errors in units of the covariance, over many
//! simulated tags.

use positioning_core::engine::{Engine, Measurement, Range, Settings};
use positioning_core::{Blocked, Motion, Noise};
use rand::Rng;
use rand_pcg::Pcg64;

use crate::engine::{ANCHORS, PLANE, ROUND_US, true_range};
use crate::support::{normal, rng};

/// Seconds between two rounds.
const ROUND_S: f64 = 1.0e-6 * ROUND_US as f64;

/// 200 errors of two coordinates: chi-squared of 400 degrees of freedom, whose 2.5 and 97.5 % points are 346.5 and
/// 457.3 (Wilson and Hilferty: 400 (1 − 2⁄3600 ± 1.96 √(2⁄3600))³), over 200.
const BAND: std::ops::RangeInclusive<f64> = 1.73..=2.29;
/// The same for a tag's settings: the motion adapts, and mixtures are collapsed to Gaussians.
const TAG_BAND: std::ops::RangeInclusive<f64> = 1.5..=2.5;
const TAGS: usize = 200;

/// Squared errors in units of the covariance, one per tag.
struct Errors(Vec<f64>);

impl Errors {
    /// The errors after the last of `rounds` rounds of each of many tags; `track` makes one and gives its ranges
    /// round by round.
    fn of(settings: Settings<f32>, rounds: u64, seed: u64, mut tag: impl FnMut(&mut Pcg64) -> Tag) -> Self {
        let mut rng = rng(seed);
        let mut squares = Vec::new();
        for _ in 0..TAGS {
            let mut engine = Engine::new(settings);
            let mut tag = tag(&mut rng);
            for round in 1..=rounds {
                tag.walk(&mut rng);
                for anchor in 0..ANCHORS.len() {
                    let measured = tag.range(anchor, &mut rng);
                    engine.step(round * ROUND_US, &measured);
                }
                let fix = engine.step(round * ROUND_US, &Measurement::RoundEnd).fix.expect("eight ranges");
                if round == rounds {
                    let c = fix.covariance.map(|row| row.map(f64::from));
                    let [x, y] = [0, 1].map(|axis| f64::from(fix.position[axis]) - tag.at[axis]);
                    let determinant = c[0][0] * c[1][1] - c[0][1] * c[1][0];
                    squares.push((c[1][1] * x * x - 2.0 * c[0][1] * x * y + c[0][0] * y * y) / determinant);
                }
            }
        }
        Self(squares)
    }

    fn mean(&self) -> f64 {
        self.0.iter().sum::<f64>() / self.0.len() as f64
    }

    /// The share of errors inside the 1σ ellipse: 39 % where the covariance is right.
    fn inside(&self) -> f64 {
        self.0.iter().filter(|square| **square <= 1.0).count() as f64 / self.0.len() as f64
    }
}

/// A tag and the errors of its links, which follow the settings.
struct Tag {
    noise: Noise<f32>,
    at: [f64; 2],
    velocity: [f64; 2],
    /// Root of the acceleration's density, m/s² per √Hz.
    acceleration: f64,
    /// The share of the velocity that is lost in a second, and the share of the distance from the middle of the room
    /// that becomes acceleration.
    homing: f64,
    common: f64,
    links: [f64; 8],
    p_nlos: [Option<f32>; 8],
    is_blocked: [bool; 8],
}

impl Tag {
    fn new(noise: Noise<f32>, acceleration: f64, homing: f64, p_nlos: [Option<f32>; 8], rng: &mut Pcg64) -> Self {
        let blocks = noise.direct_sigma > 0.0;
        let common = f64::from(noise.common_sigma) * normal(rng);
        let at = [rng.random_range(3.0..7.0), rng.random_range(2.5..5.5)];
        let velocity = if acceleration > 0.0 { [0.2, 0.1] } else { [0.0; 2] };
        // The probability that a link is blocked, by its diagnostics.
        let is_blocked = p_nlos.map(|p| blocks && rng.random_bool(p.map_or(0.1, |p| 0.1 + 0.65 * f64::from(p))));
        let mut tag = Self { noise, at, velocity, acceleration, homing, common, links: [0.0; 8], p_nlos, is_blocked };
        tag.links = core::array::from_fn(|anchor| {
            let (mean, sigma) = tag.link(anchor);
            mean + sigma * normal(rng)
        });
        tag
    }

    /// The mean and the deviation of a link's error, metres: those of `positioning-core/README.md`.
    fn link(&self, anchor: usize) -> (f64, f64) {
        if self.is_blocked[anchor] { (0.8, 0.65) } else { (0.0, f64::from(self.noise.direct_sigma)) }
    }

    /// Moves on to the next round. Its links' errors change with time and distance.
    fn walk(&mut self, rng: &mut Pcg64) {
        for axis in 0..2 {
            // White acceleration over dt: velocity √(q dt), and for the position the remainder beside half of that.
            let back = self.homing * (self.velocity[axis] + self.at[axis] - [5.0, 4.0][axis]);
            let kick = self.acceleration * ROUND_S.sqrt() * normal(rng) - ROUND_S * back;
            let aside = self.acceleration * (ROUND_S.powi(3) / 12.0).sqrt() * normal(rng);
            self.at[axis] += ROUND_S * self.velocity[axis] + 0.5 * ROUND_S * kick + aside;
            self.velocity[axis] += kick;
        }
        let way = ROUND_S * self.velocity[0].hypot(self.velocity[1]);
        let gone = ROUND_S / f64::from(self.noise.link_seconds) + way / f64::from(self.noise.link_metres);
        let kept = (-gone).exp();
        for anchor in 0..8 {
            let (mean, sigma) = self.link(anchor);
            let fresh = sigma * (1.0 - kept * kept).sqrt() * normal(rng);
            self.links[anchor] = mean + kept * (self.links[anchor] - mean) + fresh;
        }
    }

    fn range(&self, anchor: usize, rng: &mut Pcg64) -> Measurement<f32> {
        let more = if self.is_blocked[anchor] { f64::from(self.noise.blocked_noise_sigma) } else { 0.0 };
        let sigma = 0.03_f64.hypot(more);
        // Student's distribution with a whole number of degrees: a normal number divided by the root of a mean of
        // squares.
        let degrees = self.noise.degrees as usize;
        let squares: f64 = (0..degrees).map(|_| normal(rng).powi(2)).sum();
        let spread = if degrees == 0 { 1.0 } else { (squares / degrees as f64).sqrt() };
        let error = self.common + self.links[anchor] + sigma * normal(rng) / spread;
        let position_m = ANCHORS[anchor].map(|c| c as f32);
        let distance_m = (true_range(anchor, self.at) + error) as f32;
        let (anchor, p_nlos) = (anchor as u16, self.p_nlos[anchor]);
        Measurement::Range(Range { anchor, position_m, distance_m, deviation_m: 0.03, p_nlos, excess_m: None })
    }
}

#[test]
fn a_plain_filter_errs_as_much_as_it_says() {
    let motion = Motion::ConstantVelocity { acceleration: 0.3 };
    let mut settings = Settings::plain(PLANE, motion, Blocked::Alike, 3);
    settings.filter.speed = 0.2;
    let errors = Errors::of(settings, 60, 11, |rng| Tag::new(Noise::white(), 0.3, 0.0, [None; 8], rng));
    assert!(BAND.contains(&errors.mean()), "{}", errors.mean());
    assert!((0.30..=0.50).contains(&errors.inside()), "{}", errors.inside());
}

#[test]
fn a_filter_that_knows_of_lasting_errors_errs_as_much_as_it_says() {
    let motion = Motion::ConstantVelocity { acceleration: 0.3 };
    let noise =
        Noise { common_sigma: 0.12, direct_sigma: 0.1, link_seconds: 1.0e6, link_metres: 1.0e6, ..Noise::white() };
    let settings = Settings::plain(PLANE, motion, Blocked::Alike, 3).with_noise(noise);
    let tag = |rng: &mut Pcg64| Tag::new(noise, 0.3, 0.0, [None; 8], rng);
    let right = Errors::of(settings, 60, 12, tag).mean();
    assert!(BAND.contains(&right), "{right}");
    // Without such states the uncertainty from the same ranges would be far too small.
    let wrong = Errors::of(settings.with_noise(Noise::white()), 60, 12, tag).mean();
    assert!(wrong > 10.0, "{wrong}");
}

/// All settings of a tag: adaptive motion and noise, links that are direct or blocked, two hypotheses.
#[test]
fn the_settings_of_a_tag_err_as_much_as_they_say() {
    let noise = Noise::<f32>::indoors();
    let settings = Settings::track(PLANE).with_noise(noise);
    for (way, acceleration, homing) in [("lies", 0.0, 0.0), ("strolls", 0.5, 0.25), ("walks", 0.8, 0.25)] {
        for (rounds, asked) in [(20, true), (60, true), (150, true), (60, false)] {
            let errors = Errors::of(settings, rounds, 13, |rng| {
                // Most links are direct, some have a higher probability of being blocked.
                let blocked = core::array::from_fn(|_| asked.then(|| rng.random::<f32>().powi(3)));
                Tag::new(noise, acceleration, homing, blocked, rng)
            });
            let (mean, inside) = (errors.mean(), errors.inside());
            assert!(TAG_BAND.contains(&mean), "{way}, {rounds} rounds, asked {asked}: {mean}");
            assert!((0.30..=0.56).contains(&inside), "{way}, {rounds} rounds, asked {asked}: {inside}");
        }
    }
}
