//! All listed beacons, by their index in the list. Input: advertisements, as the controller reports them. Output,
//! once per window: one smoothed RSSI per beacon, with its standard deviation.
//!
//! The Kalman filter of its beacon checks and smooths an RSSI, which is then used with the beacon's path loss. The
//! noise part of its error is averaged away. The shadow of walls and people stays while the tag does not move. A
//! beacon may have an RSSI that jumps more than noise does, because the beacon moves, or because two beacons have one
//! identity. Its deviation is increased accordingly.

use heapless::Vec;

use super::{Kalman, Smoothing, Step, rssi};
use crate::Real;
use crate::ble::path_loss::PathLoss;
use crate::ble::rssi::{BeaconRssi, RssiObservation};

/// The number of nearest beacons that make a position. Each costs 512 evaluations of a logarithm per position, and
/// farther ones add little.
pub const NEAREST: usize = 8;
/// The time from one position by beacons to the next, microseconds: the thesis' time of integration for a floor
/// (section 5.3).
pub const WINDOW_US: u64 = 500_000;

/// The deviation of single RSSI values at one position, over all channels, dB (table 3.1).
const NOISE_DB: f32 = 4.41;
/// Q ⁄ R of the smoothing. The thesis has 0.01 (section 3.4.1.2) for terminals at rest. A tag is carried, and the
/// engine smooths as well. In the simulated room of `examples/beacons.toml` the tag errs by 1.95 m instead of 2.20 m.
/// A value of 0.2 is no better.
const PROCESS: f32 = 0.05;
/// The advertising interval, microseconds (section 4.2).
const INTERVAL_US: u32 = 100_000;
/// The deviation of the error that stays while the tag does not move, dB: shadowing, and the difference between the
/// path loss and the beacon's own.
const LASTING_DB: f32 = 5.0;
/// Single values of one sender scatter by noise, and by the change over a step. A larger scatter than this, dB, means
/// two senders.
const TORN_DB: f32 = 8.0;
/// The weight of a new value in the observed scatter of a beacon's values.
const LEARNING: f32 = 0.1;
/// The path-loss exponent without a calibration.
const EXPONENT: f32 = 2.0;
/// After this number of windows without an advertisement, a beacon starts anew: it may have been moved.
const FORGOTTEN: u64 = 10;

/// The data of a listed beacon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ListedBeacon {
    /// Its position, metres.
    pub position_m: [f32; 3],
    /// Its RSSI at one metre, dBm; `None`: the value that the beacon advertises.
    pub rssi_1m_dbm: Option<f32>,
    /// Its path-loss exponent; `None`: 2.
    pub path_loss_exponent: Option<f32>,
}

/// A list of beacons.
pub trait BeaconList: Sync {
    /// The beacon at this index; `None` beyond the end of the list.
    fn beacon(&self, index: usize) -> Option<ListedBeacon>;
}

impl BeaconList for &[ListedBeacon] {
    fn beacon(&self, index: usize) -> Option<ListedBeacon> {
        self.get(index).copied()
    }
}

/// The received data of one beacon.
#[derive(Clone, Copy, Debug, Default)]
struct Signal {
    kalman: Kalman<f32>,
    /// Mean square of the difference between single values and the smoothed one, dB².
    spread_db2: f32,
    /// The RSSI at 1 m that the beacon advertises, dBm.
    measured_power_dbm: i8,
    /// Whether the beacon was received since the last window.
    is_fresh: bool,
}

/// The received data of up to `N` listed beacons.
#[derive(Clone, Debug)]
pub struct BeaconSignals<const N: usize> {
    smoothing: Smoothing<f32>,
    window_us: u64,
    signals: [Signal; N],
}

/// The RSSI values of a window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scan<const N: usize> {
    /// Smoothed, dBm, by the beacons' index in the list; `None`: not received in the window.
    pub rssi_dbm: [Option<f32>; N],
    /// Their mean variance of noise, dB².
    pub noise_db2: f32,
}

impl<const N: usize> BeaconSignals<N> {
    /// Nothing has been received yet. Windows have this length, microseconds.
    pub fn new(window_us: u64) -> Self {
        let measurement = NOISE_DB * NOISE_DB;
        let smoothing = Smoothing { measurement, process: PROCESS * measurement, interval_us: INTERVAL_US };
        Self { smoothing, window_us, signals: [Signal::default(); N] }
    }

    /// Takes an advertisement of a beacon with this RSSI, and with the RSSI at 1 m that it advertises, dBm. A value
    /// that is no RSSI changes nothing.
    pub fn receive(&mut self, t_us: u64, beacon: usize, rssi_dbm: f32, measured_power_dbm: i8) {
        let (Ok(rssi_dbm), Some(signal)) = (rssi(rssi_dbm), self.signals.get_mut(beacon)) else { return };
        if t_us.saturating_sub(signal.kalman.heard_us()) > self.window_us.saturating_mul(FORGOTTEN) {
            *signal = Signal::default();
        }
        let off = signal.kalman.rssi().map_or(0.0, |smoothed| rssi_dbm - smoothed);
        match signal.kalman.receive(t_us, rssi_dbm, &self.smoothing) {
            Step::Started => signal.spread_db2 = NOISE_DB * NOISE_DB,
            Step::Smoothed => signal.spread_db2 += LEARNING * (off * off - signal.spread_db2),
        }
        (signal.measured_power_dbm, signal.is_fresh) = (measured_power_dbm, true);
    }

    /// The scan of the window until now.
    pub fn scan(&self, now_us: u64) -> Scan<N> {
        let mut scan = Scan { rssi_dbm: [None; N], noise_db2: 0.0 };
        let mut count = 0.0;
        for (rssi_dbm, signal) in scan.rssi_dbm.iter_mut().zip(&self.signals).filter(|(_, signal)| signal.is_fresh) {
            *rssi_dbm = signal.kalman.rssi();
            scan.noise_db2 += signal.kalman.variance_at(now_us, &self.smoothing);
            count += 1.0;
        }
        scan.noise_db2 /= f32::max(count, 1.0);
        scan
    }

    /// Ends the window. Returns the nearest of the beacons received in it, nearest first, for a tag at this height,
    /// metres.
    pub fn take(&mut self, now_us: u64, list: &dyn BeaconList, height_m: f32) -> Vec<BeaconRssi, NEAREST> {
        let mut nearest: Vec<(f32, BeaconRssi), NEAREST> = Vec::new();
        for (index, signal) in (0_u16..).zip(self.signals.iter_mut()) {
            if !core::mem::take(&mut signal.is_fresh) {
                continue;
            }
            let Some(beacon) = list.beacon(usize::from(index)) else { continue };
            let Some(rssi) = signal.rssi(index, &beacon, height_m, now_us, &self.smoothing) else { continue };
            let distance_m = rssi.observation.path_loss.distance(rssi.observation.rssi_dbm);
            let farther = nearest.iter().position(|(other_m, _)| distance_m < *other_m);
            let at = farther.unwrap_or(nearest.len());
            if at < NEAREST {
                if nearest.is_full() {
                    nearest.pop();
                }
                // There is room, and no gap.
                let _ = nearest.insert(at, (distance_m, rssi));
            }
        }
        nearest.into_iter().map(|(_, rssi)| rssi).collect()
    }
}

impl Signal {
    fn rssi(
        &self,
        index: u16,
        beacon: &ListedBeacon,
        height_m: f32,
        now_us: u64,
        smoothing: &Smoothing<f32>,
    ) -> Option<BeaconRssi> {
        let rssi_dbm = self.kalman.rssi()?;
        let noise_db2 = NOISE_DB * NOISE_DB;
        let more_db2 = (self.spread_db2 - noise_db2).max(0.0);
        let path_loss = PathLoss {
            level_1m: beacon.rssi_1m_dbm.unwrap_or(f32::from(self.measured_power_dbm)),
            exponent: beacon.path_loss_exponent.unwrap_or(EXPONENT),
            deviation: Real::sqrt(LASTING_DB * LASTING_DB + more_db2),
        };
        let [x, y, z] = beacon.position_m;
        path_loss.is_sane().then(|| BeaconRssi {
            beacon: index,
            observation: RssiObservation { beacon_m: [x, y], above_m: z - height_m, rssi_dbm, path_loss },
            noise_db: Real::sqrt(self.kalman.variance_at(now_us, smoothing)),
            is_torn: self.spread_db2 > TORN_DB * TORN_DB,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn beacon(x_m: f32) -> ListedBeacon {
        ListedBeacon { position_m: [x_m, 0.0, 2.0], rssi_1m_dbm: Some(-60.0), path_loss_exponent: None }
    }

    fn signals() -> BeaconSignals<24> {
        BeaconSignals::new(WINDOW_US)
    }

    fn take(signals: &mut BeaconSignals<24>, now_us: u64, list: &[ListedBeacon]) -> Vec<BeaconRssi, NEAREST> {
        signals.take(now_us, &list, 0.5)
    }

    #[test]
    fn an_rssi_gets_a_path_loss_and_a_deviation() {
        let mut signals = signals();
        for k in 0..100 {
            signals.receive(k * 100_000, 0, -80.0, -50);
        }
        let heard = take(&mut signals, 9_900_000, &[beacon(1.0)]);
        let [BeaconRssi { beacon: 0, observation, noise_db, is_torn: false }] = heard[..] else { panic!("{heard:?}") };
        assert_eq!((observation.rssi_dbm, observation.beacon_m, observation.above_m), (-80.0, [1.0, 0.0], 1.5));
        // 20 dB at an exponent of 2: 10 m, with the list's RSSI at 1 m.
        assert!((observation.path_loss.distance(-80.0) - 10.0).abs() < 1e-3, "{observation:?}");
        // The gain of Q ⁄ R = 0.05 goes to 0.2 (k² = 0.05 (1 − k)): √0.2 · 4.41 = 1.972 dB.
        assert!((noise_db - 1.972).abs() < 1e-2 && observation.path_loss.deviation == 5.0, "{heard:?}");
        assert!(take(&mut signals, 10_400_000, &[beacon(1.0)]).is_empty(), "not received since");
    }

    #[test]
    fn without_calibration_a_beacon_is_believed() {
        let mut signals = signals();
        signals.receive(1, 0, -70.0, -50);
        let heard = take(&mut signals, 1, &[ListedBeacon { rssi_1m_dbm: None, ..beacon(1.0) }]);
        assert!((heard[0].observation.path_loss.distance(-70.0) - 10.0).abs() < 1e-3);
    }

    #[test]
    fn what_is_no_rssi_changes_nothing() {
        let mut signals = signals();
        for rssi_dbm in [127.0, 0.0, 20.0, -128.0, f32::NAN] {
            signals.receive(1, 0, rssi_dbm, -59);
        }
        assert!(take(&mut signals, 1, &[beacon(1.0)]).is_empty());
        signals.receive(2, 0, -80.0, -59);
        signals.receive(3, 0, 127.0, -59);
        signals.receive(4, 24, -40.0, -59);
        assert_eq!(take(&mut signals, 4, &[beacon(1.0)])[0].observation.rssi_dbm, -80.0);
    }

    #[test]
    fn two_beacons_of_one_identity_get_a_larger_deviation() {
        let mut signals = signals();
        for k in 0..200 {
            signals.receive(k * 50_000, 0, if k % 2 == 0 { -50.0 } else { -80.0 }, -59);
        }
        let rssi = take(&mut signals, 9_950_000, &[beacon(1.0)])[0];
        // Half an interval apart the gain is 0.146 (k² = 0.025 (1 − k)). The values alternate by ± 15 dB, and the
        // smoothed RSSI with them by ± 0.146 · 15 ⁄ (2 − 0.146) = 1.18: √(25 + 16.18² − 4.41²) = 16.35 dB.
        assert!((rssi.observation.path_loss.deviation - 16.35).abs() < 0.1 && rssi.is_torn, "{rssi:?}");
    }

    #[test]
    fn the_nearest_are_taken_in_their_order() {
        let list: std::vec::Vec<ListedBeacon> = (0..12_u8).map(|x_m| beacon(x_m.into())).collect();
        let mut signals = signals();
        for index in 0..12_u8 {
            // The strongest is in the middle.
            signals.receive(1, index.into(), -60.0 - 2.0 * f32::from(index.abs_diff(6)), -59);
        }
        let order: std::vec::Vec<u16> = take(&mut signals, 1, &list).iter().map(|rssi| rssi.beacon).collect();
        assert_eq!(order, [6, 5, 7, 4, 8, 3, 9, 2]);
    }

    #[test]
    fn a_beacon_that_was_silent_for_long_starts_anew() {
        let mut signals = signals();
        for k in 0..50 {
            signals.receive(k * 100_000, 0, -50.0, -59);
        }
        signals.receive(20_000_000, 0, -80.0, -59);
        assert_eq!(take(&mut signals, 20_000_000, &[beacon(1.0)])[0].observation.rssi_dbm, -80.0);
    }

    #[test]
    fn after_the_clock_was_set_back_advertisements_count_again() {
        let mut signals = signals();
        signals.receive(90_000_000, 0, -50.0, -59);
        signals.receive(1_000, 0, -70.0, -59);
        assert_eq!(take(&mut signals, 1_000, &[beacon(1.0)])[0].observation.rssi_dbm, -70.0);
    }
}
