//! From advertisements to RSSI. Input: advertisements of listed beacons, as the controller reports them. Output, once a window: one smoothed
//! RSSI a beacon, with its standard deviation.
//!
//! An RSSI is judged and smoothed by the core's Kalman filter of its beacon (`positioning_core::ble::signal`), and goes with the
//! beacon's path loss. Of its error the noise is averaged away and the shadow of walls and people is not: it stays with the
//! place. A beacon whose RSSI values jump more than noise does, because it moves, or because two have one identity, is doubted by as much.

use heapless::Vec;
use positioning_core::Real;
use positioning_core::ble::beacon_monitor::ON_NODE;
use positioning_core::ble::path_loss::PathLoss;
use positioning_core::ble::signal::{Kalman, Smoothing, Step, rssi};
use wire::config::{Beacon, MAX_BEACONS};

use crate::HEARS_BEACONS;
use crate::channels::Level;

/// From one position by beacons to the next, microseconds: the thesis' time of integration for a floor (A. Linde 2024, section 5.3).
pub(crate) const WINDOW_US: u64 = 500_000;
/// As many of the nearest beacons make a position: each costs it 512 looks at a logarithm, and what is farther says little more.
pub(crate) const MOST: usize = 8;

/// The deviation of single RSSI values of one place, all channels together, dB (Linde, table 3.1).
const NOISE_DB: f32 = 4.41;
/// Q ⁄ R of the smoothing. The thesis has 0.01 (section 3.4.1.2) for terminals that lie; a tag is carried, and the engine smooths as well.
/// In the simulated room of `examples/beacons.toml` it errs 1.95 m instead of 2.20 m, and no more with 0.2.
const PROCESS: f32 = 0.05;
/// An interval of advertising, microseconds (Linde, section 4.2).
const INTERVAL_US: u32 = 100_000;
/// The deviation of what stays with the place, dB: shadowing, and how far the path loss is from the beacon's own.
const LASTING_DB: f32 = 5.0;
/// Single RSSI values of one sender scatter by noise, and by what a step changes; beyond this, dB, there are two.
const TORN_DB: f32 = 8.0;
/// How much a new RSSI counts in what a beacon's RSSI values are seen to deviate by.
const LEARNING: f32 = 0.1;
/// A path-loss exponent that nobody has calibrated.
const EXPONENT: f32 = 2.0;
/// After so long in silence a beacon starts anew, microseconds: it may stand elsewhere by then.
const FORGOTTEN_US: u64 = 10 * WINDOW_US;

/// Listed beacons.
const LISTED: usize = if HEARS_BEACONS { MAX_BEACONS } else { 0 };
const _: () = assert!(MAX_BEACONS == ON_NODE);

/// What was heard of one beacon.
#[derive(Clone, Copy, Debug, Default)]
struct Signal {
    kalman: Kalman<f32>,
    /// Mean square of how far RSSI values are from the smoothed one, dB².
    spread_db2: f32,
    /// What it says its RSSI is at 1 m, dBm.
    told_1m_dbm: i8,
    /// Heard since the last window.
    is_fresh: bool,
}

/// What was heard of all listed beacons, by their place in the list.
#[derive(Clone, Debug)]
pub(crate) struct Signals {
    smoothing: Smoothing<f32>,
    signals: [Signal; LISTED],
}

/// The RSSI values of a window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Scan {
    /// Smoothed, dBm, by the beacons' place in the list; `None`: not heard in it.
    pub(crate) levels_dbm: [Option<f32>; LISTED],
    /// Their mean variance by noise, dB².
    pub(crate) noise_db2: f32,
}

impl Signals {
    /// Nothing yet.
    pub(crate) fn new() -> Self {
        let measurement = NOISE_DB * NOISE_DB;
        let smoothing = Smoothing { measurement, process: PROCESS * measurement, interval_us: INTERVAL_US };
        Self { smoothing, signals: [Signal::default(); LISTED] }
    }

    /// A beacon was heard with this RSSI, and says what it should be at 1 m, dBm. An RSSI that is none changes nothing.
    pub(crate) fn receive(&mut self, t_us: u64, place: usize, rssi_dbm: i8, told_1m_dbm: i8) {
        let (Ok(heard), Some(signal)) = (rssi(f32::from(rssi_dbm)), self.signals.get_mut(place)) else { return };
        if t_us.saturating_sub(signal.kalman.heard_us()) > FORGOTTEN_US {
            *signal = Signal::default();
        }
        let off = signal.kalman.rssi().map_or(0.0, |rssi| heard - rssi);
        match signal.kalman.receive(t_us, heard, &self.smoothing) {
            Step::Started => signal.spread_db2 = NOISE_DB * NOISE_DB,
            Step::Smoothed => signal.spread_db2 += LEARNING * (off * off - signal.spread_db2),
        }
        (signal.told_1m_dbm, signal.is_fresh) = (told_1m_dbm, true);
    }

    /// What the window has until now.
    pub(crate) fn scan(&self, now_us: u64) -> Scan {
        let mut scan = Scan { levels_dbm: [None; LISTED], noise_db2: 0.0 };
        let mut heard = 0.0;
        for (rssi, signal) in scan.levels_dbm.iter_mut().zip(&self.signals).filter(|(_, signal)| signal.is_fresh) {
            *rssi = signal.kalman.rssi();
            scan.noise_db2 += signal.kalman.variance_at(now_us, &self.smoothing);
            heard += 1.0;
        }
        scan.noise_db2 /= f32::max(heard, 1.0);
        scan
    }

    /// The window ends: the nearest of the beacons heard in it, the nearest first.
    pub(crate) fn take(&mut self, now_us: u64, beacons: &[Beacon]) -> Vec<Level, MOST> {
        let mut nearest: Vec<Level, MOST> = Vec::new();
        for (place, (signal, beacon)) in (0_u16..).zip(self.signals.iter_mut().zip(beacons)) {
            let fresh = core::mem::take(&mut signal.is_fresh);
            let Some(rssi) = fresh.then(|| signal.rssi(place, beacon, now_us, &self.smoothing)).flatten() else {
                continue;
            };
            let before = nearest.iter().position(|other| rssi.distance_m < other.distance_m);
            let at = before.unwrap_or(nearest.len());
            if at < MOST {
                if nearest.is_full() {
                    nearest.pop();
                }
                // There is room, and no gap.
                let _ = nearest.insert(at, rssi);
            }
        }
        nearest
    }
}

impl Signal {
    fn rssi(&self, place: u16, beacon: &Beacon, now_us: u64, smoothing: &Smoothing<f32>) -> Option<Level> {
        let rssi_dbm = self.kalman.rssi()?;
        let noise_db2 = NOISE_DB * NOISE_DB;
        let more_db2 = (self.spread_db2 - noise_db2).max(0.0);
        let path_loss = PathLoss {
            level_1m: beacon.rssi_1m_dbm.unwrap_or(f32::from(self.told_1m_dbm)),
            exponent: beacon.path_loss_exponent.unwrap_or(EXPONENT),
            deviation: Real::sqrt(LASTING_DB * LASTING_DB + more_db2),
        };
        if !path_loss.is_sane() {
            return None;
        }
        Some(Level {
            beacon: place,
            rssi_dbm,
            noise_db: Real::sqrt(self.kalman.variance_at(now_us, smoothing)),
            path_loss,
            distance_m: path_loss.distance(rssi_dbm),
            is_torn: self.spread_db2 > TORN_DB * TORN_DB,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn beacon(minor: u16) -> Beacon {
        let position_m = [f32::from(minor), 0.0, 2.0];
        Beacon { major: 1, minor, position_m, rssi_1m_dbm: Some(-60.0), path_loss_exponent: None }
    }

    #[test]
    fn a_level_becomes_a_distance_and_a_doubt() {
        let mut signals = Signals::new();
        for k in 0..100 {
            signals.receive(k * 100_000, 0, -80, -50);
        }
        let heard = signals.take(9_900_000, &[beacon(1)]);
        let [rssi] = heard[..] else { panic!("{heard:?}") };
        // 20 dB at an exponent of 2: 10 m, by the record's RSSI at 1 m.
        assert_eq!((rssi.beacon, rssi.rssi_dbm), (0, -80.0));
        assert!((rssi.distance_m - 10.0).abs() < 1e-3, "{rssi:?}");
        // The gain of Q ⁄ R = 0.05 goes to 0.2 (k² = 0.05 (1 − k)): √0.2 · 4.41 = 1.972 dB.
        assert!((rssi.noise_db - 1.972).abs() < 1e-2 && rssi.path_loss.deviation == 5.0, "{rssi:?}");
        assert!(!rssi.is_torn);
        assert!(signals.take(10_400_000, &[beacon(1)]).is_empty(), "not heard since");
    }

    #[test]
    fn without_calibration_a_beacon_is_believed() {
        let mut signals = Signals::new();
        signals.receive(1, 0, -70, -50);
        let heard = signals.take(1, &[Beacon { rssi_1m_dbm: None, ..beacon(1) }]);
        assert!((heard[0].distance_m - 10.0).abs() < 1e-3);
    }

    #[test]
    fn an_rssi_that_is_none_changes_nothing() {
        let mut signals = Signals::new();
        for rssi in [127, 0, 20, -128] {
            signals.receive(1, 0, rssi, -59);
        }
        assert!(signals.take(1, &[beacon(1)]).is_empty());
        signals.receive(2, 0, -80, -59);
        signals.receive(3, 0, 127, -59);
        signals.receive(4, MAX_BEACONS, -40, -59);
        assert_eq!(signals.take(4, &[beacon(1)])[0].rssi_dbm, -80.0);
    }

    #[test]
    fn two_beacons_of_one_identity_are_doubted_more() {
        let mut signals = Signals::new();
        for k in 0..200 {
            signals.receive(k * 50_000, 0, if k % 2 == 0 { -50 } else { -80 }, -59);
        }
        let rssi = signals.take(9_950_000, &[beacon(1)])[0];
        // Half an interval apart the gain is 0.146 (k² = 0.025 (1 − k)). ± 15 dB, and the smoothed RSSI with them by
        // ± 0.146 · 15 ⁄ (2 − 0.146) = 1.18: √(25 + 16.18² − 4.41²) = 16.35 dB.
        assert!((rssi.path_loss.deviation - 16.35).abs() < 0.1 && rssi.is_torn, "{rssi:?}");
    }

    #[test]
    fn the_nearest_are_taken_in_their_order() {
        let list: std::vec::Vec<Beacon> = (0..12).map(beacon).collect();
        let mut signals = Signals::new();
        for place in 0..12_u8 {
            // The loudest in the middle.
            signals.receive(1, place.into(), -60 - 2 * i8::try_from(place.abs_diff(6)).unwrap(), -59);
        }
        let order: std::vec::Vec<u16> = signals.take(1, &list).iter().map(|rssi| rssi.beacon).collect();
        assert_eq!(order, [6, 5, 7, 4, 8, 3, 9, 2]);
    }

    #[test]
    fn a_beacon_that_was_silent_for_long_starts_anew() {
        let mut signals = Signals::new();
        for k in 0..50 {
            signals.receive(k * 100_000, 0, -50, -59);
        }
        signals.receive(20_000_000, 0, -80, -59);
        assert_eq!(signals.take(20_000_000, &[beacon(1)])[0].rssi_dbm, -80.0);
    }
}
