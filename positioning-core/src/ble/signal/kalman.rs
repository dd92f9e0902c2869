//! The scalar Kalman filter of one beacon's RSSI (section 3.4.1.2): x' = x, z = x, with the thesis' R and Q.
//!
//! The thesis adds Q once per advert. Here the variance grows with the time instead, by Q per advertising interval.
//! So a beacon with missed adverts follows new values faster, the longer it was silent. Where all adverts are
//! received, both are the same.

use crate::Real;

/// A time that is earlier by less than this belongs to an overtaken advert. By more, the clock was reset.
/// Microseconds.
const OVERTAKING_US: u64 = 1_000_000;

/// How an RSSI is smoothed.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Smoothing<T> {
    /// R, the variance of one advert's RSSI, dB². The gain depends on Q ⁄ R alone.
    pub measurement: T,
    /// Q, the growth of the RSSI's variance per interval, dB².
    pub process: T,
    /// The beacon's advertising interval, microseconds; above 0.
    pub interval_us: u32,
}

impl<T: Real> Default for Smoothing<T> {
    /// R = 1, Q = 0.01, an advert every 100 ms: the values of the thesis.
    fn default() -> Self {
        Self { measurement: T::ONE, process: T::of(0.01), interval_us: 100_000 }
    }
}

/// The effect of an advert on the filter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Step {
    /// It was the first advert, or the first after a clock that was set back.
    Started,
    /// It was one more advert.
    Smoothed,
}

/// The RSSI of one beacon.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Kalman<T> {
    rssi: T,
    /// Below 0 before the first advert.
    variance: T,
    at_us: u64,
}

impl<T: Real> Default for Kalman<T> {
    fn default() -> Self {
        Self { rssi: T::ZERO, variance: -T::ONE, at_us: 0 }
    }
}

impl<T: Real> Kalman<T> {
    /// Takes an RSSI that [`rssi`](super::rssi) has accepted, dBm, received at `now_us`.
    #[inline]
    pub fn receive(&mut self, now_us: u64, rssi: T, smoothing: &Smoothing<T>) -> Step {
        if self.variance < T::ZERO || now_us.saturating_add(OVERTAKING_US) < self.at_us {
            *self = Self { rssi, variance: smoothing.measurement, at_us: now_us };
            return Step::Started;
        }
        let predicted = self.variance_at(now_us, smoothing);
        let gain = predicted / (predicted + smoothing.measurement);
        self.rssi += gain * (rssi - self.rssi);
        self.variance = gain * smoothing.measurement;
        self.at_us = self.at_us.max(now_us);
        Step::Smoothed
    }

    /// The RSSI, dBm; `None` before the first advert.
    pub fn rssi(&self) -> Option<T> {
        (self.variance >= T::ZERO).then_some(self.rssi)
    }

    /// The RSSI's variance at `now_us`, dB²; negative before the first advert.
    pub fn variance_at(&self, now_us: u64, smoothing: &Smoothing<T>) -> T {
        // Microseconds beyond 32 bits are over an hour of silence: the variance is practically infinite then.
        let silent_us = u32::try_from(now_us.saturating_sub(self.at_us)).unwrap_or(u32::MAX);
        let intervals = T::count(silent_us as usize) / T::count(smoothing.interval_us as usize).at_least(T::ONE);
        self.variance + smoothing.process * intervals
    }

    /// The time of the latest advert, microseconds.
    pub fn heard_us(&self) -> u64 {
        self.at_us
    }
}

#[cfg(test)]
mod tests {
    use super::{Kalman, Smoothing, Step};

    #[test]
    fn adverts_of_the_usual_interval_are_smoothed_as_in_the_thesis() {
        // By hand, A 1, R 1, Q 0.01: x −60, P 1; P⁻ 1.01, K 1.01/2.01 = 0.502488, x −60 + 0.502488 · 4 = −57.990050,
        // P 0.502488; P⁻ 0.512488, K 0.3388375, x −57.990050 − 0.3388375 · 4.009950 = −59.348771.
        let (mut kalman, smoothing) = (Kalman::<f64>::default(), Smoothing::default());
        assert_eq!(kalman.rssi(), None);
        assert_eq!(kalman.receive(5_000_000, -60.0, &smoothing), Step::Started);
        assert_eq!(kalman.receive(5_100_000, -56.0, &smoothing), Step::Smoothed);
        assert!((kalman.rssi().expect("heard") + 57.990_050).abs() < 1e-6, "{kalman:?}");
        kalman.receive(5_200_000, -62.0, &smoothing);
        assert!((kalman.rssi().expect("heard") + 59.348_771).abs() < 2e-6, "{kalman:?}");
    }

    #[test]
    fn after_silence_the_next_advert_counts_for_more() {
        // P is 1 after the first advert; 20 s are 200 intervals: P⁻ 1 + 2 = 3, K 3/4.
        let (mut kalman, smoothing) = (Kalman::<f64>::default(), Smoothing::default());
        kalman.receive(0, -60.0, &smoothing);
        kalman.receive(20_000_000, -80.0, &smoothing);
        assert!((kalman.rssi().expect("heard") + 75.0).abs() < 1e-12, "{kalman:?}");
    }

    #[test]
    fn an_overtaken_advert_counts_and_a_clock_set_back_starts_anew() {
        let (mut kalman, smoothing) = (Kalman::<f64>::default(), Smoothing::default());
        kalman.receive(10_000_000, -60.0, &smoothing);
        assert_eq!(kalman.receive(9_500_000, -60.0, &smoothing), Step::Smoothed);
        assert_eq!(kalman.heard_us(), 10_000_000);
        assert_eq!(kalman.receive(1_000_000, -80.0, &smoothing), Step::Started);
        assert_eq!((kalman.rssi(), kalman.heard_us()), (Some(-80.0), 1_000_000));
    }

    #[test]
    fn no_interval_and_the_end_of_time_leave_numbers() {
        let (mut kalman, smoothing) = (Kalman::<f32>::default(), Smoothing { interval_us: 0, ..Smoothing::default() });
        kalman.receive(0, -60.0, &smoothing);
        kalman.receive(u64::MAX, -70.0, &smoothing);
        assert!(kalman.rssi().expect("heard").is_finite() && kalman.variance_at(u64::MAX, &smoothing).is_finite());
    }
}
