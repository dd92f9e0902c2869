//! The positions and data that tags tell in their polls, on their way to a host: anchors with a cable report them.

use std::collections::{HashMap, VecDeque};

use baliza_report::percentile;
use wire::uwb::native::PolledPosition;

/// The last rounds of a tag that are kept: a poll tells no older position. Twice as many, because an anchor's report may
/// be read before that of the tag.
const KEPT_ROUNDS: usize = 2 * PolledPosition::OLDEST as usize;

/// What became of the positions and data that tags told.
#[derive(Default)]
pub(super) struct Uplink {
    /// The numbers of each tag's data that have not arrived, oldest first.
    data: HashMap<u16, VecDeque<u8>>,
    data_arrived: usize,
    data_lost: usize,
    /// By tag, in the order of its rounds.
    positions: HashMap<u16, VecDeque<Position>>,
    /// How long each took that arrived, seconds.
    delays_s: Vec<f64>,
    lost: usize,
}

/// A position of a round.
struct Position {
    round: u16,
    /// When the tag reported it, seconds …
    found_s: Option<f64>,
    /// … and when the first anchor with a cable did.
    arrived_s: Option<f64>,
}

impl Position {
    /// Seconds from the tag's report to that of an anchor.
    fn delay_s(&self) -> Option<f64> {
        // The tag's own report may come a little later than its poll.
        Some((self.arrived_s? - self.found_s?).max(0.0))
    }
}

impl Uplink {
    /// A tag that tells its positions found one.
    pub(super) fn found(&mut self, tag: u16, round: u16, t_s: f64) {
        self.position(tag, round).found_s = Some(t_s);
    }

    /// An anchor with a cable reported a tag's position of this round.
    pub(super) fn arrived(&mut self, tag: u16, round: u16, t_s: f64) {
        let earliest_s = &mut self.position(tag, round).arrived_s;
        *earliest_s = Some(earliest_s.map_or(t_s, |earlier_s| earlier_s.min(t_s)));
    }

    /// A tag's user sends data, which the tag takes under this number, or refuses.
    pub(super) fn sends_data(&mut self, tag: u16, number: Option<u8>) {
        let Some(number) = number else {
            self.data_lost += 1;
            return;
        };
        let waiting = self.data.entry(tag).or_default();
        // The numbers have come round.
        let before = waiting.len();
        waiting.retain(|other| *other != number);
        self.data_lost += before - waiting.len();
        waiting.push_back(number);
    }

    /// An anchor with a cable reported a tag's data of this number.
    pub(super) fn data_arrived(&mut self, tag: u16, number: u8) {
        let Some(waiting) = self.data.get_mut(&tag) else { return };
        if let Some(place) = waiting.iter().position(|other| *other == number) {
            waiting.remove(place);
            self.data_arrived += 1;
        }
    }

    /// The share of the data that arrived. A tag's last data count only if they arrived. `None` without data.
    pub(super) fn data_share(&self) -> Option<f64> {
        let waiting: usize = self.data.values().map(|waiting| waiting.len().saturating_sub(1)).sum();
        let sent = self.data_arrived + self.data_lost + waiting;
        (sent > 0).then(|| self.data_arrived as f64 / sent as f64)
    }

    /// A tag starts again, and so do the numbers of its rounds. Its last position was not told.
    pub(super) fn restart(&mut self, tag: u16) {
        let mut last = self.positions.remove(&tag).unwrap_or_default();
        last.pop_back_if(|last| last.arrived_s.is_none());
        last.iter().for_each(|position| self.count(position));
    }

    fn position(&mut self, tag: u16, round: u16) -> &mut Position {
        let full = self.positions.get_mut(&tag).filter(|of_tag| of_tag.len() > KEPT_ROUNDS);
        if let Some(oldest) = full.and_then(VecDeque::pop_front) {
            self.count(&oldest);
        }
        let of_tag = self.positions.entry(tag).or_default();
        let place = of_tag.iter().rposition(|known| known.round == round).unwrap_or_else(|| {
            of_tag.push_back(Position { round, found_s: None, arrived_s: None });
            of_tag.len() - 1
        });
        &mut of_tag[place]
    }

    fn count(&mut self, position: &Position) {
        match position.delay_s() {
            Some(delay_s) => self.delays_s.push(delay_s),
            None if position.found_s.is_some() => self.lost += 1,
            None => {}
        }
    }

    /// The share of the positions that arrived, and how long 99 % of those took at most, seconds. A tag's last position
    /// counts only if it arrived: no later poll may have told it. `None` without positions, or without any that arrived.
    pub(super) fn figures(&self) -> Option<(f64, Option<f64>)> {
        let kept = || self.positions.values().flatten();
        let newest = self.positions.values().filter_map(VecDeque::back).filter(|last| last.arrived_s.is_none()).count();
        let mut delays_s: Vec<f64> =
            self.delays_s.iter().copied().chain(kept().filter_map(Position::delay_s)).collect();
        delays_s.sort_by(f64::total_cmp);
        let found = self.lost + self.delays_s.len() + kept().filter(|position| position.found_s.is_some()).count();
        let counted = found - newest;
        let p99_s = (!delays_s.is_empty()).then(|| percentile(&delays_s, 0.99));
        (counted > 0).then(|| (delays_s.len() as f64 / counted as f64, p99_s))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_and_delays_by_hand() {
        let mut uplink = Uplink::default();
        assert_eq!(uplink.figures(), None);
        uplink.found(1, 7, 1.0);
        // It was not told yet.
        assert_eq!(uplink.figures(), None);
        uplink.found(2, 7, 1.0);
        uplink.found(2, 8, 2.0);
        assert_eq!(uplink.figures(), Some((0.0, None)), "nothing has arrived");
        let mut uplink = Uplink::default();
        uplink.found(1, 7, 1.0);
        for (round, found_s, arrived_s) in [(8, 2.0, Some(2.5)), (9, 3.0, None), (10, 4.0, Some(4.25))] {
            uplink.found(1, round, found_s);
            if let Some(arrived_s) = arrived_s {
                // Another anchor reports it later.
                uplink.arrived(1, round, arrived_s + 0.5);
                uplink.arrived(1, round, arrived_s);
            }
        }
        uplink.found(1, 11, 5.0);
        // Two of the four before the last: 99 % of the way from 0.25 to 0.5 s.
        let (share, p99_s) = uplink.figures().expect("positions");
        assert!(share == 0.5 && p99_s.is_some_and(|p99_s| (p99_s - 0.4975).abs() < 1e-12), "{share} {p99_s:?}");
    }

    #[test]
    fn data_count_once_and_refused_ones_are_lost() {
        let mut uplink = Uplink::default();
        assert_eq!(uplink.data_share(), None);
        (0..4).for_each(|number| uplink.sends_data(1, Some(number)));
        for number in [0, 0, 2] {
            uplink.data_arrived(1, number);
        }
        // Two of three; the fourth may be on its way.
        assert_eq!(uplink.data_share(), Some(2.0 / 3.0));
        uplink.sends_data(1, None);
        assert_eq!(uplink.data_share(), Some(2.0 / 4.0));
        // Number 1 comes again: the first one was lost, the new one arrives. The tag that knows nobody counts for nothing.
        uplink.sends_data(1, Some(1));
        uplink.data_arrived(1, 1);
        uplink.data_arrived(2, 1);
        assert_eq!(uplink.data_share(), Some(3.0 / 5.0));
    }

    #[test]
    fn positions_count_once_after_many_rounds_and_after_a_restart() {
        let mut uplink = Uplink::default();
        for round in 0..1000_u16 {
            // An anchor's report may be read first.
            if round % 2 == 0 {
                uplink.arrived(1, round, f64::from(round) + 0.5);
            }
            uplink.found(1, round, f64::from(round));
        }
        uplink.found(1, 1000, 1000.0);
        assert_eq!(uplink.figures(), Some((0.5, Some(0.5))));
        uplink.restart(1);
        // The same numbers again: 500 of 1,000 and one of one.
        uplink.arrived(1, 2, 1002.0);
        uplink.found(1, 2, 1001.5);
        assert_eq!(uplink.figures(), Some((501.0 / 1001.0, Some(0.5))));
    }
}
