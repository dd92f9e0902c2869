//! Means over time: events a second, and mean and deviation with exponential forgetting.

use std::time::Duration;

use crate::Utc;

/// The span of a rate, seconds.
const SPAN_S: i64 = 10;
/// One place for each second of the span, and one for the second that has not ended.
const PLACES: usize = SPAN_S as usize + 1;

fn second(t: Utc) -> i64 {
    t.us() / 1_000_000
}

/// Events a second over the last ten whole seconds.
///
/// A time that is earlier than the last one by more than the span begins anew.
#[derive(Clone, Debug, Default)]
pub(super) struct Rate {
    counts: [u32; PLACES],
    first_s: i64,
    last_s: i64,
}

impl Rate {
    pub(super) fn count(&mut self, t: Utc) {
        let at_s = second(t);
        if (self.last_s - at_s > SPAN_S) || self.first_s == 0 {
            *self = Self { first_s: at_s, last_s: at_s, ..Self::default() };
        }
        if at_s - self.last_s > SPAN_S {
            self.counts = [0; PLACES];
        } else {
            for empty_s in self.last_s + 1..=at_s {
                *self.place(empty_s) = 0;
            }
        }
        self.last_s = self.last_s.max(at_s);
        let place = self.place(at_s);
        *place = place.saturating_add(1);
    }

    /// Of the ten seconds before the current one; of fewer where the first event is younger.
    pub(super) fn hz(&self, now: Utc) -> f64 {
        let now_s = second(now);
        let known = (now_s - SPAN_S).max(self.last_s - SPAN_S)..now_s.min(self.last_s + 1);
        let count: u32 = known.map(|at_s| self.counts[at_s.rem_euclid(PLACES as i64) as usize]).sum();
        f64::from(count) / (now_s - self.first_s).clamp(1, SPAN_S) as f64
    }

    fn place(&mut self, at_s: i64) -> &mut u32 {
        &mut self.counts[at_s.rem_euclid(PLACES as i64) as usize]
    }
}

/// Mean and standard deviation with exponential forgetting. A step back in time forgets nothing.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Mean {
    weight: f64,
    mean: f64,
    /// Weighted sum of the squared differences from the mean.
    squares: f64,
    /// The number of different seconds that values come from, with the same forgetting. Values of one second have most
    /// of their error in common.
    seconds: f64,
    at: Utc,
}

impl Mean {
    /// The time constant of forgetting.
    const MEMORY: Duration = Duration::from_secs(120);

    pub(super) fn add(&mut self, t: Utc, value: f64) {
        if t > self.at {
            let kept = (-t.since(self.at).as_secs_f64() / Self::MEMORY.as_secs_f64()).exp();
            self.weight *= kept;
            self.squares *= kept;
            self.seconds *= kept;
        }
        if second(t) != second(self.at) || self.seconds == 0.0 {
            self.seconds += 1.0;
        }
        self.at = t;
        self.weight += 1.0;
        let off = value - self.mean;
        self.mean += off / self.weight;
        self.squares += off * (value - self.mean);
    }

    pub(super) fn mean(&self) -> Option<f64> {
        (self.weight > 0.0).then_some(self.mean)
    }

    /// Of single values.
    pub(super) fn sigma(&self) -> Option<f64> {
        (self.weight > 1.0).then(|| (self.squares / self.weight).sqrt())
    }

    /// The standard error of the mean, where there are values of this number of different seconds at least.
    pub(super) fn standard_error(&self, least_seconds: f64) -> Option<f64> {
        (self.seconds >= least_seconds).then_some(self.sigma()? / self.seconds.sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: i64) -> Utc {
        Utc::clamped(1_000_000_000_000 + 1000 * ms)
    }

    #[test]
    fn a_rate_is_that_of_the_last_ten_whole_seconds() {
        let mut rate = Rate::default();
        assert_eq!(rate.hz(at(0)), 0.0);
        // Four a second for 20 s, then two a second for 5 s.
        (0..80).for_each(|k| rate.count(at(250 * k)));
        assert_eq!(rate.hz(at(20_000)), 4.0);
        (0..10).for_each(|k| rate.count(at(20_000 + 500 * k)));
        assert_eq!(rate.hz(at(25_000)), (5.0 * 4.0 + 5.0 * 2.0) / 10.0);
        assert_eq!(rate.hz(at(40_000)), 0.0, "nothing for a while");
    }

    #[test]
    fn a_young_rate_counts_the_seconds_since_its_first_event() {
        let mut rate = Rate::default();
        (0..20).for_each(|k| rate.count(at(100 * k)));
        assert_eq!(rate.hz(at(2000)), 10.0);
    }

    #[test]
    fn a_clock_that_steps_back_begins_the_rate_anew() {
        let mut rate = Rate::default();
        (0..20).for_each(|k| rate.count(at(86_400_000 + 100 * k)));
        (0..30).for_each(|k| rate.count(at(100 * k)));
        assert_eq!(rate.hz(at(3000)), 10.0);
        rate.count(Utc::clamped(i64::MAX));
        assert_eq!(rate.hz(at(3000)), 0.0);
        assert_eq!(rate.hz(Utc::clamped(0)), 0.0);
    }

    #[test]
    fn values_are_forgotten_by_their_age() {
        // 1 at the beginning and 0 two minutes later: the old one weighs 1/e = 0.367879, so the mean is
        // 0.367879 / 1.367879 = 0.268941 and the variance 0.268941 · 0.731059 = 0.196612 (deviation 0.443409).
        let mut mean = Mean::default();
        mean.add(at(0), 1.0);
        assert_eq!((mean.mean(), mean.sigma()), (Some(1.0), None));
        mean.add(at(120_000), 0.0);
        assert!((mean.mean().unwrap() - 0.268_941).abs() < 1e-6);
        assert!((mean.sigma().unwrap() - 0.443_409).abs() < 1e-6);
        // 1.367879 seconds: 0.443409 / 1.169564 = 0.379124.
        assert!((mean.standard_error(1.0).unwrap() - 0.379_124).abs() < 1e-6);
        assert_eq!(mean.standard_error(2.0), None);
    }

    #[test]
    fn many_values_of_one_second_are_as_uncertain_as_one() {
        // Values of -1 and 1 in turn: mean 0, deviation 1.
        let mut mean = Mean::default();
        (0..1000).for_each(|k| mean.add(at(0), if k % 2 == 0 { -1.0 } else { 1.0 }));
        assert!((mean.standard_error(1.0).unwrap() - 1.0).abs() < 1e-9);
    }
}
