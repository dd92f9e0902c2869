//! Converts a sequence of probabilities to room estimates that do not flap: in a room, between two rooms, or not
//! known.
//!
//! Probabilities are smoothed over time. A room is entered when it is very probable, and left only when it has become
//! improbable. A tag that has left one room and is not yet in another is between the two most probable rooms. A tag
//! in a doorway, where the most probable room alternates, stays in its room estimate.

use super::{MAX_ROOMS, Probabilities};
use crate::Real;

/// The settings of the room estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Settings {
    /// The time constant of smoothing, microseconds.
    pub smoothing_us: u32,
    /// A room is entered when its smoothed probability reaches this, above ½.
    pub enter: f32,
    /// A room is left when its smoothed probability falls below this.
    pub leave: f32,
    /// Without evidence for this time, the room becomes unknown, microseconds.
    pub forgotten_us: u32,
}

impl Default for Settings {
    /// Two seconds, 0.9 and 0.1, ten seconds. A tag that walks from one room into another has the new room estimate
    /// after five seconds. The room estimate of a tag in the doorway changes every ten minutes.
    fn default() -> Self {
        Self { smoothing_us: 2_000_000, enter: 0.9, leave: 0.1, forgotten_us: 10_000_000 }
    }
}

/// The room estimate of a tag.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum RoomEstimate {
    /// Nothing was received lately.
    Unknown,
    /// In the room with this number.
    Room(u8),
    /// Between two rooms; the more probable one is first.
    Between(u8, u8),
}

/// The room estimate of a tag over time.
#[derive(Clone, Debug)]
pub struct RoomHysteresis {
    settings: Settings,
    smoothed: Probabilities,
    answer: RoomEstimate,
    at_us: u64,
}

impl RoomHysteresis {
    /// Nothing is known.
    pub fn new(settings: Settings) -> Self {
        Self { settings, smoothed: Probabilities::new(), answer: RoomEstimate::Unknown, at_us: 0 }
    }

    /// Takes a classifier's probabilities at `now_us`, `None` where it has no result, and returns the room estimate.
    /// Probabilities that are not numbers count as no result.
    pub fn step(&mut self, now_us: u64, probabilities: Option<&Probabilities>) -> RoomEstimate {
        let since_us = now_us.saturating_sub(self.at_us);
        if since_us > u64::from(self.settings.forgotten_us) {
            self.answer = RoomEstimate::Unknown;
            self.smoothed.clear();
        }
        let told = probabilities.filter(|told| told.iter().all(|p| p.is_finite() && *p >= 0.0));
        let Some(told) = told.filter(|told| !told.is_empty()) else { return self.answer };
        if self.smoothed.len() == told.len() {
            // A time that is not forgotten fits in 32 bits.
            let (since, constant) = (since_us as f32, self.settings.smoothing_us as f32);
            let kept = if constant > 0.0 { Real::exp(-since / constant) } else { 0.0 };
            for (smoothed, new) in self.smoothed.iter_mut().zip(told) {
                *smoothed = kept * *smoothed + (1.0 - kept) * new;
            }
        } else {
            self.smoothed = told.clone();
        }
        self.at_us = now_us;
        self.answer = self.decide();
        self.answer
    }

    /// The last room estimate.
    pub fn answer(&self) -> RoomEstimate {
        self.answer
    }

    /// The smoothed probability of a room; 0 where there is no room of that number.
    pub fn probability(&self, room: u8) -> f32 {
        self.smoothed.get(usize::from(room)).copied().unwrap_or(0.0)
    }

    fn decide(&self) -> RoomEstimate {
        let (mut first, mut second) = (0, 0);
        let (mut most, mut next) = (-1.0, -1.0);
        for (room, &p) in (0..MAX_ROOMS as u8).zip(&self.smoothed) {
            if p > most {
                (second, next) = (first, most);
                (first, most) = (room, p);
            } else if p > next {
                (second, next) = (room, p);
            }
        }
        match self.answer {
            RoomEstimate::Room(room) if self.probability(room) >= self.settings.leave && most < self.settings.enter => {
                RoomEstimate::Room(room)
            }
            RoomEstimate::Room(_) | RoomEstimate::Between(..) | RoomEstimate::Unknown => {
                if most >= self.settings.enter || self.smoothed.len() == 1 {
                    RoomEstimate::Room(first)
                } else {
                    match self.answer {
                        // A change of which of the two is the more probable is not a new room estimate.
                        RoomEstimate::Between(one, other)
                            if [(first, second), (second, first)].contains(&(one, other)) =>
                        {
                            RoomEstimate::Between(one, other)
                        }
                        RoomEstimate::Room(_) | RoomEstimate::Between(..) | RoomEstimate::Unknown => {
                            RoomEstimate::Between(first, second)
                        }
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::{Rng, SeedableRng};

    use super::{RoomEstimate, RoomHysteresis, Settings};
    use crate::ble::rooms::{Classifier, Probabilities, Svm, likeliest};

    const SECOND: u64 = 1_000_000;

    fn told(p: &[f32]) -> Probabilities {
        p.iter().copied().collect()
    }

    #[test]
    fn a_room_is_entered_at_once_and_left_when_it_has_become_improbable() {
        // After the change each second keeps e^−½ = 0.6065. The old room's 0.96 falls towards 0.04 as 0.04 + 0.92 ·
        // 0.6065ⁿ: 0.598, 0.378, 0.245, 0.165, 0.116, 0.086 (at n = 6 it is left; the new room has 0.914 and is
        // entered).
        let mut presence = RoomHysteresis::new(Settings::default());
        assert_eq!(presence.step(SECOND, Some(&told(&[0.96, 0.04]))), RoomEstimate::Room(0));
        let answers: std::vec::Vec<_> =
            (2..=7).map(|s| presence.step(s * SECOND, Some(&told(&[0.04, 0.96])))).collect();
        assert_eq!(answers[..5], [RoomEstimate::Room(0); 5]);
        assert_eq!(answers[5], RoomEstimate::Room(1));
    }

    #[test]
    fn whoever_is_in_neither_room_is_between_them() {
        // Three rooms: the first falls as before and is left at n = 6. The others then have 0.476 and 0.438, and one
        // second later 0.367 and 0.565.
        let mut presence = RoomHysteresis::new(Settings::default());
        presence.step(SECOND, Some(&told(&[0.96, 0.02, 0.02])));
        let mut answer = RoomEstimate::Unknown;
        for s in 2..=7 {
            answer = presence.step(s * SECOND, Some(&told(&[0.04, 0.5, 0.46])));
        }
        assert_eq!(answer, RoomEstimate::Between(1, 2));
        assert_eq!(presence.step(8 * SECOND, Some(&told(&[0.04, 0.2, 0.76]))), RoomEstimate::Between(1, 2), "no news");
    }

    #[test]
    fn silence_is_waited_for_and_then_nothing_is_known() {
        let mut presence = RoomHysteresis::new(Settings::default());
        presence.step(SECOND, Some(&told(&[0.9, 0.1])));
        assert_eq!(presence.step(11 * SECOND, None), RoomEstimate::Room(0));
        assert_eq!(presence.step(11 * SECOND + 1, None), RoomEstimate::Unknown);
        assert_eq!(presence.step(12 * SECOND, Some(&told(&[f32::NAN, 0.1]))), RoomEstimate::Unknown);
        assert_eq!(presence.answer(), RoomEstimate::Unknown);
    }

    /// A tag in the doorway for ten minutes. Both beacons are equal except for noise of 4 dB that lasts for about
    /// three seconds (a body that turns) and a little noise each second. The classifier alone changes its result all
    /// the time.
    #[test]
    fn a_tag_in_a_doorway_does_not_flap() {
        let bytes = |numbers: &[f32]| -> std::vec::Vec<u8> { numbers.iter().flat_map(|n| n.to_le_bytes()).collect() };
        let (fallback, planes) = (bytes(&[-90.0, -90.0]), bytes(&[0.0, 0.08, -0.08]));
        let svm = Svm { rooms: 2, slope: 5.0, fallback_dbm: &fallback, planes: &planes };
        for seed in 0..5 {
            let mut random = rand_pcg::Pcg32::seed_from_u64(seed);
            // Twelve uniform numbers minus six: mean 0, deviation 1.
            let mut gaussian = move || (0..12).map(|_| random.random::<f32>()).sum::<f32>() - 6.0;
            let mut presence = RoomHysteresis::new(Settings::default());
            let mut lasting = [0.0; 2];
            let (mut raw, mut raw_changes, mut answers) = (None, 0, std::vec::Vec::new());
            for second in 1..=600 {
                let scan = [0, 1].map(|beacon| {
                    lasting[beacon] = 0.7 * lasting[beacon] + 1.5 * gaussian();
                    Some(-68.0 + lasting[beacon] + 1.5 * gaussian())
                });
                let p = svm.probabilities(&scan).expect("heard");
                let room = likeliest(&p).map(|(room, _)| room);
                raw_changes += u32::from(raw.is_some() && raw != room);
                raw = room;
                answers.push(presence.step(second * SECOND, Some(&p)));
            }
            let changes = answers.windows(2).filter(|pair| pair[0] != pair[1]).count();
            assert!(raw_changes > 100, "seed {seed}: {raw_changes}");
            assert!(changes <= 4, "seed {seed}: {changes}, where the classifier has {raw_changes}");
        }
    }
}
