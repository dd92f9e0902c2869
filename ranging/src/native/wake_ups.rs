//! How well a node knows the time after its radio has slept.
//!
//! The radio's clock restarts with each sleep. The node assumes that the present is the instant at which it asked to be
//! woken. A sync frame shows the error of this assumption. It has two parts: the additional time of waking, the same
//! each time, and the drift of the processor's clock. Inputs are sleeps and such errors. Outputs are the expected error
//! and the remaining uncertainty. The fit is by normalised least mean squares in both parameters.

use positioning_core::Real;

use crate::RadioDuration;
use crate::time::TICKS_PER_SECOND;

/// The uncertainty before any measurement, and its maximum.
const MOST: RadioDuration = RadioDuration::from_micros(2_000);
/// Its minimum: steps of a slow timer, interrupts.
const LEAST: RadioDuration = RadioDuration::from_micros(50);
/// The uncertainty is this multiple of the mean deviation.
const DEVIATIONS: f32 = 4.0;
/// Weight of a new error in the fit.
const STEP: f32 = 0.5;
/// The weight of a second's sleep relative to one waking: clocks drift by 40 µs in a second, waking may be off by
/// hundreds.
const SECOND: f32 = 0.1;

/// Sleeps since the clock was last compared.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Slept {
    times: u8,
    ticks: i64,
}

impl Slept {
    /// One sleep.
    pub const fn once(duration: RadioDuration) -> Self {
        Self { times: 1, ticks: duration.ticks() }
    }

    /// Both sleeps, one after the other.
    pub const fn and(self, other: Self) -> Self {
        Self { times: self.times.saturating_add(other.times), ticks: self.ticks.saturating_add(other.ticks) }
    }

    /// Whether the clock is still that of the last comparison.
    pub const fn is_none(self) -> bool {
        self.times == 0
    }

    /// How much more errors scatter than those of one sleep: each adds its own.
    fn scatter(self) -> f32 {
        Real::sqrt(f32::from(self.times.max(1)))
    }

    fn weights(self) -> [f32; 2] {
        [f32::from(self.times), SECOND * self.ticks as f32 / TICKS_PER_SECOND as f32]
    }
}

/// What is known of wake-ups.
#[derive(Clone, Debug)]
pub struct WakeUps {
    /// Lateness of each waking, ticks, and ticks that each second of sleep adds, the latter divided by the weight of a
    /// second.
    late: [f32; 2],
    /// Mean deviation of the errors of one sleep from this estimate, ticks.
    deviation: f32,
}

impl WakeUps {
    /// Nothing known.
    pub const fn new() -> Self {
        Self { late: [0.0; 2], deviation: MOST.ticks() as f32 / DEVIATIONS }
    }

    /// The expected lateness of the node's waking after these sleeps.
    pub fn late(&self, slept: Slept) -> RadioDuration {
        let [each, second] = slept.weights();
        let late = (self.late[0] * each + self.late[1] * second) as i64;
        RadioDuration::from_ticks(late.clamp(-2 * MOST.ticks(), 2 * MOST.ticks()))
    }

    /// The possible error of the node's time after these sleeps and the correction for them.
    pub fn uncertainty(&self, slept: Slept) -> RadioDuration {
        if slept.is_none() {
            return RadioDuration::ZERO;
        }
        let measured = RadioDuration::from_ticks((DEVIATIONS * self.deviation * slept.scatter()) as i64);
        RadioDuration::from_ticks(measured.ticks() + LEAST.ticks()).min(MOST)
    }

    /// After these sleeps, and with the expected lateness corrected, the node was later than estimated by `error`.
    pub fn learn(&mut self, slept: Slept, error: RadioDuration) {
        let error = error.ticks().clamp(-2 * MOST.ticks(), 2 * MOST.ticks()) as f32;
        let weights = slept.weights();
        let square = weights[0] * weights[0] + weights[1] * weights[1];
        if square > 0.0 {
            for (late, weight) in self.late.iter_mut().zip(weights) {
                *late += STEP * error * weight / square;
            }
        }
        // A larger error counts half at once; smaller errors count slowly.
        let above = error.abs() / slept.scatter() - self.deviation;
        self.deviation += above * if above > 0.0 { 0.5 } else { 0.3 };
    }

    /// No frame came at the expected instant.
    pub fn missed(&mut self) {
        self.deviation = (1.25 * self.deviation).min(MOST.ticks() as f32 / DEVIATIONS);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn us(micros: u32) -> RadioDuration {
        RadioDuration::from_micros(micros)
    }

    #[test]
    fn what_is_the_same_each_time_is_learned_and_the_doubt_shrinks() {
        let mut wakes = WakeUps::new();
        let slept = Slept::once(us(1_000_000));
        assert_eq!(wakes.uncertainty(slept), MOST);
        for _ in 0..40 {
            // 300 µs late each time, ± 20 µs.
            for jitter in [-20, 20] {
                let late = us(300).ticks() + jitter * us(1).ticks();
                let error = RadioDuration::from_ticks(late - wakes.late(slept).ticks());
                wakes.learn(slept, error);
            }
        }
        assert!((280..=320).contains(&wakes.late(slept).as_micros()), "{wakes:?}");
        // Nearly all of the lateness is that of waking, and a short sleep has the same.
        assert!((270..=320).contains(&wakes.late(Slept::once(us(10_000))).as_micros()), "{wakes:?}");
        // Errors of 20 to 40 µs: four of them, and 50.
        assert!((120..=230).contains(&wakes.uncertainty(slept).as_micros()), "{:?}", wakes.uncertainty(slept));
    }

    #[test]
    fn one_large_error_widens_the_doubt_at_once_and_what_is_missed_too() {
        let mut wakes = WakeUps::new();
        let slept = Slept::once(us(100_000));
        (0..60).for_each(|_| wakes.learn(slept, RadioDuration::ZERO));
        assert!(wakes.uncertainty(slept).as_micros() < 55);
        wakes.learn(slept, us(400));
        // Half of 400 µs, four times, and 50.
        assert!((830..=870).contains(&wakes.uncertainty(slept).as_micros()), "{:?}", wakes.uncertainty(slept));
        for _ in 0..10 {
            wakes.missed();
        }
        assert_eq!(wakes.uncertainty(slept), MOST);
        assert_eq!(wakes.uncertainty(Slept::default()), RadioDuration::ZERO);
    }
}
