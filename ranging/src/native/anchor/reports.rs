//! What an anchor reports to its host when it has nothing more urgent to do.

use super::Anchor;
use crate::native::coordinator::Coordinator;
use crate::{RadioDuration, RadioInstant};

impl Anchor<'_> {
    /// What the last poll carried is reported, and passed on.
    pub(super) fn takes_polled(&mut self) -> bool {
        let Some((at, is_first)) = self.polled_at.take() else { return false };
        if let Some(network) = &self.network {
            let course = &network.course;
            let pulse = at.plus(RadioDuration::from_ticks(-course.timing.to_rmarker.ticks()));
            self.uplink.on_poll(&self.polled, course.round_slot_at(pulse), course.of_256th(at), is_first);
        }
        true
    }

    /// Whether the own sync frame is due soon.
    pub(super) fn is_syncing_soon(&self, present: RadioInstant) -> bool {
        let Some(network) = &self.network else { return false };
        let Coordinator { course, .. } = network;
        let timing = &course.timing;
        let rest = network.due().map(|slot| course.phase.at(timing.sync_frame(slot.into())).since(present).ticks());
        rest.is_some_and(|rest| (0..2 * timing.sync_slot.ticks()).contains(&rest))
    }

    /// A gateway takes what other anchors have passed on, unless its own sync frame is due soon.
    pub(super) fn takes_relayed(&mut self, present: RadioInstant) -> bool {
        let Some(network) = self.network.as_ref().filter(|_| self.uplink.has_reports()) else { return false };
        if self.is_syncing_soon(present) {
            return false;
        }
        let Coordinator { course, .. } = network;
        let relayed = self.uplink.report(course.of_256th(present), course.timing.superframe);
        relayed.map(|relayed| self.polled = relayed).is_some()
    }
}
