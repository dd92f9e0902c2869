//! The data of a tag's user, which come several times: in several polls, and by several anchors.

use std::collections::VecDeque;
use std::time::Duration;

use crate::Utc;

/// The most bytes of data.
const MOST_BYTES: usize = 24;
/// The last data of a tag that are kept, to know them again. There are 256 numbers.
const KEPT: usize = 16;
/// After this time the same number and bytes are new data: of a tag that has started again.
const REPEATED_WITHIN: Duration = Duration::from_secs(60);

/// The last data of a tag.
#[derive(Debug, Default)]
pub(super) struct UserData {
    /// Oldest first.
    last: VecDeque<(u8, Vec<u8>, Utc)>,
}

impl UserData {
    /// Whether bytes can be data.
    pub(super) fn is_possible(data: &[u8]) -> bool {
        (1..=MOST_BYTES).contains(&data.len())
    }

    /// Whether the data are new; they are known from now on.
    pub(super) fn take(&mut self, t: Utc, number: u8, data: &[u8]) -> bool {
        let is_known = self.last.iter().any(|(last, bytes, at)| {
            (*last, &**bytes) == (number, data) && t < *at + REPEATED_WITHIN && *at < t + REPEATED_WITHIN
        });
        if !is_known {
            if self.last.len() >= KEPT {
                self.last.pop_front();
            }
            self.last.push_back((number, data.to_vec(), t));
        }
        !is_known
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_are_new_once() {
        let at = |seconds| Utc::clamped(1_000_000_000_000_000) + Duration::from_secs(seconds);
        let mut data = UserData::default();
        let steps: [(u64, u8, &[u8], bool); 6] = [
            (100, 7, b"open", true),
            // By another anchor, whose clock is a little behind.
            (99, 7, b"open", false),
            (101, 8, b"open", true),
            (110, 7, b"open", false),
            // A tag that has started again.
            (111, 7, b"shut", true),
            (160, 7, b"open", true),
        ];
        for (seconds, number, bytes, is_new) in steps {
            assert_eq!(data.take(at(seconds), number, bytes), is_new, "{number} at {seconds} s");
        }
        // The oldest of many are forgotten.
        (0..16).for_each(|number| assert!(data.take(at(200), number, b"many")));
        assert!(data.last.len() == KEPT && !data.take(at(200), 0, b"many"));
    }

    #[test]
    fn no_bytes_and_too_many_are_no_data() {
        assert_eq!([0, 1, 24, 25].map(|length| UserData::is_possible(&vec![0; length])), [false, true, true, false]);
    }
}
