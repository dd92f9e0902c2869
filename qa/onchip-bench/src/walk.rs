//! The measurements for the engine's image: a tag that walks through the room of [`cases`](crate::cases), and rounds of
//! ranges to the anchors on its walls. One link in four is blocked.
//!
//! They are computed with additions, products and exact square roots only, so that chip and desktop have the same bits.

use oorandom::Rand32;
use positioning_core::engine::{Dimensions, Engine, Measurement, Output, Range, Settings};
use positioning_core::{Real, Side};

/// The numbers of anchors in the measurements.
pub const ANCHORS: [u16; 3] = [4, 8, 16];
/// The number of rounds before the measurements.
pub const WARM_UP: u32 = 30;
/// The number of rounds of which every step is measured.
pub const ROUNDS: u32 = 8;

/// From one round to the next, microseconds.
const ROUND_US: u64 = 20_000;
/// From one range of a round to the next, microseconds.
const RANGE_US: u64 = 300;

/// The kind of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WalkStep {
    /// The end of the round that starts the track.
    Start,
    /// A range.
    Range,
    /// The end of any other round.
    RoundEnd,
}

impl WalkStep {
    /// The name that the image prints.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Start => "start",
            Self::Range => "range",
            Self::RoundEnd => "round-end",
        }
    }
}

/// Walks, in the plane or in space. `step` is called for every measurement. It gives the measurement to the engine, and
/// may measure the cost.
pub fn walk(
    anchors: u16,
    space: bool,
    mut step: impl FnMut(&mut Engine<f32>, WalkStep, u64, &Measurement<f32>) -> Output<f32>,
) {
    let dimensions = if space { Dimensions::Space { side: Side::Unknown } } else { Dimensions::Plane { height: 1.2 } };
    let mut engine = Engine::new(Settings::track(dimensions));
    let mut random = Rand32::new(u64::from(anchors));
    for round in 0..WARM_UP + ROUNDS {
        let begun = u64::from(round) * ROUND_US;
        for anchor in 0..anchors {
            let now = begun + u64::from(anchor) * RANGE_US;
            // A metre a second along the room.
            let tag = [2.0 + 1.0e-6 * now as f32, 3.0, 1.2];
            let range = Measurement::Range(range(anchor, anchors, tag, random.rand_float()));
            step(&mut engine, WalkStep::Range, now, &range);
        }
        let end = begun + u64::from(anchors) * RANGE_US;
        step(&mut engine, if round == 0 { WalkStep::Start } else { WalkStep::RoundEnd }, end, &Measurement::RoundEnd);
    }
}

/// A range to one of `anchors` anchors on the walls. Its error is derived from `random`, a number from 0 to 1.
pub fn range(anchor: u16, anchors: u16, tag: [f32; 3], random: f32) -> Range<f32> {
    let part = f32::from(anchor) / f32::from(anchors);
    let [x, y] = crate::cases::on_perimeter(part);
    let position_m = [x, y, if anchor.is_multiple_of(2) { 2.6 } else { 0.4 }];
    let mut square = 0.0;
    for axis in 0..3 {
        square += (tag[axis] - position_m[axis]).squared();
    }
    let blocked = anchor % 4 == 3;
    let excess = if blocked { 0.6 } else { 0.0 };
    Range {
        anchor,
        position_m,
        distance_m: square.sqrt() + excess + 0.1 * (random - 0.5),
        deviation_m: 0.03,
        p_nlos: Some(if blocked { 0.8 } else { 0.1 }),
        excess_m: None,
    }
}
