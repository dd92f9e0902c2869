//! The frames that a tag has refused, and whether they are more than noise makes.

use std::time::Duration;

use crate::Utc;

/// This many frames within the window are an event. Undisturbed networks have none at all
/// (`ranging/tests/suite/attack.rs`).
const FRAMES: u32 = 10;
const WINDOW: Duration = Duration::from_secs(60);

/// What a tag has refused since the window began.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Refusals {
    /// The beginning of the window, and the tag's count then.
    window: Option<(Utc, u32)>,
    is_attacked: bool,
}

impl Refusals {
    /// Takes the tag's count since its start, wrapping. Returns whether it refuses many from now on.
    pub(super) fn take(&mut self, t: Utc, frames: u32) -> bool {
        let (from, before) = *self.window.get_or_insert((t, frames));
        let grown = frames.wrapping_sub(before);
        // A count that falls is that of a tag that has started again.
        let has_restarted = grown > u32::MAX / 2;
        let is_over = t > from + WINDOW;
        if has_restarted || is_over {
            self.window = Some((t, frames));
        }
        let is_many = !has_restarted && grown >= FRAMES;
        let was_attacked = self.is_attacked;
        self.is_attacked = is_many || was_attacked && !is_over;
        is_many && !was_attacked
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The seconds of the events, of counts each five seconds.
    fn events(counts: impl IntoIterator<Item = u32>) -> Vec<i64> {
        let mut refusals = Refusals::default();
        let times = (0..).step_by(5).zip(counts);
        times.filter(|(s, frames)| refusals.take(Utc::of_ms(s * 1000), *frames)).map(|(s, _)| s).collect()
    }

    #[test]
    fn an_attack_is_one_event_until_it_is_over() {
        // Nothing for 10 s, then two a second for a minute, nothing for two minutes, two a second again.
        let rate = [0; 2].into_iter().chain([10; 12]).chain([0; 24]).chain([10; 3]);
        let counts = rate.scan(0_u32, |sum, more| {
            *sum += more;
            Some(*sum)
        });
        assert_eq!(events(counts), [10, 190]);
    }

    #[test]
    fn single_frames_and_a_restart_are_none() {
        // One in ten seconds: six in a minute.
        assert_eq!(events((0..200).map(|i| i / 2)), [0; 0]);
        // What a station that starts late did not see is not new, and what a restarted tag counts begins at nothing.
        assert_eq!(events([5000, 5000, 3, 3, 4]), [0; 0]);
        // A count that wraps has grown.
        assert_eq!(events([u32::MAX - 1, 9]), [5]);
    }
}
