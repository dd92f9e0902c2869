//! The key of a position: minute, tag and millisecond in one number, so that positions lie in this order.

use super::Span;
use crate::Utc;

/// Milliseconds of a minute.
pub const MINUTE_MS: i64 = 60_000;
/// Keys of a minute.
pub const MINUTE: i64 = 1 << 36;
/// Keys of a tag in a minute.
pub const TAG: i64 = 1 << 16;
/// The greatest number of a tag. The rest of the key's 63 bits holds minutes up to the year 2225.
pub const LAST_TAG: i64 = MINUTE / TAG - 1;

/// The key of a tag's position.
pub fn key(ms: i64, tag: i64) -> i64 {
    ms / MINUTE_MS * MINUTE + tag * TAG + ms % MINUTE_MS
}

/// Milliseconds since 1970.
pub fn ms_of(key: i64) -> i64 {
    key / MINUTE * MINUTE_MS + key % TAG
}

/// The tag's number.
pub fn tag_of(key: i64) -> i64 {
    key % MINUTE / TAG
}

impl Span {
    /// The stored instants in it: from (included) and to (excluded), milliseconds.
    pub(super) fn ms(self) -> (i64, i64) {
        let up = |t: Utc| t.us().div_euclid(1000) + i64::from(t.us() % 1000 > 0);
        (up(self.from), up(self.to))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_gives_back_time_and_tag_up_to_the_last_year_and_tag() {
        // The year 2200 begins 7,258,118,400 s after 1970.
        for ms in [0, 59_999, 60_000, 1_790_000_000_123, 7_258_118_400_000] {
            for tag in [1, 1000, LAST_TAG] {
                assert_eq!((ms_of(key(ms, tag)), tag_of(key(ms, tag))), (ms, tag));
            }
        }
    }

    #[test]
    fn keys_are_ordered_by_minute_then_tag_then_time() {
        let ordered = [(59_999, 1), (0, 2), (60_000, 1), (60_001, 1), (60_000, 2)];
        assert!(ordered.map(|(ms, tag)| key(ms, tag)).is_sorted());
    }

    #[test]
    fn a_span_between_milliseconds_holds_the_whole_ones_within() {
        let span = Span { from: Utc::clamped(1_001), to: Utc::clamped(3_001) };
        assert_eq!(span.ms(), (2, 4));
        assert_eq!(Span { from: Utc::clamped(1_000), to: Utc::clamped(3_000) }.ms(), (1, 3));
    }
}
