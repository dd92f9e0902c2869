//! How a tag requests slots: in the shared sync slots, and as long as it has no slots of its own also in round slots that
//! belong to nobody.

use super::schedule::Followed;
use super::{State, Tag, TagConfig};
use crate::exchange::Action;
use crate::native::timing::Timing;
use crate::native::{SHORTEST_WAIT, spread};
use crate::{RadioDuration, Start};
use wire::uwb::native::{Message, Request, Share};

/// Superframes from a request until the coordinator's next sync frame can answer it …
const REQUEST_PATIENCE: u16 = 2;
/// … and from there as many more as have this many places for requests, doubled after each request without effect, this
/// often at most.
const REQUEST_PLACES: u16 = 32;
const MOST_DOUBLINGS: u8 = 5;
/// A tag waits for this many superframes at most.
const MOST_PATIENCE: u16 = 64;
/// A tag without a place in a full network asks again after this many to twice as many superframes: its members give
/// their places up in turn.
const FULL_PATIENCE: u16 = 10;

/// A request that is due in this superframe.
#[derive(Clone, Copy, Debug)]
pub(super) struct DueRequest {
    share: Share,
    /// From the superframe's beginning to its RMARKER.
    pub(super) rmarker: RadioDuration,
    /// Which place that is, those of the shared slots first.
    place: u16,
    /// How many places for requests this superframe has.
    places: u16,
}

/// What a tag does about a request now.
#[derive(Clone, Copy, Debug)]
pub(super) enum Now {
    /// Its instant in this superframe has passed.
    Nothing,
    /// There is this much time before.
    Wait(RadioDuration),
    /// Sends it.
    Send,
}

impl Tag {
    /// The request that is due in this superframe, if this tag's share differs from the wanted one. In the sync slots
    /// there is time for requests before `end`.
    pub(super) fn due_request(&mut self, end: RadioDuration) -> Option<DueRequest> {
        let (TagConfig { address, .. }, rate) = (self.config, self.rate);
        let network = self.network.as_mut()?;
        let timing = network.sync.course.timing;
        let number = network.sync.course.phase.number;
        let share = self.config.share_of(rate, &timing);
        if network.has(address, share) {
            network.requests = 0;
            return None;
        }
        if network.is_full_for(address, share) && network.joined && network.request_in == 0 {
            // It has just given its place up.
            network.request_in = in_turn(number, address);
        }
        // Who has no slots need not decide on a round meanwhile.
        let end = if network.joined { end } else { timing.rounds() };
        if network.request_in > 0 { None } else { network.place_request(share, &timing, address, end) }
    }

    /// Whether a request must be sent now.
    pub(super) fn time_to_request(&mut self, due: DueRequest, passed: RadioDuration) -> Now {
        let lead = self.meter.lead();
        let Some(network) = &mut self.network else { return Now::Nothing };
        let phase = network.sync.course.phase;
        let until_pulse = due.rmarker.ticks() - network.sync.course.timing.to_rmarker.ticks() - passed.ticks();
        let spare = RadioDuration::from_ticks(until_pulse - lead.ticks());
        if spare > SHORTEST_WAIT {
            self.stopwatch.wake_at = Some(phase.at(RadioDuration::from_ticks(passed.ticks() + spare.ticks())));
            return Now::Wait(spare);
        }
        if until_pulse <= 0 {
            network.request_in = 1;
            if let Some(wake) = self.stopwatch.wake_at.take() {
                self.meter.overslept(phase.at(passed).since(wake));
            }
            return Now::Nothing;
        }
        Now::Send
    }

    /// Sends a request.
    pub(super) fn request(&mut self, due: DueRequest) -> Action<'_> {
        let address = self.config.address;
        let Some(network) = &mut self.network else { return Self::listen(RadioDuration::ZERO) };
        let phase = network.sync.course.phase;
        // After each collision a tag waits longer, and each tag a different time.
        let superframes = (REQUEST_PLACES << network.requests.min(MOST_DOUBLINGS)) / due.places.max(1);
        let patience = spread(phase.number, address, superframes.clamp(1, MOST_PATIENCE));
        network.request_in = match network.is_full_for(address, due.share) {
            true => in_turn(phase.number, address),
            false => REQUEST_PATIENCE + patience,
        };
        match due.share {
            // If the request is lost, the lease ends because it is not renewed.
            Share::Release => network.lease.release(),
            Share::Leased(turns) => network.lease.request(turns),
            Share::Slots(_) | Share::Greedy => {}
        }
        network.requests = network.requests.saturating_add(1);
        self.state = State::Requesting;
        let wish = self.meter.wish(self.config.scheme);
        let moment = self.moment().map(|moment| moment.at_place(due.place));
        self.write(Message::Request(Request { share: due.share, wish }), moment);
        Action::Transmit { frame: self.out.bytes(), start: Start::At(phase.at(due.rmarker)), listen: true }
    }
}

fn in_turn(number: u16, address: u16) -> u16 {
    FULL_PATIENCE + spread(number, address, FULL_PATIENCE)
}

impl Followed {
    /// A request in this superframe, at a place that is drawn at random; `None` if there is none before `end`.
    fn place_request(&self, share: Share, timing: &Timing, address: u16, end: RadioDuration) -> Option<DueRequest> {
        let in_reach = |slot: &u8| timing.request(usize::from(*slot)) < end;
        let shared = (0..timing.request_slots).take_while(in_reach).count() as u16;
        let is_free = !self.joined && self.sync.plan().is_some();
        let (begin, further) = if is_free { self.sync.course.request_places() } else { (0, 0) };
        let places = Some(shared + further).filter(|places| *places > 0)?;
        let drawn = spread(address, self.sync.course.phase.number, places);
        let (rmarker, place) = match drawn.checked_sub(shared) {
            Some(place) => {
                (timing.request_from_round_slot(begin, place.into()), u16::from(timing.request_slots) + place)
            }
            None => (timing.request(drawn.into()), drawn),
        };
        Some(DueRequest { share, rmarker, place, places })
    }
}
