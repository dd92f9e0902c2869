//! The offset of a receiver that is located scan by scan, without a memory of positions: what a tag learns, whose track
//! has the memory.
//!
//! A position that is a little wrong explains a scan by an offset that is a little wrong, so the two are estimated
//! together. Input: scans that are too far apart in time to have the same fading. State: one normal distribution of
//! position and offset. The likelihood of a scan is summed over the lattice, where the offset is normal at each point
//! with a mean that is linear in the position. This is [`Walk`](super::Walk) with a distribution of nine numbers.

use super::lattice::{Joint, Likelihood, Moments, Receiver};
use super::walk::{DRIFT, FADING_S, seconds};
use super::{Map, NoPosition};
use crate::Real;

/// How far a receiver goes along each axis in a second, metres.
const SPREAD_M: f64 = 0.7;
/// A point beyond this squared Mahalanobis distance is as likely as at this distance, e⁻⁷, and independent of the
/// offset: the receiver may have been carried there.
const FAR: f64 = 14.0;

/// The offset of a receiver, and the position to which it belongs.
#[derive(Clone, Copy, Debug)]
pub struct OffsetFilter<T> {
    /// The offset's own distribution.
    receiver: Receiver<T>,
    /// Position and offset after the last scan, and its time.
    last: Option<(Joint<T>, u64)>,
}

impl<T: Real> Default for OffsetFilter<T> {
    fn default() -> Self {
        Self::new(Receiver::default())
    }
}

impl<T: Real> OffsetFilter<T> {
    /// The offset that is known of the receiver, at no position.
    pub fn new(receiver: Receiver<T>) -> Self {
        Self { receiver, last: None }
    }

    /// What is known of the receiver.
    pub fn receiver(&self) -> &Receiver<T> {
        &self.receiver
    }

    /// The receiver is at another position now, which is independent of the last one.
    pub fn leave(&mut self) {
        self.last = None;
    }

    /// Learns from a scan, whose RSSI values have this variance of noise. It counts for the time since the last scan,
    /// as a share of the fading's time constant.
    ///
    /// # Errors
    /// No beacon of the map is received, or the map's RSSI values have no deviations.
    pub fn learn(&mut self, map: &Map<'_>, scan: &[Option<T>], noise_db2: T, now_us: u64) -> Result<(), NoPosition> {
        let likelihood = Likelihood::new(map, scan, &Receiver { noise_db2, ..self.receiver })?;
        let [mean, variance] = likelihood.prior();
        let passed_s = self.last.map(|(_, at_us)| seconds::<T>(now_us, at_us));
        let drift = if variance > T::ZERO { T::of(DRIFT) * passed_s.unwrap_or(T::ZERO) } else { T::ZERO };
        let share = passed_s.map_or(T::ONE, |passed_s| (passed_s * T::of(1.0 / FADING_S)).at_most(T::ONE));
        let spread = passed_s.unwrap_or(T::ZERO) * (T::of(SPREAD_M) / map.unit()).squared();
        let near = self.last.and_then(|(joint, _)| Near::of(&joint, spread));
        let mut moments = Moments::default();
        for row in map.rows() {
            let sums = likelihood.sums(&row);
            let units = row.units.map(|units| T::count(units.into()));
            let (log, mean, variance) = match &near {
                Some(near) => near.at(units, mean, variance),
                None => (T::ZERO, mean, variance),
            };
            let seen = sums.seen(mean, variance + drift, share);
            moments.add(log + seen.log, &seen, row.units);
        }
        let joint = moments.joint();
        let (offset, deviation) = (joint.offset, joint.offset_variance.sqrt());
        if self.receiver.offset_deviation_db > T::ZERO && (offset + deviation).is_finite() {
            let half = T::of(0.5);
            (self.receiver.offset_db, self.receiver.offset_deviation_db) = (half * offset, half * deviation);
            self.last = Some((joint, now_us));
        }
        Ok(())
    }
}

impl OffsetFilter<f32> {
    /// [`learn`](Self::learn), compiled in this crate so that it has the optimisation level of this crate and not that
    /// of the image.
    ///
    /// # Errors
    /// As [`learn`](Self::learn).
    #[inline(never)]
    pub fn learn_on_node(
        &mut self,
        map: &Map<'_>,
        scan: &[Option<f32>],
        noise_db2: f32,
        now_us: u64,
    ) -> Result<(), NoPosition> {
        self.learn(map, scan, noise_db2, now_us)
    }
}

/// The distribution before a scan, where there is one.
struct Near<T> {
    position: [T; 2],
    /// The inverse of the covariance: xx, xy, yy.
    precision: [T; 3],
    /// How the offset's mean changes with the position.
    slope: [T; 2],
    /// The offset's variance where the position is known.
    variance: T,
}

impl<T: Real> Near<T> {
    /// After the position has spread by this variance, in the map's units.
    fn of(joint: &Joint<T>, spread: T) -> Option<Self> {
        let [xx, xy, yy] = joint.covariance;
        let (xx, yy) = (xx + spread, yy + spread);
        let determinant = xx * yy - xy * xy;
        let precision = [yy, -xy, xx].map(|entry| entry / determinant);
        let [ox, oy] = joint.cross;
        let slope = [precision[0] * ox + precision[1] * oy, precision[1] * ox + precision[2] * oy];
        let variance = (joint.offset_variance - slope[0] * ox - slope[1] * oy).at_least(T::ZERO);
        let usable = determinant > T::ZERO && (precision[0] + precision[2] + variance).is_finite();
        usable.then_some(Self { position: joint.position, precision, slope, variance })
    }

    /// The logarithm of the probability of a point, and mean and variance of the offset there. The arguments are
    /// those of the offset at any position.
    #[inline]
    fn at(&self, units: [T; 2], mean: T, variance: T) -> (T, T, T) {
        let [x, y] = [units[0] - self.position[0], units[1] - self.position[1]];
        let [xx, xy, yy] = self.precision;
        let square = xx * x * x + T::of(2.0) * xy * x * y + yy * y * y;
        if square < T::of(FAR) {
            (T::of(-0.5) * square, mean + self.slope[0] * x + self.slope[1] * y, self.variance)
        } else {
            (T::of(-0.5 * FAR), mean, variance)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Motion, Point, Walk, encode};
    use super::*;

    /// RSSI values of three beacons that fall over a row of 21 points, 0.5 m apart.
    fn row() -> std::vec::Vec<u8> {
        let at = |x: f64| [0.0, 5.0, 10.0].map(|beacon: f64| Some(-50.0 - 20.0 * (1.0 + (x - beacon).abs()).log10()));
        let rssis: std::vec::Vec<_> = (0..21).map(|index| at(f64::from(index) * 0.5)).collect();
        let point =
            |(index, rssis)| Point { position_m: [index as f64 * 0.5, 0.0], rssis, deviations: &[4.0, 4.0, 4.0] };
        let points: std::vec::Vec<_> = rssis.iter().map(|rssis| &rssis[..]).enumerate().map(point).collect();
        let mut buffer = [0; 1024];
        encode(&points, &[1, 2, 3], &[-95.0; 3], Some(0.5), &mut buffer).expect("encoded").to_vec()
    }

    #[test]
    fn one_point_has_the_kalman_filter_of_its_offset() {
        // One point, one beacon, always 6 dB too weak; prior 4 dB, an RSSI's deviation 3 dB. By hand: gain 16 ⁄ 25,
        // offset −3.84, variance 5.76. Two seconds later 5.76 + 2 · 16 ⁄ 3600 = 5.7689, gain 5.7689 ⁄ 14.7689:
        // −4.6838 ± 1.8750.
        let bytes = super::super::lattice::tests::row_of(&[-60.0], 1.0);
        let (map, _) = Map::decode(&bytes).expect("a map");
        let mut filter = OffsetFilter::<f64>::default();
        for (now_us, offset_db, deviation_db) in [(0, -3.84, 2.4), (2_000_000, -4.6838, 1.8750)] {
            filter.learn(&map, &[Some(-66.0)], 0.0, now_us).expect("learnt");
            let found = filter.receiver();
            assert!((found.offset_db - offset_db).abs() < 1e-3, "{found:?}");
            assert!((found.offset_deviation_db - deviation_db).abs() < 1e-3, "{found:?}");
        }
        let mut known = OffsetFilter::new(Receiver { offset_deviation_db: 0.0, ..Receiver::<f64>::default() });
        known.learn(&map, &[Some(-66.0)], 0.0, 0).expect("learnt");
        assert_eq!((known.receiver().offset_db, known.receiver().offset_deviation_db), (0.0, 0.0));
        assert_eq!(known.learn(&map, &[None], 0.0, 9), Err(NoPosition::Unheard));
    }

    #[test]
    fn a_walk_finds_the_offset_that_a_filter_with_all_points_finds() {
        // The receiver is 5 dB too weak and walks from 2 m to 8 m in 60 s.
        let bytes = row();
        let (map, _) = Map::decode(&bytes).expect("a map");
        let mut filter = OffsetFilter::<f64>::default();
        let mut walk = Walk::<f64, 21>::new();
        let mut at_each = 0.0;
        for second in 0..30_u32 {
            let point = 4 + second as usize * 12 / 29;
            let wiggle = |beacon: usize| 2.0 * (f64::from(second) * (2.0 + beacon as f64)).sin();
            let scan: std::vec::Vec<Option<f64>> =
                map.rssis::<f64>(point).enumerate().map(|(b, rssi)| rssi.map(|rssi| rssi - 5.0 + wiggle(b))).collect();
            let now_us = u64::from(second) * 2_000_000;
            filter.learn(&map, &scan, 0.0, now_us).expect("learnt");
            let motion = Motion { spread_m: [SPREAD_M; 2], ..Motion::default() };
            at_each = walk.step(&map, &scan, &Receiver::default(), &motion, &[], now_us).expect("found").offset_db;
        }
        let found = filter.receiver();
        assert!((found.offset_db - at_each).abs() < 0.4, "{found:?} {at_each}");
        assert!((found.offset_db + 5.0).abs() < 2.0 * found.offset_deviation_db, "{found:?}");
        assert!(found.offset_deviation_db < 1.0, "{found:?}");
    }

    #[test]
    fn single_precision_learns_the_same() {
        let bytes = row();
        let (map, _) = Map::decode(&bytes).expect("a map");
        let (mut single, mut double) = (OffsetFilter::<f32>::default(), OffsetFilter::<f64>::default());
        for second in 0..20 {
            let scan: std::vec::Vec<Option<f64>> =
                map.rssis::<f64>(second).map(|rssi| rssi.map(|rssi| rssi + 3.0)).collect();
            let halved: std::vec::Vec<Option<f32>> = scan.iter().map(|rssi| rssi.map(|rssi| rssi as f32)).collect();
            double.learn(&map, &scan, 4.0, second as u64 * 1_000_000).expect("learnt");
            single.learn_on_node(&map, &halved, 4.0, second as u64 * 1_000_000).expect("learnt");
        }
        let (single, double) = (single.receiver(), double.receiver());
        assert!((f64::from(single.offset_db) - double.offset_db).abs() < 0.01, "{single:?} {double:?}");
    }
}
