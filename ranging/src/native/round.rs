//! A round as its initiator, a tag or an anchor, sees it: one poll, then a response in each slot of the named anchors,
//! then perhaps a final.
//!
//! In single-sided ranging, a response gives a range at once. In double-sided ranging, an anchor reports in its next
//! response when it received the final. So a round's ranges are complete and reported one round later. If the final or
//! the next response was lost, the range is the single-sided one of the same response.

use heapless::Vec;
use positioning_core::Real;

use super::anchor_table::{AnchorTable, Team};
use super::authentication::SealedPoll;
use super::timing::Timing;
use super::{MAX_ROUND, STAMP_DEVIATION_TICKS};
use crate::exchange::{Action, Range, Round};
use crate::time::METRES_PER_TICK;
use crate::tof::{double_sided_asymmetric, single_sided_corrected};
use crate::{RadioDuration, RadioInstant, RangeBias, RxFrame, Start};
use wire::uwb::layout::{Layout, Scheme};
use wire::uwb::native::{Asked, Distance, FinalReceived, Poll, Response, UserData};

/// The current round, or the last one.
#[derive(Clone, Debug)]
pub struct RoundState {
    number: u16,
    poll_tx: RadioInstant,
    team: Team,
    /// Whether its anchors take turns in the last slot.
    turns: bool,
    /// The scheme of this round.
    scheme: Scheme,
    /// Places in the team whose response may still come.
    pending: u8,
    /// The anchors that are to relay what polls carry, the better one first …
    relays: [Option<u16>; 2],
    /// … and the place in the team that one of them had before it changed with the first one.
    relay_from: usize,
    /// How many anchors this round asks: the first ones of the team.
    asked: u8,
    /// It is a blink.
    is_blink: bool,
    /// The slot in which the first of them answers.
    first_slot: u8,
    /// Data for the next poll …
    data: Option<UserData>,
    /// … and which ones the last one carried.
    sent_data: Option<(bool, u8)>,
    /// Its poll, in a network with a key.
    sealed: Option<SealedPoll>,
    /// Responses of this round.
    answers: Vec<Answer, MAX_ROUND>,
    /// Departure of its final.
    final_tx: Option<RadioInstant>,
    /// The double-sided round before, whose ranges are complete at the end of this one.
    former: Former,
    ranges: Vec<Range, MAX_ROUND>,
}

/// The result of a response.
#[derive(Clone, Copy, Debug)]
struct Answer {
    /// The first half's interval at the tag, poll TX to response RX …
    round1: RadioDuration,
    /// … and at the anchor, poll RX to response TX.
    reply1: RadioDuration,
    /// Arrival of the response.
    rx_time: RadioInstant,
    /// Bias of a range by its received power, metres.
    bias_m: f32,
    /// The single-sided range.
    range: Range,
}

/// The round before.
#[derive(Clone, Debug, Default)]
struct Former {
    number: u16,
    poll_tx: RadioInstant,
    asked: u8,
    final_tx: Option<RadioInstant>,
    answers: Vec<Answer, MAX_ROUND>,
}

impl RoundState {
    /// No round yet.
    #[inline(always)]
    pub fn new() -> Self {
        Self {
            number: 0,
            poll_tx: RadioInstant::default(),
            team: Team::new(),
            turns: false,
            scheme: Scheme::SingleSided,
            pending: 0,
            relays: [None; 2],
            relay_from: 0,
            asked: 0,
            is_blink: false,
            first_slot: 0,
            data: None,
            sent_data: None,
            sealed: None,
            answers: Vec::new(),
            final_tx: None,
            former: Former::default(),
            ranges: Vec::new(),
        }
    }

    /// Sets the anchors of the next rounds, in the order of their slots, and those of them that are to relay what polls
    /// carry.
    pub fn set_team(&mut self, team: Team, relays: [Option<u16>; 2]) {
        (self.team, self.relays, self.relay_from) = (team, relays, 0);
        let turn = usize::from(self.number).checked_rem(self.team.len()).unwrap_or(0);
        if self.turns {
            self.team.rotate_left(turn);
        }
    }

    /// Sets whether anchors take turns in the last slot, after whose response no other frame is awaited.
    pub fn set_turns(&mut self, turns: bool) {
        self.turns = turns;
    }

    /// Which data the last poll carried, once.
    pub fn take_sent_data(&mut self) -> Option<(bool, u8)> {
        self.sent_data.take()
    }

    /// Sets what the next poll carries beside.
    pub fn set_data(&mut self, data: Option<UserData>) {
        self.data = data;
    }

    /// How many slots for responses the next round needs, none without anchors.
    pub fn slots(&self) -> usize {
        if self.data.is_some() { self.most_slots() } else { self.team.len() }
    }

    /// The same for a round with data.
    pub fn most_slots(&self) -> usize {
        match self.team.len() {
            0 => 0,
            anchors => (anchors + 1).min(MAX_ROUND),
        }
    }

    /// How many anchors this round asks.
    pub fn asked(&self) -> u8 {
        self.asked
    }

    /// The slot of the anchor in this place of the team.
    fn slot_of(&self, place: usize) -> usize {
        usize::from(self.first_slot) + place
    }

    /// This node's clock was restarted: no interval reaches across.
    pub fn forget(&mut self) {
        self.final_tx = None;
        self.former.forget();
        self.answers.clear();
    }

    /// The next round's poll. With data it asks one anchor fewer, if they fill all slots.
    pub fn begin(&mut self, anchors: &mut AnchorTable, scheme: Scheme, wish: Layout, tell_distances: bool) -> Poll {
        match self.scheme {
            // Its ranges have been reported.
            Scheme::SingleSided => self.former.forget(),
            Scheme::DoubleSided => {
                self.former.answers.clone_from(&self.answers);
                (self.former.number, self.former.poll_tx) = (self.number, self.poll_tx);
                (self.former.asked, self.former.final_tx) = (self.asked, self.final_tx);
            }
        }
        self.answers.clear();
        self.final_tx = None;
        self.number = self.number.wrapping_add(1);
        self.scheme = scheme;
        if !self.team.is_empty() {
            self.team.swap(0, core::mem::take(&mut self.relay_from));
            self.team.rotate_left(self.turns.into());
        }
        (self.first_slot, self.is_blink) = (self.data.is_some().into(), false);
        self.asked = self.team.len().min(MAX_ROUND - self.slot_of(0)) as u8;
        // Who is in the last slot in its turn stays there.
        let candidates = self.team.get(..usize::from(self.asked).saturating_sub(self.turns.into())).unwrap_or_default();
        let place_of = |relay: &u16| candidates.iter().position(|asked| asked == relay);
        if let Some(place) = self.relays.iter().flatten().find_map(place_of) {
            self.team.swap(0, place);
            self.relay_from = place;
        }
        self.ranges.clear();
        self.pending = match usize::from(self.asked) {
            0 => 0,
            places => u8::MAX >> MAX_ROUND.saturating_sub(places),
        };
        let ask = |&address: &u16| {
            let known = anchors.get_mut(address).and_then(|anchor| anchor.distance_m);
            let distance = match (tell_distances, known) {
                (false, _) => Distance::Unsent,
                (true, None) => Distance::Unknown,
                (true, Some(metres)) => Distance::from_metres(metres),
            };
            Asked { address, distance }
        };
        let asked = self.team.iter().take(self.asked.into()).map(ask).collect();
        Poll { round: self.number, wish, anchors: asked, position: None, data: self.data, part: None }
    }

    /// The next blink, which is this part of its slot, and asks an anchor or nobody. It measures nothing.
    pub fn begin_blink(&mut self, part: u8, asked: Option<u16>, wish: Layout) -> Poll {
        self.former.forget();
        self.answers.clear();
        self.number = self.number.wrapping_add(1);
        self.scheme = Scheme::SingleSided;
        (self.team, self.relay_from) = (asked.into_iter().collect(), 0);
        self.asked = self.team.len() as u8;
        (self.pending, self.is_blink) = (self.asked, true);
        let anchors = self.team.iter().map(|&address| Asked { address, distance: Distance::Unsent }).collect();
        let blink = Poll { round: self.number, wish, anchors, position: None, data: self.data, part: Some(part) };
        self.first_slot = blink.first_slot() as u8;
        blink
    }

    /// The poll was written.
    pub fn seal(&mut self, sealed: Option<SealedPoll>) {
        self.sealed = sealed;
    }

    /// The poll, in a network with a key.
    pub fn sealed(&self) -> Option<&SealedPoll> {
        self.sealed.as_ref()
    }

    /// The poll has left.
    pub fn sent(&mut self, departure: RadioInstant) {
        self.poll_tx = departure;
        if let Some(data) = self.data.take() {
            self.sent_data = Some(data.id());
        }
    }

    /// The final has left.
    pub fn ended(&mut self, departure: RadioInstant) {
        self.final_tx = Some(departure);
    }

    /// The round that a final must end, if the scheme has a final and an anchor answered.
    pub fn to_end(&self) -> Option<u16> {
        (self.scheme == Scheme::DoubleSided && self.final_tx.is_none() && !self.answers.is_empty())
            .then_some(self.number)
    }

    /// No response is awaited any more.
    pub fn give_up(&mut self) {
        self.pending = 0;
    }

    /// A response for this node was received. If it belongs to this round, to an asked anchor and to its slot, it gives
    /// a range; returns its distance, metres.
    pub fn receive(
        &mut self,
        timing: &Timing,
        bias: &RangeBias,
        anchors: &mut AnchorTable,
        source: u16,
        response: Response,
        frame: &RxFrame<'_>,
    ) -> Option<f32> {
        let place = self.team.iter().position(|&anchor| anchor == source)?;
        let round1 = frame.rx_time.since(self.poll_tx);
        let awaited = response.round == self.number as u8 && self.pending >> place & 1 == 1;
        if !awaited {
            return None;
        }
        let slot = self.slot_of(place);
        if !timing.is_in_slot(slot, round1) || !timing.is_reply(slot, response.reply) {
            anchors.refused.off_slot = anchors.refused.off_slot.saturating_add(1);
            return None;
        }
        // Each copy of it takes some dozens of instructions.
        let diagnostics = &frame.diagnostics;
        let anchor = anchors.receive(source, diagnostics.rx_power_dbm)?;
        if !anchor.compare_clocks(self.poll_tx, response.poll_rx, diagnostics.clock_offset_ppm) {
            anchors.refused.carriers = anchors.refused.carriers.saturating_add(1);
            return None;
        }
        // Responses come in the order of their slots: the earlier ones have been lost.
        self.pending &= !(u8::MAX >> (MAX_ROUND - 1 - place));
        let flight = single_sided_corrected(round1, response.reply, anchor.clock.rate());
        // A single estimate of the power has an error of a decibel, which corresponds to several decibels of the power
        // itself for a strong signal.
        let bias_m = bias.metres(anchor.power_dbm());
        let distance_m = flight.metres() - bias_m;
        // Noise of two timestamps and of the rate over the reply, each counted half (see `tof`).
        let reply = response.reply.ticks() as f32;
        let stamps = 2.0 * STAMP_DEVIATION_TICKS * STAMP_DEVIATION_TICKS;
        let variance = stamps + reply * reply * anchor.clock.rate_variance();
        let deviation_m = 0.5 * METRES_PER_TICK as f32 * Real::sqrt(variance);
        let told_m = match response.last_final.and_then(|heard| self.former.complete(source, heard)) {
            Some(complete_m) => complete_m,
            None => distance_m,
        };
        anchor.distance_m = Some(told_m);
        // At most one for each slot: it fits.
        let _ = self.answers.push(Answer {
            round1,
            reply1: response.reply,
            rx_time: frame.rx_time,
            bias_m,
            range: Range {
                peer: source,
                distance_m,
                deviation_m,
                position_m: anchor.position.metres(),
                diagnostics: *diagnostics,
            },
        });
        Some(told_m)
    }

    /// The next action while responses are awaited, the last frame having ended at `ended`: more listening, or `None`
    /// when the round is over.
    pub fn await_more(&self, timing: &Timing, ended: RadioInstant) -> Option<Action<'static>> {
        let last = usize::from(self.asked).checked_sub(1)?;
        let end = timing.reply_in(self.slot_of(last)).ticks() + timing.response_tail.ticks() + timing.guard.ticks();
        let window = self.poll_tx.plus(RadioDuration::from_ticks(end)).since(ended);
        let others_may_follow = self.pending & !(1 << last) != 0;
        (self.pending != 0 && window > RadioDuration::ZERO).then_some(Action::Receive {
            start: Start::Now,
            window,
            keep_listening: others_may_follow,
        })
    }

    /// When the first response begins, and how long after the poll the last one ends.
    pub fn responses(&self, timing: &Timing) -> (RadioInstant, RadioDuration) {
        let first = timing.reply_in(self.slot_of(0)).ticks() - timing.to_rmarker.ticks();
        let last = self.slot_of(usize::from(self.asked).saturating_sub(1));
        let last = timing.reply_in(last).ticks() + timing.response_tail.ticks();
        (self.poll_tx.plus(RadioDuration::from_ticks(first)), RadioDuration::from_ticks(last + timing.guard.ticks()))
    }

    /// Each anchor of the round, and whether it answered.
    pub fn outcomes(&self) -> impl Iterator<Item = (u16, bool)> {
        let answered = |anchor| self.answers.iter().any(|answer| answer.range.peer == anchor);
        self.team.iter().take(self.asked.into()).map(move |&anchor| (anchor, answered(anchor)))
    }

    /// The round is over: records which anchors answered, and computes the ranges to report.
    pub fn close(&mut self, anchors: &mut AnchorTable) {
        for &anchor in self.team.iter().take(self.asked.into()) {
            let answered = self.answers.iter().any(|answer| answer.range.peer == anchor);
            anchors.asked(anchor, answered);
        }
        let answers = match self.scheme {
            Scheme::SingleSided => &self.answers,
            Scheme::DoubleSided => &self.former.answers,
        };
        self.ranges = answers.iter().map(|answer| answer.range).collect();
    }

    /// Whether there is anything to report: a blink has nothing, and the first double-sided round nothing yet.
    pub fn has_report(&self) -> bool {
        self.report().asked > 0 && !self.is_blink
    }

    /// The result of the round; in double-sided ranging, of the round before.
    pub fn report(&self) -> Round<'_> {
        let (number, poll, asked) = match self.scheme {
            Scheme::SingleSided => (self.number, self.poll_tx, self.asked),
            Scheme::DoubleSided => (self.former.number, self.former.poll_tx, self.former.asked),
        };
        Round { number, poll, asked, ranges: &self.ranges }
    }
}

impl Former {
    fn forget(&mut self) {
        (self.asked, self.final_tx) = (0, None);
        self.answers.clear();
    }

    /// An anchor reports when it received this round's final: its range is double-sided now. Returns its distance,
    /// metres.
    fn complete(&mut self, anchor: u16, heard: FinalReceived) -> Option<f32> {
        let final_tx = self.final_tx.filter(|_| heard.round == self.number as u8)?;
        let answer = self.answers.iter_mut().find(|answer| answer.range.peer == anchor)?;
        let (round2, reply2) = (heard.after_response, final_tx.since(answer.rx_time));
        let flight = double_sided_asymmetric(answer.round1, answer.reply1, round2, reply2)?;
        // A response to another frame, a clock restarted in between, or a forged response: both ranges differ by more
        // than clocks explain.
        let reply_m = answer.reply1.ticks() as f32 * METRES_PER_TICK as f32;
        let explained_m = 0.5 * reply_m * REPLY_DRIFT + STAMPS_M;
        if single_sided_corrected(answer.round1, answer.reply1, 0.0).apart_from(flight) > explained_m {
            return None;
        }
        answer.range.distance_m = flight.metres() - answer.bias_m;
        answer.range.deviation_m = deviation_m(answer.reply1, reply2);
        Some(answer.range.distance_m)
    }
}

/// The single-sided and the double-sided range of one response differ by half of the clocks' drift over the reply, as a
/// fraction of it …
const REPLY_DRIFT: f32 = 50e-6;
/// … and by the noise of their timestamps, metres.
const STAMPS_M: f32 = 0.5;

/// Standard deviation of an asymmetric double-sided range, metres. Let a and b be the fractions of the final's and of
/// the response's reply in the sum of both. Then the flight moves by a/2 of the timestamp of the poll, ½ of that of the
/// response, and b/2 of that of the final. These are the derivatives of the formula of the DW1000 user manual, 12.3.2,
/// for a flight that is short compared with the replies.
fn deviation_m(reply1: RadioDuration, reply2: RadioDuration) -> f32 {
    let [reply1, reply2] = [reply1, reply2].map(|reply| reply.ticks().max(1) as f32);
    let [a, b] = [reply2, reply1].map(|reply| reply / (reply1 + reply2));
    0.5 * STAMP_DEVIATION_TICKS * METRES_PER_TICK as f32 * Real::sqrt(1.0 + a * a + b * b)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The anchors in the last slot of `rounds` rounds. In each superframe the team is chosen again.
    fn last_of(turns: bool, rounds: usize) -> std::vec::Vec<u16> {
        let (mut exchange, mut anchors) = (RoundState::new(), AnchorTable::new());
        exchange.set_turns(turns);
        let mut last = std::vec::Vec::new();
        for _ in 0..rounds {
            exchange.set_team([5, 6, 7].into_iter().collect(), [None; 2]);
            let poll = exchange.begin(&mut anchors, Scheme::SingleSided, Layout::LEAST, false);
            last.extend(poll.anchors.last().map(|asked| asked.address));
        }
        last
    }

    #[test]
    fn who_relays_is_named_first_except_in_its_turn_in_the_last_slot() {
        for turns in [false, true] {
            let (mut exchange, mut anchors) = (RoundState::new(), AnchorTable::new());
            exchange.set_turns(turns);
            exchange.set_team([5, 6, 7, 8].into_iter().collect(), [Some(7), Some(6)]);
            let mut last = std::vec::Vec::new();
            for _ in 0..8 {
                let poll = exchange.begin(&mut anchors, Scheme::SingleSided, Layout::LEAST, false);
                let named: std::vec::Vec<u16> = poll.anchors.iter().map(|asked| asked.address).collect();
                last.push(named[3]);
                assert_eq!(named[0], if named[3] == 7 { 6 } else { 7 }, "{named:?}");
                assert!([5, 6, 7, 8].iter().all(|anchor| named.contains(anchor)), "{named:?}");
            }
            let expected = if turns { [5, 6, 7, 8, 5, 6, 7, 8] } else { [8; 8] };
            assert_eq!(last, expected);
        }
    }

    #[test]
    fn anchors_take_turns_in_being_the_last_where_that_is_wanted() {
        assert_eq!(last_of(false, 4), [7; 4]);
        assert_eq!(last_of(true, 7), [5, 6, 7, 5, 6, 7, 5]);
        // Several rounds in a superframe continue where the last one ended.
        let (mut exchange, mut anchors) = (RoundState::new(), AnchorTable::new());
        exchange.set_turns(true);
        exchange.set_team([5, 6, 7].into_iter().collect(), [None; 2]);
        let mut begin = || exchange.begin(&mut anchors, Scheme::SingleSided, Layout::LEAST, false);
        let firsts = [(); 4].map(|()| begin().anchors[0].address);
        assert_eq!(firsts, [6, 7, 5, 6]);
        exchange.set_team(Team::new(), [None; 2]);
        let nobody = exchange.begin(&mut anchors, Scheme::SingleSided, Layout::LEAST, false);
        assert_eq!(nobody.anchors.len(), 0);
    }
}
