//! The window of integration of one beacon: the mean of the RSSI values of the last 200 or 500 ms (14).

use crate::Real;

/// The most adverts of one window: of a beacon that advertises every 100 ms, five are heard in 500 ms, and up to three times as many
/// by a receiver that listens on all channels. Of a beacon that screams, the latest count.
pub const INTEGRATED: usize = 14;

/// The latest RSSI values of one beacon.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Window<T, const N: usize = INTEGRATED> {
    adverts: [(u64, T); N],
    count: usize,
    /// Where the next one goes.
    next: usize,
}

impl<T: Real, const N: usize> Default for Window<T, N> {
    fn default() -> Self {
        Self { adverts: [(0, T::ZERO); N], count: 0, next: 0 }
    }
}

impl<T: Real, const N: usize> Window<T, N> {
    /// Takes an RSSI, dBm, heard at `now_us`; it displaces the oldest where the window is full.
    pub fn receive(&mut self, now_us: u64, rssi: T) {
        if let Some(advert) = self.adverts.get_mut(self.next) {
            *advert = (now_us, rssi);
            self.next = (self.next + 1) % N;
            self.count = (self.count + 1).min(N);
        }
    }

    /// Forgets all.
    pub fn clear(&mut self) {
        (self.count, self.next) = (0, 0);
    }

    /// The mean of the RSSI values heard in the `span_us` before `now_us`, dBm, the ends with them (14); `None` where there are none.
    pub fn mean(&self, now_us: u64, span_us: u64) -> Option<T> {
        let (count, sum, _) = self.sums(now_us, span_us);
        (count > 0).then(|| sum / T::count(count))
    }

    /// The standard deviation of those RSSI values about their mean, dB; `None` for fewer than two. Two beacons of one identity, or a
    /// beacon that moves, show here first.
    pub fn deviation(&self, now_us: u64, span_us: u64) -> Option<T> {
        let (count, sum, squares) = self.sums(now_us, span_us);
        let mean = sum / T::count(count);
        (count > 1).then(|| ((squares - sum * mean) / T::count(count - 1)).at_least(T::ZERO).sqrt())
    }

    /// How many RSSI values, their sum and the sum of their squares.
    fn sums(&self, now_us: u64, span_us: u64) -> (usize, T, T) {
        let since_us = now_us.saturating_sub(span_us);
        let within = |(at_us, _): &&(u64, T)| (since_us..=now_us).contains(at_us);
        let rssis = self.adverts.iter().take(self.count).filter(within);
        rssis.fold((0, T::ZERO, T::ZERO), |(count, sum, squares), &(_, rssi)| {
            (count + 1, sum + rssi, squares + rssi.squared())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::Window;

    #[test]
    fn the_mean_is_that_of_the_last_half_second() {
        let mut window = Window::<f64>::default();
        for (at_ms, rssi) in [(0, -90.0), (500, -60.0), (800, -64.0), (1000, -62.0)] {
            window.receive(at_ms * 1000, rssi);
        }
        // (−60 − 64 − 62) ⁄ 3 = −62; deviation √((4 + 4 + 0) ⁄ 2) = 2.
        assert_eq!(window.mean(1_000_000, 500_000), Some(-62.0));
        assert_eq!(window.deviation(1_000_000, 500_000), Some(2.0));
        assert_eq!(window.mean(1_000_000, 200_000), Some(-63.0));
        assert_eq!((window.mean(3_000_000, 500_000), window.deviation(3_000_000, 500_000)), (None, None));
        assert_eq!(window.mean(400_000, 500_000), Some(-90.0), "what is yet to come does not count");
    }

    #[test]
    fn of_a_beacon_that_screams_the_latest_count() {
        let mut window = Window::<f64, 3>::default();
        for (at_us, rssi) in [(1, -10.0), (2, -61.0), (3, -62.0), (4, -63.0)] {
            window.receive(at_us, rssi);
        }
        assert_eq!(window.mean(4, 100), Some(-62.0));
        Window::<f64, 0>::default().receive(1, -60.0);
    }
}
