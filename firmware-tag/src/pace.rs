//! How often a tag ranges by how it moves: in flow positions, out flow changes of the rate.
//!
//! A tag that stays where it is for some seconds, as far as its positions can tell, goes to its still rate. Where it stays is the
//! mean of its positions since; one that is off by more than two standard deviations is a movement: most of what a track doubts, the
//! errors of links, stays with the place. So is not to know: two
//! rounds in a row without a position.

use firmware_common::machines;
use positioning_core::Real;
use ranging::native::Rate;

use crate::Position;

/// How long a tag has to stay before it is still, microseconds.
const STILL_AFTER_US: u64 = 5_000_000;
/// Off by more than this many standard deviations, it has moved.
const MOVED_SIGMAS: f32 = 2.0;
/// Rounds without a position after which the full rate is worth a try.
const FAILURES: u8 = 2;
/// The mean forgets: its newest position counts at least one in so many, so that creeping is not movement for ever.
const MEAN_OF: u16 = 32;

/// The rates of a tag, and which it is at.
#[derive(Clone, Debug)]
pub struct Pace {
    full: Rate,
    /// None: the full one always.
    still: Option<Rate>,
    is_still: bool,
    place: Option<Place>,
    failures: u8,
}

/// Where the tag stays.
#[derive(Clone, Copy, Debug)]
struct Place {
    since_us: u64,
    mean_m: [f32; 3],
    count: u16,
}

impl Pace {
    /// That of a tag with this record.
    pub fn of(tag: &node_record::Tag) -> Self {
        let still = tag.still_rate_chz.map(|chz| machines::rate(Some(chz)));
        Self::new(machines::rate(tag.rate_chz), still)
    }

    /// A tag that ranges at the full rate, and at the still rate, if it has one, while it does not move.
    pub const fn new(full: Rate, still: Option<Rate>) -> Self {
        Self { full, still, is_still: false, place: None, failures: 0 }
    }

    /// A round is over, now; the rate from now on where that changes.
    pub fn after(&mut self, now_us: u64, position: Option<&Position>) -> Option<Rate> {
        let still = self.still?;
        let stays = match position {
            Some(position) => {
                self.failures = 0;
                self.stays(now_us, position)
            }
            None => {
                self.failures = self.failures.saturating_add(1);
                if self.failures < FAILURES {
                    return None;
                }
                self.place = None;
                false
            }
        };
        if stays == self.is_still {
            return None;
        }
        self.is_still = stays;
        Some(if stays { still } else { self.full })
    }

    /// Whether the tag has stayed for long enough.
    fn stays(&mut self, now_us: u64, position: &Position) -> bool {
        let Some(place) = self.place.as_mut().filter(|place| !place.is_left(position)) else {
            self.place = Some(Place { since_us: now_us, mean_m: position.position_m, count: 1 });
            return false;
        };
        place.count = (place.count + 1).min(MEAN_OF);
        for (mean, new) in place.mean_m.iter_mut().zip(position.position_m) {
            *mean += (new - *mean) / f32::from(place.count);
        }
        now_us.saturating_sub(place.since_us) >= STILL_AFTER_US
    }
}

impl Place {
    fn is_left(&self, position: &Position) -> bool {
        let away = self.mean_m.iter().zip(position.position_m).map(|(a, b)| (a - b) * (a - b)).sum::<f32>();
        let variance: f32 = (0..3).map(|axis| position.covariance_m2[axis][axis]).sum();
        Real::sqrt(away) > MOVED_SIGMAS * Real::sqrt(variance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ranging::RadioDuration;

    const SLOW: Rate = Rate::Every(RadioDuration::from_micros(1_000_000));

    /// At x, with a standard deviation of 5 cm in the plane.
    fn at(x: f32) -> Position {
        let mut covariance_m2 = [[0.0; 3]; 3];
        // 0.03² + 0.04² = 0.05².
        (covariance_m2[0][0], covariance_m2[1][1]) = (0.0009, 0.0016);
        Position { position_m: [x, 1.0, 1.5], covariance_m2, used: 0b1111, quality: 1.0 }
    }

    fn pace() -> Pace {
        Pace::new(Rate::Greedy, Some(SLOW))
    }

    /// Lies at 0 from `from_s` on until it is still; when that was, seconds.
    fn until_still(pace: &mut Pace, from_s: f64) -> f64 {
        let mut t_s = from_s;
        loop {
            match pace.after((t_s * 1e6) as u64, Some(&at(0.0))) {
                Some(rate) => {
                    assert_eq!(rate, SLOW);
                    return t_s;
                }
                None => t_s += 0.1,
            }
            assert!(t_s < from_s + 60.0, "never still");
        }
    }

    #[test]
    fn a_tag_that_lies_still_ranges_seldom_until_it_moves() {
        let mut pace = pace();
        let still_s = until_still(&mut pace, 1.0);
        assert!((5.9..6.2).contains(&still_s), "{still_s}");
        // 9 cm are less than twice 5 cm, 12 cm more.
        assert_eq!(pace.after(8_000_000, Some(&at(0.09))), None);
        assert_eq!(pace.after(9_000_000, Some(&at(0.12))), Some(Rate::Greedy));
        let still_s = until_still(&mut pace, 10.0);
        assert!((14.9..16.2).contains(&still_s), "{still_s}");
    }

    #[test]
    fn a_tag_that_walks_is_never_still() {
        let mut pace = pace();
        // 0.3 m/s, ten times a second.
        for step in 0..600_u64 {
            assert_eq!(pace.after(step * 100_000, Some(&at(0.03 * step as f32))), None);
        }
    }

    #[test]
    fn a_lost_round_is_nothing_and_two_are() {
        let mut pace = pace();
        until_still(&mut pace, 0.0);
        assert_eq!(pace.after(20_000_000, None), None);
        assert_eq!(pace.after(21_000_000, Some(&at(0.0))), None);
        assert_eq!(pace.after(22_000_000, None), None);
        assert_eq!(pace.after(23_000_000, None), Some(Rate::Greedy));
    }

    #[test]
    fn without_a_still_rate_nothing_changes() {
        let mut pace = Pace::new(Rate::Greedy, None);
        assert!((0..1000_u64).all(|step| pace.after(step * 100_000, Some(&at(0.0))).is_none()));
    }
}
