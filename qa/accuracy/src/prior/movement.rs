//! The tag's true positions.

use rand::Rng;

use super::{CaseConditions, Movement, distance, happens};
use crate::draw::between;

/// Least distance of a goal from a wall, metres.
const MARGIN_M: f64 = 0.6;
/// The tag itself is never nearer to a wall, metres.
const NEVER_NEARER_M: f64 = 0.1;
/// Time constant of the velocity, seconds.
const TURNING_S: f64 = 0.5;
/// Longest step of the movement, seconds.
const STEP_S: f64 = 0.02;
/// A goal is reached within the way of this time, seconds, and within the least distance, metres.
const NEAR: [f64; 2] = [0.7, 0.3];
/// Least length of a jump: metres, and in a small room this share of the diagonal.
const JUMP: (f64, f64) = (3.0, 0.4);
/// The silence after which a tag at rest is at another place, seconds.
const MOVED_AFTER_S: f64 = 30.0;
/// The share of goals where the tag stops.
const STOPS: f64 = 0.3;

/// The positions at these times, metres.
pub(super) fn places_m(random: &mut impl Rng, conditions: &CaseConditions, times_s: &[f64]) -> Vec<[f64; 3]> {
    let jumps = match conditions.movement {
        Movement::Walk | Movement::Rest => 0,
        Movement::WalkAndJump | Movement::RestAndJump => random.random_range(1..=2),
    };
    let jumps_s: Vec<f64> = (0..jumps)
        .map(|jump| conditions.seconds * (f64::from(jump) + between(random, 0.3, 0.8)) / f64::from(jumps))
        .collect();
    let mut walker = Walker::new(random, conditions);
    let mut before_s = times_s.first().copied().unwrap_or_default();
    let places = times_s.iter().map(|&t_s| {
        let moves = match conditions.movement {
            Movement::Walk | Movement::WalkAndJump => true,
            Movement::Rest | Movement::RestAndJump => false,
        };
        if moves {
            walker.walk(random, t_s - before_s);
        } else if t_s - before_s > MOVED_AFTER_S {
            walker = Walker::new(random, conditions);
        }
        if jumps_s.iter().any(|jump_s| (before_s..t_s).contains(jump_s)) {
            walker.jump(random);
        }
        before_s = t_s;
        walker.at_m
    });
    places.collect()
}

/// A tag that walks.
struct Walker<'a> {
    conditions: &'a CaseConditions,
    at_m: [f64; 3],
    velocity_m_s: [f64; 3],
    goal_m: [f64; 3],
    speed_m_s: f64,
    /// The time that it still stops, seconds.
    stops_s: f64,
}

impl<'a> Walker<'a> {
    fn new(random: &mut impl Rng, conditions: &'a CaseConditions) -> Self {
        let (at_m, goal_m) = (goal(random, conditions), goal(random, conditions));
        let speed_m_s = speed(random);
        Self { conditions, at_m, velocity_m_s: [0.0; 3], goal_m, speed_m_s, stops_s: 0.0 }
    }

    fn walk(&mut self, random: &mut impl Rng, seconds: f64) {
        let steps = (seconds / STEP_S).ceil().max(1.0);
        for _ in 0..steps as usize {
            self.step(random, seconds / steps);
        }
    }

    fn step(&mut self, random: &mut impl Rng, dt_s: f64) {
        let [near_s, near_m] = NEAR;
        if distance(&self.at_m, &self.goal_m) < (near_s * self.speed_m_s).max(near_m) {
            self.goal_m = goal(random, self.conditions);
            self.speed_m_s = speed(random);
            self.stops_s = if happens(random, STOPS) { between(random, 1.0, 6.0) } else { 0.0 };
        }
        self.stops_s -= dt_s;
        let away_m = distance(&self.at_m, &self.goal_m).max(f64::MIN_POSITIVE);
        let wanted = if self.stops_s > 0.0 { 0.0 } else { self.speed_m_s / away_m };
        for axis in 0..3 {
            let change = wanted * (self.goal_m[axis] - self.at_m[axis]) - self.velocity_m_s[axis];
            self.velocity_m_s[axis] += change * dt_s / TURNING_S;
            self.at_m[axis] += self.velocity_m_s[axis] * dt_s;
        }
        for axis in 0..2 {
            let wall_m = self.conditions.room_m[axis] - NEVER_NEARER_M;
            self.at_m[axis] = self.at_m[axis].clamp(NEVER_NEARER_M, wall_m);
        }
    }

    /// Puts the tag at another place, at rest.
    fn jump(&mut self, random: &mut impl Rng) {
        let (before_m, least_m) = (self.at_m, least_jump_m(self.conditions));
        // From anywhere, a corner is farther than half of the diagonal.
        while distance(&before_m, &self.at_m) < least_m {
            self.at_m = goal(random, self.conditions);
        }
        self.velocity_m_s = [0.0; 3];
        self.goal_m = goal(random, self.conditions);
    }
}

/// The least length of a jump, metres.
pub(super) fn least_jump_m(conditions: &CaseConditions) -> f64 {
    let [length, width] = [0, 1].map(|axis: usize| conditions.room_m[axis] - 2.0 * MARGIN_M);
    JUMP.0.min(JUMP.1 * length.hypot(width))
}

fn speed(random: &mut impl Rng) -> f64 {
    between(random, 0.3, 1.5)
}

fn goal(random: &mut impl Rng, conditions: &CaseConditions) -> [f64; 3] {
    let [length, width, _] = conditions.room_m;
    let [x, y] = [length, width].map(|size| between(random, MARGIN_M, size - MARGIN_M));
    let [least, greatest] = conditions.heights_m;
    [x, y, between(random, least, greatest)]
}
