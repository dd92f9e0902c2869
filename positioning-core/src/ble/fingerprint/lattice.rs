//! The position of a scan on a lattice whose RSSI values are a Gaussian process: the posterior's mean, not the most
//! likely point.
//!
//! At each point the RSSI values z are normal about the map's m with the map's deviations σ. They share the
//! receiver's offset o, which is normal too, N(ō, v), and is integrated out. With d = z − m − ō, w = 1 ⁄ σ², W = Σ w,
//! R = Σ w d and the gain G = v ⁄ (1 + v W):
//! ln L = −½ (Σ w d² − G R²) − ½ ln(1 + v W) − Σ ln σ, and the offset at the point is N(ō + G R, G).
//! If a scan counts for a share of its information, w and ln σ are multiplied by this share.
//! Deviations have sixteen values, so their reciprocals and logarithms are a table, and the node has no matrix to
//! compute.

use heapless::Vec;

use super::map::Row;
use super::{Codes, DEVIATIONS_DB, MAX_BEACONS, Map, NoPosition};
use crate::Real;

/// The growth of the variance of a learnt offset from one position to the next, dB²: by a hand, or a pocket.
const SWAY_DB2: f64 = 0.05;
/// A point whose log-likelihood is below the greatest by more than this counts for nothing: 200 such points together
/// would weigh 10⁻⁵.
const NOTHING: f64 = 17.0;

/// What is known of the receiver before the scan.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Receiver<T> {
    /// By how much the receiver measures all beacons stronger than the surveyor's receiver did, dB.
    pub offset_db: T,
    /// The standard deviation of that, dB; 0: the offset is known.
    pub offset_deviation_db: T,
    /// The variance of the scan's RSSI values beyond the map's deviations, dB²: that of a short window.
    pub noise_db2: T,
}

impl<T: Real> Default for Receiver<T> {
    /// An unknown receiver: its offset from the surveyor's has a standard deviation of 4 dB.
    fn default() -> Self {
        Self { offset_db: T::ZERO, offset_deviation_db: T::of(4.0), noise_db2: T::ZERO }
    }
}

impl<T: Real> Receiver<T> {
    /// The offset's mean and variance in half decibels; an invalid offset is none.
    fn prior(&self) -> [T; 2] {
        let (mean, deviation) = (self.offset_db + self.offset_db, self.offset_deviation_db + self.offset_deviation_db);
        let mean = if mean.is_finite() { mean } else { T::ZERO };
        [mean, if deviation > T::ZERO && deviation.is_finite() { deviation.squared() } else { T::ZERO }]
    }

    /// Takes the offset that a scan has given, with its deviation, dB, for the next scan. An offset that is known
    /// stays. Scans at one position have the same shadows: they must be given once per position.
    pub fn set_offset(&mut self, offset_db: T, offset_deviation_db: T) {
        if self.offset_deviation_db > T::ZERO && (offset_db + offset_deviation_db).is_finite() {
            self.offset_db = offset_db;
            self.offset_deviation_db = (offset_deviation_db.squared() + T::of(SWAY_DB2)).sqrt();
        }
    }
}

/// The position of the receiver.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Posterior<T> {
    /// The mean, metres: it has the least expected squared error.
    pub position: [T; 2],
    /// Its covariance, m²: xx, xy, yy.
    pub covariance: [T; 3],
    /// The receiver's offset, dB, for [`Receiver::set_offset`].
    pub offset_db: T,
    /// Its deviation, dB.
    pub offset_deviation_db: T,
    /// The number of the map's beacons that are received.
    pub heard: usize,
}

/// The position of one scan by itself.
///
/// # Errors
/// No beacon of the map is received, or the map's RSSI values have no deviations.
pub fn locate<T: Real>(map: &Map<'_>, scan: &[Option<T>], receiver: &Receiver<T>) -> Result<Posterior<T>, NoPosition> {
    let likelihood = Likelihood::new(map, scan, receiver)?;
    let mut moments = Moments::default();
    for row in map.rows() {
        let seen = likelihood.at(&row);
        moments.add(seen.log, &seen, row.units);
    }
    Ok(moments.posterior(map, &likelihood))
}

/// [`locate`], compiled in this crate so that it has the optimisation level of this crate and not that of the image.
///
/// # Errors
/// As [`locate`].
#[inline(never)]
pub fn locate_on_node(
    map: &Map<'_>,
    scan: &[Option<f32>],
    receiver: &Receiver<f32>,
) -> Result<Posterior<f32>, NoPosition> {
    locate(map, scan, receiver)
}

/// The likelihood of a scan at the points of a map.
pub(super) struct Likelihood<T> {
    /// For each received beacon: its index in the map, its RSSI, and the fall-back code for a point that did not
    /// receive it.
    heard: Vec<(usize, T, u8), MAX_BEACONS>,
    /// 1 ⁄ σ² and ln σ of each half byte, in the map's half decibels.
    table: [(T, T); 16],
    /// ō and v.
    prior: [T; 2],
}

/// The sums over the received beacons at one point, with d = z − m.
#[derive(Clone, Copy)]
pub(super) struct Sums<T> {
    weights: T,
    sum: T,
    square: T,
    logs: T,
}

/// The likelihood of a scan at one point, and the offset there in half decibels.
#[derive(Clone, Copy)]
pub(super) struct Seen<T> {
    pub log: T,
    pub offset: T,
    pub offset_variance: T,
}

impl<T: Real> Sums<T> {
    /// The likelihood where the offset is normal with this mean and variance, in half decibels. The scan counts for
    /// `share` of its information.
    #[inline]
    pub fn seen(&self, mean: T, variance: T, share: T) -> Seen<T> {
        let sum = self.sum - self.weights * mean;
        let square = self.square - mean * (self.sum + sum);
        let spread = T::ONE + share * variance * self.weights;
        let gain = variance / spread;
        let sum = share * sum;
        let half = T::of(0.5);
        let log = -half * (share * square - gain * sum * sum)
            - T::of(0.5 * core::f64::consts::LN_2) * spread.log2_about()
            - share * self.logs;
        Seen { log, offset: mean + gain * sum, offset_variance: gain }
    }
}

impl<T: Real> Likelihood<T> {
    /// The likelihood of `scan` at the points of `map`, with the prior of `receiver`.
    ///
    /// # Errors
    /// No beacon of the map is received, or the map's RSSI values have no deviations.
    pub fn new(map: &Map<'_>, scan: &[Option<T>], receiver: &Receiver<T>) -> Result<Self, NoPosition> {
        if !map.has_deviations() {
            return Err(NoPosition::NoDeviations);
        }
        let codes = Codes::of(scan, map.beacons())?;
        let beacons = codes.codes.iter().zip(codes.heard).zip(map.fallbacks()).enumerate();
        let heard = beacons.filter(|(_, ((_, heard), _))| *heard);
        let heard = heard.map(|(beacon, ((code, _), fallback))| (beacon, *code, *fallback)).collect();
        let four = T::of(4.0);
        let noise = if receiver.noise_db2 > T::ZERO { four * receiver.noise_db2 } else { T::ZERO };
        let table = core::array::from_fn(|half| {
            let deviation = T::of(2.0 * DEVIATIONS_DB) * T::count(half + 1);
            let variance = deviation * deviation + noise;
            (T::ONE / variance, T::of(0.5) * variance.ln())
        });
        Ok(Self { heard, table, prior: receiver.prior() })
    }

    /// ō and v, in half decibels and their square.
    pub fn prior(&self) -> [T; 2] {
        self.prior
    }

    #[inline]
    pub fn at(&self, row: &Row<'_>) -> Seen<T> {
        let [mean, variance] = self.prior;
        self.sums(row).seen(mean, variance, T::ONE)
    }

    #[inline]
    pub fn sums(&self, row: &Row<'_>) -> Sums<T> {
        let (mut weights, mut sum, mut square, mut logs) = (T::ZERO, T::ZERO, T::ZERO, T::ZERO);
        for (beacon, scanned, fallback) in &self.heard {
            let (Some(code), Some(halves)) = (row.rssis.get(*beacon), row.deviations.get(*beacon / 2)) else { break };
            let code = if *code == 0 { *fallback } else { *code };
            let half = usize::from(if *beacon % 2 == 0 { halves & 15 } else { halves >> 4 });
            let (weight, log) = self.table[half & 15];
            // Codes count downward: those of a stronger receiver are lower.
            let apart = T::count(code.into()) - *scanned;
            let weighted = weight * apart;
            weights += weight;
            sum += weighted;
            square += weighted * apart;
            logs += log;
        }
        Sums { weights, sum, square, logs }
    }
}

/// Sums over points whose weights are given by their logarithms. The largest weight so far counts as one.
#[derive(Clone, Copy)]
pub(super) struct Moments<T> {
    top: Option<T>,
    total: T,
    first: [T; 2],
    second: [T; 3],
    offset: [T; 2],
    /// Of the offset with x and y.
    cross: [T; 2],
}

/// Means and covariances of position and offset, in the map's units and half decibels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Joint<T> {
    pub position: [T; 2],
    /// xx, xy, yy.
    pub covariance: [T; 3],
    pub offset: T,
    pub offset_variance: T,
    /// Of the offset with x and y.
    pub cross: [T; 2],
}

impl<T: Real> Default for Moments<T> {
    fn default() -> Self {
        let zero = [T::ZERO; 2];
        Self { top: None, total: T::ZERO, first: zero, second: [T::ZERO; 3], offset: zero, cross: zero }
    }
}

impl<T: Real> Moments<T> {
    #[inline]
    pub fn add(&mut self, log: T, seen: &Seen<T>, units: [u8; 2]) {
        let weight = match self.top {
            Some(top) if log < top - T::of(NOTHING) => return,
            Some(top) if log <= top => (log - top).exp(),
            Some(top) => {
                self.scale((top - log).exp());
                self.top = Some(log);
                T::ONE
            }
            None => {
                self.top = Some(log);
                T::ONE
            }
        };
        self.add_weighted(weight, seen, units);
    }

    #[inline]
    pub fn add_weighted(&mut self, weight: T, seen: &Seen<T>, units: [u8; 2]) {
        let [x, y] = units.map(|units| T::count(units.into()));
        let (wx, wy, wo) = (weight * x, weight * y, weight * seen.offset);
        self.total += weight;
        self.first = [self.first[0] + wx, self.first[1] + wy];
        self.second = [self.second[0] + wx * x, self.second[1] + wx * y, self.second[2] + wy * y];
        self.offset = [self.offset[0] + wo, self.offset[1] + wo * seen.offset + weight * seen.offset_variance];
        self.cross = [self.cross[0] + wo * x, self.cross[1] + wo * y];
    }

    fn scale(&mut self, factor: T) {
        self.total *= factor;
        self.first = self.first.map(|sum| sum * factor);
        self.second = self.second.map(|sum| sum * factor);
        self.offset = self.offset.map(|sum| sum * factor);
        self.cross = self.cross.map(|sum| sum * factor);
    }

    pub fn joint(&self) -> Joint<T> {
        let [x, y] = self.first.map(|sum| sum / self.total);
        let [xx, xy, yy] = self.second.map(|sum| sum / self.total);
        let [offset, offsets] = self.offset.map(|sum| sum / self.total);
        let [ox, oy] = self.cross.map(|sum| sum / self.total);
        // A point represents the square around it.
        let within = T::of(1.0 / 12.0);
        Joint {
            position: [x, y],
            covariance: [(xx - x * x).at_least(T::ZERO) + within, xy - x * y, (yy - y * y).at_least(T::ZERO) + within],
            offset,
            offset_variance: (offsets - offset * offset).at_least(T::ZERO),
            cross: [ox - offset * x, oy - offset * y],
        }
    }

    pub fn posterior(&self, map: &Map<'_>, likelihood: &Likelihood<T>) -> Posterior<T> {
        let joint = self.joint();
        let (half, square) = (T::of(0.5), map.unit::<T>().squared());
        Posterior {
            position: map.place(joint.position),
            covariance: joint.covariance.map(|entry| entry * square),
            offset_db: half * joint.offset,
            offset_deviation_db: half * joint.offset_variance.sqrt(),
            heard: likelihood.heard.len(),
        }
    }
}

#[cfg(test)]
pub(super) mod tests {
    use std::vec::Vec;

    use super::super::{Point, encode};
    use super::*;

    /// A lattice of one beacon's RSSI values along x, `unit_m` apart, with deviations of 3 dB.
    pub fn row_of(rssis: &[f64], unit_m: f64) -> Vec<u8> {
        let rssis: Vec<[Option<f64>; 1]> = rssis.iter().map(|rssi| [Some(*rssi)]).collect();
        let point = |(index, rssis)| Point { position_m: [index as f64 * unit_m, 1.0], rssis, deviations: &[3.0] };
        let points: Vec<_> = rssis.iter().map(|rssis| &rssis[..]).enumerate().map(point).collect();
        let mut buffer = [0; 4096];
        encode(&points, &[1], &[-95.0], Some(unit_m), &mut buffer).expect("encoded").to_vec()
    }

    #[test]
    fn mean_and_covariance_are_those_of_bayes() {
        // One beacon, no offset, σ 3. At −60 the points −60 and −66 have the weights 1 and e^−2 = 0.135335. The mean
        // lies at 0.135335 ⁄ 1.135335 = 0.119203 of the distance of 2 m. The variance is p (1 − p) 2² = 0.419974,
        // plus 2² ⁄ 12.
        let bytes = row_of(&[-60.0, -66.0], 2.0);
        let (map, _) = Map::decode(&bytes).expect("a map");
        let known = Receiver { offset_deviation_db: 0.0, ..Receiver::default() };
        let found = locate(&map, &[Some(-60.0)], &known).expect("found");
        assert!((found.position[0] - 0.238_406).abs() < 1e-5 && (found.position[1] - 1.0).abs() < 1e-9, "{found:?}");
        assert!((found.covariance[0] - 0.419_974 - 1.0 / 3.0).abs() < 1e-5, "{found:?}");
        assert!((found.covariance[2] - 1.0 / 3.0).abs() < 1e-9 && found.covariance[1].abs() < 1e-9, "{found:?}");
        // The receiver is known to measure 6 dB less: now the second point is the likelier one.
        let deaf = Receiver { offset_db: -6.0, ..known };
        let found = locate(&map, &[Some(-66.0)], &deaf).expect("found");
        assert!((found.position[0] - 0.238_406).abs() < 1e-5 && (found.offset_db + 6.0).abs() < 1e-9, "{found:?}");
        // With twice the variance: e^(−36 ⁄ 2 ⁄ 18) = e^−1: 0.367879 ⁄ 1.367879 · 2 m.
        let noisy = Receiver { noise_db2: 9.0, ..known };
        let found = locate(&map, &[Some(-60.0)], &noisy).expect("found");
        assert!((found.position[0] - 0.537_883).abs() < 1e-5, "{found:?}");
    }

    #[test]
    fn an_offset_common_to_all_beacons_is_found_and_forgiven() {
        // Two points whose beacons differ by 10 dB in opposite directions. scipy.stats.multivariate_normal with the
        // covariance diag(9, 9) + 16 for all entries gives ln L = −6.518 at the first point and −12.074 at the
        // second: a weight of 0.003851.
        let rssis = [[Some(-50.0), Some(-60.0)], [Some(-60.0), Some(-50.0)]];
        let point =
            |index: usize| Point { position_m: [index as f64, 0.0], rssis: &rssis[index], deviations: &[3.0, 3.0] };
        let mut buffer = [0; 128];
        let bytes = encode(&[point(0), point(1)], &[1, 2], &[-95.0; 2], Some(1.0), &mut buffer).expect("encoded");
        let (map, _) = Map::decode(bytes).expect("a map");
        let receiver = Receiver { offset_deviation_db: 4.0, ..Receiver::default() };
        let found = locate(&map, &[Some(-59.0), Some(-64.0)], &receiver).expect("found");
        assert!((found.position[0] - 0.003_851).abs() < 1e-5, "{found:?}");
        // Common to both points: R ⁄ (W + π) = (−13 ⁄ 9) ⁄ (2 ⁄ 9 + 1 ⁄ 16) = −5.0732 dB, 1 ⁄ √0.284722 = 1.8741 dB.
        assert!((found.offset_db + 5.0732).abs() < 1e-3, "{found:?}");
        assert!((found.offset_deviation_db - 1.8741).abs() < 1e-3, "{found:?}");
    }

    #[test]
    fn an_offset_is_learnt_from_scan_to_scan() {
        // One point, one beacon, always 6 dB too weak. The offset's prior is 4 dB, an RSSI's deviation 3 dB. By hand:
        // gain 16 ⁄ 25, offset −3.84, variance 16 · 9 ⁄ 25 + 0.05 = 5.81, deviation 2.4104. Then 5.81 ⁄ 14.81 of the
        // rest, −4.6874, √(5.81 · 9 ⁄ 14.81 + 0.05) = 1.8923. Finally v = 9 v ⁄ (9 + v) + 0.05: v = 0.6963, 0.8344 dB.
        let bytes = row_of(&[-60.0], 1.0);
        let (map, _) = Map::decode(&bytes).expect("a map");
        let mut receiver = Receiver { offset_deviation_db: 4.0, ..Receiver::<f64>::default() };
        let mut scan = || {
            let found = locate(&map, &[Some(-66.0)], &receiver).expect("found");
            receiver.set_offset(found.offset_db, found.offset_deviation_db);
            (receiver.offset_db, receiver.offset_deviation_db)
        };
        for (offset, deviation) in [(-3.84, 2.4104), (-4.6874, 1.8923)] {
            let found = scan();
            assert!((found.0 - offset).abs() < 1e-3 && (found.1 - deviation).abs() < 1e-3, "{found:?}");
        }
        let last = (0..60).map(|_| scan()).last().expect("some");
        assert!((last.0 + 6.0).abs() < 0.01 && (last.1 - 0.8344).abs() < 1e-3, "{last:?}");
        let mut known = Receiver { offset_db: 2.0, offset_deviation_db: 0.0, ..receiver };
        let found = locate(&map, &[Some(-66.0)], &known).expect("found");
        known.set_offset(found.offset_db, found.offset_deviation_db);
        assert_eq!(known.offset_db, 2.0);
    }

    #[test]
    fn single_precision_says_the_same() {
        let rssis: Vec<f64> = (0..200).map(|index| -50.0 - f64::from(index % 37) / 2.0).collect();
        let bytes = row_of(&rssis, 0.5);
        let (map, _) = Map::decode(&bytes).expect("a map");
        let double = locate(&map, &[Some(-58.0)], &Receiver::<f64>::default()).expect("found");
        let single = locate(&map, &[Some(-58.0_f32)], &Receiver::default()).expect("found");
        assert!((double.position[0] - f64::from(single.position[0])).abs() < 1e-3, "{double:?} {single:?}");
        assert!((double.covariance[0] - f64::from(single.covariance[0])).abs() < 0.1, "{double:?} {single:?}");
    }

    #[test]
    fn nonsense_has_no_position_and_no_panic() {
        let bytes = row_of(&[-60.0, -66.0], 2.0);
        let (map, _) = Map::decode(&bytes).expect("a map");
        let receiver = Receiver::<f32>::default();
        assert_eq!(locate(&map, &[], &receiver), Err(NoPosition::Unheard));
        assert_eq!(locate(&map, &[Some(f32::NAN)], &receiver), Err(NoPosition::Unheard));
        let odd = Receiver { offset_db: f32::NAN, offset_deviation_db: f32::NAN, noise_db2: f32::NAN };
        assert!(locate(&map, &[Some(-60.0)], &odd).expect("found").position[0].is_finite());
        let points = super::super::map::tests::surveyed(&[([0.0, 0.0], &[Some(-60.0)])]);
        let (points, _) = Map::decode(&points).expect("a map");
        assert_eq!(locate(&points, &[Some(-60.0)], &receiver), Err(NoPosition::NoDeviations));
    }
}
