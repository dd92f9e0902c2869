//! The samples of all measurements of solvers: a room, a tag at a random position in each epoch, and ranges with noise
//! and with blocked paths.
//!
//! They are computed with additions, products and exact square roots only, so that chip and desktop have the same bits.

use oorandom::Rand32;
use positioning_core::{MAX_ANCHORS, RangeSample, Real};

/// The numbers of anchors in the measurements.
pub const ANCHORS: [usize; 3] = [4, 8, 12];
/// The number of epochs of one measurement: iterative methods cost more in some epochs than in others.
pub const EPOCHS: u32 = 32;

/// The room in the simulation of P. M. de Rojas Malpartida's thesis (annex G), metres.
const WIDTH_M: f32 = 9.5;
const DEPTH_M: f32 = 7.5;
/// Heights of anchors, metres: under the ceiling, and above the skirting board.
const HIGH_M: f32 = 2.6;
const LOW_M: f32 = 0.4;
/// The errors of a direct range, metres: the rest of the antenna delay, and the radio's noise.
const BIAS_M: f32 = 0.04;
const NOISE_M: f32 = 0.07;
/// The least and the greatest excess of a blocked range, metres.
const LEAST_EXCESS_M: f32 = 0.3;
const MOST_EXCESS_M: f32 = 2.0;
/// One anchor in `BLOCKED_EVERY` is blocked, beginning with a random one.
const BLOCKED_EVERY: usize = 4;

/// The ranges of one epoch.
#[derive(Clone, Copy, Debug)]
pub struct DrawnEpoch<const D: usize> {
    samples: [RangeSample<f32, D>; MAX_ANCHORS],
    count: usize,
}

impl<const D: usize> DrawnEpoch<D> {
    /// The ranges to `anchors` anchors at epoch number `number`, in the plane or in space.
    ///
    /// The anchors have equal distances along the room's perimeter. In space all of them are under the ceiling in every
    /// other epoch, where a position has a mirror image. In the remaining epochs they are alternately high and low.
    pub fn new(anchors: usize, number: u32) -> Self {
        let mut random = Rand32::new(u64::from(number) << 8 | (anchors * D) as u64);
        let mut within = |low: f32, high: f32| low + (high - low) * random.rand_float();
        let tag = [within(0.5, WIDTH_M - 0.5), within(0.5, DEPTH_M - 0.5), within(0.2, 2.0)];
        let first_blocked = within(0.0, BLOCKED_EVERY as f32) as usize;
        let under_ceiling = number % 2 == 1;

        let count = anchors.min(MAX_ANCHORS);
        let mut samples = [RangeSample::new([0.0; D], 0.0); MAX_ANCHORS];
        for (i, sample) in samples.iter_mut().enumerate().take(count) {
            let [x, y] = on_perimeter(i as f32 / count as f32);
            let place = [x, y, if under_ceiling || i % 2 == 0 { HIGH_M } else { LOW_M }];
            let anchor: [f32; D] = core::array::from_fn(|axis| place[axis]);
            let mut square = 0.0;
            for axis in 0..D {
                square += (tag[axis] - anchor[axis]).squared();
            }
            let blocked = i % BLOCKED_EVERY == first_blocked;
            // The sum of four uniform numbers is approximately normal. Its variance is 4/3, and 0.866 scales it to 1.
            let bell = within(-1.0, 1.0) + within(-1.0, 1.0) + within(-1.0, 1.0) + within(-1.0, 1.0);
            let noise = BIAS_M + NOISE_M * 0.866 * bell;
            let excess = within(LEAST_EXCESS_M, MOST_EXCESS_M);
            *sample = RangeSample::new(anchor, square.sqrt() + noise + if blocked { excess } else { 0.0 });
            sample.los = Some(!blocked);
        }
        Self { samples, count }
    }

    /// The ranges.
    pub fn samples(&self) -> &[RangeSample<f32, D>] {
        &self.samples[..self.count]
    }
}

/// The point at a `part` of the way around the room, 0 to 1.
pub(crate) fn on_perimeter(part: f32) -> [f32; 2] {
    let way = part * 2.0 * (WIDTH_M + DEPTH_M);
    if way < WIDTH_M {
        [way, 0.0]
    } else if way < WIDTH_M + DEPTH_M {
        [WIDTH_M, way - WIDTH_M]
    } else if way < 2.0 * WIDTH_M + DEPTH_M {
        [2.0 * WIDTH_M + DEPTH_M - way, DEPTH_M]
    } else {
        [0.0, 2.0 * (WIDTH_M + DEPTH_M) - way]
    }
}
