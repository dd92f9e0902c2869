//! What an anchor sends in round slots: its polls to other anchors, and relay frames.

use super::{Anchor, Doing};
use crate::exchange::{Action, COMPENSATION};
use crate::native::SHORTEST_WAIT;
use crate::{RadioDuration, RadioInstant, Start};
use wire::uwb::layout::Scheme;
use wire::uwb::native::Message;

impl Anchor<'_> {
    /// In the round slots: ranges to the other anchors in slots of its own, else listens.
    pub(super) fn among_rounds(&mut self, passed: RadioDuration, rest: RadioDuration) -> Action<'_> {
        let lead = self.meter.lead();
        let Some(network) = &mut self.network else { return Self::listen(rest) };
        let timing = network.course.timing;
        self.rounds.plan(network, &mut self.leases, self.config.address);
        let phase = network.course.phase;
        let in_time = RadioDuration::from_ticks(passed.ticks() + lead.ticks());
        // The anchor was woken for a round. It makes the round if the round's instant is still in the future.
        let spare = |pulse: RadioDuration| RadioDuration::from_ticks(pulse.ticks() - passed.ticks() - lead.ticks());
        let planned = self.pulse_at.take().map(|pulse| pulse.since(phase.start));
        if let Some(wake) = self.wake_at.filter(|_| planned.is_some_and(|pulse| pulse <= passed)) {
            self.meter.overslept(phase.at(passed).since(wake));
        }
        let planned = planned.filter(|pulse| *pulse > passed && spare(*pulse) <= SHORTEST_WAIT);
        let round = planned.or_else(|| self.rounds.next(&timing, phase, in_time));
        // Relay slots come behind those of rounds.
        let wake_for = |pulse: RadioDuration| phase.at(RadioDuration::from_ticks(pulse.ticks() - lead.ticks()));
        let is_awaited = |pulse: &RadioDuration| *pulse > passed && self.wake_at == Some(wake_for(*pulse));
        let relay = network.relay_pulse().filter(|_| self.uplink.has_relay_frame());
        let relay = relay.filter(|pulse| *pulse >= in_time || is_awaited(pulse));
        let Some(pulse) = round.or(relay) else {
            let is_due = rest > COMPENSATION && self.compensation.take(phase.number, self.config.address);
            return if is_due { Action::Compensate } else { Self::listen(rest) };
        };
        let pulse_at = phase.at(pulse);
        if spare(pulse) > SHORTEST_WAIT {
            (self.wake_at, self.pulse_at) = (Some(wake_for(pulse)), round.map(|pulse| phase.at(pulse)));
            return Self::listen(spare(pulse));
        }
        self.wake_at = self.wake_at.filter(|_| planned.is_some() || round.is_none() && is_awaited(&pulse));
        let rmarker = pulse_at.plus(timing.to_rmarker);
        if round.is_none() {
            return self.relay(rmarker, rest);
        }
        // This anchor renews its own lease.
        network.on_tag(self.config.address);
        let poll = self.rounds.poll(&timing, pulse_at, self.meter.reading(), self.meter.wish(Scheme::SingleSided));
        self.doing = Doing::Polling;
        let moment = network.course.moment_of_round(pulse_at);
        let sealed = self.write_to_all(&Message::Poll(poll), moment);
        self.rounds.seal(sealed);
        // A start at once would be before the slot if the board is quicker than required. Listening tags rely on the
        // slot.
        Action::Transmit { frame: self.out.bytes(), start: Start::At(rmarker), listen: true }
    }

    /// Sends a relay frame at its place.
    fn relay(&mut self, rmarker: RadioInstant, rest: RadioDuration) -> Action<'_> {
        let own = self.network.as_ref().and_then(|network| Some((network.own_slot()?, network.course.moment())));
        let frame = own.and_then(|(slot, moment)| Some((self.uplink.relay_frame(slot)?, moment)));
        let Some(((next, frame), moment)) = frame else { return Self::listen(rest) };
        self.doing = Doing::Relaying;
        self.write(next, &Message::RelayFrame(frame));
        if let Some((key, moment)) = self.config.network.key.as_ref().zip(moment) {
            key.seal(&mut self.out, moment);
        }
        let start = Start::At(rmarker.plus(RadioDuration::from_ticks(-self.stamps.antenna_delay.ticks())));
        Action::Transmit { frame: self.out.bytes(), start, listen: true }
    }
}
