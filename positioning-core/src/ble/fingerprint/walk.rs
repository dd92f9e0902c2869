//! The position of a walking receiver, from scan to scan: a Bayes filter over the points of a lattice, and at each
//! point over the receiver's offset.
//!
//! Between scans the probability spreads to the neighbours of each point, as on a random walk, but not through walls.
//! A receiver lingers or walks, which is a state of its own that changes now and then. A scan multiplies the
//! probability by its likelihood. Fading does not change while the receiver stands still, so scans in quick succession
//! have the same errors. Each scan therefore counts for the time since the last scan, as a share of the fading's time
//! constant: for the position and for the offset, so that short and long epochs give the same.
//!
//! The offset is normal at each point: given the position it is a linear state, so each point has a Kalman filter of
//! its own (A. Doucet et al., *Rao-Blackwellised Particle Filtering for Dynamic Bayesian Networks*, UAI 2000). Where
//! probability moves to a point, means and variances are mixed by their moments. One offset for all points would be
//! learnt from the mean position, and then confirm it.

use heapless::Vec;

use super::lattice::{Likelihood, Moments, Posterior, Receiver, Seen};
use super::{MAX_NODE_POINTS, Map, NoPosition};
use crate::Real;
use crate::ble::path_loss::Wall;

/// The largest share of a point's probability that one pass moves to each neighbour.
const MOST_A_PASS: f64 = 0.2;
/// If more passes than this are needed, the probability becomes uniform again.
const MOST_PASSES: usize = 100;
/// The share of the probability that is spread uniformly before a scan, so that a lost receiver is found again.
const LOST: f64 = 1.0e-3;
/// The growth of the offset's variance, (½ dB)² per second: in an hour as much as receivers differ, (4 dB)².
pub(super) const DRIFT: f64 = 64.0 / 3600.0;
/// How long errors of RSSI values stay the same, seconds.
pub(super) const FADING_S: f64 = 1.3;

/// Probabilities below this do not count in the mean.
const NOTHING: f64 = 1.0e-6;

/// How a receiver moves.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Motion<T> {
    /// How far the receiver goes along each axis in a second while it lingers, and while it walks, metres (standard
    /// deviation; it grows with the square root of time).
    pub spread_m: [T; 2],
    /// After about this time a receiver that lingers walks, or the other way round, seconds.
    pub gait_s: T,
    /// How long errors of RSSI values stay the same, seconds.
    pub fading_s: T,
}

impl<T: Real> Default for Motion<T> {
    /// A person or a robot indoors.
    fn default() -> Self {
        Self { spread_m: [0.4, 1.2].map(T::of), gait_s: T::of(3.0), fading_s: T::of(FADING_S) }
    }
}

/// A part of the probability with its offset: the probability, its product with the offset's mean, and with the mean
/// of the offset's square. All three add up where parts meet.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Part<T> {
    belief: T,
    offset: T,
    square: T,
}

/// The parts at a point of a receiver that lingers, and of one that walks.
type Cell<T> = [Part<T>; 2];

/// The probability over a map's points; `N` is the room for points.
#[derive(Clone, Debug, Default)]
pub struct Walk<T, const N: usize = MAX_NODE_POINTS> {
    cells: Vec<Cell<T>, N>,
    next: Vec<Cell<T>, N>,
    at_us: u64,
    /// Since when the first scan was received.
    since_us: Option<u64>,
}

impl<T: Real> Part<T> {
    fn map(self, change: impl Fn(T) -> T) -> Self {
        Self { belief: change(self.belief), offset: change(self.offset), square: change(self.square) }
    }

    fn plus(self, other: Self) -> Self {
        Self {
            belief: self.belief + other.belief,
            offset: self.offset + other.offset,
            square: self.square + other.square,
        }
    }

    fn minus(self, other: Self) -> Self {
        Self {
            belief: self.belief - other.belief,
            offset: self.offset - other.offset,
            square: self.square - other.square,
        }
    }

    /// With an offset of this mean and variance.
    fn of(belief: T, mean: T, variance: T) -> Self {
        Self { belief, offset: belief * mean, square: belief * (variance + mean * mean) }
    }

    /// The offset's mean and variance.
    fn normal(&self) -> [T; 2] {
        let (mean, square) = (self.offset / self.belief, self.square / self.belief);
        [mean, (square - mean * mean).at_least(T::ZERO)]
    }
}

impl<T: Real, const N: usize> Walk<T, N> {
    /// Nothing is known. The first scan counts in full.
    pub fn new() -> Self {
        Self { cells: Vec::new(), next: Vec::new(), at_us: 0, since_us: None }
    }

    /// Nothing is known. The first scan is what is received from this time, and counts for no longer.
    pub fn since(at_us: u64) -> Self {
        Self { since_us: Some(at_us), ..Self::new() }
    }

    /// Takes the scan of `now_us`. The map is a lattice whose points are ordered column by column. If the map has
    /// another number of points than before, or the clock was set back, the filter starts anew, with the offset of
    /// `receiver`. The probability does not spread through walls, which are in the map's coordinates. Where the scans
    /// contradict that repeatedly, a receiver is still found again behind a wall. A scan that is refused changes
    /// nothing.
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
        let prior = likelihood.prior();
        let passed_s = if self.cells.len() == points && now_us >= self.at_us {
            let passed_s = seconds(now_us, self.at_us);
            if self.spread(map, motion, walls, passed_s, prior) { Some(passed_s) } else { None }
        } else {
            let since_us = self.since_us.take().filter(|since_us| now_us > *since_us);
            self.start(points, prior);
            since_us.map(|since_us| seconds(now_us, since_us))
        };
        self.at_us = now_us;
        let share = passed_s.map(|passed_s| passed_s / motion.fading_s).filter(|share| *share < T::ONE);
        let share = share.unwrap_or(T::ONE);

        let mut all = self.cells.iter().flatten().fold(Part::default(), |all, part| all.plus(*part));
        all = all.map(|sum| sum * T::of(0.5 * LOST) / T::count(points));
        let mut top: Option<T> = None;
        self.next.clear();
        for (cell, row) in self.cells.iter_mut().zip(map.rows()) {
            let sums = likelihood.sums(&row);
            // The logarithms of the likelihood stand where the probability goes, until the greatest is known.
            let seen = core::array::from_fn(|gait| {
                let part = &mut cell[gait];
                *part = part.plus(all);
                let [mean, variance] = part.normal();
                let Seen { log, offset, offset_variance } = sums.seen(mean, variance, share);
                top = Some(top.map_or(log, |top| top.at_least(log)));
                Part { belief: log, offset, square: offset_variance }
            });
            // There is room for all points.
            let _ = self.next.push(seen);
        }
        let top = top.unwrap_or(T::ZERO);
        let mut total = T::ZERO;
        for (part, seen) in self.cells.iter_mut().flatten().zip(self.next.iter().flatten()) {
            part.belief *= (seen.belief - top).exp();
            total += part.belief;
        }
        let mut moments = Moments::default();
        for ((cell, seen), row) in self.cells.iter_mut().zip(&self.next).zip(map.rows()) {
            for (part, seen) in cell.iter_mut().zip(seen) {
                let belief = part.belief / total;
                *part = Part::of(belief, seen.offset, seen.square);
                if belief > T::of(NOTHING) {
                    let seen = Seen { log: T::ZERO, offset: seen.offset, offset_variance: seen.square };
                    moments.add_weighted(belief, &seen, row.units);
                }
            }
        }
        Ok(moments.posterior(map, &likelihood))
    }

    /// Sets the probability to uniform.
    fn start(&mut self, points: usize, [mean, variance]: [T; 2]) {
        self.cells.clear();
        // There are no more points than room.
        let _ = self.cells.resize(points, [Part::of(T::of(0.5) / T::count(points), mean, variance); 2]);
    }

    /// Spreads the probability over the time that has passed. Returns false if that is too long: then nothing is
    /// known but the offset.
    fn spread(
        &mut self,
        map: &Map<'_>,
        motion: &Motion<T>,
        walls: &[Wall<T>],
        passed_s: T,
        [_, variance]: [T; 2],
    ) -> bool {
        // A share s to each of two neighbours along an axis is a variance of 2 s units².
        let moved = motion.spread_m.map(|spread_m| T::of(0.5) * passed_s * (spread_m / map.unit()).squared());
        let most = moved[0].at_least(moved[1]);
        let mut passes = 1;
        while passes <= MOST_PASSES && most > T::count(passes) * T::of(MOST_A_PASS) {
            passes += 1;
        }
        if passes > MOST_PASSES || !(moved[0] + moved[1]).is_finite() {
            let all = self.cells.iter().flatten().fold(Part::default(), |all, part| all.plus(*part));
            self.start(map.points(), all.normal());
            return false;
        }
        // An offset that is known does not drift.
        let drift = if variance > T::ZERO { T::of(DRIFT) * passed_s } else { T::ZERO };
        // Of two states that change with equal rates.
        let changed = T::of(0.5) * (T::ONE - (-passed_s / motion.gait_s).exp());
        let changed = if changed.is_finite() { changed } else { T::of(0.5) };
        for cell in &mut self.cells {
            let [lingers, walks] = cell.map(|part| Part { square: part.square + drift * part.belief, ..part });
            let mixed = |one: Part<T>, other: Part<T>| {
                one.map(|sum| sum * (T::ONE - changed)).plus(other.map(|sum| sum * changed))
            };
            *cell = [mixed(lingers, walks), mixed(walks, lingers)];
        }
        let shares = moved.map(|moved| moved / T::count(passes));
        for _ in 0..passes {
            self.pass(map, walls, shares);
        }
        true
    }

    /// Neighbours exchange a share of their probability. The part that would leave the lattice or pass through a wall
    /// stays.
    fn pass(&mut self, map: &Map<'_>, walls: &[Wall<T>], shares: [T; 2]) {
        let place = |units: [u8; 2]| map.place(units.map(|units| T::count(units.into())));
        let is_open = |a: [u8; 2], b: [u8; 2]| {
            walls.is_empty() || {
                let (a, b) = (place(a), place(b));
                !walls.iter().any(|wall| wall.parts(a, b))
            }
        };
        self.next.clear();
        // There is as much room as for the cells. A clone would pass through the stack.
        let _ = self.next.extend_from_slice(&self.cells);
        let mut beside = map.rows().enumerate().peekable();
        let mut after = map.rows().skip(1);
        for (index, row) in map.rows().enumerate() {
            let [x, y] = row.units;
            let above = after.next().filter(|next| next.units[0] == x && y.checked_add(1) == Some(next.units[1]));
            if above.is_some_and(|above| is_open(row.units, above.units)) {
                self.exchange(index, index + 1, shares);
            }
            let Some(right) = x.checked_add(1) else { continue };
            while beside.next_if(|(_, other)| other.units < [right, y]).is_some() {}
            let beside = beside.peek().filter(|(_, other)| other.units == [right, y]);
            if let Some(&(other, _)) = beside.filter(|(_, other)| is_open(row.units, other.units)) {
                self.exchange(index, other, shares);
            }
        }
        core::mem::swap(&mut self.cells, &mut self.next);
    }

    fn exchange(&mut self, one: usize, other: usize, shares: [T; 2]) {
        let [Some(a), Some(b)] = [one, other].map(|at| self.cells.get(at).copied()) else { return };
        let flow = |gait: usize, share: T| a[gait].minus(b[gait]).map(|sum| sum * share);
        let flows = [flow(0, shares[0]), flow(1, shares[1])];
        if let Some([lingers, walks]) = self.next.get_mut(one) {
            (*lingers, *walks) = (lingers.minus(flows[0]), walks.minus(flows[1]));
        }
        if let Some([lingers, walks]) = self.next.get_mut(other) {
            (*lingers, *walks) = (lingers.plus(flows[0]), walks.plus(flows[1]));
        }
    }
}

/// The time between two clock readings, seconds.
pub(super) fn seconds<T: Real>(now_us: u64, before_us: u64) -> T {
    let passed_us = u32::try_from(now_us.saturating_sub(before_us)).unwrap_or(u32::MAX);
    T::of(1.0e-6) * T::count(passed_us as usize)
}

#[cfg(test)]
mod tests {
    use super::super::lattice::tests::row_of;
    use super::*;

    const STILL: Motion<f64> = moving(0.0, 1.0);

    /// The same motion in both gaits.
    const fn moving(spread_m: f64, fading_s: f64) -> Motion<f64> {
        Motion { spread_m: [spread_m; 2], gait_s: 3.0, fading_s }
    }

    /// A walk with this probability at each point, and a known offset.
    fn believing<const N: usize>(beliefs: [f64; N]) -> Walk<f64, N> {
        let cells = beliefs.map(|belief| [Part::of(0.5 * belief, 0.0, 0.0); 2]);
        Walk { cells: Vec::from_array(cells), ..Walk::new() }
    }

    fn beliefs<const N: usize>(walk: &Walk<f64, N>) -> std::vec::Vec<f64> {
        walk.cells.iter().map(|cell| cell[0].belief + cell[1].belief).collect()
    }

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
        let motion = moving(0.5, 1.0e9);
        walk.step(&map, &[Some(-40.0)], &receiver(), &motion, &[], 0).expect("found");
        let later = walk.step(&map, &[Some(-40.0)], &receiver(), &motion, &[], 1_000_000).expect("found");
        assert!((later.position[0] - 10.0).abs() < 0.01, "{later:?}");
        let lost = LOST * 0.25 * (41.0 * 41.0 - 1.0) / 12.0;
        assert!((later.covariance[0] - 0.25 / 12.0 - (0.25 + lost)).abs() < 0.01, "{later:?}");
        let sum: f64 = beliefs(&walk).iter().sum();
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
        let mut walk = believing([1.0, 0.0, 0.0, 0.0, 0.0]);
        walk.pass(&map, &[], [0.1; 2]);
        let expected = [0.8, 0.1, 0.0, 0.1, 0.0];
        assert!(beliefs(&walk).iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{:?}", walk.cells);
        // A wall through (1, 0); the point is on the wall's left. Nothing reaches (2, 0), and the other four points
        // share everything.
        let walls = [Wall { ends: [[1.0, -1.0], [1.0, 3.0]], attenuation: 0.0 }];
        let mut walk = believing([1.0, 0.0, 0.0, 0.0, 0.0]);
        for _ in 0..200 {
            walk.pass(&map, &walls, [0.1; 2]);
        }
        let expected = [0.25, 0.25, 0.25, 0.25, 0.0];
        assert!(beliefs(&walk).iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-4), "{:?}", walk.cells);
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
            walk.cells = believing::<11>(core::array::from_fn(|x| if x == 2 { 1.0 } else { 0.0 })).cells;
            let motion = moving(1.0, 1.0);
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

    /// The filter over a grid of points, gaits and offsets, without any assumption on the offset's distribution.
    struct Grid {
        rssis: [[f64; 2]; 7],
        belief: std::vec::Vec<[[f64; 2]; 7]>,
    }

    impl Grid {
        const STEP_DB: f64 = 0.1;

        fn offset_db(index: usize) -> f64 {
            (index as f64 - 250.0) * Self::STEP_DB
        }

        fn new(rssis: [[f64; 2]; 7]) -> Self {
            let prior = |index| (-0.5 * (Self::offset_db(index) / 4.0).powi(2)).exp();
            let mut grid = Self { rssis, belief: (0..501).map(|index| [[prior(index); 2]; 7]).collect() };
            grid.normalise();
            grid
        }

        fn normalise(&mut self) {
            let total: f64 = self.belief.iter().flatten().flatten().sum();
            self.belief.iter_mut().flatten().flatten().for_each(|belief| *belief /= total);
        }

        /// The same random walk on points 1 m apart, in many small steps, and a scan with deviations of 3 dB.
        fn step(&mut self, scan: [f64; 2], spread_m: [f64; 2], gait_s: f64, passed_s: f64, share: f64) {
            let changed = 0.5 * (1.0 - (-passed_s / gait_s).exp());
            for cells in &mut self.belief {
                for cell in cells.iter_mut() {
                    let [a, b] = *cell;
                    *cell = [a + changed * (b - a), b + changed * (a - b)];
                }
                for _ in 0..10 {
                    let before = *cells;
                    for (gait, spread_m) in spread_m.iter().enumerate() {
                        let flow = 0.05 * passed_s * spread_m * spread_m;
                        for left in 0..6 {
                            let moved = flow * (before[left][gait] - before[left + 1][gait]);
                            cells[left][gait] -= moved;
                            cells[left + 1][gait] += moved;
                        }
                    }
                }
                let lost: f64 = cells.iter().flatten().sum::<f64>() * LOST / 14.0;
                cells.iter_mut().flatten().for_each(|belief| *belief += lost);
            }
            for (index, cells) in self.belief.iter_mut().enumerate() {
                for (cell, rssis) in cells.iter_mut().zip(self.rssis) {
                    let misfit =
                        |beacon: usize| ((scan[beacon] - rssis[beacon] - Self::offset_db(index)) / 3.0).powi(2);
                    let likelihood = (-0.5 * share * (misfit(0) + misfit(1))).exp();
                    cell.iter_mut().for_each(|belief| *belief *= likelihood);
                }
            }
            self.normalise();
        }

        /// Means of position and offset, and the offset's deviation.
        fn answer(&self) -> [f64; 3] {
            let mean = |value: &dyn Fn(usize, usize) -> f64| -> f64 {
                let each = self.belief.iter().enumerate().flat_map(|(index, cells)| {
                    cells.iter().enumerate().map(move |(x, cell)| (index, x, cell[0] + cell[1]))
                });
                each.map(|(index, x, belief)| belief * value(index, x)).sum()
            };
            let offset_db = mean(&|index, _| Self::offset_db(index));
            let variance = mean(&|index, _| (Self::offset_db(index) - offset_db).powi(2));
            [mean(&|_, x| x as f64), offset_db, variance.sqrt()]
        }
    }

    #[test]
    fn offsets_at_each_point_are_those_of_a_grid_of_points_and_offsets() {
        // Seven points in a row. The receiver is 5 dB too weak, and walks from point 1 to point 5 in epochs of half a
        // second. A scan that is too weak by 5 dB could also be from another point.
        let rssis = [0, 1, 2, 3, 4, 5, 6].map(|x| [-50.0 - 3.0 * f64::from(x), -66.0 + 2.0 * f64::from(x * x) / 6.0]);
        let scanned: std::vec::Vec<[Option<f64>; 2]> = rssis.iter().map(|rssi| rssi.map(Some)).collect();
        let point =
            |x: usize| super::super::Point { position_m: [x as f64, 0.0], rssis: &scanned[x], deviations: &[3.0, 3.0] };
        let mut buffer = [0; 256];
        let points: [_; 7] = core::array::from_fn(point);
        let bytes = super::super::encode(&points, &[1, 2], &[-95.0; 2], Some(1.0), &mut buffer).expect("encoded");
        let (map, _) = Map::decode(bytes).expect("a map");
        // As the map has them, in half decibels.
        let mapped = core::array::from_fn(|x| {
            let mut stored = map.rssis::<f64>(x).map(|rssi| rssi.expect("stored"));
            [stored.next().expect("one"), stored.next().expect("two")]
        });
        let mut grid = Grid::new(mapped);
        let mut walk = Walk::<f64, 7>::new();
        let motion = Motion { spread_m: [0.4, 1.2], gait_s: 3.0, fading_s: 1.3 };
        for epoch in 0..30_u32 {
            let at = (1 + epoch / 7) as usize;
            let wiggle = 1.5 * f64::from(epoch).sin();
            let scan = [mapped[at][0] - 5.0 + wiggle, mapped[at][1] - 5.0 - wiggle];
            let now_us = u64::from(epoch) * 500_000;
            let found = walk.step(&map, &scan.map(Some), &Receiver::default(), &motion, &[], now_us).expect("found");
            let (passed_s, share) = if epoch == 0 { (0.0, 1.0) } else { (0.5, 0.5 / 1.3) };
            grid.step(scan, motion.spread_m, motion.gait_s, passed_s, share);
            let [x, offset_db, deviation_db] = grid.answer();
            assert!((found.position[0] - x).abs() < 0.1, "{epoch}: {found:?}, {x}");
            assert!((found.offset_db - offset_db).abs() < 0.2, "{epoch}: {found:?}, {offset_db}");
            assert!((found.offset_deviation_db - deviation_db).abs() < 0.2, "{epoch}: {found:?}, {deviation_db}");
        }
    }

    #[test]
    fn a_first_scan_counts_for_as_long_as_it_was_received() {
        // As in `scans_count_for_the_time_between_them`: weights 1 and e^−2, here half of it, e^−1: 0.367879 ⁄
        // 1.367879 · 2 m, of probabilities that are equal.
        let bytes = row_of(&[-60.0, -66.0], 2.0);
        let (map, _) = Map::decode(&bytes).expect("a map");
        let mut walk = Walk::<f64, 2>::since(5_000_000);
        let first = walk.step(&map, &[Some(-60.0)], &receiver(), &STILL, &[], 5_500_000).expect("found");
        assert!((first.position[0] - 0.537_883).abs() < 1e-5, "{first:?}");
    }

    #[test]
    fn nonsense_changes_nothing() {
        let bytes = row_of(&[-60.0, -66.0], 2.0);
        let (map, _) = Map::decode(&bytes).expect("a map");
        let mut walk = Walk::<f64, 2>::new();
        let motion = Motion::default();
        walk.step(&map, &[Some(-60.0)], &receiver(), &motion, &[], 0).expect("found");
        let before = walk.cells.clone();
        assert_eq!(walk.step(&map, &[Some(f64::NAN)], &receiver(), &motion, &[], 9), Err(NoPosition::Unheard));
        assert_eq!((walk.cells.clone(), walk.at_us), (before, 0));
        let odd = Motion { spread_m: [f64::NAN; 2], gait_s: f64::NAN, fading_s: f64::NAN };
        assert!(
            walk.step(&map, &[Some(-60.0)], &receiver(), &odd, &[], u64::MAX).expect("found").position[0].is_finite()
        );
        let mut small = Walk::<f64, 1>::new();
        assert_eq!(small.step(&map, &[Some(-60.0)], &receiver(), &motion, &[], 0), Err(NoPosition::TooManyPoints));
    }
}
