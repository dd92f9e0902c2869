//! The position of a walking receiver, from scan to scan: a Bayes filter over the points of a lattice.
//!
//! Between scans the probability spreads to the neighbours of each point, as on a random walk, but not through walls.
//! A scan multiplies the probability by its likelihood. Fading does not change while the receiver stands still, so
//! scans in quick succession have the same errors. Each scan therefore counts for the time since the last scan, as a
//! share of the fading's time constant.

use heapless::Vec;

use super::lattice::{Likelihood, Moments, Posterior, Receiver};
use super::{MAX_NODE_POINTS, Map, NoPosition};
use crate::Real;
use crate::ble::path_loss::Wall;

/// The largest share of a point's probability that one pass moves to each neighbour.
const MOST_A_PASS: f64 = 0.2;
/// If more passes than this are needed, the probability becomes uniform again.
const MOST_PASSES: usize = 100;
/// The share of the probability that is spread uniformly before a scan, so that a lost receiver is found again.
const LOST: f64 = 1.0e-3;

/// Probabilities below this do not count in the mean.
const NOTHING: f64 = 1.0e-6;

/// How a receiver walks.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Motion<T> {
    /// How far the receiver goes along each axis in a second, metres (standard deviation; it grows with the square
    /// root of time).
    pub spread_m: T,
    /// How long errors of RSSI values stay the same, seconds.
    pub fading_s: T,
}

impl<T: Real> Default for Motion<T> {
    /// A person or a robot indoors.
    fn default() -> Self {
        Self { spread_m: T::of(0.5), fading_s: T::of(1.3) }
    }
}

/// The probability over a map's points; `N` is the room for points.
#[derive(Clone, Debug, Default)]
pub struct Walk<T, const N: usize = MAX_NODE_POINTS> {
    belief: Vec<T, N>,
    next: Vec<T, N>,
    at_us: u64,
}

impl<T: Real, const N: usize> Walk<T, N> {
    /// Nothing is known.
    pub fn new() -> Self {
        Self { belief: Vec::new(), next: Vec::new(), at_us: 0 }
    }

    /// Takes the scan of `now_us`. The map is a lattice whose points are ordered column by column. If the map has
    /// another number of points than before, or the clock was set back, the filter starts anew. The probability does
    /// not spread through walls, which are in the map's coordinates. Where the scans contradict that repeatedly, a
    /// receiver is still found again behind a wall. A scan that is refused changes nothing.
    ///
    /// # Errors
    /// There is no position; [`NoPosition`] has the reason.
    pub fn step(
        &mut self,
        map: &Map<'_>,
        scan: &[Option<T>],
        receiver: &Receiver<T>,
        motion: &Motion<T>,
        walls: &[Wall<T>],
        now_us: u64,
    ) -> Result<Posterior<T>, NoPosition> {
        let likelihood = Likelihood::new(map, scan, receiver)?;
        let points = map.points();
        if points > N {
            return Err(NoPosition::TooManyPoints);
        }
        let known = self.belief.len() == points && now_us >= self.at_us;
        let share = if known { self.spread(map, motion, walls, now_us) } else { self.start(points) };
        self.at_us = now_us;
        let uniform = T::of(LOST) / T::count(points);
        let mut top: Option<T> = None;
        self.next.clear();
        for row in map.rows() {
            let log = share * likelihood.at(&row).log;
            top = Some(top.map_or(log, |top| top.at_least(log)));
            // There is room for all points.
            let _ = self.next.push(log);
        }
        let top = top.unwrap_or(T::ZERO);
        let mut total = T::ZERO;
        for (belief, log) in self.belief.iter_mut().zip(&self.next) {
            *belief = (*belief + uniform) * (*log - top).exp();
            total += *belief;
        }
        let mut moments = Moments::default();
        for (belief, row) in self.belief.iter_mut().zip(map.rows()) {
            *belief /= total;
            // Where the probability is negligible, the likelihood need not be computed again.
            if *belief > T::of(NOTHING) {
                moments.add_weighted(*belief, &likelihood.at(&row), row.units);
            }
        }
        Ok(moments.posterior(map, &likelihood))
    }

    /// Sets the probability to uniform. The first scan counts in full.
    fn start(&mut self, points: usize) -> T {
        self.belief.clear();
        // There are no more points than room.
        let _ = self.belief.resize(points, T::ONE / T::count(points));
        T::ONE
    }

    /// Spreads the probability until `now_us`. Returns the share for which a scan then counts.
    fn spread(&mut self, map: &Map<'_>, motion: &Motion<T>, walls: &[Wall<T>], now_us: u64) -> T {
        let passed_us = u32::try_from(now_us.saturating_sub(self.at_us)).unwrap_or(u32::MAX);
        let passed_s = T::of(1.0e-6) * T::count(passed_us as usize);
        // A share s to each of two neighbours along an axis is a variance of 2 s units².
        let moved = T::of(0.5) * passed_s * (motion.spread_m / map.unit()).squared();
        let mut passes = 1;
        while passes <= MOST_PASSES && moved > T::count(passes) * T::of(MOST_A_PASS) {
            passes += 1;
        }
        if passes > MOST_PASSES || !moved.is_finite() {
            return self.start(map.points());
        }
        let share = moved / T::count(passes);
        for _ in 0..passes {
            self.pass(map, walls, share);
        }
        let counts = passed_s / motion.fading_s;
        if counts < T::ONE { counts } else { T::ONE }
    }

    /// Neighbours exchange a share of their probability. The part that would leave the lattice or pass through a wall
    /// stays.
    fn pass(&mut self, map: &Map<'_>, walls: &[Wall<T>], share: T) {
        let place = |units: [u8; 2]| map.place(units.map(|units| T::count(units.into())));
        let is_open = |a: [u8; 2], b: [u8; 2]| {
            walls.is_empty() || {
                let (a, b) = (place(a), place(b));
                !walls.iter().any(|wall| wall.parts(a, b))
            }
        };
        self.next.clone_from(&self.belief);
        let mut beside = map.rows().enumerate().peekable();
        let mut after = map.rows().skip(1);
        for (index, row) in map.rows().enumerate() {
            let [x, y] = row.units;
            let above = after.next().filter(|next| next.units[0] == x && y.checked_add(1) == Some(next.units[1]));
            if above.is_some_and(|above| is_open(row.units, above.units)) {
                self.exchange(index, index + 1, share);
            }
            let Some(right) = x.checked_add(1) else { continue };
            while beside.next_if(|(_, other)| other.units < [right, y]).is_some() {}
            let beside = beside.peek().filter(|(_, other)| other.units == [right, y]);
            if let Some(&(other, _)) = beside.filter(|(_, other)| is_open(row.units, other.units)) {
                self.exchange(index, other, share);
            }
        }
        core::mem::swap(&mut self.belief, &mut self.next);
    }

    fn exchange(&mut self, one: usize, other: usize, share: T) {
        let [Some(a), Some(b)] = [one, other].map(|at| self.belief.get(at).copied()) else { return };
        let flow = share * (a - b);
        for (at, flow) in [(one, -flow), (other, flow)] {
            if let Some(belief) = self.next.get_mut(at) {
                *belief += flow;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::lattice::tests::row_of;
    use super::*;

    const STILL: Motion<f64> = Motion { spread_m: 0.0, fading_s: 1.0 };

    fn receiver() -> Receiver<f64> {
        Receiver { offset_deviation_db: 0.0, ..Receiver::default() }
    }

    #[test]
    fn scans_count_for_the_time_between_them() {
        // A scan has the weights 1 and e^−2 (see `locate`). A second scan 0.5 s later counts for half: e^−2 · e^−1 =
        // e^−3 in all. With 0.1 % of probability spread uniformly: 0.1192 → (0.119203 + 0.0005) · e^−1 ⁄ ((0.880797 +
        // 0.0005) + …) = 0.04758.
        let bytes = row_of(&[-60.0, -66.0], 2.0);
        let (map, _) = Map::decode(&bytes).expect("a map");
        let mut walk = Walk::<f64, 2>::new();
        let first = walk.step(&map, &[Some(-60.0)], &receiver(), &STILL, &[], 5_000_000).expect("found");
        assert!((first.position[0] - 0.238_406).abs() < 1e-5, "{first:?}");
        let second = walk.step(&map, &[Some(-60.0)], &receiver(), &STILL, &[], 5_500_000).expect("found");
        assert!((second.position[0] / 2.0 - 0.047_58).abs() < 1e-4, "{second:?}");
        // The clock is set back: the filter starts anew.
        let third = walk.step(&map, &[Some(-60.0)], &receiver(), &STILL, &[], 0).expect("found");
        assert!((third.position[0] - 0.238_406).abs() < 1e-5, "{third:?}");
    }

    #[test]
    fn belief_spreads_as_a_random_walk_and_none_is_lost() {
        // RSSI values without information, except for the first scan: 41 points, of which the middle one is certain.
        // After 1 s with 0.5 m ⁄ √s on 0.5 m the variance is (0.5 m)², apart from the variance within a point's
        // square.
        let mut rssis = [-90.0; 41];
        rssis[20] = -40.0;
        let bytes = row_of(&rssis, 0.5);
        let (map, _) = Map::decode(&bytes).expect("a map");
        let mut walk = Walk::<f64, 41>::new();
        let motion = Motion { spread_m: 0.5, fading_s: 1.0e9 };
        walk.step(&map, &[Some(-40.0)], &receiver(), &motion, &[], 0).expect("found");
        let later = walk.step(&map, &[Some(-40.0)], &receiver(), &motion, &[], 1_000_000).expect("found");
        assert!((later.position[0] - 10.0).abs() < 0.01, "{later:?}");
        let lost = LOST * 0.25 * (41.0 * 41.0 - 1.0) / 12.0;
        assert!((later.covariance[0] - 0.25 / 12.0 - (0.25 + lost)).abs() < 0.01, "{later:?}");
        let sum: f64 = walk.belief.iter().sum();
        assert!((sum - 1.0).abs() < 1e-9);
    }

    #[test]
    fn neighbours_are_found_across_gaps() {
        // An L of five points, column by column: (0,0) (0,1) (0,2) (1,0) (2,0). (0,0) is certain; a pass of 0.1
        // reaches (0,1) and (1,0).
        let places = [[0.0, 0.0], [0.0, 1.0], [0.0, 2.0], [1.0, 0.0], [2.0, 0.0]];
        let points =
            places.map(|position_m| super::super::Point { position_m, rssis: &[Some(-60.0)], deviations: &[3.0] });
        let mut buffer = [0; 128];
        let bytes = super::super::encode(&points, &[1], &[-95.0], Some(1.0), &mut buffer).expect("encoded");
        let (map, _) = Map::decode(bytes).expect("a map");
        let mut walk = Walk::<f64, 5> { belief: Vec::from_array([1.0, 0.0, 0.0, 0.0, 0.0]), ..Walk::new() };
        walk.pass(&map, &[], 0.1);
        let expected = [0.8, 0.1, 0.0, 0.1, 0.0];
        assert!(walk.belief.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{:?}", walk.belief);
        // A wall through (1, 0); the point is on the wall's left. Nothing reaches (2, 0), and the other four points
        // share everything.
        let walls = [Wall { ends: [[1.0, -1.0], [1.0, 3.0]], attenuation: 0.0 }];
        let mut walk = Walk::<f64, 5> { belief: Vec::from_array([1.0, 0.0, 0.0, 0.0, 0.0]), ..Walk::new() };
        for _ in 0..200 {
            walk.pass(&map, &walls, 0.1);
        }
        let expected = [0.25, 0.25, 0.25, 0.25, 0.0];
        assert!(walk.belief.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-4), "{:?}", walk.belief);
    }

    #[test]
    fn a_walker_does_not_pass_a_wall() {
        // A corridor of eleven points, 1 m apart, symmetric about its middle: RSSI values fall from −50 at the middle
        // by 4 dB per metre. The probability starts at x = 2. The receiver walks to the middle and goes back to −62.
        // Without a wall both ends are equally likely, and the mean is the middle. With a wall at x = 5.5 the mean is
        // x = 2, where −62 is.
        let rssis: std::vec::Vec<f64> = (0..11).map(|x| -50.0 - 4.0 * f64::from((x - 5_i32).abs())).collect();
        let bytes = row_of(&rssis, 1.0);
        let (map, _) = Map::decode(&bytes).expect("a map");
        let goes = |walls: &[Wall<f64>]| {
            let mut walk = Walk::<f64, 11>::new();
            walk.step(&map, &[Some(-62.0)], &receiver(), &STILL, walls, 0).expect("found");
            for (x, belief) in walk.belief.iter_mut().enumerate() {
                *belief = if x == 2 { 1.0 } else { 0.0 };
            }
            let motion = Motion { spread_m: 1.0, fading_s: 1.0 };
            let way = [-62.0, -58.0, -54.0, -50.0, -50.0, -50.0, -54.0, -58.0, -62.0, -62.0];
            let scans = way.into_iter().zip(1..);
            let found = scans.map(|(rssi, second)| {
                walk.step(&map, &[Some(rssi)], &receiver(), &motion, walls, second * 1_000_000).expect("found")
            });
            found.last().expect("some").position[0]
        };
        let (open, walled) = (goes(&[]), goes(&[Wall { ends: [[5.5, 0.0], [5.5, 2.0]], attenuation: 0.0 }]));
        assert!((open - 5.0).abs() < 1.0, "{open}");
        assert!((walled - 2.0).abs() < 0.5, "{walled}");
    }

    #[test]
    fn nonsense_changes_nothing() {
        let bytes = row_of(&[-60.0, -66.0], 2.0);
        let (map, _) = Map::decode(&bytes).expect("a map");
        let mut walk = Walk::<f64, 2>::new();
        let motion = Motion::default();
        walk.step(&map, &[Some(-60.0)], &receiver(), &motion, &[], 0).expect("found");
        let before = walk.belief.clone();
        assert_eq!(walk.step(&map, &[Some(f64::NAN)], &receiver(), &motion, &[], 9), Err(NoPosition::Unheard));
        assert_eq!((walk.belief.clone(), walk.at_us), (before, 0));
        let odd = Motion { spread_m: f64::NAN, fading_s: f64::NAN };
        assert!(
            walk.step(&map, &[Some(-60.0)], &receiver(), &odd, &[], u64::MAX).expect("found").position[0].is_finite()
        );
        let mut small = Walk::<f64, 1>::new();
        assert_eq!(small.step(&map, &[Some(-60.0)], &receiver(), &motion, &[], 0), Err(NoPosition::TooManyPoints));
    }
}
