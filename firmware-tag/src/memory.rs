//! Ranges of a moment ago: where an answer was lost, the anchor's last range stands in, its deviation enlarged by the way a
//! walking tag may have gone since. In flows a round, out flow the ranges to solve with.

use heapless::Vec;
use positioning_core::{MAX_ANCHORS, Real};
use ranging::exchange::{Range, Round};
use ranging::{RadioDuration, RadioInstant};

/// Older ranges stand in for nothing.
const OLDEST: RadioDuration = RadioDuration::from_micros(50_000);
/// The pace of a tag, metres a second: a brisk walk.
const PACE_M_PER_S: f32 = 1.5;

/// The last range to each anchor.
#[derive(Clone, Debug, Default)]
pub struct Memory {
    /// In the order of rounds, the youngest last.
    last: Vec<(Range, RadioInstant), MAX_ANCHORS>,
}

impl Memory {
    /// The ranges of `round`, and behind them so many remembered ones, the youngest first, that there are as many as anchors
    /// were asked. A round that brought nothing is not helped: its position would be the last one again.
    pub fn complete(&mut self, round: &Round<'_>) -> Vec<Range, MAX_ANCHORS> {
        let mut ranges: Vec<Range, MAX_ANCHORS> = round.ranges.iter().take(MAX_ANCHORS).copied().collect();
        let age = |taken: RadioInstant| round.poll.since(taken);
        self.last.retain(|(range, taken)| {
            let fresh = round.ranges.iter().any(|new| new.peer == range.peer);
            !fresh && age(*taken) > RadioDuration::ZERO && age(*taken) <= OLDEST
        });
        if !ranges.is_empty() {
            let missing = usize::from(round.asked).saturating_sub(ranges.len());
            for (range, taken) in self.last.iter().rev().take(missing) {
                let gone_m = PACE_M_PER_S * 1.0e-6 * age(*taken).as_micros() as f32;
                let deviation_m = Real::sqrt(range.deviation_m * range.deviation_m + gone_m * gone_m);
                // Full only where more were asked than a position takes.
                let _ = ranges.push(Range { deviation_m, ..*range });
            }
        }
        for range in round.ranges {
            if self.last.is_full() {
                self.last.remove(0);
            }
            let _ = self.last.push((*range, round.poll));
        }
        ranges
    }

    /// Nothing is remembered: the radio's clock has begun anew.
    pub fn forget(&mut self) {
        self.last.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ranging::Diagnostics;

    fn range(peer: u16, distance_m: f32) -> Range {
        Range { peer, distance_m, deviation_m: 0.03, position_m: None, diagnostics: Diagnostics::default() }
    }

    fn at(millis: u32) -> RadioInstant {
        RadioInstant::default().plus(RadioDuration::from_micros(1000 * millis))
    }

    fn round(poll: RadioInstant, ranges: &[Range]) -> Round<'_> {
        Round { number: 0, poll, asked: 3, ranges }
    }

    fn peers(ranges: &[Range]) -> std::vec::Vec<u16> {
        ranges.iter().map(|range| range.peer).collect()
    }

    #[test]
    fn a_lost_answer_is_stood_in_for_by_the_last_range_with_the_way_gone_since() {
        let mut memory = Memory::default();
        memory.complete(&round(at(0), &[range(1, 1.0), range(2, 2.0), range(3, 3.0)]));
        let ranges = memory.complete(&round(at(20), &[range(3, 3.1), range(1, 1.1)]));
        assert_eq!(peers(&ranges), [3, 1, 2]);
        assert_eq!((ranges[1].distance_m, ranges[1].deviation_m), (1.1, 0.03));
        // 20 ms at 1.5 m/s are 3 cm; √(0.03² + 0.03²) = 0.0424.
        assert_eq!(ranges[2].distance_m, 2.0);
        assert!((ranges[2].deviation_m - 0.0424).abs() < 1e-4, "{}", ranges[2].deviation_m);
    }

    #[test]
    fn nothing_stands_in_for_long_nor_for_a_whole_round() {
        let mut memory = Memory::default();
        memory.complete(&round(at(0), &[range(1, 1.0), range(2, 2.0), range(3, 3.0)]));
        assert_eq!(peers(&memory.complete(&round(at(10), &[]))), []);
        assert_eq!(peers(&memory.complete(&round(at(51), &[range(1, 1.0)]))), [1]);
        memory.complete(&round(at(60), &[range(2, 2.0)]));
        memory.forget();
        assert_eq!(peers(&memory.complete(&round(at(61), &[range(1, 1.0)]))), [1]);
    }

    #[test]
    fn a_full_round_is_not_added_to() {
        let mut memory = Memory::default();
        memory.complete(&round(at(0), &[range(7, 1.0), range(8, 2.0), range(9, 3.0)]));
        let ranges = memory.complete(&round(at(3), &[range(1, 1.0), range(2, 2.0), range(3, 3.0)]));
        assert_eq!(peers(&ranges), [1, 2, 3]);
    }
}
