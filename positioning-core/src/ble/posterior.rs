//! The mean of a tag's possible positions, given the RSSI values that it receives and the area that it can be in: the
//! integral over the area of position times likelihood. It uses two lattices. The second one covers the region where
//! the first found the tag.
//!
//! Likelihoods of RSSI values are wide, bent and often in two parts. Their mean errs less than their maximum, which
//! [`nonlinear`] finds. Their spread is a correct covariance for every shape. One beacon alone already gives
//! information.
//!
//! [`nonlinear`]: super::multilateration::nonlinear

use super::path_loss::Wall;
use super::rssi::{RssiLikelihood, RssiObservation, Term};
use crate::{AnchorSet, Area, Fix, MAX_ANCHORS, Real, SolveError};

/// The number of points of a lattice along each axis.
const POINTS: usize = 16;
/// A beacon is not farther than the distance of an RSSI that is lower by this number of deviations …
const FARTHEST: f64 = 2.5;
/// … but this bound is at least this distance, metres.
const FARTHEST_AT_LEAST_M: f64 = 2.0;
/// The second lattice covers this number of deviations about the first one's mean.
const REACH: f64 = 3.5;

/// How RSSI values are weighted.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct PosteriorSettings<T> {
    /// The standard deviation of the receiver's own offset, dB.
    pub offset_deviation: T,
    /// The weight of the RSSI values' likelihood, up to 1: shadows of several beacons at one position depend on each
    /// other, and the path loss is not exact.
    pub trust: T,
}

impl<T: Real> Default for PosteriorSettings<T> {
    /// 2 dB and one half: the least error over all fingerprints of a room and a flat, where each was located by the
    /// others.
    fn default() -> Self {
        Self { offset_deviation: T::of(2.0), trust: T::of(0.5) }
    }
}

/// The tag's position, and the offset of its receiver.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Posterior<T> {
    /// The mean position in the plane, and its covariance.
    pub fix: Fix<T, 2>,
    /// The receiver's offset, dB.
    pub offset: T,
    /// Its variance, dB².
    pub offset_variance: T,
}

/// The tag's position within an area, by RSSI values of which the first [`MAX_ANCHORS`] count. Walls attenuate
/// signals (2), if any are given.
///
/// # Errors
/// [`SolveError::TooFewAnchors`] without an RSSI, [`SolveError::TooManyAnchors`] beyond [`MAX_ANCHORS`],
/// [`SolveError::NotFinite`] where a number is invalid or the area is empty.
#[inline(never)]
pub fn posterior<T: Real>(
    heard: &[RssiObservation<T, 2>],
    area: &Area<T, 2>,
    walls: &[Wall<T>],
    belief: &PosteriorSettings<T>,
) -> Result<Posterior<T>, SolveError> {
    if heard.is_empty() {
        return Err(SolveError::TooFewAnchors);
    }
    if heard.len() > MAX_ANCHORS {
        return Err(SolveError::TooManyAnchors);
    }
    if !(is_some(area) && heard.iter().all(RssiObservation::is_sane)) {
        return Err(SolveError::NotFinite);
    }
    let rssis = belief.of(heard).through(walls);
    let area = &belief.narrowed(area, heard);
    let coarse = Moments::over(&rssis, area, None);
    let near = Area {
        min: core::array::from_fn(|axis| (coarse.mean[axis] - coarse.reach(axis)).at_least(area.min[axis])),
        max: core::array::from_fn(|axis| (coarse.mean[axis] + coarse.reach(axis)).at_most(area.max[axis])),
    };
    let fine = Moments::over(&rssis, &near, None);
    let found = if fine.weight > T::ZERO { fine } else { coarse };
    if !(found.mean[0] + found.mean[1]).is_finite() {
        return Err(SolveError::Diverged);
    }
    let fix = Fix {
        position: found.mean,
        covariance: found.covariance,
        // Metres of position per metre of range have no meaning here.
        dilution_of_precision: [T::ZERO; 2],
        used: AnchorSet(((1_u32 << heard.len()) - 1) as u16),
        quality: rssis.agreement(found.mean),
        alternative: None,
    };
    let [offset, spread] = found.decibels;
    Ok(Posterior { fix, offset, offset_variance: spread + rssis.offset_variance() })
}

/// By how much an RSSI is too strong, dB, and the variance of that, dB², where other RSSI values give the likelihood
/// of each position of an area. `None` where the result is not finite, or the input is not valid.
#[inline(never)]
pub(crate) fn too_loud<T: Real>(
    heard: &RssiObservation<T, 2>,
    others: &[RssiObservation<T, 2>],
    area: &Area<T, 2>,
    walls: &[Wall<T>],
    belief: &PosteriorSettings<T>,
) -> Option<[T; 2]> {
    if !(is_some(area) && heard.is_sane()) {
        return None;
    }
    let rssis = belief.of(others).through(walls);
    let [excess, spread] = Moments::over(&rssis, &belief.narrowed(area, others), Some(&Term::of(heard))).decibels;
    let variance = spread + rssis.offset_variance() + heard.path_loss.deviation.squared();
    (excess + variance).is_finite().then_some([excess, variance])
}

/// Whether an area is not empty and is finite.
#[inline(never)]
fn is_some<T: Real>(area: &Area<T, 2>) -> bool {
    (0..2).all(|axis| area.max[axis] > area.min[axis] && (area.max[axis] - area.min[axis]).is_finite())
}

impl<T: Real> PosteriorSettings<T> {
    /// The likelihood of RSSI values.
    #[inline(never)]
    pub fn of<'a>(&self, heard: &[RssiObservation<T, 2>]) -> RssiLikelihood<'a, T> {
        RssiLikelihood::of(heard, self.offset_deviation, self.trust)
    }

    /// The part of an area that is near enough to the beacon whose greatest possible distance is the least; the whole
    /// area where that part is empty. A lattice over a whole site would be coarse. The part that is near enough to
    /// every beacon may be very narrow where the beacons contradict each other.
    #[inline(never)]
    fn narrowed(&self, area: &Area<T, 2>, heard: &[RssiObservation<T, 2>]) -> Area<T, 2> {
        let mut near = *area;
        let mut nearest = None;
        for RssiObservation { beacon_m, rssi_dbm, path_loss, .. } in heard {
            let deviation = (path_loss.deviation.squared() / self.trust + self.offset_deviation.squared()).sqrt();
            let farthest =
                path_loss.distance(*rssi_dbm - T::of(FARTHEST) * deviation).at_least(T::of(FARTHEST_AT_LEAST_M));
            if nearest.is_none_or(|nearest| farthest < nearest) {
                nearest = Some(farthest);
                near = Area {
                    min: core::array::from_fn(|axis| area.min[axis].at_least(beacon_m[axis] - farthest)),
                    max: core::array::from_fn(|axis| area.max[axis].at_most(beacon_m[axis] + farthest)),
                };
            }
        }
        if is_some(&near) { near } else { *area }
    }
}

/// Mean and covariance of a likelihood over a lattice.
struct Moments<T> {
    weight: T,
    mean: [T; 2],
    covariance: [[T; 2]; 2],
    /// Mean, dB, and variance, dB², of the receiver's offset, or of by how much one more RSSI is too strong with that
    /// offset.
    decibels: [T; 2],
    /// The distance between two points of the lattice.
    spacing: [T; 2],
}

impl<T: Real> Moments<T> {
    #[inline(never)]
    fn over(rssis: &RssiLikelihood<'_, T>, area: &Area<T, 2>, one_more: Option<&Term<T>>) -> Self {
        let spacing: [T; 2] = core::array::from_fn(|axis| (area.max[axis] - area.min[axis]) / T::count(POINTS));
        let half = T::of(0.5);
        // Sums relative to the area's middle, scaled by the greatest likelihood so far: nothing underflows, and one
        // pass is enough.
        let middle: [T; 2] = core::array::from_fn(|axis| half * (area.min[axis] + area.max[axis]));
        let mut greatest = None;
        let mut sums = [T::ZERO; 8];
        for row in 0..POINTS {
            let y = area.min[1] + (T::count(row) + half) * spacing[1];
            for column in 0..POINTS {
                let x = area.min[0] + (T::count(column) + half) * spacing[0];
                let (ln, offset) = rssis.seen_from([x, y]);
                let db = one_more.map_or(offset, |term| rssis.residual(term, [x, y]) - offset);
                let scale = match greatest {
                    Some(greatest) if ln <= greatest => (ln - greatest).exp(),
                    Some(least) => {
                        let shrink = (least - ln).exp();
                        sums = sums.map(|sum| sum * shrink);
                        greatest = Some(ln);
                        T::ONE
                    }
                    None => {
                        greatest = Some(ln);
                        T::ONE
                    }
                };
                let (x, y) = (x - middle[0], y - middle[1]);
                let terms = [T::ONE, x, y, x * x, x * y, y * y, db, db * db];
                for (sum, term) in sums.iter_mut().zip(terms) {
                    *sum += scale * term;
                }
            }
        }
        let [weight, x, y, xx, xy, yy, db, squares] = sums;
        let (x, y, db) = (x / weight, y / weight, db / weight);
        // The variance within a cell of the lattice.
        let own = |axis: usize| spacing[axis].squared() / T::of(12.0);
        let xy = xy / weight - x * y;
        Self {
            weight,
            mean: [middle[0] + x, middle[1] + y],
            covariance: [
                [(xx / weight - x * x).at_least(T::ZERO) + own(0), xy],
                [xy, (yy / weight - y * y).at_least(T::ZERO) + own(1)],
            ],
            decibels: [db, (squares / weight - db * db).at_least(T::ZERO)],
            spacing,
        }
    }

    /// Half the extent of the second lattice along an axis.
    fn reach(&self, axis: usize) -> T {
        T::of(REACH) * self.covariance[axis][axis].sqrt() + self.spacing[axis]
    }
}

#[cfg(test)]
mod tests {
    use super::{PosteriorSettings, posterior, too_loud};
    use crate::ble::path_loss::PathLoss;
    use crate::ble::rssi::RssiObservation;
    use crate::{Area, SolveError};

    const MODEL: PathLoss<f64> = PathLoss { level_1m: -50.0, exponent: 2.0, deviation: 4.0 };
    const ROOM: Area<f64, 2> = Area { min: [0.0, 0.0], max: [6.0, 8.0] };

    fn heard(place: [f64; 2], rssi: f64) -> RssiObservation<f64, 2> {
        RssiObservation { beacon_m: place, above_m: 0.0, rssi_dbm: rssi, path_loss: MODEL }
    }

    #[test]
    fn the_mean_is_that_of_a_fine_integral() {
        // The same integral by brute force over a lattice of 1 cm.
        let beacons = [heard([0.0, 0.0], -62.0), heard([6.0, 0.0], -66.0), heard([3.0, 8.0], -63.0)];
        let (mut weight, mut sums, mut squares) = (0.0, [0.0; 2], [0.0; 2]);
        for row in 0..800 {
            for column in 0..600 {
                let at = [0.005 + 0.01 * f64::from(column), 0.005 + 0.01 * f64::from(row)];
                let square: f64 = beacons
                    .iter()
                    .map(|beacon| {
                        let d2 = (at[0] - beacon.beacon_m[0]).powi(2) + (at[1] - beacon.beacon_m[1]).powi(2) + 0.09;
                        ((beacon.rssi_dbm + 50.0 + 10.0 * d2.log10()) / 4.0).powi(2)
                    })
                    .sum();
                let likelihood = (-0.5 * 0.5 * square).exp();
                weight += likelihood;
                for axis in 0..2 {
                    sums[axis] += likelihood * at[axis];
                    squares[axis] += likelihood * at[axis] * at[axis];
                }
            }
        }
        let mean = sums.map(|sum| sum / weight);
        let found = posterior(&beacons, &ROOM, &[], &PosteriorSettings { offset_deviation: 0.0, trust: 0.5 });
        let fix = found.expect("a position").fix;
        for axis in 0..2 {
            let variance = squares[axis] / weight - mean[axis] * mean[axis];
            assert!((fix.position[axis] - mean[axis]).abs() < 0.03, "{fix:?} {mean:?}");
            assert!((fix.covariance[axis][axis] / variance - 1.0).abs() < 0.05, "{fix:?} {variance}");
        }
    }

    #[test]
    fn the_offset_and_what_one_more_is_too_loud_are_those_of_a_fine_integral() {
        // By brute force over position, 5 cm, and offset, 0.1 dB. Half of the RSSI values' likelihood counts, and the
        // whole prior of the offset, 3 dB.
        let beacons = [heard([0.0, 0.0], -58.0), heard([6.0, 0.0], -62.0), heard([3.0, 8.0], -60.0)];
        let one_more = heard([0.0, 8.0], -75.0);
        let (mut weight, mut sums, mut squares) = (0.0, [0.0; 2], [0.0; 2]);
        for row in 0..160 {
            for column in 0..120 {
                let at = [0.025 + 0.05 * f64::from(column), 0.025 + 0.05 * f64::from(row)];
                let too_loud = |beacon: &RssiObservation<f64, 2>| {
                    let d2 = (at[0] - beacon.beacon_m[0]).powi(2) + (at[1] - beacon.beacon_m[1]).powi(2) + 0.09;
                    beacon.rssi_dbm + 50.0 + 10.0 * d2.log10()
                };
                for step in -150..150 {
                    let offset = 0.1 * f64::from(step);
                    let square: f64 = beacons.iter().map(|b| ((too_loud(b) - offset) / 4.0).powi(2)).sum();
                    let likelihood = (-0.25 * square - 0.5 * (offset / 3.0).powi(2)).exp();
                    weight += likelihood;
                    for (what, value) in [offset, too_loud(&one_more) - offset].into_iter().enumerate() {
                        sums[what] += likelihood * value;
                        squares[what] += likelihood * value * value;
                    }
                }
            }
        }
        let mean = sums.map(|sum: f64| sum / weight);
        let variance = [0, 1].map(|what: usize| squares[what] / weight - mean[what] * mean[what]);
        let belief = PosteriorSettings { offset_deviation: 3.0, trust: 0.5 };
        let found = posterior(&beacons, &ROOM, &[], &belief).expect("a position");
        let off = [found.offset - mean[0], found.offset_variance / variance[0] - 1.0];
        assert!(off.iter().all(|off| off.abs() < 0.05), "{found:?} {mean:?} {variance:?}");
        // The RSSI's own 4 dB are added. This lattice is the coarse one.
        let [excess, doubt] = too_loud(&one_more, &beacons, &ROOM, &[], &belief).expect("three others");
        assert!(
            (excess - mean[1]).abs() < 0.15 && (doubt / (variance[1] + 16.0) - 1.0).abs() < 0.05,
            "{excess} {doubt}"
        );
        assert_eq!(too_loud(&RssiObservation { rssi_dbm: f64::NAN, ..one_more }, &beacons, &ROOM, &[], &belief), None);
    }

    #[test]
    fn of_a_large_area_only_what_the_levels_reach_is_looked_at() {
        // Over a kilometre a lattice has 62 m between two points. Over 80 m it has 5 m, and the RSSI values end at 40
        // m. Exact RSSI values at (2, 3), as in multilateration's tests.
        let [site, near] = [500.0, 40.0].map(|half| Area { min: [-half; 2], max: [half; 2] });
        let beacons = [([0.0, 0.0], 13.09_f64), ([6.0, 0.0], 25.09), ([0.0, 8.0], 29.09), ([6.0, 8.0], 41.09)]
            .map(|(place, square)| heard(place, -50.0 - 10.0 * square.log10()));
        let fix = posterior(&beacons, &site, &[], &PosteriorSettings::default()).expect("a position").fix;
        let near = posterior(&beacons, &near, &[], &PosteriorSettings::default()).expect("a position").fix;
        let apart = (fix.position[0] - near.position[0]).hypot(fix.position[1] - near.position[1]);
        let wider = fix.covariance[0][0] / near.covariance[0][0];
        assert!(apart < 0.5 && (0.8..1.25).contains(&wider), "{fix:?} {near:?}");
    }

    #[test]
    fn one_beacon_says_something_and_none_nothing() {
        let fix =
            posterior(&[heard([0.0, 0.0], -50.0)], &ROOM, &[], &PosteriorSettings::default()).expect("a position").fix;
        assert!(fix.position[0] < 3.0 && fix.position[1] < 4.0 && fix.covariance[1][1] > 1.0, "{fix:?}");
        assert_eq!(posterior(&[], &ROOM, &[], &PosteriorSettings::default()), Err(SolveError::TooFewAnchors));
    }

    #[test]
    fn a_small_tag_in_a_large_hall_is_found_by_the_second_lattice() {
        let hall = Area { min: [-200.0, -200.0], max: [200.0, 200.0] };
        let sharp =
            |place, rssi| RssiObservation { path_loss: PathLoss { deviation: 0.5, ..MODEL }, ..heard(place, rssi) };
        // Exact RSSI values at (2, 3), as in multilateration's tests.
        let beacons = [([0.0, 0.0], 13.09_f64), ([6.0, 0.0], 25.09), ([0.0, 8.0], 29.09), ([6.0, 8.0], 41.09)]
            .map(|(place, square)| sharp(place, -50.0 - 10.0 * square.log10()));
        let found = posterior(&beacons, &hall, &[], &PosteriorSettings { offset_deviation: 0.0, trust: 1.0 });
        let fix = found.expect("a position").fix;
        let error = (fix.position[0] - 2.0).hypot(fix.position[1] - 3.0);
        assert!(error < 3.0 * (fix.covariance[0][0] + fix.covariance[1][1]).sqrt() && error < 10.0, "{fix:?}");
    }

    #[test]
    fn what_is_no_number_is_a_reason() {
        let good = heard([0.0, 0.0], -60.0);
        let at = |heard: &[RssiObservation<f64, 2>], area: &Area<f64, 2>| {
            posterior(heard, area, &[], &PosteriorSettings::default()).err()
        };
        assert_eq!(at(&[RssiObservation { rssi_dbm: f64::NAN, ..good }], &ROOM), Some(SolveError::NotFinite));
        assert_eq!(at(&[good], &Area { min: [0.0, 0.0], max: [0.0, 8.0] }), Some(SolveError::NotFinite));
        assert_eq!(at(&[good], &Area { min: [0.0, f64::NAN], max: [6.0, 8.0] }), Some(SolveError::NotFinite));
        assert_eq!(at(&[good; 17], &ROOM), Some(SolveError::TooManyAnchors));
    }

    #[test]
    fn levels_that_say_nothing_are_the_middle_of_the_area() {
        let blind = RssiObservation { path_loss: PathLoss { deviation: 99.0, ..MODEL }, ..heard([0.0, 0.0], -60.0) };
        let fix = posterior(&[blind], &ROOM, &[], &PosteriorSettings::default()).expect("a position").fix;
        // A box of 6 by 8: variances 36 ⁄ 12 and 64 ⁄ 12.
        assert!((fix.position[0] - 3.0).abs() < 0.05 && (fix.position[1] - 4.0).abs() < 0.05, "{fix:?}");
        assert!(
            (fix.covariance[0][0] - 3.0).abs() < 0.05 && (fix.covariance[1][1] - 16.0 / 3.0).abs() < 0.1,
            "{fix:?}"
        );
    }
}
