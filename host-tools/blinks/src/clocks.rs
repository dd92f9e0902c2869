//! How far the clocks of two anchors are apart at the instant of a blink, by the sync frames that both received.
//!
//! A sync frame of an anchor at a known place arrives at two others at instants that differ by their distances and by
//! their clocks. The clocks' difference and its rate are followed from the oldest sync frame to the blink, and from the
//! newest one back to it, and both results are combined (D. C. Fraser, J. E. Potter, "The optimum linear smoother as a
//! combination of two optimum linear filters", 1969). Sync frames come ten times a second, so a blink lies between some.

use radio::RadioInstant;
use radio::time::{METRES_PER_TICK, TICKS_PER_SECOND};

/// Standard deviation of a timestamp, metres: that of the nodes' own ranging, 6.4 ticks.
pub(crate) const STAMP_M: f64 = 6.4 * METRES_PER_TICK;
/// The speed of light in air, metres a second.
const LIGHT_M_S: f64 = METRES_PER_TICK * TICKS_PER_SECOND as f64;
/// Two crystals may differ by this much, 40 parts per million, metres a second.
const UNKNOWN_RATE_M_S: f64 = 40e-6 * LIGHT_M_S;
/// Wander of the difference of two rates, variance per second: 0.05 ppm after a second for each, as nodes assume.
const RATE_WANDER: f64 = 2.0 * 2.5e-15 * LIGHT_M_S * LIGHT_M_S;
/// A sync frame beyond this many standard deviations took another path.
const GATE: f64 = 5.0;
/// Clocks that are known less well than this, metres, are not known.
const VAGUEST_M: f64 = 1.0;

/// A sync frame at two anchors, relative to the blink.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Common {
    /// Seconds after the blink.
    pub(crate) after_s: f64,
    /// How much later it arrived at the one than at the other, relative to the blink, without what the distances of its
    /// sender explain, metres.
    pub(crate) later_m: f64,
    /// Timestamps of receptions in it: one if it was sent by one of the two.
    pub(crate) receptions: u8,
}

/// The difference of two clocks at the instant of the blink, metres, and its variance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Relation {
    pub(crate) later_m: f64,
    pub(crate) variance_m2: f64,
}

/// From one instant of a clock to another, metres.
pub(crate) fn between_m(from: RadioInstant, to: RadioInstant) -> f64 {
    to.since(from).ticks() as f64 * METRES_PER_TICK
}

/// From one instant of a clock to another, seconds.
pub(crate) fn between_s(from: RadioInstant, to: RadioInstant) -> f64 {
    to.since(from).ticks() as f64 / TICKS_PER_SECOND as f64
}

/// What the sync frames say of the clocks, in any order. `None` if there are too few, or if they contradict each other: an
/// anchor was restarted.
pub(crate) fn relation(common: &mut [Common]) -> Option<Relation> {
    common.sort_by(|a, b| a.after_s.total_cmp(&b.after_s));
    let (before, after) = common.split_at(common.partition_point(|common| common.after_s <= 0.0));
    let relation = match (Track::along(before.iter()), Track::along(after.iter().rev())) {
        (Some(before), Some(after)) => before.and(&after)?,
        (Some(one), None) | (None, Some(one)) => Relation { later_m: one.later_m, variance_m2: one.variance[0][0] },
        (None, None) => return None,
    };
    (relation.variance_m2 < VAGUEST_M * VAGUEST_M).then_some(relation)
}

/// Two clocks as they are followed.
#[derive(Clone, Copy, Debug)]
struct Track {
    after_s: f64,
    /// Their difference …
    later_m: f64,
    /// … and how it grows.
    rate_m_s: f64,
    variance: [[f64; 2]; 2],
}

impl Track {
    /// Follows the clocks from the first sync frame to the last, and on to the blink.
    fn along<'c>(mut common: impl Iterator<Item = &'c Common>) -> Option<Self> {
        let first = common.next()?;
        let variance = [[noise(first), 0.0], [0.0, UNKNOWN_RATE_M_S * UNKNOWN_RATE_M_S]];
        let mut track = Self { after_s: first.after_s, later_m: first.later_m, rate_m_s: 0.0, variance };
        for next in common {
            track.advance(next.after_s);
            track.take(next);
        }
        track.advance(0.0);
        Some(track)
    }

    /// Time goes on, or back.
    fn advance(&mut self, after_s: f64) {
        let step = after_s - self.after_s;
        let span = step.abs();
        self.after_s = after_s;
        self.later_m += step * self.rate_m_s;
        let [[of_offset, covariance], [_, of_rate]] = self.variance;
        let offset = of_offset + step * (2.0 * covariance + step * of_rate) + RATE_WANDER * span.powi(3) / 3.0;
        let cross = covariance + step * of_rate + step.signum() * RATE_WANDER * span * span / 2.0;
        self.variance = [[offset, cross], [cross, of_rate + RATE_WANDER * span]];
    }

    fn take(&mut self, common: &Common) {
        let innovation = common.later_m - self.later_m;
        let [[of_offset, covariance], [_, of_rate]] = self.variance;
        let expected = of_offset + noise(common);
        if innovation * innovation > GATE * GATE * expected {
            return;
        }
        let [offset_gain, rate_gain] = [of_offset / expected, covariance / expected];
        self.later_m += offset_gain * innovation;
        self.rate_m_s += rate_gain * innovation;
        let cross = covariance * (1.0 - offset_gain);
        self.variance = [[of_offset * (1.0 - offset_gain), cross], [cross, of_rate - rate_gain * covariance]];
    }

    /// Both together. `None` if they contradict each other.
    fn and(&self, other: &Self) -> Option<Relation> {
        // The sum of both covariances, inverted, weighs the difference of both states.
        let [[a, b], [_, d]]: [[f64; 2]; 2] =
            core::array::from_fn(|r| core::array::from_fn(|c| self.variance[r][c] + other.variance[r][c]));
        let determinant = a * d - b * b;
        let apart = [other.later_m - self.later_m, other.rate_m_s - self.rate_m_s];
        let weighed = [(d * apart[0] - b * apart[1]) / determinant, (a * apart[1] - b * apart[0]) / determinant];
        let square = apart[0] * weighed[0] + apart[1] * weighed[1];
        let [own, cross] = self.variance[0];
        let gains = [(own * d - cross * b) / determinant, (cross * a - own * b) / determinant];
        let relation = Relation {
            later_m: self.later_m + own * weighed[0] + cross * weighed[1],
            variance_m2: own - (gains[0] * own + gains[1] * cross),
        };
        (square < GATE * GATE).then_some(relation)
    }
}

fn noise(common: &Common) -> f64 {
    f64::from(common.receptions) * STAMP_M * STAMP_M
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;
    use rand_distr::{Distribution, Normal};
    use rand_pcg::Pcg64;

    /// Clocks that differ by 12 ppm and wander as assumed: sixteen sync frames in 20 ms of each 100 ms, and how far apart
    /// the clocks are at the blink, `into_s` after the beginning of a superframe.
    fn drawn(rng: &mut Pcg64, into_s: f64, from: i32, to: i32) -> (Vec<Common>, f64) {
        let mut normal = |deviation: f64| Normal::new(0.0, deviation).unwrap().sample(rng);
        let (mut offset_m, mut rate_m_s, mut t_s) = (5.0, 12e-6 * LIGHT_M_S, f64::from(from) * 0.1);
        let mut frames = Vec::new();
        let mut at_blink_m = None;
        let mut instants: Vec<f64> =
            (from..to).flat_map(|n| (0..16).map(move |slot| f64::from(n) * 0.1 + f64::from(slot) * 1.25e-3)).collect();
        instants.push(into_s);
        instants.sort_by(f64::total_cmp);
        for at_s in instants {
            let step = (at_s - t_s) / 10.0;
            for _ in 0..10 {
                rate_m_s += normal((RATE_WANDER * step).sqrt());
                offset_m += rate_m_s * step;
            }
            t_s = at_s;
            if at_s == into_s {
                at_blink_m = Some(offset_m);
            } else {
                let later_m = offset_m + normal(2_f64.sqrt() * STAMP_M);
                frames.push(Common { after_s: at_s - into_s, later_m, receptions: 2 });
            }
        }
        (frames, at_blink_m.unwrap())
    }

    #[test]
    fn errors_are_as_large_as_their_variance_says_between_sync_frames_and_after_the_last() {
        let mut rng = Pcg64::seed_from_u64(1);
        for (to, most_m) in [(2, 0.06), (1, 0.3)] {
            let (mut square, mut normalised) = (0.0, 0.0);
            for round in 0..400 {
                let (mut frames, truth_m) = drawn(&mut rng, 0.025 + 0.07 * f64::from(round) / 400.0, -3, to);
                let found = relation(&mut frames).expect("enough sync frames");
                let error = found.later_m - truth_m;
                square += error * error / 400.0;
                normalised += error * error / found.variance_m2 / 400.0;
            }
            // The mean of 400 squares of normalised errors is 1 ± 0.07.
            assert!((0.75..1.25).contains(&normalised), "{normalised}");
            assert!(square.sqrt() < most_m, "{}", square.sqrt());
        }
    }

    #[test]
    fn a_restart_a_wrong_frame_and_too_few_of_them() {
        let mut rng = Pcg64::seed_from_u64(2);
        let (frames, truth_m) = drawn(&mut rng, 0.05, -3, 2);
        let mut wrong = frames.clone();
        // Another path, by 3 m.
        wrong[40].later_m += 3.0;
        let found = relation(&mut wrong).expect("one of eighty does not matter");
        assert!((found.later_m - truth_m).abs() < 0.2, "{found:?} {truth_m}");
        let mut restarted = frames.clone();
        restarted.iter_mut().filter(|common| common.after_s > 0.0).for_each(|common| common.later_m += 1000.0);
        assert_eq!(relation(&mut restarted), None);
        assert_eq!(relation(&mut []), None);
        // The rate is not known by one.
        assert_eq!(relation(&mut frames[..1].to_vec()), None);
    }
}
