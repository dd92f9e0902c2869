//! The numbers that were taken, as ranges: most of them are in order.

use std::collections::BTreeMap;

/// The most ranges. Beyond that, numbers before the last ranges count as taken: each gap is a lost datagram.
const MOST_RANGES: usize = 4096;

/// A set of numbers.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct TakenNumbers {
    /// First and last of each range; no two touch.
    ranges: BTreeMap<u32, u32>,
}

impl TakenNumbers {
    /// Adds a number. Returns false if it was there.
    pub(super) fn insert(&mut self, number: u32) -> bool {
        let before = self.ranges.range(..=number).next_back().map(|(first, last)| (*first, *last));
        if before.is_some_and(|(_, last)| number <= last) {
            return false;
        }
        let mut range = (number, number);
        if let Some((first, last)) = before
            && last.checked_add(1) == Some(number)
        {
            range.0 = first;
        }
        if let Some(next) = number.checked_add(1)
            && let Some(last) = self.ranges.remove(&next)
        {
            range.1 = last;
        }
        self.ranges.insert(range.0, range.1);
        if self.ranges.len() > MOST_RANGES
            && let (Some((first, _)), Some((_, last))) = (self.ranges.pop_first(), self.ranges.pop_first())
        {
            self.ranges.insert(first, last);
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_number_counts_once_in_any_order() {
        let mut taken = TakenNumbers::default();
        let order = [5, 3, 4, 4, 0, 5, 1, 2, u32::MAX, u32::MAX - 1, 3, u32::MAX];
        let is_new = order.map(|number| taken.insert(number));
        assert_eq!(is_new, [true, true, true, false, true, false, true, true, true, true, false, false]);
        assert_eq!(taken.ranges, BTreeMap::from([(0, 5), (u32::MAX - 1, u32::MAX)]));
    }

    #[test]
    fn gaps_take_little_memory() {
        let mut taken = TakenNumbers::default();
        for number in (0..20_000).step_by(2) {
            assert!(taken.insert(number));
        }
        assert_eq!(taken.ranges.len(), MOST_RANGES);
        // The last gaps are known.
        assert!(taken.insert(19_997) && !taken.insert(19_998) && taken.insert(19_999));
    }
}
