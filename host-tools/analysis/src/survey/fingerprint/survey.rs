//! A survey: the RSSI values at known points, one number a beacon.

use baliza_report::{mean, percentile};
use std::collections::BTreeSet;

use positioning_core::ble::fingerprint::{MAX_BEACONS, MapError, Point, encode};

use super::process::apart;
use recording::beacons::{Dwell, Sample, rssis_by_beacon};

/// RSSI of a beacon that no point received, dBm.
const NEVER_HEARD_DBM: f64 = -100.0;

/// How the RSSI values of a dwell become one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Average {
    /// The mean power. Fading is deep and narrow. The mean of decibels follows its notches, which differ from channel
    /// to channel and from visit to visit; the mean of powers hardly does.
    #[default]
    Power,
    /// The mean of the decibels between the 10th and the 90th percentile, as in A. Linde Cerezo's thesis (section
    /// 4.3.2).
    Trimmed,
}

impl Average {
    /// The average of RSSI values, dBm; `None` without values.
    pub fn of(self, levels_dbm: &[f64]) -> Option<f64> {
        if levels_dbm.is_empty() {
            return None;
        }
        Some(match self {
            Self::Power => dbm(mean(levels_dbm.iter().map(|rssi| milliwatts(*rssi)))),
            Self::Trimmed => {
                let mut sorted = levels_dbm.to_vec();
                sorted.sort_by(f64::total_cmp);
                let (low, high) = (percentile(&sorted, 0.1), percentile(&sorted, 0.9));
                mean(sorted.into_iter().filter(|rssi| (low..=high).contains(rssi)))
            }
        })
    }
}

/// The power of an RSSI.
pub fn milliwatts(dbm: f64) -> f64 {
    10.0_f64.powf(dbm / 10.0)
}

/// The RSSI of a power.
pub fn dbm(milliwatts: f64) -> f64 {
    10.0 * milliwatts.log10()
}

/// The minor of a beacon: its name, or the end of its name after a major.
pub fn minor(name: &str) -> Option<u16> {
    name.rsplit_once('-').map_or(name, |(_, minor)| minor).parse().ok()
}

/// A surveyed point.
#[derive(Clone, Debug, PartialEq)]
pub struct Spot {
    /// Its position, metres.
    pub position_m: [f64; 2],
    /// The RSSI of each beacon, dBm; `None` where it was not received.
    pub rssis: Vec<Option<f64>>,
}

/// A survey.
#[derive(Clone, Debug, PartialEq)]
pub struct Survey {
    /// The beacons' names in their order: by number where all are numbers, else by name.
    pub beacons: Vec<String>,
    /// The points.
    pub spots: Vec<Spot>,
}

impl Survey {
    /// The survey of dwells at known points. Values that are not an RSSI are left out.
    pub fn of(stays: &[Dwell], average: Average) -> Self {
        let names: BTreeSet<&str> =
            stays.iter().flat_map(|stay| &stay.samples).map(|sample| sample.beacon.as_str()).collect();
        let mut beacons: Vec<String> = names.into_iter().map(str::to_owned).collect();
        if let Ok(mut numbers) =
            beacons.iter().map(|name| name.parse::<u64>().map(|n| (n, name.clone()))).collect::<Result<Vec<_>, _>>()
        {
            numbers.sort();
            beacons = numbers.into_iter().map(|(_, name)| name).collect();
        }
        let spot = |stay: &Dwell| Spot { position_m: stay.position_m, rssis: scan(&beacons, &stay.samples, average) };
        let spots = stays.iter().map(spot).collect();
        Self { beacons, spots }
    }

    /// Some of its points.
    pub fn only(&self, keep: impl Fn(usize) -> bool) -> Self {
        let spots =
            self.spots.iter().enumerate().filter(|(index, _)| keep(*index)).map(|(_, spot)| spot.clone()).collect();
        Self { beacons: self.beacons.clone(), spots }
    }

    /// The middle of its points, metres.
    pub fn middle_m(&self) -> [f64; 2] {
        let count = self.spots.len().max(1) as f64;
        [0, 1].map(|axis| self.spots.iter().map(|spot| spot.position_m[axis]).sum::<f64>() / count)
    }

    /// The same survey shifted by this, metres.
    pub fn moved(&self, by_m: [f64; 2]) -> Self {
        let mut moved = self.clone();
        for spot in &mut moved.spots {
            spot.position_m = [0, 1].map(|axis| spot.position_m[axis] + by_m[axis]);
        }
        moved
    }

    /// RSSI of a beacon that is not received: its weakest RSSI at any point, dBm (table 5.3 of the thesis has such
    /// RSSI values).
    pub fn fallbacks(&self) -> Vec<f64> {
        let weakest = |beacon: usize| self.spots.iter().filter_map(|spot| spot.rssis[beacon]).reduce(f64::min);
        (0..self.beacons.len()).map(|beacon| weakest(beacon).unwrap_or(NEVER_HEARD_DBM)).collect()
    }

    /// The numbers of the beacons in the map: a tag's minors, which are the numbers that their names are or end in
    /// (`7`, `1-7`), if all of them are different; else their places in the order.
    pub fn identities(&self) -> Vec<u16> {
        let minors: Option<Vec<u16>> = self.beacons.iter().map(|name| minor(name)).collect();
        let distinct = |minors: &Vec<u16>| minors.iter().collect::<BTreeSet<_>>().len() == minors.len();
        minors.filter(distinct).unwrap_or_else(|| (0..).take(self.beacons.len()).collect())
    }

    /// The points themselves as a map.
    ///
    /// # Errors
    /// There are no points, or too many beacons (more than [`MAX_BEACONS`]).
    pub fn map(&self) -> Result<Vec<u8>, MapError> {
        let points: Vec<Point> = self
            .spots
            .iter()
            .map(|Spot { position_m, rssis }| Point { position_m: *position_m, rssis, deviations: &[] })
            .collect();
        to_bytes(&points, &self.identities(), &self.fallbacks(), None)
    }
}

/// Some points of a survey, spread over the area: the middle one first, and then always the farthest from those
/// before.
pub fn spread(survey: &Survey, count: usize) -> BTreeSet<usize> {
    let place = |point: usize| survey.spots.get(point).map_or([f64::NAN; 2], |spot| spot.position_m);
    let middle_m = survey.middle_m();
    let points = || 0..survey.spots.len();
    let mut kept = BTreeSet::new();
    kept.extend(points().min_by(|a, b| apart(place(*a), middle_m).total_cmp(&apart(place(*b), middle_m))));
    while kept.len() < count {
        let far =
            |point: &usize| kept.iter().map(|other| apart(place(*point), place(*other))).fold(f64::INFINITY, f64::min);
        let others = points().filter(|point| !kept.contains(point));
        let Some(next) = others.max_by(|a, b| far(a).total_cmp(&far(b))) else { break };
        kept.insert(next);
    }
    kept
}

/// The average RSSI of every beacon in samples, dBm; values that no receiver can have measured are left out.
pub fn scan(beacons: &[String], samples: &[Sample], average: Average) -> Vec<Option<f64>> {
    let heard = rssis_by_beacon(samples);
    beacons.iter().map(|name| average.of(heard.get(name.as_str())?)).collect()
}

/// A map's bytes, however long.
///
/// # Errors
/// The points make no valid map.
pub fn to_bytes(
    points: &[Point],
    identities: &[u16],
    fallbacks: &[f64],
    unit_m: Option<f64>,
) -> Result<Vec<u8>, MapError> {
    let mut buffer = vec![0; 64 + 4 * MAX_BEACONS + points.len() * (2 + 2 * MAX_BEACONS)];
    encode(points, identities, fallbacks, unit_m, &mut buffer).map(<[u8]>::to_vec)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stay(point: &str, samples: &[(&str, f64)]) -> Dwell {
        let sample = |&(beacon, rssi_dbm): &(&str, f64)| Sample { beacon: beacon.to_owned(), rssi_dbm, t_s: 0.0 };
        Dwell {
            point: point.to_owned(),
            room: None,
            position_m: [1.0, 2.0],
            samples: samples.iter().map(sample).collect(),
        }
    }

    #[test]
    fn averages_are_of_powers_or_of_what_percentiles_leave() {
        // −60 and −70 dBm are 1 and 0.1 nW: 0.55 nW, −62.596 dBm.
        assert!((Average::Power.of(&[-60.0, -70.0]).expect("one") + 62.596).abs() < 1e-3);
        // numpy.percentile of −90, −60 … −52, −20: 10 % is −60, 90 % is −52: what is left has the mean −56.
        let rssis: Vec<f64> = [-90.0, -20.0].into_iter().chain((52..=60).map(|rssi| -f64::from(rssi))).collect();
        assert_eq!(Average::Trimmed.of(&rssis), Some(-56.0));
        assert_eq!((Average::Power.of(&[]), Average::Trimmed.of(&[])), (None, None));
        assert_eq!(Average::Trimmed.of(&[-61.0]), Some(-61.0));
    }

    #[test]
    fn beacons_are_in_the_order_of_their_numbers_and_nonsense_is_left_out() {
        let stays =
            [stay("a", &[("10", -60.0), ("9", 127.0)]), stay("b", &[("9", -70.0), ("9", f64::NAN), ("10", -65.0)])];
        let survey = Survey::of(&stays, Average::Power);
        assert_eq!((survey.beacons.clone(), survey.identities()), (vec!["9".to_owned(), "10".to_owned()], vec![9, 10]));
        assert_eq!(survey.spots[0].rssis, [None, Some(-60.0)]);
        let [weakest, other] = survey.fallbacks()[..] else { panic!("two") };
        assert!((weakest + 70.0).abs() < 1e-9 && (other + 65.0).abs() < 1e-9);
        let named = Survey::of(&[stay("a", &[("north", -60.0), ("8", -60.0)])], Average::Power);
        assert_eq!((named.beacons.clone(), named.identities()), (vec!["8".to_owned(), "north".to_owned()], vec![0, 1]));
        let of =
            |names: [&str; 2]| Survey::of(&[stay("a", &names.map(|name| (name, -60.0)))], Average::Power).identities();
        assert_eq!(of(["1-7", "fda50693-2-9"]), [7, 9], "minors");
        assert_eq!(of(["1-7", "2-7"]), [0, 1], "two of one minor");
    }

    #[test]
    fn few_points_are_spread_over_the_place() {
        // Along a line at 0, 1, 2, 9, 10: the middle is 4.4, its nearest 2; then 10, which is 8 away, then 0.
        let spot = |x: f64| Spot { position_m: [x, 0.0], rssis: vec![None] };
        let survey = Survey { beacons: vec!["a".to_owned()], spots: [0.0, 1.0, 2.0, 9.0, 10.0].map(spot).to_vec() };
        assert_eq!(spread(&survey, 3), BTreeSet::from([0, 2, 4]));
        assert_eq!(spread(&survey, 9).len(), 5);
    }

    #[test]
    fn surveys_that_make_no_map_are_refused() {
        let nothing = Survey { beacons: vec!["1".to_owned()], spots: Vec::new() };
        assert_eq!(nothing.map(), Err(MapError::Invalid));
        let crowd: Vec<(String, f64)> = (0..25).map(|name| (name.to_string(), -60.0)).collect();
        let crowd: Vec<(&str, f64)> = crowd.iter().map(|(name, rssi)| (name.as_str(), *rssi)).collect();
        assert_eq!(Survey::of(&[stay("a", &crowd)], Average::Power).map(), Err(MapError::Invalid));
    }
}
