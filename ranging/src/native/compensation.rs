//! When a node corrects its antenna delays for temperature and supply: at its start, a few times while the chip warms
//! up, and then once a minute. A node receives nothing during a correction, so nodes do it at different times.

use super::spread;
use wire::serial_number::SerialNumber;

/// Superframes between the first corrections …
const SOON: u16 = 100;
/// … the number of these corrections …
const SOON_TIMES: u8 = 6;
/// … and superframes between later corrections. A node takes up to a quarter more.
const LATER: u16 = 600;

/// A node's state of the correction.
#[derive(Clone, Copy, Debug, Default)]
pub struct Compensation {
    last: Option<u16>,
    times: u8,
}

impl Compensation {
    /// Whether the node of this address is to correct in this superframe. Returns true once for each correction.
    pub fn take(&mut self, superframe: u16, address: u16) -> bool {
        let every = if self.times <= SOON_TIMES { SOON } else { LATER };
        let every = every + spread(address, 0, every / 4);
        // A node that did not ask for a whole turn of the numbers may correct later by `every`.
        let is_due = self.last.is_none_or(|last| !SerialNumber(last).is_within(every - 1, superframe));
        if is_due {
            (self.last, self.times) = (Some(superframe), self.times.saturating_add(1));
        }
        is_due
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_done_at_the_start_then_each_ten_seconds_for_a_minute_then_once_a_minute() {
        let mut compensation = Compensation::default();
        let begin = u16::MAX - 50;
        let times: std::vec::Vec<u16> = (0..2_500).filter(|n| compensation.take(begin.wrapping_add(*n), 7)).collect();
        let between: std::vec::Vec<u16> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
        assert_eq!(times.first(), Some(&0));
        assert!(between[..6].iter().all(|superframes| (100..125).contains(superframes)), "{between:?}");
        assert!(between[6..].iter().all(|superframes| (600..750).contains(superframes)), "{between:?}");
        assert!(between.len() >= 8, "{between:?}");
    }

    #[test]
    fn nodes_do_it_at_different_times() {
        let third = |address: u16| {
            let mut compensation = Compensation::default();
            (0..1_000).filter(|n| compensation.take(*n, address)).nth(2)
        };
        let times: std::collections::BTreeSet<_> = (1..9).map(third).collect();
        assert!(times.len() >= 5, "{times:?}");
    }
}
