//! All beacons of a map, by their place in it: adverts in, scans out.

use super::{Kalman, RssiError, Smoothing, Step, Window, rssi};
use crate::Real;

/// What became of an advert.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Verdict {
    /// It is the first of its beacon since long, or since the clock was set back.
    Started,
    /// It has changed its beacon's RSSI.
    Taken,
    /// It is no measurement.
    Refused(RssiError),
    /// Its beacon is not on the map.
    Unknown,
}

/// The RSSI values of `N` beacons. A beacon that falls silent is unheard once the window has passed, and starts anew when it comes back
/// after ten of them: it may stand elsewhere by then.
#[derive(Clone, Debug)]
pub struct Beacons<T, const N: usize> {
    smoothing: Smoothing<T>,
    window_us: u64,
    signals: [(Kalman<T>, Window<T>); N],
}

/// A beacon starts anew after so many windows of silence.
const FORGOTTEN: u64 = 10;

impl<T: Real, const N: usize> Beacons<T, N> {
    /// Nothing heard. Windows are 200 ms in a room, 500 ms over a floor (sections 4.3.3 and 5.3).
    pub fn new(smoothing: Smoothing<T>, window_us: u64) -> Self {
        Self { smoothing, window_us, signals: core::array::from_fn(|_| (Kalman::default(), Window::default())) }
    }

    /// Takes the RSSI of an advert of beacon number `beacon`, dBm as reported.
    pub fn receive(&mut self, now_us: u64, beacon: usize, rssi_dbm: T) -> Verdict {
        let rssi_dbm = match rssi(rssi_dbm) {
            Ok(rssi_dbm) => rssi_dbm,
            Err(reason) => return Verdict::Refused(reason),
        };
        let Some((kalman, window)) = self.signals.get_mut(beacon) else { return Verdict::Unknown };
        if now_us.saturating_sub(kalman.heard_us()) > self.window_us.saturating_mul(FORGOTTEN) {
            *kalman = Kalman::default();
        }
        let step = kalman.receive(now_us, rssi_dbm, &self.smoothing);
        if step == Step::Started {
            window.clear();
        }
        window.receive(now_us, kalman.rssi().unwrap_or(rssi_dbm));
        match step {
            Step::Started => Verdict::Started,
            Step::Smoothed => Verdict::Taken,
        }
    }

    /// The smoothed RSSI of one beacon at its latest advert, dBm; `None` where it was never heard.
    pub fn smoothed(&self, beacon: usize) -> Option<T> {
        self.signals.get(beacon)?.0.rssi()
    }

    /// The RSSI of every beacon at `now_us`: the mean of its smoothed RSSI values over the window (14), `None` where it is not heard.
    pub fn scan(&self, now_us: u64) -> [Option<T>; N] {
        core::array::from_fn(|beacon| {
            self.signals.get(beacon).and_then(|(_, window)| window.mean(now_us, self.window_us))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::{Beacons, Verdict};
    use crate::ble::signal::{RssiError, Smoothing};

    fn beacons() -> Beacons<f32, 2> {
        Beacons::new(Smoothing::default(), 500_000)
    }

    #[test]
    fn a_beacon_that_vanishes_is_unheard_and_one_that_never_spoke_too() {
        let mut beacons = beacons();
        assert_eq!(beacons.receive(1_000_000, 0, -60.0), Verdict::Started);
        assert_eq!(beacons.scan(1_400_000), [Some(-60.0), None]);
        assert_eq!(beacons.scan(1_600_000), [None, None]);
    }

    #[test]
    fn what_is_no_measurement_changes_nothing() {
        let mut beacons = beacons();
        beacons.receive(1_000_000, 0, -60.0);
        assert_eq!(beacons.receive(1_000_000, 0, 127.0), Verdict::Refused(RssiError::Unavailable));
        assert_eq!(beacons.receive(1_000_000, 0, 0.0), Verdict::Refused(RssiError::NotNegative));
        assert_eq!(beacons.receive(1_000_000, 0, f32::NAN), Verdict::Refused(RssiError::NotFinite));
        assert_eq!(beacons.receive(1_000_000, 2, -50.0), Verdict::Unknown);
        assert_eq!(beacons.scan(1_000_000), [Some(-60.0), None]);
    }

    #[test]
    fn a_beacon_that_comes_back_elsewhere_is_believed_at_once() {
        let mut beacons = beacons();
        for advert in 0..50 {
            beacons.receive(advert * 100_000, 0, -50.0);
        }
        assert_eq!(beacons.receive(60_000_000, 0, -80.0), Verdict::Started);
        assert_eq!(beacons.scan(60_000_000), [Some(-80.0), None]);
    }

    #[test]
    fn a_beacon_that_screams_is_smoothed_no_worse() {
        // 10,000 adverts a second, RSSI values alternating by 2 dB about −60.
        let mut beacons = beacons();
        for advert in 0..20_000_u64 {
            beacons.receive(advert * 100, 1, if advert % 2 == 0 { -58.0 } else { -62.0 });
        }
        let rssi = beacons.scan(2_000_000)[1].expect("heard");
        assert!((rssi + 60.0).abs() < 0.1, "{rssi}");
    }

    #[test]
    fn after_the_clock_was_set_back_adverts_count_again() {
        let mut beacons = beacons();
        beacons.receive(90_000_000, 0, -50.0);
        assert_eq!(beacons.receive(1_000, 0, -70.0), Verdict::Started);
        assert_eq!(beacons.scan(1_000), [Some(-70.0), None]);
    }
}
