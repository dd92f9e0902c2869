//! Which captures are of one walk, and which are stays.

use positioning_core::ble::fingerprint::Motion;

use recording::beacons::Capture;

/// Captures with a shorter gap than this belong to one walk, seconds.
const ONE_WALK_S: f64 = 2.0;

/// First and last time of a capture, seconds.
pub(crate) fn span_s(capture: &Capture) -> Option<(f64, f64)> {
    let times = || capture.samples.iter().map(|sample| sample.t_s).chain(capture.t_s).filter(|t_s| t_s.is_finite());
    let (first, last) = (times().reduce(f64::min)?, times().reduce(f64::max)?);
    Some((first, last))
}

/// Whether a capture is one position over all its scans: a dwell that lasts longer than fading. Shorter dwells are
/// scans on the way.
pub(crate) fn is_stay(capture: &Capture) -> bool {
    capture.is_stay && span_s(capture).is_some_and(|(first_s, last_s)| last_s - first_s >= Motion::default().fading_s)
}

/// The time of a walk.
#[derive(Default)]
pub(crate) struct WalkClock {
    begun_s: Option<f64>,
    ended_s: f64,
}

impl WalkClock {
    /// When the capture ends, microseconds since the walk began, and whether it continues the walk of the capture
    /// before. A stay never does, because nobody knows how the receiver came there. Captures that all end at one time
    /// have no time of their own.
    pub(crate) fn next(&mut self, capture: &Capture) -> (u64, bool) {
        let Some((first_s, last_s)) = span_s(capture) else {
            self.begun_s = None;
            return (0, false);
        };
        let gap_s = first_s - self.ended_s;
        let follows = !is_stay(capture) && (0.0..=ONE_WALK_S).contains(&gap_s) && last_s > self.ended_s;
        let begun_s = self.begun_s.filter(|_| follows);
        let goes_on = begun_s.is_some();
        let begun_s = begun_s.unwrap_or(first_s);
        (self.begun_s, self.ended_s) = (Some(begun_s), last_s);
        (((last_s - begun_s) * 1.0e6) as u64, goes_on)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use recording::beacons::Sample;

    fn capture(is_stay: bool, times_s: &[f64]) -> Capture {
        let sample = |&t_s: &f64| Sample { beacon: "a".to_owned(), rssi_dbm: -60.0, t_s };
        Capture {
            name: String::new(),
            t_s: None,
            truth_m: None,
            is_stay,
            samples: times_s.iter().map(sample).collect(),
        }
    }

    #[test]
    fn a_dwell_that_lasts_is_a_stay_and_short_ones_are_a_walk() {
        let mut clock = WalkClock::default();
        // Epochs of a walk, half a second each.
        assert_eq!(clock.next(&capture(false, &[10.0, 10.5])), (500_000, false));
        assert_eq!(clock.next(&capture(false, &[10.6, 11.0])), (1_000_000, true));
        // Points that a robot passes are a walk as well, until there is a gap.
        assert_eq!(clock.next(&capture(true, &[11.5])), (1_500_000, true));
        assert_eq!(clock.next(&capture(true, &[14.0])), (0, false));
        // A dwell of five seconds right behind is another position.
        assert_eq!(clock.next(&capture(true, &[14.1, 19.1])), (5_000_000, false));
        assert_eq!(clock.next(&capture(true, &[19.2, 24.2])), (5_000_000, false));
        // Without times nothing follows.
        assert_eq!(clock.next(&capture(false, &[])), (0, false));
    }
}
