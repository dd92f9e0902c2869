//! In which room a tag is that is located by RSSI alone.
//!
//! Its position is vague: with a deviation of three metres no room of a flat holds half of it. But most of the rest is
//! outside of all rooms, where the tag is not. So each room's probability is divided by that of all rooms. Fading passes:
//! these shares are means over some seconds. The tests compare the room with that of the strongest receiver.

use std::time::Duration;

use super::limits::Thresholds;
use crate::Utc;

/// A room is entered where it is likelier than all others together. Another one must be clearly likelier.
pub(super) const THRESHOLDS: Thresholds = Thresholds { enter: 0.5, changes: 0.6, leave: 0.2 };
/// The time constant of the means.
const SMOOTHED_OVER: Duration = Duration::from_secs(5);
/// With a lower probability of all rooms together the tag is outside.
const LEAST_INSIDE: f64 = 0.05;

/// Mean probabilities of the rooms of a site.
#[derive(Clone, Debug, Default)]
pub(super) struct RoomShares {
    /// The last position.
    at: Option<Utc>,
    shares: Vec<f64>,
}

impl RoomShares {
    /// Takes the probabilities of a position at `t`: one a room, always of the same rooms. Returns the means.
    pub(super) fn take(&mut self, t: Utc, probabilities: &[f64]) -> &[f64] {
        let all: f64 = probabilities.iter().sum();
        let share = |probability: &f64| if all < LEAST_INSIDE { 0.0 } else { probability / all };
        let shares = probabilities.iter().map(share);
        match self.at.filter(|_| self.shares.len() == probabilities.len()) {
            Some(before) => {
                let weight = 1.0 - (-t.since(before).as_secs_f64() / SMOOTHED_OVER.as_secs_f64()).exp();
                self.shares.iter_mut().zip(shares).for_each(|(mean, share)| *mean += weight * (share - *mean));
            }
            None => self.shares = shares.collect(),
        }
        self.at = Some(t);
        &self.shares
    }

    /// The rooms are others, or the tag is located better.
    pub(super) fn clear(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: i64) -> Utc {
        Utc::of_ms(1_000_000_000_000 + ms)
    }

    #[test]
    fn the_first_position_counts_at_once_and_others_as_seconds_pass() {
        let mut rooms = RoomShares::default();
        // 0.3 of 0.4.
        let close = |means: &[f64], expected: [f64; 2]| {
            assert!(means.iter().zip(expected).all(|(mean, of)| (mean - of).abs() < 1e-4), "{means:?}");
        };
        close(rooms.take(at(0), &[0.3, 0.1]), [0.75, 0.25]);
        // The time constant: 1 - 1/e = 0.6321 of the way from 0.75 to 0.
        close(rooms.take(at(5_000), &[0.0, 0.2]), [0.75 - 0.6321 * 0.75, 0.25 + 0.6321 * 0.75]);
        // At the same time, or with a clock that was set back, nothing changes.
        let before = rooms.shares.clone();
        assert_eq!(rooms.take(at(4_000), &[1.0, 0.0]), before);
        // Outside of all rooms.
        close(rooms.take(at(104_000), &[0.01, 0.02]), [0.0, 0.0]);
        // Other rooms.
        assert_eq!(rooms.take(at(104_001), &[0.2]), [1.0]);
        rooms.clear();
        assert_eq!(rooms.take(at(0), &[0.0, 0.5]), [0.0, 1.0]);
    }
}
