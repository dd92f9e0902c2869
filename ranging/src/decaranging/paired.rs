//! What a tag knows of the anchor that took it: the contents of its ranging init, and what its responses show of its
//! software.

use super::Software;
use crate::{RadioDuration, RadioInstant};
use wire::uwb::Address;
use wire::uwb::decaranging::{Variant, delay_of};

/// A delay without a unit that is less than this is in milliseconds if the anchor's software is older, else in
/// microseconds.
const LEAST_MICROS: u16 = 1_000;
/// Added to the time after which an answer should come.
const PATIENCE: RadioDuration = RadioDuration::from_micros(5_000);

/// The anchor that took the tag.
#[derive(Clone, Copy, Debug)]
pub(super) struct Paired {
    pub anchor: Address,
    /// This tag's own address.
    pub tag: Address,
    pub software: Software,
    /// From a poll's departure to the response's arrival.
    pub anchor_delay: RadioDuration,
    /// From a response's arrival to the final's departure.
    pub tag_delay: RadioDuration,
    /// The delay of the ranging init read as milliseconds, if it may have been milliseconds.
    pub millis: Option<RadioDuration>,
    /// A response has shown which unit it was.
    pub sure: bool,
    /// The multiple of the time of flight that it reports.
    pub flights: f32,
    /// When the last frame of the anchor was received.
    pub heard: RadioInstant,
    pub unanswered: u8,
    /// The anchor's last sequence number.
    pub sequence: u8,
}

impl Paired {
    /// `anchor` and `tag` have these addresses. A ranging init names the anchor's delay and perhaps the tag's. No delay
    /// is less than `least`.
    pub fn new(
        (anchor, tag): (Address, Address),
        (anchor_delay, tag_delay): (u16, Option<u16>),
        least: RadioDuration,
        variant: Variant,
    ) -> Self {
        let ambiguous =
            tag_delay.is_none() && variant == Variant::Standard && (1..LEAST_MICROS).contains(&anchor_delay);
        Self {
            anchor,
            tag,
            software: if tag_delay.is_some() { Software::Delays } else { Software::Units },
            anchor_delay: delay_of(anchor_delay).max(least),
            tag_delay: delay_of(tag_delay.unwrap_or(anchor_delay)).max(least),
            millis: ambiguous.then(|| RadioDuration::from_micros(u32::from(anchor_delay) * 1000)),
            sure: false,
            flights: 1.0,
            heard: RadioInstant::default(),
            unanswered: 0,
            sequence: 0,
        }
    }

    /// How long after a poll the tag waits for a response.
    pub fn response_patience(&self) -> RadioDuration {
        let named = self.delay(self.anchor_delay);
        let longest = self.millis.filter(|_| !self.sure).map_or(named, |millis| millis.max(named));
        RadioDuration::from_ticks(longest.ticks() + longest.ticks().min(PATIENCE.ticks()) + PATIENCE.ticks())
    }

    /// How long after a final the tag waits for a report. Stock anchors are slow to report.
    pub fn report_patience(&self) -> RadioDuration {
        RadioDuration::from_ticks(2 * self.delay(self.anchor_delay).ticks() + PATIENCE.ticks())
    }

    /// The time after a poll from which no response can come.
    pub fn silence(&self) -> RadioDuration {
        let known = self.sure || self.millis.is_none();
        if known { self.delay(self.anchor_delay) } else { RadioDuration::ZERO }
    }

    /// `named`, or the milliseconds that were meant by it.
    pub fn delay(&self, named: RadioDuration) -> RadioDuration {
        match (self.software, self.millis) {
            (Software::Millis, Some(millis)) => millis,
            (Software::Millis, None) | (Software::Units | Software::Delays, _) => named,
        }
    }

    /// A response came `after` the poll. This shows the unit of the delay.
    pub fn answered(&mut self, after: RadioDuration) {
        if let Some(millis) = self.millis {
            let late = after.ticks() > millis.ticks() / 2;
            self.software = if late { Software::Millis } else { Software::Units };
        }
        (self.sure, self.unanswered) = (true, 0);
    }
}
