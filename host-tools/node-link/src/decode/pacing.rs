//! A recording at the pace of its times.

use std::time::{Duration, Instant};

/// A longer recorded pause is left out, seconds, so that a wrong time from a node does not cause a long wait.
const LONGEST_PAUSE_S: f64 = 3600.0;

/// Converts recorded times to waits.
#[derive(Clone, Copy, Debug)]
pub struct Pacing {
    speed: f64,
    begun: Instant,
    first_t_s: Option<f64>,
    last_t_s: f64,
}

impl Pacing {
    /// Begins now, `speed` times as fast as recorded.
    pub fn new(speed: f64) -> Self {
        Self { speed, begun: Instant::now(), first_t_s: None, last_t_s: f64::INFINITY }
    }

    /// The wait until a recorded time, relative to the first recorded time; `None` where the time has passed.
    pub fn until(&mut self, t_s: f64) -> Option<Duration> {
        let first_t_s = self.first_t_s.get_or_insert(t_s);
        let pause_s = t_s - std::mem::replace(&mut self.last_t_s, t_s);
        if pause_s > LONGEST_PAUSE_S {
            *first_t_s += pause_s;
        }
        // Times beyond the range of a duration are limited to its maximum.
        let due = Duration::try_from_secs_f64(((t_s - *first_t_s) / self.speed).max(0.0)).unwrap_or(Duration::MAX);
        due.checked_sub(self.begun.elapsed()).filter(|wait| !wait.is_zero())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pauses_are_kept_and_absurd_ones_left_out() {
        let mut pacing = Pacing::new(2.0);
        assert_eq!(pacing.until(5.0), None);
        // Half an hour at twice the speed is a quarter of an hour.
        assert!(pacing.until(1805.0).is_some_and(|wait| wait > Duration::from_secs(890)));
        let after = pacing.until(1.8e12).map_or(Duration::ZERO, |wait| wait);
        assert!(after <= Duration::from_secs(900), "{after:?}");
    }
}
