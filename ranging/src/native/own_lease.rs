//! The lease of a tag, as the tag itself knows it.
//!
//! A lease is void if it is not confirmed: the tag counts less time than the coordinator does, so that the turns are
//! given to another tag only when this one has stopped. Anchors confirm it in their responses, so that a tag need not
//! listen to sync frames for it. They also tell the tag if it has ended.

use super::lease_entry::{term, unanswered};
use wire::uwb::native::{Confirmation, Grant, Lease, MAX_BLINKS, Turn, Turns};

/// A tag's lease, or none.
#[derive(Clone, Debug, Default)]
pub struct OwnLease {
    held: Option<Held>,
    /// The tag has requested these turns, and has not used them yet.
    requested: Option<Turns>,
    /// The coordinator has no turn for this tag at present.
    pub is_refused: bool,
}

#[derive(Clone, Copy, Debug)]
struct Held {
    turn: Turn,
    /// Entries with these turns, minus those with others. The most frequent ones prevail until …
    told: u8,
    /// … an anchor has answered a poll in these turns.
    is_answered: bool,
    /// The number of the superframe since which …
    since: u16,
    /// … it holds for this many.
    lasts: u16,
}

impl OwnLease {
    /// The turns.
    pub fn turn(&self) -> Option<Turn> {
        self.held.map(|held| held.turn)
    }

    /// Whether the tag has such turns.
    pub fn has(&self, turns: Turns) -> bool {
        self.turn().is_some_and(|turn| turn.turns() == turns)
    }

    /// The tag requests these turns.
    pub fn request(&mut self, turns: Turns) {
        self.requested = Some(turns);
    }

    /// Whether the tag is to ask an anchor in its blink of this superframe: if its lease needs a confirmation, and if
    /// the one place for an answer is not for another one of the slot's blinks.
    pub fn asks(&self, number: u16) -> bool {
        let Some(held) = &self.held else { return false };
        let turns = held.turn.turns();
        let turn = number / turns.period.superframes() % u16::from(MAX_BLINKS);
        let is_due = !held.is_answered || number.wrapping_sub(held.since) >= term(turns) / 2;
        is_due && turn + 1 == u16::from(held.turn.part())
    }

    /// A sync frame of superframe `number` has an entry for this tag, which wants these turns. An entry that
    /// the tag has not asked for changes nothing: anybody can send one.
    pub fn receive(&mut self, lease: &Lease, wanted: Turns, number: u16) {
        if lease.turn.turns() != wanted {
            return;
        }
        let held = self.held.as_mut().filter(|held| held.turn.turns() == wanted);
        match (lease.grant, held) {
            (_, Some(held)) if held.is_answered => {}
            (Grant::New | Grant::Kept, Some(held)) if held.turn == lease.turn => {
                held.told = held.told.saturating_add(1);
            }
            (Grant::New | Grant::Kept, Some(held)) if held.told > 1 => held.told -= 1,
            (_, None) if self.requested != Some(wanted) => {}
            (Grant::New | Grant::Kept, _) => {
                let lasts = lease.turn.next_after(number).saturating_add(unanswered(wanted));
                self.held = Some(Held { turn: lease.turn, told: 1, is_answered: false, since: number, lasts });
                self.is_refused = false;
            }
            (Grant::Refused, None) => self.is_refused = true,
            (Grant::Refused, Some(_)) | (Grant::Ended, _) => {}
        }
    }

    /// An anchor answered a poll in superframe `number`, and says this of the lease.
    pub fn answered(&mut self, confirmation: Confirmation, number: u16) {
        let Some(held) = self.held.as_mut().filter(|held| held.turn.is_in(number)) else { return };
        let turns = held.turn.turns();
        self.requested = self.requested.filter(|requested| *requested != turns);
        match confirmation {
            Confirmation::Renewed => (held.is_answered, held.since, held.lasts) = (true, number, 2 * term(turns)),
            // The anchor passes the poll on to the coordinator, unless the grant was forged.
            Confirmation::None if !held.is_answered => {
                let lasts = turns.period.superframes().saturating_add(unanswered(turns));
                (held.is_answered, held.since, held.lasts) = (true, number, lasts);
            }
            Confirmation::None => {}
            Confirmation::Ended => self.held = None,
        }
    }

    /// It is superframe `number`: a lease that was not confirmed in time is void. The tag calls this at least once in
    /// 10,000 superframes.
    pub fn expire(&mut self, number: u16) {
        let is_over = |held: &mut Held| number.wrapping_sub(held.since) > held.lasts;
        if let Some(held) = self.held.take_if(is_over) {
            self.requested = self.requested.filter(|requested| *requested != held.turn.turns());
        }
    }

    /// The tag gives its turns back.
    pub fn release(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wire::uwb::native::Period;

    const fn every(superframes: u16) -> Turns {
        Turns::rounds(Period::at_most(superframes))
    }

    fn lease(grant: Grant) -> Lease {
        Lease { tag: 1, turn: Turn::new(3, 0, Period::at_most(10), 4), grant }
    }

    fn requested() -> OwnLease {
        OwnLease { requested: Some(lease(Grant::New).turn.turns()), ..OwnLease::default() }
    }

    fn holds_until(own: &OwnLease, from: u16) -> u16 {
        let mut own = own.clone();
        (0..)
            .find(|after| {
                own.expire(from.wrapping_add(*after));
                own.turn().is_none()
            })
            .unwrap()
    }

    #[test]
    fn a_lease_lasts_as_long_as_it_is_confirmed() {
        for at in [0, u16::MAX] {
            let mut own = requested();
            own.receive(&lease(Grant::New), every(10), at);
            // Its turn comes in 4 superframes, or after the wrap in 1 + 4; then 40 superframes pass.
            let turn = if at == 0 { 4 } else { 5 };
            assert_eq!(holds_until(&own, at), turn + 41);
            let polled = at.wrapping_add(turn);
            own.answered(Confirmation::None, polled);
            assert_eq!(holds_until(&own, polled), 51);
            own.answered(Confirmation::None, polled.wrapping_add(10));
            assert_eq!(holds_until(&own, polled), 51, "the grant may be forged");
            own.answered(Confirmation::Renewed, polled);
            // Two thirds of a lease of 300 superframes.
            assert_eq!(holds_until(&own, polled), 201);
            own.answered(Confirmation::Renewed, polled.wrapping_add(5));
            assert_eq!(holds_until(&own, polled), 201, "not its turn");
            own.answered(Confirmation::None, polled);
            assert_eq!(holds_until(&own, polled), 201, "confirmed before");
            own.answered(Confirmation::Ended, polled.wrapping_add(5));
            assert!(own.turn().is_some(), "not its turn");
            own.answered(Confirmation::Ended, polled);
            assert_eq!(own.turn(), None);
        }
    }

    #[test]
    fn blinks_of_one_slot_ask_one_after_the_other_and_only_if_they_need_to() {
        let turns = Turns::blinks(Period::at_most(10));
        let mut tags = [1, 2, 7].map(|part| {
            let turn = Turn::new(3, part, turns.period, 4);
            let mut own = OwnLease::default();
            own.request(turns);
            own.receive(&Lease { tag: 1, turn, grant: Grant::New }, turns, 0);
            own
        });
        let asking = |tags: &[OwnLease], number: u16| tags.iter().filter(|own| own.asks(number)).count();
        // Seven turns from superframe 4 on: each asks once.
        let asked: std::vec::Vec<_> = (0..7).map(|turn| asking(&tags, 4 + 10 * turn)).collect();
        assert_eq!(asked, [1, 1, 0, 0, 0, 0, 1]);
        // Unanswered, such a lease lasts two rotations, to the first turn, and 40 superframes.
        assert_eq!(holds_until(&tags[0], 0), 4 + 140 + 41);
        for (own, turn) in tags.iter_mut().zip([0, 1, 6]) {
            own.answered(Confirmation::Renewed, 4 + 10 * turn);
        }
        // A term is 56 periods, and a tag asks from the middle of one on.
        let first = (8..).map(|turn| 4 + 10 * turn).find(|number| tags[0].asks(*number));
        assert_eq!(first, Some(4 + 280));
        assert_eq!(holds_until(&tags[0], 4), 2 * 560 + 1);
    }

    #[test]
    fn entries_that_were_not_asked_for_change_nothing() {
        let mut own = OwnLease::default();
        own.receive(&lease(Grant::New), every(10), 0);
        own.receive(&lease(Grant::Refused), every(10), 0);
        assert!(own.turn().is_none() && !own.is_refused, "not requested");
        own.request(every(10));
        own.receive(&lease(Grant::New), every(20), 0);
        assert_eq!(own.turn(), None);
        own.receive(&lease(Grant::Refused), every(10), 0);
        assert!(own.is_refused && own.turn().is_none());
        own.receive(&lease(Grant::Kept), every(10), 0);
        assert!(!own.is_refused && own.has(every(10)));
        own.receive(&lease(Grant::Refused), every(10), 1);
        assert_eq!((own.turn(), own.is_refused), (Some(lease(Grant::New).turn), false));
    }

    #[test]
    fn turns_with_another_period_are_awaited_while_the_old_ones_are_used() {
        let (mut own, old) = (requested(), lease(Grant::New));
        own.receive(&old, every(10), 0);
        own.answered(Confirmation::Renewed, 4);
        let Turns { period, .. } = every(20);
        own.request(every(20));
        own.answered(Confirmation::Renewed, 14);
        own.receive(&Lease { turn: Turn { period, ..old.turn }, ..old }, every(20), 15);
        assert!(own.has(every(20)));
        // A lease that is void must be requested again.
        own.expire(15 + 20 + 41);
        own.receive(&Lease { turn: Turn { period, ..old.turn }, ..old }, every(20), 80);
        assert_eq!(own.turn(), None);
    }

    #[test]
    fn the_turns_that_most_entries_say_count_until_an_anchor_answers() {
        let other = Lease { turn: Turn { slot: 9, ..lease(Grant::New).turn }, ..lease(Grant::New) };
        let (mut own, turns) = (requested(), every(10));
        own.receive(&other, turns, 0);
        own.receive(&lease(Grant::New), turns, 1);
        own.receive(&lease(Grant::New), turns, 1);
        own.receive(&other, turns, 1);
        assert_eq!(own.turn(), Some(lease(Grant::New).turn));
        own.receive(&other, turns, 2);
        assert_eq!(own.turn(), Some(other.turn));
        own.answered(Confirmation::None, 4);
        (0..9).for_each(|_| own.receive(&lease(Grant::New), turns, 4));
        assert_eq!(own.turn(), Some(other.turn));
    }
}
