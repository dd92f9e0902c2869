//! A lease as an anchor knows it: how long it lasts, and what a poll means for it. What a look over all leases collects,
//! and who waits for one.

use wire::uwb::layout::Layout;
use wire::uwb::native::{Grant, Lease, MAX_BLINKS, Period, Turn, Turns};

/// A tag's new lease holds until its first turn and this many superframes …
pub const GRANTED_SUPERFRAMES: u16 = 40;
/// … and the coordinator keeps it for this many more: sync frames take some superframes from anchor to anchor.
pub const RELAYED_SUPERFRAMES: u16 = 22;
/// A term of a lease is at least this many superframes …
const TERM_SUPERFRAMES: u16 = 100;
/// … and this many periods …
const TERM_PERIODS: u16 = 4;
/// … or this many of blinks: only one in [`MAX_BLINKS`] may ask, and there are many, whose renewals are news.
const BLINK_TERM_PERIODS: u16 = 2 * TERM_PERIODS * MAX_BLINKS as u16;
/// A term is no longer than this, so that three of them can be counted.
const LONGEST_TERM: u16 = TERM_PERIODS * Period::MOST;
/// Blinks with this period come as seldom as such terms allow.
pub const LONGEST_BLINK_PERIOD: u16 = LONGEST_TERM / BLINK_TERM_PERIODS;
/// What a lease of whole slots weighs on probation, and the least weight of one that comes seldom.
const WHOLE_SLOT: u16 = 100;
const LEAST_WEIGHT: u16 = 2;
/// A lease of a full network is renewed for this many turns before another tag gets it.
const KEPT_TURNS: u32 = 60;

/// A third of a lease, superframes.
#[inline(never)]
pub const fn term(turns: Turns) -> u16 {
    let periods = if turns.are_blinks { BLINK_TERM_PERIODS } else { TERM_PERIODS };
    let term = periods.saturating_mul(turns.period.superframes());
    match term {
        ..TERM_SUPERFRAMES => TERM_SUPERFRAMES,
        LONGEST_TERM.. => LONGEST_TERM,
        _ => term,
    }
}

/// How long a tag without an answer may use its turns after the first one, superframes: in this time it asks at least
/// twice.
#[inline(never)]
pub const fn unanswered(turns: Turns) -> u16 {
    let rotation = if turns.are_blinks { MAX_BLINKS as u16 } else { 0 };
    turns.period.superframes().saturating_mul(2 * rotation).saturating_add(GRANTED_SUPERFRAMES)
}

/// How a lease stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standing {
    /// No poll was received yet.
    Probation,
    /// It is renewed.
    Proven,
    /// Its tag gave it back. It is proven again by a poll.
    Released,
    /// It has ended, as another tag waits. Its tag may not know.
    Ending,
    /// It has ended, and its tag was told so in a response.
    Told,
}

/// A lease as an anchor knows it.
#[derive(Clone, Copy, Debug)]
pub struct Entry {
    /// The tag.
    pub tag: u16,
    /// Its turns.
    pub turn: Turn,
    /// The superframe in which it was granted or renewed, as far as known here.
    pub made: u16,
    /// How often it was renewed.
    pub renewals: u8,
    /// How it stands.
    pub standing: Standing,
    /// The tag's request for the layout, if it polls here.
    pub wish: u8,
    /// A poll was received here, or by an anchor that passed it on.
    pub is_heard: bool,
}

impl Entry {
    /// How much it counts if it is on probation.
    pub fn weight(&self) -> u16 {
        let parts = if self.turn.part() > 0 { MAX_BLINKS.into() } else { 1 };
        (WHOLE_SLOT / self.turn.period.superframes() / parts).max(LEAST_WEIGHT)
    }

    /// Whether its turns are for another tag.
    pub fn has_ended(&self) -> bool {
        matches!(self.standing, Standing::Ending | Standing::Told)
    }

    /// Superframes since it was made.
    pub fn age(&self, number: u16) -> u16 {
        number.wrapping_sub(self.made)
    }

    /// Superframes that it lasts if it is not renewed.
    fn lasts(&self) -> u16 {
        match self.standing {
            Standing::Probation => {
                let unanswered = unanswered(self.turn.turns()).saturating_add(RELAYED_SUPERFRAMES);
                self.turn.next_after(self.made).saturating_add(unanswered)
            }
            // Anchors that do not know that it was given back pass polls on only after half a term.
            Standing::Released => {
                term(self.turn.turns()) / 2 + 2 * self.turn.period.superframes() + RELAYED_SUPERFRAMES
            }
            Standing::Told => 2 * self.turn.period.superframes() + RELAYED_SUPERFRAMES,
            Standing::Proven | Standing::Ending => 3 * term(self.turn.turns()) + RELAYED_SUPERFRAMES,
        }
    }

    /// Whether it is void.
    pub fn is_over(&self, number: u16) -> bool {
        self.age(number) > self.lasts()
    }

    /// Whether a poll is news to the coordinator: in the second half of a term, or if it is not proven.
    pub fn is_due(&self, number: u16) -> bool {
        match self.standing {
            Standing::Proven => self.age(number) >= term(self.turn.turns()) / 2,
            Standing::Probation | Standing::Released | Standing::Ending | Standing::Told => true,
        }
    }

    /// Whether it has had its share of a full network. A renewal comes after half a term.
    pub fn has_had_its_turn(&self) -> bool {
        let half_term = u32::from(term(self.turn.turns()) / 2);
        u32::from(self.renewals) * half_term >= KEPT_TURNS * u32::from(self.turn.period.superframes())
    }

    /// The entry that says this of it.
    pub fn lease(&self, grant: Grant) -> Lease {
        Lease { tag: self.tag, turn: self.turn, grant }
    }
}

/// What a look over all leases collects, a part in each superframe.
#[derive(Clone, Copy, Debug)]
pub struct Survey {
    /// The next lease.
    pub at: usize,
    /// What tags request of the layout.
    pub wish: Layout,
    /// Slots up to the highest one with a lease.
    pub slots: u8,
    /// Leases that end for others, or are on probation.
    pub unsettled: usize,
    /// The tag that has had its turn for longest, and its number of renewals.
    pub served: Option<(u16, u8)>,
}

impl Survey {
    /// Nothing looked at.
    pub const NONE: Self = Self { at: 0, wish: Layout::LEAST, slots: 0, unsettled: 0, served: None };
}

/// A tag that waits for a lease.
#[derive(Clone, Copy, Debug)]
pub struct Waiting {
    /// Its short address.
    pub tag: u16,
    /// The turns that it wants.
    pub turns: Turns,
    /// It has asked again.
    pub insists: bool,
}

/// Places for turns in the order in which they are searched: of each slot the whole, then its blinks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct TurnPlace(u16);

impl TurnPlace {
    const OF_SLOT: u16 = MAX_BLINKS as u16 + 1;

    /// The first of a slot.
    pub const fn of_slot(slot: u8) -> Self {
        Self(slot as u16 * Self::OF_SLOT)
    }

    /// The first from this one on for such turns, in the first `slots` slots; after the last one the first of all.
    pub const fn for_turns(self, are_blinks: bool, slots: u8) -> Self {
        let part = self.0 % Self::OF_SLOT;
        let next = match are_blinks {
            true => self.0 + (part == 0) as u16,
            false => self.0.next_multiple_of(Self::OF_SLOT),
        };
        if next < Self::of_slot(slots).0 { Self(next) } else { Self(are_blinks as u16) }
    }

    /// The one after.
    pub const fn next(self) -> Self {
        Self(self.0 + 1)
    }

    /// How many there are for such turns in this many slots.
    pub const fn count(are_blinks: bool, slots: u8) -> u16 {
        slots as u16 * if are_blinks { MAX_BLINKS as u16 } else { 1 }
    }

    /// The slot and the part of it.
    pub const fn slot_and_part(self) -> (u8, u8) {
        ((self.0 / Self::OF_SLOT) as u8, (self.0 % Self::OF_SLOT) as u8)
    }
}

/// A tag's turn in this place that meets none of these leases, but for one of its own with more turns; the first from
/// superframe `from` on. Turns with the same remainder of ten, five or two as others in the slot come first: so remainders
/// stay free for turns that come more often, and slots for rounds.
pub fn free_turn(entries: &[Entry], tag: u16, place: TurnPlace, period: Period, from: u16) -> Option<Turn> {
    let (slot, part) = place.slot_and_part();
    let mut taken = [0_u64; Period::MOST.div_ceil(u64::BITS as u16) as usize];
    let mut remainders = [(10, 0_u16), (5, 0), (2, 0), (1, 1)];
    let length = period.superframes();
    let is_replaced = |entry: &Entry| entry.tag == tag && entry.turn.period.superframes() < length;
    for entry in entries.iter().filter(|entry| entry.turn.slot == slot && !is_replaced(entry)) {
        let step = period.common_with(entry.turn.period);
        for (of, used) in remainders.iter_mut().filter(|(of, _)| step.is_multiple_of(*of)) {
            *used |= 1 << (entry.turn.phase() % *of);
        }
        let other = entry.turn.part();
        if part > 0 && other > 0 && part != other {
            continue;
        }
        for phase in (entry.turn.phase() % step..length).step_by(step.into()) {
            taken[usize::from(phase / 64)] |= 1 << (phase % 64);
        }
    }
    let is_free = |phase: u16| taken[usize::from(phase / 64)] >> (phase % 64) & 1 == 0;
    let first = from % length;
    let phase = remainders.into_iter().find_map(|(of, used)| {
        (first..length).chain(0..first).find(|&phase| used >> (phase % of) & 1 == 1 && is_free(phase))
    })?;
    Some(Turn::new(slot, part, period, phase))
}
