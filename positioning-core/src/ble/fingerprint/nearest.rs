//! The K nearest points of a survey (7).
//!
//! The distance between a scan z and a point f is √Σ (zᵢ − fᵢ)², as in the thesis. With an unknown offset of the
//! receiver it is the Mahalanobis distance: its square is Σ dᵢ² − (Σ dᵢ)² ⁄ (N + ρ), d = z − f. A normal offset whose
//! variance is 1 ⁄ ρ times that of an RSSI has been integrated out.
//!
//! The scatter of a few neighbours is a poor covariance: it is singular where they lie on a line. So it is shrunk towards
//! the errors that the map's own points have where they are located by the points elsewhere: the posterior mean of a
//! covariance with an inverse Wishart prior (A. Gelman et al., *Bayesian Data Analysis*, 3rd edition, section 3.6).

use heapless::Vec;

use super::{Codes, MAX_BEACONS, Map, NoPosition};
use crate::Real;

/// The most neighbours.
pub const MAX_NEIGHBOURS: usize = 15;
/// The least distance that counts: half a decibel, to which the map's RSSI values are rounded (a quarter of a dB²).
const LEAST_SQUARE: f64 = 1.0;
/// The prior's weight beside the neighbours', in neighbours: as much as the least K of the thesis.
const PRIOR_NEIGHBOURS: usize = 3;
/// Points of a map that are located by the others, at most.
const MOST_LEFT_OUT: usize = 100;

/// How neighbours make a position.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Nearest<T> {
    /// K, the number of neighbours: 1 to [`MAX_NEIGHBOURS`], 3 to 5 in the thesis.
    pub neighbours: usize,
    /// Whether neighbours are weighted by 1 ⁄ d² (7), or all alike.
    pub weighted: bool,
    /// The standard deviation of the receiver's common offset from the surveyor's receiver, in deviations of a single
    /// RSSI; 0: no offset.
    pub offset: T,
}

/// The position of a scan's neighbours.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Vicinity<T> {
    /// Their weighted mean, metres.
    pub position: [T; 2],
    /// Their scatter about the mean, m²: xx, xy, yy, plus a unit's square. With one neighbour it is hardly more than
    /// that: [`Vicinity::covariance`] is the position's.
    pub scatter: [T; 3],
    /// Their number.
    pub neighbours: usize,
    /// The nearest point's index in the map.
    pub nearest: usize,
    /// Its distance, dB.
    pub distance_db: T,
    /// By how much the scan is stronger than the neighbours, with the weights of the neighbours, where the receiver's
    /// offset is unknown, dB.
    pub offset_db: T,
    /// The number of the map's beacons that are received.
    pub heard: usize,
}

/// How far positions by neighbours are off, by the map's own points: see [`Nearest::left_out`].
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct NeighbourError<T> {
    /// The mean square of the errors along an axis, m², at least that within a cell of the survey.
    error: T,
    /// The mean of the neighbours' scatter along an axis, m².
    scatter: T,
}

impl<T: Real> Vicinity<T> {
    /// The covariance of the position, m²: xx, xy, yy. Without the errors of a map, whose points all have one position,
    /// it is the scatter.
    pub fn covariance(&self, map: Option<NeighbourError<T>>) -> [T; 3] {
        let Some(NeighbourError { error, scatter }) = map else { return self.scatter };
        let (prior, neighbours) = (T::count(PRIOR_NEIGHBOURS), T::count(self.neighbours));
        // The scatter is that of the neighbours about their mean, and not about the truth.
        let scale = neighbours * error / scatter;
        let [xx, xy, yy] = self.scatter.map(|sum| scale * sum / (prior + neighbours));
        let floor = prior * error / (prior + neighbours);
        [xx + floor, xy, yy + floor]
    }
}

/// One of the nearest points found so far.
struct Neighbour<T> {
    /// The square of its distance, in the map's half decibels.
    square: T,
    /// Its index in the map.
    index: usize,
    units: [u8; 2],
    /// The difference between the scan and the point, summed over all beacons.
    sum: T,
}

impl<T: Real> Nearest<T> {
    /// Compares a scan with every point of the map. The map's fall-back RSSI values replace the values of beacons
    /// that are not received, in the scan and at a point. Among points at the same distance the first ones are taken.
    ///
    /// # Errors
    /// No beacon of the map is received.
    pub fn locate(&self, map: &Map<'_>, scan: &[Option<T>]) -> Result<Vicinity<T>, NoPosition> {
        let codes = Codes::of(scan, map.beacons())?;
        let mut wanted = [T::ZERO; MAX_BEACONS];
        let all = wanted.iter_mut().zip(codes.codes).zip(codes.heard).zip(map.fallbacks());
        for (((wanted, code), heard), fallback) in all {
            *wanted = if heard { code } else { T::count(usize::from(*fallback)) };
        }
        self.mean(map, &self.nearest(map, &wanted, None), codes.count).ok_or(NoPosition::Unheard)
    }

    /// How far positions by neighbours are off on this map: some of its points, as scans, are located by the points at
    /// other positions. `None` if there are no others.
    pub fn left_out(&self, map: &Map<'_>) -> Option<NeighbourError<T>> {
        let (mut count, mut error, mut scatter, mut cell) = (T::ZERO, T::ZERO, T::ZERO, T::ZERO);
        let square_m2 = map.unit::<T>().squared();
        for row in map.rows().step_by(1 + map.points() / MOST_LEFT_OUT) {
            let mut wanted = [T::ZERO; MAX_BEACONS];
            for ((wanted, code), fallback) in wanted.iter_mut().zip(row.rssis).zip(map.fallbacks()) {
                *wanted = T::count(usize::from(if *code == 0 { *fallback } else { *code }));
            }
            let near = self.nearest(map, &wanted, Some(row.units));
            let Some(found) = self.mean(map, &near, map.beacons()) else { continue };
            let [x, y] = map.place(row.units.map(|units| T::count(units.into())));
            let apart = |other: [u8; 2]| {
                let [dx, dy] = [0, 1].map(|axis: usize| T::count(other[axis].abs_diff(row.units[axis]).into()));
                dx * dx + dy * dy
            };
            let others = map.rows().map(|other| apart(other.units)).filter(|square| *square > T::ZERO);
            let next = others.fold(T::of(f64::INFINITY), |next, square| if square < next { square } else { next });
            error += (found.position[0] - x).squared() + (found.position[1] - y).squared();
            scatter += found.scatter[0] + found.scatter[2];
            cell += next * square_m2;
            count += T::ONE;
        }
        let axes = count + count;
        // Within a square cell, whose side is the distance to the next point.
        let cell = cell / (T::of(12.0) * count);
        (count > T::ZERO).then(|| NeighbourError { error: (error / axes).at_least(cell), scatter: scatter / axes })
    }

    /// The share of the sum of differences that an unknown offset explains.
    fn share(&self, map: &Map<'_>) -> T {
        if self.offset > T::ZERO {
            T::ONE / (T::count(map.beacons()) + T::ONE / self.offset.squared())
        } else {
            T::ZERO
        }
    }

    /// The nearest points, the nearest first, but none at this position.
    fn nearest(&self, map: &Map<'_>, wanted: &[T], except: Option<[u8; 2]>) -> Vec<Neighbour<T>, MAX_NEIGHBOURS> {
        let (fallbacks, share) = (map.fallbacks(), self.share(map));
        let most = self.neighbours.clamp(1, MAX_NEIGHBOURS);
        // Sorted, the nearest first.
        let mut near: Vec<Neighbour<T>, MAX_NEIGHBOURS> = Vec::new();
        let mut farthest = T::of(f64::INFINITY);
        for (index, row) in map.rows().enumerate().filter(|(_, row)| except != Some(row.units)) {
            let (mut sum, mut square) = (T::ZERO, T::ZERO);
            for ((wanted, code), fallback) in wanted.iter().zip(row.rssis).zip(fallbacks) {
                let code = if *code == 0 { *fallback } else { *code };
                let apart = *wanted - T::count(code.into());
                sum += apart;
                square += apart * apart;
            }
            let square = square - share * sum * sum;
            if square < farthest {
                if near.len() == most {
                    near.pop();
                }
                let at = near.iter().position(|other| square < other.square).unwrap_or(near.len());
                // There is room: at most 15 are kept, and the farthest has been removed.
                let _ = near.insert(at, Neighbour { square, index, units: row.units, sum });
                if near.len() == most {
                    farthest = near.last().map_or(farthest, |last| last.square);
                }
            }
        }
        near
    }

    fn mean(&self, map: &Map<'_>, near: &[Neighbour<T>], heard: usize) -> Option<Vicinity<T>> {
        let &Neighbour { square, index: nearest, .. } = near.first()?;
        let neighbours = || {
            near.iter().map(|near| {
                let weight = if self.weighted { T::ONE / near.square.at_least(T::of(LEAST_SQUARE)) } else { T::ONE };
                (weight, near.units.map(|units| T::count(units.into())))
            })
        };
        let (mut total, mut mean, mut apart) = (T::ZERO, [T::ZERO; 2], T::ZERO);
        for ((weight, [x, y]), near) in neighbours().zip(near) {
            total += weight;
            mean = [mean[0] + weight * x, mean[1] + weight * y];
            apart += weight * near.sum;
        }
        // Codes are half decibels, and count downward.
        let offset_db = T::of(-0.5) * self.share(map) * apart / total;
        let [x, y] = mean.map(|sum| sum / total);
        let mut scatter = [T::ZERO; 3];
        for (weight, [px, py]) in neighbours() {
            let (dx, dy) = (px - x, py - y);
            for (sum, product) in scatter.iter_mut().zip([dx * dx, dx * dy, dy * dy]) {
                *sum += weight * product;
            }
        }
        let square_m2 = map.unit::<T>().squared();
        let [xx, xy, yy] = scatter.map(|sum| sum / total);
        // A position was rounded to a unit's square.
        let within = T::of(1.0 / 12.0);
        let scatter = [xx + within, xy, yy + within].map(|sum| sum * square_m2);
        let distance_db = T::of(0.5) * square.at_least(T::ZERO).sqrt();
        let (position, neighbours) = (map.place([x, y]), near.len());
        Some(Vicinity { position, scatter, neighbours, nearest, distance_db, offset_db, heard })
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use rand::{Rng, SeedableRng};

    use super::super::map::tests::surveyed;
    use super::*;

    const PLAIN: Nearest<f64> = Nearest { neighbours: 3, weighted: false, offset: 0.0 };

    #[test]
    fn weights_are_those_of_equation_7() {
        // Distances by hand: to A √(2² + 0²) = 2, to B √(0² + 4²) = 4, to C √(10² + 10²) = 14.14. K = 2: weights ¼
        // and ¹⁄₁₆, so the mean is 0.8 A + 0.2 B: x = 0.2 · 10 = 2, y 0; scatter 0.8 · 2² + 0.2 · 8² = 16.
        let bytes = surveyed(&[
            ([0.0, 0.0], &[Some(-60.0), Some(-70.0)]),
            ([10.0, 0.0], &[Some(-62.0), Some(-74.0)]),
            ([0.0, 10.0], &[Some(-72.0), Some(-80.0)]),
        ]);
        let (map, _) = Map::decode(&bytes).expect("a map");
        let nearest = Nearest { neighbours: 2, weighted: true, ..PLAIN };
        let found = nearest.locate(&map, &[Some(-62.0), Some(-70.0)]).expect("found");
        // Positions are rounded to units of 40 mm (10 m ⁄ 255, rounded up).
        assert!((found.position[0] - 2.0).abs() < 0.01 && found.position[1].abs() < 0.01, "{found:?}");
        assert!((found.scatter[0] - 16.0).abs() < 0.1 && found.scatter[2].abs() < 0.1, "{found:?}");
        assert_eq!((found.nearest, found.heard, found.distance_db), (0, 2, 2.0));
        let plain = Nearest { neighbours: 2, ..PLAIN }.locate(&map, &[Some(-62.0), Some(-70.0)]).expect("found");
        assert!((plain.position[0] - 5.0).abs() < 0.01, "{plain:?}");
    }

    #[test]
    fn a_receiver_that_hears_all_weaker_is_where_it_is() {
        // 8 dB below B's RSSI values; without an offset, nearer to C's.
        let bytes = surveyed(&[
            ([0.0, 0.0], &[Some(-50.0), Some(-80.0), Some(-60.0)]),
            ([10.0, 0.0], &[Some(-60.0), Some(-60.0), Some(-60.0)]),
            ([0.0, 10.0], &[Some(-68.0), Some(-72.0), Some(-64.0)]),
        ]);
        let (map, _) = Map::decode(&bytes).expect("a map");
        let scan = [Some(-68.0), Some(-68.0), Some(-68.0)];
        assert_eq!(PLAIN.locate(&map, &scan).expect("found").nearest, 2);
        let found = Nearest { offset: 3.0, ..PLAIN }.locate(&map, &scan).expect("found");
        // By hand: 3 · 8² − 24² ⁄ (3 + ¹⁄₉) = 192 − 185.143 = 6.857 dB².
        assert_eq!(found.nearest, 1);
        assert!((found.distance_db.powi(2) - 6.857).abs() < 0.001, "{found:?}");
        // The offset of the nearest point is −24 ⁄ (3 + ¹⁄₉) = −7.714 dB. Where the offset is known, it is not
        // computed.
        let one = Nearest { offset: 3.0, neighbours: 1, ..PLAIN }.locate(&map, &scan).expect("found");
        assert!((one.offset_db + 7.714).abs() < 0.001, "{one:?}");
        assert_eq!(PLAIN.locate(&map, &scan).expect("found").offset_db, 0.0);
    }

    #[test]
    fn neighbours_are_those_of_a_sorted_list() {
        let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(1);
        let points: Vec<([f64; 2], Vec<Option<f64>>)> = (0..200)
            .map(|_| {
                let rssis =
                    (0..12).map(|_| random.random_bool(0.9).then(|| -f64::from(random.random_range(60..190)) / 2.0));
                let rssis = rssis.collect();
                (
                    [f64::from(random.random_range(0..=255)) / 10.0, f64::from(random.random_range(0..=255)) / 10.0],
                    rssis,
                )
            })
            .collect();
        let corners = [([0.0, 0.0], std::vec![None; 12]), ([25.5, 25.5], std::vec![None; 12])];
        let all: Vec<_> = points.into_iter().chain(corners).collect();
        let rows: Vec<_> = all.iter().map(|(place, rssis)| (*place, &rssis[..])).collect();
        let bytes = surveyed(&rows);
        let (map, _) = Map::decode(&bytes).expect("a map");
        for neighbours in [1, 3, 5, 15] {
            let scan: Vec<Option<f64>> = (0..12)
                .map(|_| random.random_bool(0.8).then(|| -f64::from(random.random_range(60..190)) / 2.0))
                .collect();
            let mut sorted: Vec<(f64, [f64; 2])> = rows
                .iter()
                .map(|(place, rssis)| {
                    let apart = |(a, b): (&Option<f64>, &Option<f64>)| a.unwrap_or(-95.0) - b.unwrap_or(-95.0);
                    (scan.iter().zip(*rssis).map(apart).map(|d| d * d).sum(), *place)
                })
                .collect();
            sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
            let near = &sorted[..neighbours];
            let weight: f64 = near.iter().map(|(square, _)| 1.0 / square).sum();
            let expected = [0, 1].map(|axis| near.iter().map(|(square, at)| at[axis] / square).sum::<f64>() / weight);
            let found = Nearest { neighbours, weighted: true, offset: 0.0 }.locate(&map, &scan).expect("found");
            for axis in [0, 1] {
                assert!((found.position[axis] - expected[axis]).abs() < 1e-9, "{found:?} {expected:?}");
            }
        }
    }

    /// The smaller eigenvalue of a covariance.
    fn least_variance([xx, xy, yy]: [f64; 3]) -> f64 {
        (xx + yy) / 2.0 - ((xx - yy) / 2.0).hypot(xy)
    }

    #[test]
    fn errors_of_a_map_are_those_of_its_points_left_out() {
        // Points at 0, 10 and 20 m of one beacon: −60, −62 and −70 dBm. The nearest other point of the first is the
        // second, of the second the first, of the third the second: each 10 m off along x. Along an axis: 300 ⁄ 6 = 50
        // m². A cell has 10² ⁄ 12 m², and one neighbour no scatter but that of rounding to 79 mm.
        let bytes =
            surveyed(&[([0.0, 0.0], &[Some(-60.0)]), ([10.0, 0.0], &[Some(-62.0)]), ([20.0, 0.0], &[Some(-70.0)])]);
        let (map, _) = Map::decode(&bytes).expect("a map");
        let one = Nearest { neighbours: 1, ..PLAIN };
        let errors = one.left_out(&map).expect("there are others");
        assert!((errors.error - 50.0).abs() < 1.0 && errors.scatter < 0.001, "{errors:?}");
        // A neighbour of one, and a prior of three: by the scale the neighbour's scatter is 50 m² too.
        let [xx, xy, yy] = one.locate(&map, &[Some(-61.0)]).expect("found").covariance(Some(errors));
        assert!((xx - 50.0).abs() < 1.0 && xy.abs() < 0.01 && (yy - 50.0).abs() < 1.0, "{xx} {xy} {yy}");
        // Two neighbours of the middle point are its mean: no error there. The others are 15 m off: 450 ⁄ 6 = 75.
        let two = Nearest { neighbours: 2, ..PLAIN }.left_out(&map).expect("there are others");
        assert!((two.error - 75.0).abs() < 1.0, "{two:?}");
        assert_eq!(PLAIN.left_out(&Map::decode(&surveyed(&[([0.0, 0.0], &[Some(-60.0)])])).expect("a map").0), None);
    }

    #[test]
    fn a_covariance_is_never_singular() {
        let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(2);
        let mut rssi = move || Some(-f64::from(random.random_range(120..190)) / 2.0);
        // Points on a line along an axis, on a diagonal, all but one in one place.
        let lines = [[1.0, 0.0], [0.0, 1.0], [0.7, 0.7], [0.0, 0.0]];
        for [dx, dy] in lines {
            let mut rows: Vec<([f64; 2], [Option<f64>; 3])> =
                (0..8).map(|at| ([f64::from(at) * dx, f64::from(at) * dy], [rssi(), rssi(), rssi()])).collect();
            if dx == dy && dx == 0.0 {
                rows.push(([5.0, 0.0], [rssi(), rssi(), rssi()]));
            }
            let rows: Vec<_> = rows.iter().map(|(place, rssis)| (*place, &rssis[..])).collect();
            let bytes = surveyed(&rows);
            let (map, _) = Map::decode(&bytes).expect("a map");
            for (neighbours, weighted) in [(1, false), (3, false), (3, true), (5, true)] {
                let nearest = Nearest { neighbours, weighted, offset: 1.3 };
                let errors = nearest.left_out(&map).expect("there are others");
                for _ in 0..20 {
                    let covariance =
                        nearest.locate(&map, &[rssi(), rssi(), rssi()]).expect("found").covariance(Some(errors));
                    // A cell of 1 m has 1 ⁄ 12 m² along an axis, of which a prior of 3 beside 5 neighbours leaves ⅜.
                    let least = least_variance(covariance);
                    assert!(least > 0.9 / 32.0, "{least} m² of {neighbours} on ({dx}, {dy})");
                }
            }
        }
    }

    #[test]
    fn scans_of_nothing_and_of_nonsense_have_no_position() {
        let bytes = surveyed(&[([0.0, 0.0], &[Some(-60.0), None]), ([1.0, 0.0], &[Some(-60.0), None])]);
        let (map, _) = Map::decode(&bytes).expect("a map");
        for scan in [&[][..], &[None, None], &[Some(f64::NAN), Some(127.0)], &[None, None, Some(-60.0)]] {
            assert_eq!(PLAIN.locate(&map, scan), Err(NoPosition::Unheard), "{scan:?}");
        }
        // Points with the same values give their mean. A scan that fits exactly does not divide by zero.
        let found = Nearest { weighted: true, ..PLAIN }.locate(&map, &[Some(-60.0)]).expect("found");
        assert!((found.position[0] - 0.5).abs() < 0.01 && found.heard == 1, "{found:?}");
    }
}
