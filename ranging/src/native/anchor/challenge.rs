//! When an anchor asks whether a session is there.

use super::{Anchor, Doing, SHORTEST_WAIT};
use crate::native::authentication::Moment;
use crate::{RadioDuration, RadioInstant};
use wire::uwb::native::Message;

impl Anchor<'_> {
    /// How much time there is before a challenge, if one is due.
    pub(super) fn spare_before_challenge(&mut self, present: RadioInstant) -> Option<RadioDuration> {
        let to_rmarker = self.config.network.phy.time_to_rmarker().ticks();
        let until_pulse = self.challenger.due()?.since(present).ticks() - to_rmarker;
        let spare = RadioDuration::from_ticks(until_pulse - self.meter.lead().ticks());
        if spare > SHORTEST_WAIT {
            self.asks_at = Some(present.plus(spare));
        }
        Some(spare)
    }

    /// Writes the challenge that is due, and returns when its RMARKER leaves; `None` if there is no time left for it.
    #[cold]
    pub(super) fn write_challenge(&mut self, present: RadioInstant) -> Option<RadioInstant> {
        let (challenge, at, superframe) = self.challenger.take()?;
        if at.since(present) <= self.config.network.phy.time_to_rmarker() {
            if let Some(wake) = self.asks_at.take() {
                self.meter.overslept(present.since(wake));
            }
            return None;
        }
        self.doing = Doing::Challenging;
        self.write_to_all(&Message::Challenge(challenge), Some(Moment::of_challenge(&challenge, superframe)));
        Some(at)
    }
}
