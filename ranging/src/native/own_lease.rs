//! The lease of a tag, as the tag itself knows it.
//!
//! A lease is void if it is not confirmed: the tag counts less time than the coordinator does, so that the turns are
//! given to another tag only when this one has stopped. Anchors confirm it in their responses, so that a tag need not
//! listen to sync frames for it. They also tell the tag if it has ended.

use super::lease_entry::{GRANTED_SUPERFRAMES, term};
use wire::uwb::native::{Confirmation, Grant, Lease, Period, Turn};

/// A tag's lease, or none.
#[derive(Clone, Debug, Default)]
pub struct OwnLease {
    held: Option<Held>,
    /// The tag has requested turns with this period, and has not used them yet.
    requested: Option<Period>,
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

    /// Whether the tag has turns with this period.
    pub fn has(&self, period: Period) -> bool {
        self.turn().is_some_and(|turn| turn.period == period)
    }

    /// The tag requests turns with this period.
    pub fn request(&mut self, period: Period) {
        self.requested = Some(period);
    }

    /// A sync frame of superframe `number` has an entry for this tag, which wants turns with this period. An entry that
    /// the tag has not asked for changes nothing: anybody can send one.
    pub fn receive(&mut self, lease: &Lease, wanted: Period, number: u16) {
        if lease.turn.period != wanted {
            return;
        }
        let held = self.held.as_mut().filter(|held| held.turn.period == wanted);
        match (lease.grant, held) {
            (_, Some(held)) if held.is_answered => {}
            (Grant::New | Grant::Kept, Some(held)) if held.turn == lease.turn => {
                held.told = held.told.saturating_add(1);
            }
            (Grant::New | Grant::Kept, Some(held)) if held.told > 1 => held.told -= 1,
            (_, None) if self.requested != Some(wanted) => {}
            (Grant::New | Grant::Kept, _) => {
                let lasts = lease.turn.next_after(number).saturating_add(GRANTED_SUPERFRAMES);
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
        let period = held.turn.period;
        self.requested = self.requested.filter(|requested| *requested != period);
        match confirmation {
            Confirmation::Renewed => (held.is_answered, held.since, held.lasts) = (true, number, 2 * term(period)),
            // The anchor passes the poll on to the coordinator, unless the grant was forged.
            Confirmation::None if !held.is_answered => {
                let lasts = period.superframes() + GRANTED_SUPERFRAMES;
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
            self.requested = self.requested.filter(|requested| *requested != held.turn.period);
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

    fn lease(grant: Grant) -> Lease {
        Lease { tag: 1, turn: Turn { slot: 3, period: Period::at_most(10), phase: 4 }, grant }
    }

    fn requested() -> OwnLease {
        OwnLease { requested: Some(lease(Grant::New).turn.period), ..OwnLease::default() }
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
            own.receive(&lease(Grant::New), Period::at_most(10), at);
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
    fn entries_that_were_not_asked_for_change_nothing() {
        let mut own = OwnLease::default();
        own.receive(&lease(Grant::New), Period::at_most(10), 0);
        own.receive(&lease(Grant::Refused), Period::at_most(10), 0);
        assert!(own.turn().is_none() && !own.is_refused, "not requested");
        own.request(Period::at_most(10));
        own.receive(&lease(Grant::New), Period::at_most(20), 0);
        assert_eq!(own.turn(), None);
        own.receive(&lease(Grant::Refused), Period::at_most(10), 0);
        assert!(own.is_refused && own.turn().is_none());
        own.receive(&lease(Grant::Kept), Period::at_most(10), 0);
        assert!(!own.is_refused && own.has(Period::at_most(10)));
        own.receive(&lease(Grant::Refused), Period::at_most(10), 1);
        assert_eq!((own.turn(), own.is_refused), (Some(lease(Grant::New).turn), false));
    }

    #[test]
    fn turns_with_another_period_are_awaited_while_the_old_ones_are_used() {
        let (mut own, old) = (requested(), lease(Grant::New));
        own.receive(&old, old.turn.period, 0);
        own.answered(Confirmation::Renewed, 4);
        let period = Period::at_most(20);
        own.request(period);
        own.answered(Confirmation::Renewed, 14);
        own.receive(&Lease { turn: Turn { period, ..old.turn }, ..old }, period, 15);
        assert!(own.has(period));
        // A lease that is void must be requested again.
        own.expire(15 + 20 + 41);
        own.receive(&Lease { turn: Turn { period, ..old.turn }, ..old }, period, 80);
        assert_eq!(own.turn(), None);
    }

    #[test]
    fn the_turns_that_most_entries_say_count_until_an_anchor_answers() {
        let other = Lease { turn: Turn { slot: 9, ..lease(Grant::New).turn }, ..lease(Grant::New) };
        let (mut own, period) = (requested(), Period::at_most(10));
        own.receive(&other, period, 0);
        own.receive(&lease(Grant::New), period, 1);
        own.receive(&lease(Grant::New), period, 1);
        own.receive(&other, period, 1);
        assert_eq!(own.turn(), Some(lease(Grant::New).turn));
        own.receive(&other, period, 2);
        assert_eq!(own.turn(), Some(other.turn));
        own.answered(Confirmation::None, 4);
        (0..9).for_each(|_| own.receive(&lease(Grant::New), period, 4));
        assert_eq!(own.turn(), Some(other.turn));
    }
}
