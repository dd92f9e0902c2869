//! A round as the one who asks sees it, a tag or an anchor: one poll, then a response in each slot of those named.

use heapless::Vec;
use positioning_core::Real;

use super::neighbours::{Neighbours, Team};
use super::timing::Timing;
use super::{MAX_ROUND, STAMP_DEVIATION_TICKS};
use crate::exchange::{Action, Range, Round};
use crate::frame::native::{Asked, Distance, Poll, Response};
use crate::time::METRES_PER_TICK;
use crate::tof::single_sided_corrected;
use crate::{RadioDuration, RadioInstant, RangeBias, RxFrame, Start};

/// A response may come this much off its slot, ticks (10 µs): the way there and back, and the clocks' drift.
const SLOT_TOLERANCE_TICKS: u64 = 640_000;

/// The round in progress, or the last.
#[derive(Clone, Debug)]
pub struct Exchange {
    number: u16,
    poll_tx: RadioInstant,
    team: Team,
    /// Whether its anchors take turns in being the last.
    turns: bool,
    /// Slots of the round whose response may still come.
    pending: u8,
    ranges: Vec<Range, MAX_ROUND>,
}

impl Exchange {
    /// No round yet.
    pub fn new() -> Self {
        Self {
            number: 0,
            poll_tx: RadioInstant::default(),
            team: Team::new(),
            turns: false,
            pending: 0,
            ranges: Vec::new(),
        }
    }

    /// Names the anchors of the next rounds, in the order of their slots.
    pub fn set_team(&mut self, team: Team) {
        self.team = team;
        let turn = usize::from(self.number).checked_rem(self.team.len()).unwrap_or(0);
        if self.turns {
            self.team.rotate_left(turn);
        }
    }

    /// Whether anchors take turns in being the last, after whose response nothing is awaited.
    pub fn set_turns(&mut self, turns: bool) {
        self.turns = turns;
    }

    /// How many anchors are asked.
    pub fn asked(&self) -> usize {
        self.team.len()
    }

    /// The next round's poll.
    pub fn begin(&mut self, neighbours: &mut Neighbours, tell_distances: bool) -> Poll {
        self.number = self.number.wrapping_add(1);
        if self.turns && !self.team.is_empty() {
            self.team.rotate_left(1);
        }
        self.ranges.clear();
        self.pending = match self.team.len() {
            0 => 0,
            places => u8::MAX >> MAX_ROUND.saturating_sub(places),
        };
        let ask = |&address: &u16| {
            let known = neighbours.get_mut(address).and_then(|anchor| anchor.distance_m);
            let distance = match (tell_distances, known) {
                (false, _) => Distance::Unsent,
                (true, None) => Distance::Unknown,
                (true, Some(metres)) => Distance::from_metres(metres),
            };
            Asked { address, distance }
        };
        Poll { round: self.number, anchors: self.team.iter().map(ask).collect() }
    }

    /// The poll has left.
    pub fn sent(&mut self, departure: RadioInstant) {
        self.poll_tx = departure;
    }

    /// No response is awaited any more.
    pub fn give_up(&mut self) {
        self.pending = 0;
    }

    /// A response came for us: where it is of this round, of an anchor asked and in its slot, it makes a range: its distance, metres.
    pub fn hear(
        &mut self,
        timing: &Timing,
        bias: &RangeBias,
        neighbours: &mut Neighbours,
        source: u16,
        response: Response,
        frame: &RxFrame<'_>,
    ) -> Option<f32> {
        let slot = self.team.iter().position(|&anchor| anchor == source)?;
        let round1 = frame.rx_time.since(self.poll_tx);
        let due = timing.reply_in(slot).ticks();
        let in_slot = |time: RadioDuration| time.ticks().abs_diff(due) <= SLOT_TOLERANCE_TICKS;
        let awaited = response.round == self.number && self.pending >> slot & 1 == 1;
        if !awaited || !in_slot(round1) || !in_slot(response.reply) {
            return None;
        }
        // Responses come in the order of their slots: those before have been lost.
        self.pending &= !(u8::MAX >> (MAX_ROUND - 1 - slot));
        let diagnostics = frame.diagnostics;
        let anchor = neighbours.hear(source, diagnostics.rx_power_dbm)?;
        anchor.compare_clocks(self.poll_tx, response.poll_rx, diagnostics.clock_offset_ppm);
        let flight = single_sided_corrected(round1, response.reply, anchor.clock.rate());
        let distance_m = flight.metres() - bias.metres(diagnostics.rx_power_dbm);
        // Noise of two stamps and of the rate over the reply, each by half (see `tof`).
        let reply = response.reply.ticks() as f32;
        let stamps = 2.0 * STAMP_DEVIATION_TICKS * STAMP_DEVIATION_TICKS;
        let variance = stamps + reply * reply * anchor.clock.rate_variance();
        let deviation_m = 0.5 * METRES_PER_TICK as f32 * Real::sqrt(variance);
        anchor.distance_m = Some(distance_m);
        let range = Range { peer: source, distance_m, deviation_m, position_m: anchor.position_m, diagnostics };
        // One a slot at most: it fits.
        let _ = self.ranges.push(range);
        Some(distance_m)
    }

    /// What follows while responses are awaited, the last frame being over since `ended`: more listening, or `None` when the round
    /// is over.
    pub fn await_more(&self, timing: &Timing, ended: RadioInstant) -> Option<Action<'static>> {
        let last = self.team.len().checked_sub(1)?;
        let end = timing.reply_in(last).ticks() + timing.response_tail.ticks() + timing.guard.ticks();
        let window = self.poll_tx.plus(RadioDuration::from_ticks(end)).since(ended);
        let others_may_follow = self.pending & !(1 << last) != 0;
        (self.pending != 0 && window > RadioDuration::ZERO).then_some(Action::Receive {
            start: Start::Now,
            window,
            keep_listening: others_may_follow,
        })
    }

    /// The round is over: tells which anchors answered.
    pub fn close(&mut self, neighbours: &mut Neighbours) {
        for &anchor in &self.team {
            let answered = self.ranges.iter().any(|range| range.peer == anchor);
            neighbours.asked(anchor, answered);
        }
    }

    /// What the round gave.
    pub fn report(&self) -> Round<'_> {
        Round { number: self.number, poll: self.poll_tx, asked: self.team.len() as u8, ranges: &self.ranges }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whom so many rounds ask last, a superframe each having chosen the team anew.
    fn last_of(turns: bool, rounds: usize) -> std::vec::Vec<u16> {
        let (mut exchange, mut neighbours) = (Exchange::new(), Neighbours::new());
        exchange.set_turns(turns);
        let mut last = std::vec::Vec::new();
        for _ in 0..rounds {
            exchange.set_team([5, 6, 7].into_iter().collect());
            let poll = exchange.begin(&mut neighbours, false);
            last.extend(poll.anchors.last().map(|asked| asked.address));
        }
        last
    }

    #[test]
    fn anchors_take_turns_in_being_the_last_where_that_is_wanted() {
        assert_eq!(last_of(false, 4), [7; 4]);
        assert_eq!(last_of(true, 7), [5, 6, 7, 5, 6, 7, 5]);
        // Several rounds a superframe go on where the last one ended.
        let (mut exchange, mut neighbours) = (Exchange::new(), Neighbours::new());
        exchange.set_turns(true);
        exchange.set_team([5, 6, 7].into_iter().collect());
        let firsts = [(); 4].map(|()| exchange.begin(&mut neighbours, false).anchors[0].address);
        assert_eq!(firsts, [6, 7, 5, 6]);
        exchange.set_team(Team::new());
        assert_eq!(exchange.begin(&mut neighbours, false).anchors.len(), 0);
    }
}
