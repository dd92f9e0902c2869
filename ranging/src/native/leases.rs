//! Which tag owns which turns of the leased slots: the coordinator's table, and every other anchor's replica of it.
//!
//! A lease lasts three terms ([`lease_entry`](super::lease_entry)). The coordinator renews it if one of its polls is
//! received in the second half of the first term, here or by an anchor that passes the poll on. Each anchor confirms it
//! to the tag during the first term, and a tag that was confirmed goes on for two. So a tag stops before the coordinator
//! gives its turns away, and no turn has two owners. A new lease is on probation until its first poll: a request costs a
//! single frame, so tags that do not exist must not keep turns.
//!
//! A tag may have two leases, while it changes from one period to another. The turns of the rarer one may be some of the
//! other's: so it can give turns back in a full network, too. A lease that its tag gives back ends only if
//! it does not poll in its turns any more: anybody can send a tag's request.
//!
//! A full network is shared in turn: while tags wait, up to one lease in eight is ended at a time, those that have lasted
//! longest first, each after its own turn. Anchors tell their tags so in responses, and pass polls on that still come.
//! Those tags ask again, and wait behind the others.
//!
//! A new coordinator goes on with its replica. What it has missed it may grant twice: then polls collide, neither lease
//! is renewed, and both tags ask again.

use heapless::{Vec, VecView};

use super::lease_entry::{Entry, RELAYED_SUPERFRAMES, Standing, Survey, TurnPlace, Waiting, free_turn, term};
use super::lease_news::LeaseNews;
use super::memory::Table;
use super::plan::most_leased;
use super::spread;
use wire::uwb::layout::Layout;
use wire::uwb::native::{Confirmation, Grant, Lease, LeasedPoll, SyncFrame, Turn, Turns};

/// From a grant to the first turn: the entry is repeated, and relayed.
const NOTICE: u16 = 4;
/// Leases on probation at a time weigh no more than this. One of whole slots weighs 100, one of a slot in n superframes
/// the n-th part, but at least 2: so 10, or 100 with a turn in ten superframes, or 500 with few turns.
const MAX_ON_PROBATION: u16 = 1000;
/// Tags that wait for a lease.
const MAX_WAITING: usize = 128;
/// Most polls are passed on within this many superframes.
const PASSED_ON_WITHIN: u16 = 4;
/// A superframe's work is bounded: leases that are looked over, and places that are searched for a free turn.
const LOOKED_OVER: usize = 32;
const SEARCHED_PLACES: usize = 4;
/// A new lease whose entry comes again after this many superframes was announced once more: its tag has asked again.
const ANNOUNCED_SUPERFRAMES: u16 = 12;
/// Slots that are leased although no lease is in them yet.
const SPARE_SLOTS: u8 = 8;
/// After all that wait were refused, they are looked at again after this many superframes, or when a lease ends.
const PAUSE: u8 = 20;
/// One in this many leases of a full network ends at a time.
const ENDING: usize = 8;

/// The leases of a network as an anchor knows them.
#[derive(Debug)]
#[cfg_attr(not(target_os = "none"), derive(Clone))]
pub struct Leases<'m> {
    /// By tag; a tag may have two.
    entries: Table<'m, VecView<Entry>>,
    on_probation: u16,
    /// For the next sync frames.
    pub news: LeaseNews,
    /// Those that have asked again come first: a request costs a single frame, and invented tags are many.
    waiting: Vec<Waiting, MAX_WAITING>,
    /// The one that waits for whom a turn is searched, the place that is searched next for rounds and for blinks, and how
    /// many were searched.
    turn_of: usize,
    cursors: [TurnPlace; 2],
    searched: u16,
    /// Superframes until those that wait are looked at again, if no lease ends before.
    pause: u8,
    /// A tag found no turn in the slots that are leased now.
    is_cramped: bool,
    /// A tag was refused since the last survey …
    has_refused: bool,
    /// … and some tag waits since.
    is_full: bool,
    survey: Survey,
    /// The last whole survey.
    known: Survey,
}

impl<'m> Leases<'m> {
    /// No leases.
    pub const fn new(entries: Table<'m, VecView<Entry>>) -> Self {
        Self {
            entries,
            on_probation: 0,
            news: LeaseNews::new(),
            waiting: Vec::new(),
            turn_of: 0,
            cursors: [TurnPlace::of_slot(0); 2],
            searched: 0,
            pause: 0,
            is_cramped: false,
            has_refused: false,
            is_full: false,
            survey: Survey::NONE,
            known: Survey::NONE,
        }
    }

    /// Another network is followed. In place: the table is large.
    pub fn clear(&mut self) {
        self.entries.clear();
        self.news.clear();
        self.waiting.clear();
        self.on_probation = 0;
        self.search_anew(0);
        (self.is_cramped, self.has_refused, self.is_full) = (false, false, false);
        (self.survey, self.known) = (Survey::NONE, Survey::NONE);
    }

    /// What tags with leases request of the layout.
    pub fn wish(&self) -> Layout {
        self.known.wish.max(self.survey.wish)
    }

    /// How many of these round slots may be leased. As long as nobody is listed, one is left for requests. Else an eighth
    /// is left to the list of members, unless there are leases in it already: these stay.
    pub fn most_slots(&self, round_slots: u8, others_use_them: bool) -> u8 {
        let all = round_slots.saturating_sub(1);
        if others_use_them { most_leased(round_slots).max(self.used_slots()).min(all) } else { all }
    }

    /// Slots up to the highest one with a lease.
    fn used_slots(&self) -> u8 {
        self.known.slots.max(self.survey.slots)
    }

    /// How many slots are to be leased of at most `most`: as many as are needed. As long as no other tag uses them, some
    /// more, for the next tags: the rest are places for requests. `now` are leased.
    pub fn wanted_slots(&self, now: u8, most: u8, others_use_them: bool) -> u8 {
        let used = self.used_slots();
        let needed = match others_use_them {
            true if self.is_cramped => now + 1,
            true => used,
            false if self.is_cramped => now + now / 2 + SPARE_SLOTS,
            // A plan that takes slots away needs notice.
            false if used < now / 4 => used + SPARE_SLOTS,
            false => now.max(used + SPARE_SLOTS),
        };
        needed.min(most)
    }

    /// A tag's leases.
    fn range_of(&self, tag: u16) -> core::ops::Range<usize> {
        let begin = self.entries.partition_point(|entry| entry.tag < tag);
        let count = self.entries.iter().skip(begin).take_while(|entry| entry.tag == tag).count();
        begin..begin + count
    }

    /// The lease of a tag for which a poll counts that may have come in these turns: of two, one may be old, or made by a
    /// forged request, and it is the one with fewer turns.
    fn rarest(&self, tag: u16, is_in: impl Fn(Turn) -> bool) -> Option<usize> {
        let candidates = self.range_of(tag).filter(|&place| is_in(self.entries[place].turn));
        candidates.max_by_key(|&place| self.entries[place].turn.period.superframes())
    }

    /// Whether a tag has a lease.
    pub fn has(&self, tag: u16) -> bool {
        !self.range_of(tag).is_empty()
    }

    /// Sets the standing of an entry, and counts those on probation.
    fn set_standing(&mut self, place: usize, standing: Standing) {
        let Some(entry) = self.entries.get_mut(place) else { return };
        let weigh = |standing| if standing == Standing::Probation { entry.weight() } else { 0 };
        let [before, after] = [entry.standing, standing].map(weigh);
        entry.standing = standing;
        self.on_probation = (self.on_probation + after).saturating_sub(before);
    }

    fn remove(&mut self, place: usize) {
        self.set_standing(place, Standing::Ending);
        if place < self.entries.len() {
            let removed = self.entries.remove(place);
            self.search_anew(removed.turn.slot);
        }
    }

    /// A turn in this slot is free again: for the one that has waited for longest.
    fn search_anew(&mut self, slot: u8) {
        (self.turn_of, self.searched, self.pause) = (0, 0, 0);
        self.cursors = self.cursors.map(|cursor| cursor.min(TurnPlace::of_slot(slot)));
    }

    /// A new lease. `None` if there are too many.
    fn insert(&mut self, tag: u16, turn: Turn, standing: Standing, number: u16) -> Option<()> {
        let place = self.range_of(tag).end;
        let entry = Entry { tag, turn, made: number, renewals: 0, standing, wish: 0, is_heard: false };
        self.entries.insert(place, entry).ok()?;
        self.on_probation += if standing == Standing::Probation { entry.weight() } else { 0 };
        self.survey.slots = self.survey.slots.max(turn.slot + 1);
        Some(())
    }

    /// A lease was renewed: granted turns are kept.
    fn renew(&mut self, place: usize, number: u16) {
        self.set_standing(place, Standing::Proven);
        if let Some(entry) = self.entries.get_mut(place) {
            entry.made = number;
            entry.renewals = entry.renewals.saturating_add(1);
        }
    }

    /// The coordinator knows of a poll. Returns whether it renews the lease.
    fn note_poll(&mut self, place: usize, number: u16) -> bool {
        let Some(entry) = self.entries.get_mut(place).filter(|entry| entry.is_due(number)) else { return false };
        if entry.has_ended() {
            (entry.standing, entry.made) = (Standing::Told, number);
            return false;
        }
        let lease = entry.lease(Grant::Kept);
        let is_announced = self.news.announce(lease);
        if is_announced {
            self.renew(place, number);
        }
        is_announced
    }

    /// A tag polled in this slot of superframe `number`, or blinked in this part of it. Returns what this anchor knows of its lease; the coordinator
    /// renews it now, other anchors pass the poll on.
    pub fn on_poll(
        &mut self,
        tag: u16,
        (slot, part): (u8, u8),
        wish: u8,
        number: u16,
        coordinates: bool,
    ) -> Confirmation {
        let in_turn = self.rarest(tag, |turn| (turn.slot, turn.part()) == (slot, part) && turn.is_in(number));
        let Some((place, entry)) = in_turn.and_then(|place| Some((place, self.entries.get_mut(place)?))) else {
            return Confirmation::None;
        };
        (entry.wish, entry.is_heard) = (wish, true);
        let confirmation = match entry.standing {
            Standing::Proven if entry.age(number) <= term(entry.turn.turns()) => Confirmation::Renewed,
            Standing::Ending | Standing::Told => Confirmation::Ended,
            Standing::Proven | Standing::Probation | Standing::Released => Confirmation::None,
        };
        let is_due = entry.is_due(number);
        if coordinates && self.note_poll(place, number) {
            return Confirmation::Renewed;
        }
        if !coordinates && is_due {
            self.news.pass_on(LeasedPoll { tag, wish });
        }
        confirmation
    }

    /// An anchor passes on a tag's poll.
    fn on_passed_poll(&mut self, poll: LeasedPoll, number: u16, coordinates: bool) {
        let range = self.range_of(poll.tag);
        self.entries[range.clone()].iter_mut().for_each(|entry| entry.is_heard = true);
        if !coordinates {
            // Anybody can pass polls on that the coordinator does not need.
            if self.entries[range].iter().any(|entry| entry.is_due(number)) {
                self.news.pass_on(poll);
            }
            return;
        }
        let came_in = |turn: Turn| (0..=PASSED_ON_WITHIN).any(|ago| turn.is_in(number.wrapping_sub(ago)));
        if let Some(place) = self.rarest(poll.tag, came_in).or(range.last()) {
            self.entries[place].wish = poll.wish;
            self.note_poll(place, number);
        }
    }

    /// A sync frame of an anchor that is farther from the coordinator passes polls on.
    pub fn on_passed_polls(&mut self, sync_frame: &SyncFrame, coordinates: bool) {
        for poll in &sync_frame.polls {
            self.on_passed_poll(*poll, sync_frame.superframe, coordinates);
        }
    }

    /// A sync frame of an anchor that is nearer to the coordinator has news of leases: keeps and relays what is new.
    pub fn learn(&mut self, sync_frame: &SyncFrame) {
        for lease in &sync_frame.leases {
            let number = sync_frame.superframe;
            let known = self.range_of(lease.tag).find(|&place| self.entries[place].turn == lease.turn);
            let age = known.map(|place| self.entries[place].age(number));
            // Each entry is repeated, and comes from several anchors.
            let is_news = match (lease.grant, known, age) {
                (Grant::Ended, None, _) => false,
                (Grant::Ended, Some(place), _) => {
                    let is_news = self.entries[place].standing != Standing::Ending;
                    self.set_standing(place, Standing::Ending);
                    is_news
                }
                (Grant::Refused, ..) => !self.news.is_announced(lease),
                (_, None, _) => {
                    self.forget_unproven(lease.tag);
                    self.forget_others(lease.tag, lease.turn);
                    self.make_room(lease.tag, number);
                    let standing = if lease.grant == Grant::New { Standing::Probation } else { Standing::Proven };
                    self.insert(lease.tag, lease.turn, standing, number).is_some()
                }
                (Grant::New, Some(_), Some(age)) if age < ANNOUNCED_SUPERFRAMES => false,
                (Grant::New, Some(place), _) => {
                    self.entries[place].made = number;
                    true
                }
                (Grant::Kept, Some(place), Some(age)) => {
                    let is_news = self.entries[place].standing != Standing::Proven || age >= RELAYED_SUPERFRAMES;
                    if is_news {
                        self.renew(place, number);
                    }
                    is_news
                }
                (Grant::Kept, Some(_), None) => false,
            };
            if is_news {
                let _ = self.news.announce(*lease);
            }
        }
    }

    /// In a full table a lease of which no poll is known gives way, a random one: it may be forged.
    fn make_room(&mut self, tag: u16, number: u16) {
        if !self.entries.is_full() {
            return;
        }
        let known = self.entries.len();
        let from = usize::from(spread(tag, number, known as u16));
        if let Some(place) = (from..known).chain(0..from).find(|&place| !self.entries[place].is_heard) {
            self.remove(place);
        }
    }

    /// The coordinator has given these turns to a tag: leases of other tags in them are those of another coordinator, or
    /// have ended unnoticed.
    #[inline(never)]
    fn forget_others(&mut self, tag: u16, turn: Turn) {
        for place in (0..self.entries.len()).rev() {
            if self.entries[place].tag != tag && self.entries[place].turn.meets(turn) {
                self.remove(place);
            }
        }
    }

    /// A tag's lease on probation is replaced by another.
    fn forget_unproven(&mut self, tag: u16) {
        for place in self.range_of(tag).rev() {
            if self.entries[place].standing == Standing::Probation {
                self.remove(place);
            }
        }
    }

    /// To the coordinator: a tag requests turns. `is_passed_on`: another anchor has received the request.
    pub fn request(&mut self, tag: u16, turns: Turns, number: u16, is_passed_on: bool) {
        let known = self.range_of(tag).find(|&place| {
            let entry = &self.entries[place];
            entry.turn.turns() == turns && !entry.has_ended() && !entry.is_over(number)
        });
        if let Some(place) = known {
            let entry = &mut self.entries[place];
            entry.made = number;
            // Anchors that missed a renewal, or were told of a false end, learn of it.
            let lease = entry.lease(if entry.standing == Standing::Proven { Grant::Kept } else { Grant::New });
            self.news.announce_once(lease);
            return;
        }
        self.wait(tag, turns, number, is_passed_on);
        if self.is_full {
            self.announce_refusal(tag, turns);
        }
    }

    /// A tag waits for turns, behind those that have asked again, as long as it has asked only once.
    fn wait(&mut self, tag: u16, turns: Turns, number: u16, is_passed_on: bool) {
        let insistent = self.waiting.iter().take_while(|waiting| waiting.insists).count();
        if let Some(place) = self.waiting.iter().position(|waiting| waiting.tag == tag) {
            self.waiting[place].turns = turns;
            // Several anchors pass one request on. In a full network all tags ask again, and the order stays.
            if place >= insistent && !is_passed_on && !self.is_full {
                self.waiting[place].insists = true;
                self.waiting[insistent..=place].rotate_right(1);
                self.searched = if insistent == self.turn_of { 0 } else { self.searched };
            }
        } else if self.waiting.push(Waiting { tag, turns, insists: false }).is_err() {
            // Too many wait. The new one replaces one of them, but not the first. That one asks again.
            let from = if insistent < MAX_WAITING { insistent.max(1) } else { 1 };
            let place = from + usize::from(spread(tag, number, (MAX_WAITING - from) as u16));
            (self.waiting[place].tag, self.waiting[place].turns) = (tag, turns);
        }
    }

    /// To the coordinator: a tag needs no leases any more. They end, unless it polls in their turns.
    pub fn release(&mut self, tag: u16, number: u16) {
        self.waiting.retain(|waiting| waiting.tag != tag);
        self.turn_of = 0;
        for place in self.range_of(tag) {
            if self.entries[place].standing != Standing::Released {
                self.set_standing(place, Standing::Released);
                self.entries[place].made = number;
            }
        }
    }

    /// The work of a superframe: ends the leases that are over. `slots` are leased.
    pub fn look_over(&mut self, number: u16, slots: u8) {
        for _ in 0..LOOKED_OVER {
            let Some(entry) = self.entries.get(self.survey.at) else {
                self.end_survey();
                break;
            };
            if entry.is_over(number) || entry.turn.slot >= slots {
                self.remove(self.survey.at);
                continue;
            }
            let survey = &mut self.survey;
            if entry.standing == Standing::Proven {
                survey.wish = survey.wish.max(Layout::from_tag_byte(entry.wish));
                if entry.has_had_its_turn() && survey.served.is_none_or(|(_, renewals)| renewals < entry.renewals) {
                    survey.served = Some((entry.tag, entry.renewals));
                }
            }
            // Invented tags do not drive out those that poll.
            let is_unsettled = entry.standing == Standing::Probation || entry.has_ended();
            survey.unsettled += usize::from(is_unsettled);
            survey.slots = survey.slots.max(entry.turn.slot + 1);
            survey.at += 1;
        }
    }

    fn end_survey(&mut self) {
        let Survey { unsettled, served, .. } = self.survey;
        self.known = core::mem::replace(&mut self.survey, Survey::NONE);
        let is_refusing = core::mem::take(&mut self.has_refused);
        let Some((tag, _)) = served.filter(|_| is_refusing && unsettled < (self.entries.len() / ENDING).max(1)) else {
            return;
        };
        for place in self.range_of(tag) {
            let lease = self.entries[place].lease(Grant::Ended);
            if self.entries[place].standing == Standing::Proven && self.news.announce(lease) {
                self.set_standing(place, Standing::Ending);
            }
        }
    }

    /// The coordinator's work: grants turns in the first `slots` round slots to those that wait, in superframe `number`.
    /// Up to `most` slots may be leased.
    pub fn grant(&mut self, number: u16, slots: u8, most: u8) {
        self.is_cramped &= !self.waiting.is_empty();
        self.is_full &= !self.waiting.is_empty();
        self.pause = self.pause.saturating_sub(1);
        if self.pause > 0 {
            return;
        }
        for _ in 0..SEARCHED_PLACES {
            let Some(&Waiting { tag, turns, .. }) = self.waiting.get(self.turn_of) else {
                self.pause = if self.turn_of > 0 { PAUSE } else { 0 };
                self.turn_of = 0;
                return;
            };
            if self.on_probation >= MAX_ON_PROBATION || self.news.is_full() {
                self.is_cramped = false;
                return;
            }
            self.make_room(tag, number);
            let Turns { period, are_blinks } = turns;
            if self.searched >= TurnPlace::count(are_blinks, slots) || self.entries.is_full() {
                // More slots may be leased with notice. Until then this tag waits, and the others with it.
                (self.is_cramped, self.searched) = (true, 0);
                if slots >= most {
                    self.refuse(tag, turns);
                }
                return;
            }
            let cursor = &mut self.cursors[usize::from(are_blinks)];
            let place = cursor.for_turns(are_blinks, slots);
            match free_turn(&self.entries, tag, place, period, number.wrapping_add(NOTICE)) {
                Some(turn) => {
                    self.waiting.remove(self.turn_of);
                    (*cursor, self.searched, self.is_cramped) = (place, 0, false);
                    self.forget_unproven(tag);
                    if self.insert(tag, turn, Standing::Probation, number).is_some() {
                        self.news.announce(Lease { tag, turn, grant: Grant::New });
                    }
                }
                None => (*cursor, self.searched) = (place.next(), self.searched + 1),
            }
        }
    }

    /// No turn is free: the tag is told so. Another one may want turns that are.
    fn refuse(&mut self, tag: u16, turns: Turns) {
        (self.has_refused, self.is_full) = (true, true);
        self.turn_of += 1;
        self.announce_refusal(tag, turns);
    }

    /// A tag that is not told asks again.
    fn announce_refusal(&mut self, tag: u16, Turns { period, are_blinks }: Turns) {
        if self.news.has_room_for_refusals() {
            let turn = Turn::new(0, are_blinks.into(), period, 0);
            self.news.announce_once(Lease { tag, turn, grant: Grant::Refused });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::native::memory::AnchorTables;
    use std::vec::Vec;
    use wire::uwb::native::{MAX_BLINKS, Period};

    fn every(superframes: u16) -> Turns {
        Turns::rounds(Period::at_most(superframes))
    }

    fn leases() -> Leases<'static> {
        Leases::new(AnchorTables::default().leases)
    }

    /// A coordinator and a relay that receives all its sync frames, and which tags poll where.
    struct Network {
        coordinator: Leases<'static>,
        relay: Leases<'static>,
        number: u16,
        slots: u8,
    }

    impl Network {
        fn new(slots: u8) -> Self {
            Self { coordinator: leases(), relay: leases(), number: 0, slots }
        }

        fn request(&mut self, tag: u16, superframes: u16) {
            self.coordinator.request(tag, every(superframes), self.number, false);
        }

        fn at(&self) -> SyncFrame {
            SyncFrame { superframe: self.number, leased: self.slots, ..crate::native::blank_sync_frame() }
        }

        /// The superframe's sync frames. Returns what the coordinator's says.
        fn superframe(&mut self) -> SyncFrame {
            self.number = self.number.wrapping_add(1);
            self.coordinator.look_over(self.number, self.slots);
            self.relay.look_over(self.number, self.slots);
            self.coordinator.grant(self.number, self.slots, self.slots);
            let mut sync_frame = self.at();
            self.coordinator.news.fill(&mut sync_frame);
            self.relay.learn(&sync_frame);
            let mut relayed = self.at();
            self.relay.news.fill(&mut relayed);
            self.coordinator.on_passed_polls(&relayed, true);
            sync_frame
        }

        fn turns(&self) -> Vec<(u16, Turn)> {
            self.coordinator.entries.iter().map(|entry| (entry.tag, entry.turn)).collect()
        }

        /// In this superframe these tags poll in their turns, and the relay alone receives them. Returns those that it
        /// confirms.
        fn polls_at_relay(&mut self, polls: impl Fn(u16) -> bool) -> Vec<u16> {
            let due = self.turns().into_iter().filter(|(tag, turn)| polls(*tag) && turn.is_in(self.number));
            let due: Vec<_> = due.collect();
            let number = self.number;
            due.into_iter()
                .filter(|(tag, turn)| {
                    self.relay.on_poll(*tag, (turn.slot, turn.part()), 0, number, false) == Confirmation::Renewed
                })
                .map(|(tag, _)| tag)
                .collect()
        }
    }

    #[test]
    fn turns_of_all_periods_never_meet_and_fill_the_slots() {
        let mut network = Network::new(3);
        // Slots for 1 + 1/2 + 1/10 · 5 + 1/100 · 50 + 1/5 · 2 = 2.9 of three.
        let periods = [(1, 1), (2, 1), (10, 5), (100, 50), (5, 2)];
        let wanted: Vec<u16> = periods.iter().flat_map(|&(period, tags)| std::vec![period; tags]).collect();
        for (tag, &period) in wanted.iter().enumerate() {
            network.request(tag as u16, period);
        }
        for _ in 0..200 {
            network.superframe();
            for (tag, turn) in network.turns() {
                network.coordinator.on_poll(tag, (turn.slot, turn.part()), 0, network.number, true);
            }
        }
        let turns = network.turns();
        assert_eq!(turns.len(), wanted.len(), "{turns:?}");
        for (i, (_, turn)) in turns.iter().enumerate() {
            assert!(turn.slot < 3 && turns[..i].iter().all(|(_, other)| !turn.meets(*other)), "{turn:?}");
        }
    }

    #[test]
    fn a_lease_is_renewed_through_a_relay_and_confirmed_as_long_as_its_tag_polls() {
        let mut network = Network::new(2);
        // Numbers wrap in between.
        network.number = 65_000;
        network.request(7, 10);
        let mut confirmed = Vec::new();
        for since in 0..1500_u16 {
            network.superframe();
            if !network.polls_at_relay(|_| since < 1000).is_empty() {
                confirmed.push(since);
            }
            if since == 1000 {
                let [entry] = &network.coordinator.entries[..] else { panic!("one lease") };
                assert!(entry.standing == Standing::Proven && entry.renewals >= 15, "{entry:?}");
            }
        }
        // Every turn but the first, which proves it; at the wrap one comes early.
        assert!((97..=99).contains(&confirmed.len()), "{confirmed:?}");
        // Renewed for the last time between superframes 900 and 1000: over after 300 and 22 more.
        assert!(network.turns().is_empty() && network.relay.entries.is_empty());
    }

    /// A slot for one tag; another tag asks from superframe `asks` on. The tag stops to poll in superframe `stops`, or when
    /// it is told to. Returns when it was confirmed and told for the last time, and when the other got its turns.
    fn hand_over(asks: u16, stops: u16) -> (u16, Option<u16>, Option<u16>) {
        let mut network = Network::new(1);
        network.request(1, 1);
        let (mut confirmed, mut told, mut granted) = (0, None, None);
        for since in 0..900_u16 {
            let sync_frame = network.superframe();
            if since == asks {
                network.request(2, 1);
            }
            let turn = network.turns().into_iter().find(|(tag, _)| *tag == 1);
            if let Some((_, turn)) = turn.filter(|_| since < stops && told.is_none()) {
                match network.relay.on_poll(1, (turn.slot, turn.part()), 0, network.number, false) {
                    Confirmation::Renewed => confirmed = since,
                    Confirmation::Ended => told = Some(since),
                    Confirmation::None => {}
                }
            }
            let is_grant = |lease: &Lease| lease.tag == 2 && lease.grant == Grant::New;
            granted = granted.or(sync_frame.leases.iter().any(is_grant).then_some(since));
        }
        (confirmed, told, granted)
    }

    #[test]
    fn the_coordinator_gives_a_turn_away_only_when_its_tag_has_stopped() {
        let (confirmed, told, granted) = hand_over(300, 250);
        // The tag may go on for two terms of 100 superframes after a confirmation.
        let granted = granted.expect("the other gets the turn in the end");
        assert!(told.is_none() && (confirmed + 200..confirmed + 340).contains(&granted), "{confirmed}: {granted}");
        let (_, told, granted) = hand_over(300, 900);
        let (told, granted) = (told.expect("it is told"), granted.expect("the other gets the turn"));
        // The poll goes up, and 24 superframes pass without another.
        assert!(told < 310 && (told + 24..told + 30).contains(&granted), "{told}: {granted}");
    }

    #[test]
    fn tags_that_do_not_exist_keep_no_turns() {
        let mut network = Network::new(4);
        (0..20).for_each(|tag| network.request(tag, 10));
        let mut most = 0;
        for since in 0..600_u16 {
            (0..6).for_each(|i| network.request(0x4000 + 6 * since + i, 5120));
            for (tag, turn) in network.turns().into_iter().filter(|(tag, _)| *tag < 20) {
                if turn.is_in(network.number) {
                    network.coordinator.on_poll(tag, (turn.slot, turn.part()), 0, network.number, true);
                }
            }
            network.superframe();
            most = most.max(network.turns().iter().filter(|(tag, _)| *tag >= 20).count());
        }
        assert!((0..20).all(|tag| network.coordinator.has(tag)));
        assert!((1..=500).contains(&most), "{most}");
    }

    #[test]
    fn invented_tags_do_not_drive_out_those_that_poll() {
        for requests in [1, 3, 6] {
            let mut network = Network::new(1);
            let (mut invented, mut renewed) = (0x4000, 0);
            for since in 0..4000_u16 {
                for _ in (0..requests).filter(|_| since > 100) {
                    invented += 1;
                    network.request(invented, 10);
                }
                network.superframe();
                for tag in 0..10 {
                    let entry = network.coordinator.entries.iter().find(|entry| entry.tag == tag).copied();
                    match entry {
                        None if spread(tag, since, 12) == 0 || since < 2 => network.request(tag, 10),
                        Some(Entry { turn, standing, .. })
                            if turn.is_in(network.number) && standing != Standing::Told =>
                        {
                            let said =
                                network.coordinator.on_poll(tag, (turn.slot, turn.part()), 0, network.number, true);
                            renewed += u32::from(since >= 1000 && said == Confirmation::Renewed);
                        }
                        None | Some(_) => {}
                    }
                }
            }
            // A slot for ten tags, full. One of them gives its turns up at a time, and up to two more wait behind invented
            // tags, each of which has turns for 62 superframes: seven of ten times 300 turns.
            assert!(renewed > 2100, "{requests} a superframe: {renewed}");
        }
    }

    #[test]
    fn a_full_network_is_shared_in_turn() {
        let mut network = Network::new(1);
        // Ten turns for twelve tags that range once in ten superframes.
        let mut served = [0_u32; 12];
        let mut waited = [0_u32; 12];
        let (mut longest, mut refused, mut is_told) = (0, 0, [false; 12]);
        for since in 0..30_000_u32 {
            let sync_frame = network.superframe();
            refused += sync_frame.leases.iter().filter(|lease| lease.grant == Grant::Refused).count();
            for tag in 0..12 {
                let turn = network.coordinator.entries.iter().find(|entry| entry.tag == tag);
                let Some(Entry { turn, standing, .. }) = turn.copied() else {
                    if (since + u32::from(tag)).is_multiple_of(15) {
                        network.request(tag, 10);
                    }
                    waited[usize::from(tag)] += 1;
                    longest = longest.max(waited[usize::from(tag)]);
                    continue;
                };
                waited[usize::from(tag)] = 0;
                served[usize::from(tag)] += 1;
                // One poll that is answered tells the tag that its lease has ended.
                if turn.is_in(network.number) && !(standing == Standing::Told && is_told[usize::from(tag)]) {
                    let said = network.coordinator.on_poll(tag, (turn.slot, turn.part()), 0, network.number, true);
                    is_told[usize::from(tag)] = said == Confirmation::Ended;
                }
            }
        }
        // Ten of twelve: 25,000 superframes each. A lease lasts 600 superframes at least, and ends within 10 and 42 more,
        // one at a time: the first to wait do so for 600 and 52. Each of the two that wait is refused when it asks, every
        // 15 superframes, and every 20 superframes, each time in two sync frames.
        assert!(served.iter().all(|served| served.abs_diff(25_000) < 1_000), "{served:?}");
        assert!(longest < 600 + 2 * 52 && (6_000..14_000).contains(&refused), "{longest}, {refused} refusals");
    }

    #[test]
    fn a_release_counts_only_if_the_tag_stops() {
        for polls in [true, false] {
            let mut network = Network::new(1);
            network.request(1, 10);
            for since in 0..200 {
                network.superframe();
                if since < 50 || polls {
                    network.polls_at_relay(|_| true);
                }
                if since == 60 {
                    network.coordinator.release(1, network.number);
                }
            }
            assert_eq!(network.coordinator.has(1), polls);
        }
    }

    #[test]
    fn another_period_is_a_second_lease_until_the_first_is_over() {
        let mut network = Network::new(1);
        network.request(1, 10);
        for since in 0..600 {
            network.superframe();
            let wanted = if since < 100 { 10 } else { 50 };
            if since == 100 {
                network.request(1, 50);
            }
            for (tag, turn) in network.turns() {
                if turn.period.superframes() == wanted && turn.is_in(network.number) {
                    network.coordinator.on_poll(tag, (turn.slot, turn.part()), 0, network.number, true);
                }
            }
            let expected = match since {
                0..=100 => 1,
                110..=370 => 2,
                // Renewed between superframes 50 and 100, over after 322 more.
                440.. => 1,
                _ => continue,
            };
            assert_eq!(network.turns().len(), expected, "superframe {since}");
        }
        assert!(network.turns()[0].1.period.superframes() == 50);
    }

    #[test]
    fn slots_are_leased_as_needed_where_others_use_them() {
        let mut leases = leases();
        assert_eq!((leases.wanted_slots(0, 26, false), leases.wanted_slots(26, 26, true)), (SPARE_SLOTS, 0));
        let mut slots = 0;
        (0..25).for_each(|tag| leases.request(tag, every(10), 0, false));
        for number in 1..60 {
            leases.look_over(number, slots);
            leases.grant(number, slots, 26);
            slots = leases.wanted_slots(slots, 26, true);
            leases.news.clear();
        }
        // 25 tenths.
        assert_eq!((slots, leases.entries.len()), (3, 25));
    }

    #[test]
    fn more_slots_are_leased_than_are_used_where_nobody_else_uses_them() {
        let mut leases = leases();
        let mut slots = 0;
        let mut grown = Vec::new();
        for number in 0..300_u16 {
            if number < 100 {
                leases.request(number, every(10), number, false);
            }
            leases.look_over(number, slots);
            leases.grant(number, slots, 26);
            slots = leases.wanted_slots(slots, 26, false);
            if grown.last() != Some(&slots) {
                grown.push(slots);
            }
            leases.news.clear();
            leases.entries.iter_mut().for_each(|entry| (entry.standing, entry.made) = (Standing::Proven, number));
            leases.on_probation = 0;
        }
        // Ten slots for a hundred tenths, and the spare ones.
        assert_eq!((slots, leases.entries.len()), (10 + SPARE_SLOTS, 100), "{grown:?}");
        assert!(grown.is_sorted());
        // All but a few leave.
        leases.entries.truncate(5);
        (0..3).for_each(|_| leases.look_over(300, slots));
        assert_eq!(leases.wanted_slots(slots, 26, false), 1 + SPARE_SLOTS);
    }

    #[test]
    fn seven_blinks_share_each_turn_of_a_slot_and_rounds_have_slots_of_their_own() {
        let mut leases = leases();
        let all = 10 * u16::from(MAX_BLINKS);
        for tag in 0..all + 15 {
            // Each tenth tag ranges.
            let turns = if tag % 10 == 9 { every(10) } else { Turns::blinks(Period::at_most(10)) };
            leases.request(tag, turns, 0, false);
            for number in 1..20 {
                leases.grant(number, 26, 26);
            }
            leases.news.clear();
            leases.entries.iter_mut().for_each(|entry| entry.standing = Standing::Proven);
            leases.on_probation = 0;
        }
        let turns: Vec<Turn> = leases.entries.iter().map(|entry| entry.turn).collect();
        assert_eq!(turns.len(), usize::from(all) + 15);
        for (place, turn) in turns.iter().enumerate() {
            assert!(turns[..place].iter().all(|other| !other.meets(*turn)), "{turn:?}");
        }
        // 77 blinks of 70 a slot, and 8 rounds: the rounds take a phase of a slot from seven blinks.
        let slots = turns.iter().map(|turn| turn.slot).max();
        assert!(slots <= Some(2), "{slots:?}");
        // A blink of the fifth part renews the lease of that part, and no other's.
        let of_blink = leases.entries.iter().position(|entry| entry.turn.part() == 5).unwrap();
        let (tag, turn) = (leases.entries[of_blink].tag, leases.entries[of_blink].turn);
        let number = 1000 + turn.phase();
        leases.entries.iter_mut().for_each(|entry| entry.made = number.wrapping_sub(500));
        assert_eq!(leases.on_poll(tag, (turn.slot, 4), 0, number, true), Confirmation::None);
        assert_eq!(leases.on_poll(tag, (turn.slot, 5), 0, number, true), Confirmation::Renewed);
        // A full network says so to tags that blink, too.
        leases.request(999, Turns::blinks(Period::ONE), number, false);
        (0..40).for_each(|after| leases.grant(number + after, 3, 3));
        let mut sync_frame = crate::native::blank_sync_frame();
        leases.news.fill(&mut sync_frame);
        let refused =
            sync_frame.leases.iter().find(|lease| lease.tag == 999).map(|lease| (lease.grant, lease.turn.turns()));
        assert_eq!(refused, Some((Grant::Refused, Turns::blinks(Period::ONE))));
    }

    #[test]
    fn one_round_slot_is_left_where_nobody_is_listed_and_an_eighth_where_somebody_is() {
        let mut leases = leases();
        // 26 less 26 / 8, rounded up.
        assert_eq!([false, true].map(|others| leases.most_slots(26, others)), [25, 22]);
        // 24 slots of ten turns. A tag that is listed then takes none of them away.
        (0..240).for_each(|tag| {
            leases.request(tag, every(10), 0, false);
            (1..20).for_each(|number| {
                leases.grant(number, 25, 25);
                leases.news.clear();
            });
            leases.entries.iter_mut().for_each(|entry| entry.standing = Standing::Proven);
            leases.on_probation = 0;
        });
        (0..20).for_each(|_| leases.look_over(20, 25));
        assert_eq!(leases.entries.len(), 240);
        assert_eq!([false, true].map(|others| leases.most_slots(26, others)), [25, 24]);
        assert_eq!(leases.wanted_slots(25, leases.most_slots(26, true), true), 24);
        assert_eq!([0, 1, 2].map(|slots| leases.most_slots(slots, true)), [0, 0, 1]);
    }

    #[test]
    fn in_a_full_network_a_tag_gives_turns_back_within_its_own() {
        // Tag 1 has every other turn of the only slot, five others have the rest, and three wait.
        let mut network = Network::new(1);
        network.request(1, 2);
        let mut wanted = 2;
        for since in 0..900 {
            network.superframe();
            if since == 20 {
                (2..=9).for_each(|tag| network.request(tag, 10));
            }
            if since == 300 {
                assert_eq!(network.turns().len(), 6);
                wanted = 10;
                network.request(1, 10);
            }
            let turns = network.turns();
            let rarest =
                |tag| turns.iter().filter(|(of, _)| *of == tag).map(|(_, turn)| turn.period.superframes()).max();
            for &(tag, turn) in &turns {
                let uses = tag != 1 || turn.period.superframes() == wanted || rarest(1) == Some(2);
                if uses && turn.is_in(network.number) {
                    network.coordinator.on_poll(tag, (turn.slot, turn.part()), 0, network.number, true);
                }
            }
            if since > 300 && since % 50 == 0 {
                let without: Vec<u16> = (7..=9).filter(|tag| !network.coordinator.has(*tag)).collect();
                without.into_iter().for_each(|tag| network.request(tag, 10));
            }
        }
        let turns = network.turns();
        assert_eq!(turns.iter().map(|(tag, _)| *tag).collect::<Vec<_>>(), (1..=9).collect::<Vec<_>>(), "{turns:?}");
        assert!(turns.iter().all(|(_, turn)| turn.period.superframes() == 10), "{turns:?}");
    }

    #[test]
    fn what_tags_request_of_the_layout_is_kept_with_their_leases() {
        let mut network = Network::new(1);
        let slow = Layout::from_tag_byte(0x40);
        (1..=2).for_each(|tag| network.request(tag, 10));
        for since in 0..900 {
            network.superframe();
            for (tag, turn) in network.turns() {
                if turn.is_in(network.number) && (tag == 1 || since < 100) {
                    network.coordinator.on_poll(
                        tag,
                        (turn.slot, turn.part()),
                        if tag == 2 { 0x40 } else { 0x10 },
                        network.number,
                        true,
                    );
                }
            }
            if since == 90 {
                assert_eq!(network.coordinator.wish(), slow);
            }
        }
        assert_eq!(network.coordinator.wish(), Layout::from_tag_byte(0x10));
    }
}
