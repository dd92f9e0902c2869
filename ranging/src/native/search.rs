//! When a tag without a network listens: all the time at first, then less and less often.
//!
//! Anchors repeat their sync frames each superframe: listening for a little more than one superframe is enough to
//! receive every anchor in range. With a receiver of some 115 mA, a superframe of 100 ms and a pause of a minute take
//! 0.23 mA in the mean.

use super::timing::SUPERFRAME;
use crate::{RadioDuration, RadioInstant};

/// At first the tag listens for this long.
const FIRST: RadioDuration = RadioDuration::from_micros(2_000_000);
/// Later it listens for a superframe and this fraction of one more.
const MORE: i64 = 5;
/// The first pause. Each pause is twice as long as the one before, up to the longest.
const FIRST_PAUSE: RadioDuration = RadioDuration::from_micros(2_000_000);
const LONGEST_PAUSE: RadioDuration = RadioDuration::from_micros(64_000_000);

/// A search.
#[derive(Clone, Debug, Default)]
pub struct Search {
    /// The end of the current listening.
    until: Option<RadioInstant>,
    /// Pauses so far.
    pauses: u8,
}

/// What a searching tag does next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Next {
    /// It listens for this long.
    Listen(RadioDuration),
    /// It does nothing for this long; its clock may be lost.
    Pause(RadioDuration),
}

impl Search {
    /// The next step.
    pub fn next(&mut self, present: RadioInstant) -> Next {
        let listening = if self.pauses == 0 { FIRST.ticks() } else { SUPERFRAME.ticks() + SUPERFRAME.ticks() / MORE };
        let until = *self.until.get_or_insert(present.plus(RadioDuration::from_ticks(listening)));
        let rest = until.since(present);
        if rest > RadioDuration::ZERO {
            return Next::Listen(rest);
        }
        self.until = None;
        let pause = RadioDuration::from_ticks(FIRST_PAUSE.ticks() << self.pauses.min(5)).min(LONGEST_PAUSE);
        self.pauses = self.pauses.saturating_add(1);
        Next::Pause(pause)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_receiver_is_on_for_two_seconds_and_then_a_five_hundredth_of_the_time() {
        let (mut search, mut now) = (Search::default(), RadioInstant::from_ticks(0));
        let (mut listened_ms, mut passed_ms) = (std::vec::Vec::new(), 0);
        while passed_ms < 3_600_000 {
            let wait = match search.next(now) {
                Next::Listen(window) => {
                    listened_ms.push(window.as_micros() / 1000);
                    window
                }
                Next::Pause(pause) => pause,
            };
            passed_ms += wait.as_micros() / 1000;
            now = now.plus(wait);
        }
        assert_eq!(listened_ms[..3], [2_000, 120, 120]);
        // Pauses of 2, 4, 8, 16, 32 and then 64 s: in an hour 5 + (3600 − 62 − 2) / 64.1 = 60 times 120 ms.
        assert!((58..=62).contains(&(listened_ms.len() - 1)), "{}", listened_ms.len());
    }
}
