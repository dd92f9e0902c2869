//! Whether an anchor has more to pass on than fits into its sync frames.

/// An anchor asks for relay slots if it sends more entries a superframe than this in the mean, in 1/64 …
const MANY: u16 = 64 * 7 / 4;
/// … or if more than this wait in the mean …
const MANY_WAIT: u16 = 64 * 6;
/// … until fewer wait, and it sends fewer than this.
const FEW: u16 = 64 * 5 / 4;

/// What an anchor passes on in the mean.
#[derive(Clone, Copy, Debug)]
pub(super) struct Demand {
    /// Entries sent in this superframe …
    sent: u8,
    /// … and in the mean of those before, in 1/64.
    mean_sent: u16,
    /// Entries that wait in the mean, in 1/64.
    mean_waiting: u16,
    /// It asks for relay slots.
    pub wants_relay_slots: bool,
}

impl Demand {
    /// Nothing was sent yet.
    pub(super) const NONE: Self = Self { sent: 0, mean_sent: 0, mean_waiting: 0, wants_relay_slots: false };

    /// An entry is sent.
    pub(super) fn count(&mut self) {
        self.sent = self.sent.saturating_add(1);
    }

    /// `superframes` have begun, and `waiting` entries wait. `has_way`: a way to a gateway is known.
    pub(super) fn advance(&mut self, superframes: u8, waiting: usize, has_way: bool) {
        for _ in 0..superframes {
            let sent = u16::from(core::mem::take(&mut self.sent));
            self.mean_sent = self.mean_sent - self.mean_sent / 8 + 8 * sent;
            self.mean_waiting = self.mean_waiting - self.mean_waiting / 8 + 8 * waiting as u16;
        }
        let enough = if self.wants_relay_slots { FEW } else { MANY };
        self.wants_relay_slots = has_way && (self.mean_sent > enough || self.mean_waiting > MANY_WAIT);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(demand: &mut Demand, superframes: usize, sent: usize, waiting: usize) -> bool {
        for _ in 0..superframes {
            (0..sent).for_each(|_| demand.count());
            demand.advance(1, waiting, true);
        }
        demand.wants_relay_slots
    }

    #[test]
    fn who_sends_two_entries_in_each_superframe_asks_until_it_sends_one() {
        let mut demand = Demand::NONE;
        assert!(!after(&mut demand, 50, 1, 4));
        assert!(after(&mut demand, 50, 2, 0));
        // Three of two superframes are fewer than seven of four, and more than five.
        assert!((0..40).all(|i| after(&mut demand, 1, 1 + i % 2, 0)));
        assert!(!after(&mut demand, 50, 1, 0));
    }

    #[test]
    fn eight_that_wait_once_are_not_many_and_eight_in_each_superframe_are() {
        let mut demand = Demand::NONE;
        assert!(!after(&mut demand, 1, 1, 16));
        assert!(!after(&mut demand, 20, 1, 1));
        assert!(after(&mut demand, 20, 1, 8));
        demand.advance(1, 8, false);
        assert!(!demand.wants_relay_slots, "nobody takes them");
    }
}
