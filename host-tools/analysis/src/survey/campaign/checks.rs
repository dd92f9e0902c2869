//! Checks whether the adverts of a dwell represent its point without bias.
//!
//! The bounds refuse three of 74 dwells recorded in a flat (10 and 5 s, phone in hand).

use baliza_report::mean;
use std::fmt;

use super::dwell::Dwell;

/// Least advert rate of the strongest beacon, Hz.
const LEAST_RATE_HZ: f64 = 2.0;
/// A beacon with fewer adverts than this is not checked by itself.
const LEAST_JUDGED: usize = 10;
/// Beacons weaker than this are received irregularly, dBm.
const STEADY_DBM: f64 = -85.0;
/// A silence is refused where it is longer than this number of the beacon's usual intervals, and longer than
/// `SILENT_S`.
const SILENT_INTERVALS: f64 = 20.0;
const SILENT_S: f64 = 2.5;
/// Largest change of a beacon's mean RSSI between the halves of a dwell, dB.
const SHIFT_DB: f64 = 8.0;
/// Largest rise or fall of a straight line through a beacon's RSSI values over the dwell, dB. The shift between the
/// halves must be half as much, too.
const DRIFT_DB: f64 = 12.0;
/// While the receiver is still, half of the beacons change by less than this between the halves, dB.
const STILL_DB: f64 = 4.0;

/// Why a dwell does not represent its point.
#[derive(Clone, Debug, PartialEq)]
pub enum Bias {
    /// Too few adverts were received: advert rate of the beacon with the most adverts.
    TooFew {
        /// Adverts a second.
        rate_hz: f64,
    },
    /// A beacon fell silent, or was silent from the start.
    Silent {
        /// The beacon.
        beacon: String,
        /// Since when, seconds.
        from_s: f64,
        /// How long, seconds.
        for_s: f64,
    },
    /// A beacon's RSSI drifts.
    Drift {
        /// The beacon.
        beacon: String,
        /// By how much over the dwell, dB.
        by_db: f64,
    },
    /// A beacon's RSSI changed between the halves.
    Shift {
        /// The beacon.
        beacon: String,
        /// By how much, dB.
        by_db: f64,
    },
    /// Most RSSI values changed: the receiver moved.
    Moved {
        /// Half of the beacons changed by at least this, dB.
        by_db: f64,
    },
}

impl fmt::Display for Bias {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooFew { rate_hz } => {
                write!(
                    f,
                    "too few adverts: {rate_hz:.1} a second of the beacon heard best, {LEAST_RATE_HZ:.0} are needed"
                )
            }
            Self::Silent { beacon, from_s, for_s } => {
                write!(f, "{beacon} is silent for {for_s:.1} s from {from_s:.1} s on")
            }
            Self::Drift { beacon, by_db } => write!(f, "the level of {beacon} drifts by {by_db:+.1} dB"),
            Self::Shift { beacon, by_db } => write!(f, "the level of {beacon} changes by {by_db:+.1} dB half way"),
            Self::Moved { by_db } => write!(f, "most levels change, by {by_db:.1} dB and more: stand still"),
        }
    }
}

/// Why a dwell does not represent its point; empty where it does.
pub fn biases(stay: &Dwell) -> Vec<Bias> {
    let beacons = stay.by_beacon();
    let most = beacons.values().map(Vec::len).max().unwrap_or(0);
    let rate_hz = most as f64 / stay.length_s;
    if rate_hz < LEAST_RATE_HZ {
        return vec![Bias::TooFew { rate_hz }];
    }
    let mut biases = Vec::new();
    let mut shifts = Vec::new();
    for (beacon, adverts) in beacons.iter().filter(|(_, adverts)| adverts.len() >= LEAST_JUDGED) {
        let beacon = || (*beacon).to_owned();
        let mean = mean(adverts.iter().map(|(_, rssi)| *rssi));
        if let Some((from_s, for_s)) = silence(adverts, stay.length_s).filter(|_| mean >= STEADY_DBM) {
            biases.push(Bias::Silent { beacon: beacon(), from_s, for_s });
        }
        let Some(shift_db) = shift(adverts, 0.5 * stay.length_s) else { continue };
        shifts.push(shift_db.abs());
        let drift_db = drift(adverts) * stay.length_s;
        if drift_db.abs() > DRIFT_DB {
            biases.push(Bias::Drift { beacon: beacon(), by_db: drift_db });
        } else if shift_db.abs() > SHIFT_DB {
            biases.push(Bias::Shift { beacon: beacon(), by_db: shift_db });
        }
    }
    shifts.sort_by(f64::total_cmp);
    // The lower of the two in the middle: one beacon of two is not a majority.
    if let Some(&by_db) =
        shifts.get(shifts.len().saturating_sub(1) / 2).filter(|shift| **shift > STILL_DB && shifts.len() > 1)
    {
        biases.push(Bias::Moved { by_db });
    }
    biases
}

/// The longest silence that is not a matter of chance: its start and its length, seconds.
fn silence(adverts: &[(f64, f64)], length_s: f64) -> Option<(f64, f64)> {
    let times = std::iter::once(0.0).chain(adverts.iter().map(|(t_s, _)| *t_s)).chain([length_s]);
    let times: Vec<f64> = times.collect();
    let mut gaps: Vec<(f64, f64)> = times.windows(2).map(|pair| (pair[1] - pair[0], pair[0])).collect();
    gaps.sort_by(|a, b| a.0.total_cmp(&b.0));
    let usual = gaps.get(gaps.len() / 2)?.0;
    let (for_s, from_s) = *gaps.last()?;
    (for_s > SILENT_S && for_s > SILENT_INTERVALS * usual).then_some((from_s, for_s))
}

/// By how much the mean RSSI of the second half is higher, dB; `None` where a half has too few adverts.
fn shift(adverts: &[(f64, f64)], middle_s: f64) -> Option<f64> {
    let (early, late) = adverts.split_at(adverts.partition_point(|(t_s, _)| *t_s < middle_s));
    let rssi = |half: &[(f64, f64)]| mean(half.iter().map(|(_, rssi)| *rssi));
    (early.len().min(late.len()) >= LEAST_JUDGED / 2).then(|| rssi(late) - rssi(early))
}

/// The slope of the straight line through the RSSI values, dB a second.
fn drift(adverts: &[(f64, f64)]) -> f64 {
    let count = adverts.len() as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| adverts.iter().map(of).sum::<f64>() / count;
    let (time, rssi) = (mean(|advert| advert.0), mean(|advert| advert.1));
    let (products, squares) = adverts.iter().fold((0.0, 0.0), |(products, squares), advert| {
        (products + (advert.0 - time) * (advert.1 - rssi), squares + (advert.0 - time).powi(2))
    });
    if squares > 0.0 { products / squares } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::{Bias, biases};
    use crate::survey::campaign::Dwell;

    /// Ten seconds of three beacons at ten adverts a second; `rssi` gives the RSSI of a beacon at a time, `None`
    /// where it is not received.
    fn stay(rssi: impl Fn(usize, f64) -> Option<f64>) -> Dwell {
        let mut stay = Dwell::new(None, 10.0);
        for advert in 0..100 {
            let t_s = f64::from(advert) * 0.1;
            stay.at(t_s);
            for beacon in 0..3 {
                // One decibel up and down: no receiver is steadier.
                if let Some(rssi) = rssi(beacon, t_s) {
                    stay.receive(t_s, &beacon.to_string(), rssi + f64::from(advert % 3 - 1));
                }
            }
        }
        stay
    }

    #[test]
    fn a_steady_stay_is_taken() {
        assert_eq!(biases(&stay(|beacon, _| Some(-60.0 - 5.0 * beacon as f64))), []);
        // A weak beacon is received only half of the time.
        assert_eq!(biases(&stay(|beacon, t_s| (beacon < 2 || t_s < 5.0).then_some([-60.0, -70.0, -90.0][beacon]))), []);
    }

    #[test]
    fn silence_is_no_fingerprint() {
        assert_eq!(biases(&stay(|_, t_s| (t_s < 0.95).then_some(-60.0))), [Bias::TooFew { rate_hz: 1.0 }]);
        let biases = biases(&stay(|beacon, t_s| (beacon != 1 || t_s < 6.0).then_some(-60.0)));
        let [Bias::Silent { beacon, from_s, for_s }] = biases.as_slice() else { panic!("{biases:?}") };
        assert_eq!(beacon, "1");
        assert!((from_s - 5.9).abs() < 1e-9 && (for_s - 4.1).abs() < 1e-9);
    }

    #[test]
    fn a_level_that_drifts_or_jumps_is_no_fingerprint() {
        // 1.5 dB a second over ten seconds.
        let found = biases(&stay(|beacon, t_s| Some(-60.0 - if beacon == 2 { 1.5 * t_s } else { 0.0 })));
        let [Bias::Drift { beacon, by_db }] = found.as_slice() else { panic!("{found:?}") };
        assert!(beacon == "2" && (by_db + 15.0).abs() < 0.1, "{by_db}");
        // 9 dB from seven seconds on: the mean of the second half is 9 · 3/5 = 5.4 dB higher, which is still
        // accepted; from five seconds on it is 9 dB higher.
        let jump = |from_s: f64| {
            biases(&stay(move |beacon, t_s| Some(-60.0 + if beacon == 0 && t_s >= from_s { 9.0 } else { 0.0 })))
        };
        assert_eq!(jump(7.0), []);
        // A straight line through a step of 9 rises by 1.5 · 9 = 13.5 over the dwell.
        let biases = jump(4.95);
        let [Bias::Drift { by_db, .. }] = biases.as_slice() else { panic!("{biases:?}") };
        assert!((by_db - 13.5).abs() < 0.3, "{by_db}");
    }

    #[test]
    fn whoever_walks_is_told_to_stand_still() {
        // All RSSI values change by 5 dB half way, one up and two down: too little for the check of a single beacon.
        let biases =
            biases(&stay(|beacon, t_s| Some(-60.0 + if t_s >= 4.95 { [5.0, -5.0, -5.0][beacon] } else { 0.0 })));
        let [Bias::Moved { by_db }] = biases.as_slice() else { panic!("{biases:?}") };
        assert!((by_db - 5.0).abs() < 0.1, "{by_db}");
        assert_eq!(biases[0].to_string(), "most levels change, by 5.0 dB and more: stand still");
    }
}
