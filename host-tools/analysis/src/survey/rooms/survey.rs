//! The data of a survey's points: each beacon's RSSI and deviation, and the scans of short windows.

use baliza_report::{mean, rms};
use std::collections::HashSet;
use std::path::Path;

use positioning_core::ble::rooms::{MAX_BEACONS, MAX_ROOMS};

use super::file::Names;
use crate::survey::fingerprint::{self, Average, scan};
use recording::UserError;
use recording::beacons::{Dwell, Sample, rssis_by_beacon};

/// RSSI values are averaged as in maps.
const AVERAGE: Average = Average::Power;
/// Largest number of windows, because a file may claim any span of time.
pub const MOST_WINDOWS: f64 = 1e5;

/// A beacon at a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeanRssi {
    /// RSSI of the mean power, dBm.
    pub mean_dbm: f64,
    /// Standard deviation of single adverts, dB.
    pub deviation_db: f64,
}

/// A point of a survey.
#[derive(Clone, Debug, PartialEq)]
pub struct Point {
    /// Its name in the file.
    pub name: String,
    /// Its room, by its index in [`Survey::rooms`].
    pub room: usize,
    /// One entry a beacon, in the beacons' order.
    pub heard: Vec<Option<MeanRssi>>,
    /// One scan a window, in order of time; a window without adverts has no RSSI.
    pub windows: Vec<Vec<Option<f32>>>,
}

/// A survey whose points have rooms.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Survey {
    /// Names of the beacons, by number where all are numbers, else by name.
    pub beacons: Vec<String>,
    /// Names of the rooms, in the file's order.
    pub rooms: Vec<String>,
    /// The points, in the file's order.
    pub points: Vec<Point>,
}

impl Survey {
    /// The survey for training.
    ///
    /// # Errors
    /// A point has no room, there are fewer than two rooms, or there are more rooms or beacons than a model holds.
    pub fn of_fingerprints(file: &Path, stays: &[Dwell], window_s: f64) -> Result<Self, UserError> {
        let at_most = |what: &str, count: usize, most: usize| match count > most {
            true => Err(UserError::line(file, 1, format!("{count} {what}, where a model holds {most}"))),
            false => Ok(()),
        };
        at_most("rooms", stays.iter().filter_map(|stay| stay.room.as_ref()).collect::<HashSet<_>>().len(), MAX_ROOMS)?;
        let beacons = fingerprint::Survey::of(stays, AVERAGE).beacons;
        at_most("beacons", beacons.len(), MAX_BEACONS)?;
        let mut survey = Self { beacons, ..Self::default() };
        survey.add(file, stays, window_s, true)?;
        match (survey.rooms.len(), survey.points.len()) {
            (_, 0) => Err(UserError::line(file, 1, "none of its levels is one that a receiver can have measured")),
            (0 | 1, _) => {
                Err(UserError::line(file, 1, "its points are all in one room: there is nothing to tell apart"))
            }
            (_, _) => Ok(survey),
        }
    }

    /// The names of a model, without points: the base for dwells that are to be classified.
    pub fn of_names(names: &Names) -> Self {
        Self { beacons: names.beacons.clone(), rooms: names.rooms.clone(), points: Vec::new() }
    }

    /// Dwells to be classified, with the beacons and rooms of this survey; unknown rooms are appended to its own.
    ///
    /// # Errors
    /// A point has no room.
    pub fn targets(&self, file: &Path, stays: &[Dwell], window_s: f64) -> Result<Self, UserError> {
        let mut targets = Self { beacons: self.beacons.clone(), rooms: self.rooms.clone(), points: Vec::new() };
        targets.add(file, stays, window_s, false)?;
        Ok(targets)
    }

    fn add(&mut self, file: &Path, stays: &[Dwell], window_s: f64, learnt: bool) -> Result<(), UserError> {
        let mut all_windows = 0;
        for stay in stays {
            let Some(room) = &stay.room else {
                return Err(UserError::line(
                    file,
                    1,
                    format!("point {:?} has no room: column room is needed", stay.point),
                ));
            };
            let known = self.rooms.iter().position(|known| known == room);
            let room = known.unwrap_or_else(|| {
                self.rooms.push(room.clone());
                self.rooms.len() - 1
            });
            let heard = heard(&stay.samples, &self.beacons);
            // A point without received beacons is useless for training; as a target it counts as not classified.
            if learnt && heard.iter().all(Option::is_none) {
                continue;
            }
            let windows = windows(&stay.samples, &self.beacons, window_s);
            all_windows += windows.len();
            if all_windows > MOST_WINDOWS as usize {
                let wrong = format!(
                    "its dwells last for more than {MOST_WINDOWS} windows of {window_s} s: are the times seconds?"
                );
                return Err(UserError::file(file, wrong));
            }
            self.points.push(Point { name: stay.point.clone(), room, heard, windows });
        }
        Ok(())
    }
}

impl Point {
    /// The scan of the whole dwell.
    pub fn scan(&self) -> Vec<Option<f32>> {
        self.heard.iter().map(|heard| heard.map(|heard| heard.mean_dbm as f32)).collect()
    }
}

fn heard(samples: &[Sample], beacons: &[String]) -> Vec<Option<MeanRssi>> {
    let means = scan(beacons, samples, AVERAGE);
    let by_beacon = rssis_by_beacon(samples);
    let deviation_db = |beacon: &String| {
        let rssis = by_beacon.get(beacon.as_str()).map_or(&[][..], Vec::as_slice);
        let middle = mean(rssis.iter().copied());
        rms(rssis.iter().map(|rssi| rssi - middle))
    };
    let heard = |(mean, beacon): (Option<f64>, &String)| {
        mean.map(|mean_dbm| MeanRssi { mean_dbm, deviation_db: deviation_db(beacon) })
    };
    means.into_iter().zip(beacons).map(heard).collect()
}

/// The scans of successive windows; an incomplete window at the end is dropped.
pub(super) fn windows(samples: &[Sample], beacons: &[String], window_s: f64) -> Vec<Vec<Option<f32>>> {
    let times = || samples.iter().map(|sample| sample.t_s);
    let (begin, end) = (times().fold(f64::INFINITY, f64::min), times().fold(f64::NEG_INFINITY, f64::max));
    let count = ((end - begin) / window_s).clamp(0.0, MOST_WINDOWS) as usize;
    let mut parts = vec![Vec::new(); count];
    for sample in samples {
        if let Some(part) = parts.get_mut(((sample.t_s - begin) / window_s) as usize) {
            part.push(sample.clone());
        }
    }
    let single = |rssi: Option<f64>| rssi.map(|rssi| rssi as f32);
    parts.into_iter().map(|part| scan(beacons, &part, AVERAGE).into_iter().map(single).collect()).collect()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::Survey;
    use recording::beacons::{Dwell, Sample};

    fn stay(point: &str, room: Option<&str>, samples: &[(&str, f64, f64)]) -> Dwell {
        let samples = samples.iter().map(|&(beacon, rssi_dbm, t_s)| Sample { beacon: beacon.into(), rssi_dbm, t_s });
        Dwell { point: point.into(), room: room.map(str::to_owned), position_m: [0.0; 2], samples: samples.collect() }
    }

    #[test]
    fn levels_are_averaged_by_stay_and_by_window() {
        let stays = [
            stay("p", Some("hall"), &[("10", -60.0, 5.0), ("10", -64.0, 5.9), ("2", 127.0, 6.1), ("10", -70.0, 7.0)]),
            stay("q", Some("attic"), &[("2", -80.0, 0.0)]),
            stay("r", Some("attic"), &[("2", 0.0, 0.0)]),
        ];
        let survey = Survey::of_fingerprints(Path::new("f"), &stays, 1.0).expect("good");
        assert_eq!((survey.beacons.join(","), survey.rooms.join(",")), ("2,10".into(), "hall,attic".into()));
        // r received no valid RSSI. p: 1, 0.398107 and 0.1 nW, mean 0.499369, −63.0158 dBm; about the mean of the
        // decibels, −64.667: 4.667² + 0.667² + 5.333² = 50.667, /3 = 16.889. The first window: 0.699054 nW, −61.5549
        // dBm.
        assert_eq!(survey.points.len(), 2);
        let heard = survey.points[0].heard[1].expect("heard");
        assert!((heard.mean_dbm + 63.0158).abs() < 1e-4 && (heard.deviation_db - 16.888_889_f64.sqrt()).abs() < 1e-6);
        let windows = &survey.points[0].windows;
        assert!((windows[0][1].expect("heard") + 61.5549).abs() < 1e-3, "{windows:?}");
        assert_eq!((windows.len(), windows[0][0], &windows[1]), (2, None, &vec![None, None]));
    }

    #[test]
    fn what_cannot_be_learnt_from_is_refused() {
        let refused =
            |stays: &[Dwell]| Survey::of_fingerprints(Path::new("f"), stays, 1.0).expect_err("wrong").to_string();
        let one = stay("p", Some("hall"), &[("2", -60.0, 0.0)]);
        assert_eq!(
            refused(std::slice::from_ref(&one)),
            "f:1: its points are all in one room: there is nothing to tell apart"
        );
        let lost = stay("q", None, &[("2", -60.0, 0.0)]);
        assert_eq!(refused(&[one, lost]), "f:1: point \"q\" has no room: column room is needed");
    }
}
