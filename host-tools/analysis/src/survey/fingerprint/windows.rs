//! A capture as a tag receives it: window by window, smoothed (sections 3.4 and 3.4.1.2 of A. Linde Cerezo's thesis).

use baliza_report::mean;
use positioning_core::ble::signal::{Kalman, Smoothing, rssi};

use super::survey::{Average, dbm, milliwatts};
use crate::locate::ble::walk_clock::span_s;
use recording::beacons::{Capture, Sample};

/// A beacon keeps its RSSI for this number of windows without an advert.
const KEPT: f64 = 10.0;
/// Largest number of windows, because a file may claim any span of time.
const MOST_WINDOWS: f64 = 1.0e5;

/// A window of integration.
pub struct Window {
    /// How long before the end of the capture it ends, microseconds.
    pub before_us: u64,
    /// The RSSI of each beacon, dBm.
    pub scan: Vec<Option<f64>>,
}

/// The windows of a capture, at least one; a capture shorter than one window is left as it is. Where RSSI values are
/// averaged as powers, they are smoothed as powers.
pub fn windows(beacons: &[String], capture: &Capture, window_s: f64, average: Average) -> Vec<Window> {
    let (first_s, last_s) = span_s(capture).unwrap_or((0.0, 0.0));
    let count = ((last_s - first_s) / window_s).min(MOST_WINDOWS) as usize;
    if count < 2 {
        return vec![Window { before_us: 0, scan: super::scan(beacons, &capture.samples, average) }];
    }
    let ways: Vec<Vec<(f64, f64)>> = beacons.iter().map(|name| smoothed(name, &capture.samples, average)).collect();
    let window = |index: usize| {
        let begin_s = first_s + index as f64 * window_s;
        let end_s = if index + 1 == count { f64::INFINITY } else { begin_s + window_s };
        let rssi = |way: &Vec<(f64, f64)>| {
            let [from, until] = [begin_s, end_s].map(|limit_s| way.partition_point(|(t_s, _)| *t_s < limit_s));
            let inside: Vec<f64> = way[from..until].iter().map(|(_, rssi)| *rssi).collect();
            let kept = way[..until].last().filter(|(t_s, _)| begin_s - t_s < KEPT * window_s).map(|(_, rssi)| *rssi);
            let mean = mean(inside.iter().copied());
            if inside.is_empty() { kept } else { Some(mean) }.map(|rssi| match average {
                Average::Power => dbm(rssi),
                Average::Trimmed => rssi,
            })
        };
        let before_s = (last_s - begin_s - window_s).max(0.0);
        Window { before_us: (before_s * 1.0e6) as u64, scan: ways.iter().map(rssi).collect() }
    };
    (0..count).map(window).collect()
}

/// Times and smoothed RSSI values of a beacon, in order; as powers or as decibels.
fn smoothed(name: &str, samples: &[Sample], average: Average) -> Vec<(f64, f64)> {
    let own = samples.iter().filter(|sample| sample.beacon == name && sample.t_s.is_finite());
    let mut rssis: Vec<(f64, f64)> = own.filter_map(|sample| Some((sample.t_s, rssi(sample.rssi_dbm).ok()?))).collect();
    rssis.sort_by(|a, b| a.0.total_cmp(&b.0));
    let begun_s = rssis.first().map_or(0.0, |(t_s, _)| *t_s);
    let mut kalman = Kalman::<f64>::default();
    for (t_s, rssi) in &mut rssis {
        let value = match average {
            Average::Power => milliwatts(*rssi),
            Average::Trimmed => *rssi,
        };
        kalman.receive(((*t_s - begun_s) * 1.0e6) as u64, value, &Smoothing::default());
        *rssi = kalman.rssi().unwrap_or(value);
    }
    rssis
}

#[cfg(test)]
mod tests {
    use super::*;

    fn capture(samples: &[(f64, f64)]) -> Capture {
        let sample = |&(t_s, rssi_dbm): &(f64, f64)| Sample { beacon: "a".to_owned(), rssi_dbm, t_s };
        let samples = samples.iter().map(sample).collect();
        Capture { name: String::new(), t_s: None, truth_m: None, is_stay: true, samples }
    }

    #[test]
    fn levels_are_smoothed_and_kept_for_a_while() {
        // Smoothed by hand as with the filter of the thesis: −60, then −57.990 after −56 (gain 0.502488). Windows of
        // 0.2 s: the first has both, (−60 − 57.990) ⁄ 2 = −58.995, the next ten without an advert keep −57.990, and
        // then the beacon is silent.
        let capture = capture(&[(5.0, -60.0), (5.1, -56.0), (5.15, 127.0), (8.0, 0.0)]);
        let found = windows(&["a".to_owned()], &capture, 0.2, Average::Trimmed);
        assert_eq!(found.len(), 15);
        let rssis: Vec<Option<f64>> = found.iter().map(|window| window.scan[0]).collect();
        assert!((rssis[0].expect("heard") + 58.995).abs() < 1e-3, "{rssis:?}");
        assert!((rssis[9].expect("kept") + 57.990).abs() < 1e-3, "{rssis:?}");
        assert_eq!(rssis[14], None);
        assert_eq!((found[0].before_us, found[14].before_us), (2_800_000, 0));
    }

    #[test]
    fn a_capture_shorter_than_two_windows_is_as_it_is() {
        let found = windows(&["a".to_owned()], &capture(&[(5.0, -60.0), (5.1, -60.0)]), 0.2, Average::Power);
        assert_eq!((found.len(), found[0].before_us), (1, 0));
        assert!((found[0].scan[0].expect("heard") + 60.0).abs() < 1e-9);
        assert_eq!(windows(&["a".to_owned()], &capture(&[]), 0.2, Average::Power)[0].scan, [None]);
    }
}
