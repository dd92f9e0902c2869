//! The arrivals that an anchor reports to its host, so that a station computes the positions of tags that blink: those of
//! blinks, and as long as tags blink those of sync frames, which tie the anchors' clocks together.

use heapless::Deque;

use crate::exchange::{Arrival, ArrivedFrame};
use crate::time::METRES_PER_TICK;
use crate::{Diagnostics, RadioDuration, RadioInstant, RangeBias};

/// Arrivals that wait to be reported: those of a superframe's sync frames, or of two slots' blinks.
const MAX_WAITING: usize = 16;
/// Sync frames are reported for this many superframes after a blink.
const REPORTED_SUPERFRAMES: u16 = 100;
/// Reports after each event: a report takes as long as a frame, and the receiver keeps two.
const REPORTS_AN_EVENT: u8 = 2;

/// The arrivals that are not reported yet.
#[derive(Clone, Debug, Default)]
pub(super) struct Arrivals {
    waiting: Deque<Arrival, MAX_WAITING>,
    /// The superframe of the last blink.
    blinked: Option<u16>,
    /// The superframe of the own sync frame that is leaving.
    pub(super) own: u16,
    /// Reports that may follow the last event.
    left: u8,
}

impl Arrivals {
    /// Nobody blinks.
    pub(super) fn clear(&mut self) {
        self.waiting.clear();
        self.blinked = None;
    }

    /// An event was received.
    pub(super) fn begin(&mut self) {
        self.left = REPORTS_AN_EVENT;
    }

    /// A blink of superframe `superframe` arrived, which the tag counts as its `number`-th.
    pub(super) fn blink(
        &mut self,
        (source, number): (u16, u16),
        superframe: u16,
        rx_time: RadioInstant,
        diagnostics: &Diagnostics,
        bias: &RangeBias,
    ) {
        self.blinked = Some(superframe);
        self.push(received((source, number), ArrivedFrame::Blink, rx_time, diagnostics, bias));
    }

    /// A sync frame arrived.
    pub(super) fn sync_frame(
        &mut self,
        (source, superframe): (u16, u16),
        rx_time: RadioInstant,
        diagnostics: &Diagnostics,
        bias: &RangeBias,
    ) {
        if self.is_wanted(superframe) {
            self.push(received((source, superframe), ArrivedFrame::SyncFrame, rx_time, diagnostics, bias));
        }
    }

    /// The own sync frame has left.
    pub(super) fn departure(&mut self, source: u16, instant: RadioInstant) {
        let (frame, number) = (ArrivedFrame::OwnSyncFrame, self.own);
        if self.is_wanted(number) {
            let [rx_power_dbm, first_path_power_dbm] = [f32::NAN; 2];
            self.push(Arrival { source, number, frame, instant, rx_power_dbm, first_path_power_dbm });
        }
    }

    fn is_wanted(&mut self, superframe: u16) -> bool {
        self.blinked = self.blinked.filter(|last| superframe.wrapping_sub(*last) <= REPORTED_SUPERFRAMES);
        self.blinked.is_some()
    }

    fn push(&mut self, arrival: Arrival) {
        if self.waiting.is_full() {
            // A station can do without one.
            self.waiting.pop_front();
        }
        // There is a place now.
        let _ = self.waiting.push_back(arrival);
    }

    /// The next one to be reported now.
    pub(super) fn next(&mut self) -> Option<Arrival> {
        self.left = self.left.checked_sub(1)?;
        self.waiting.pop_front()
    }
}

fn received(
    (source, number): (u16, u16),
    frame: ArrivedFrame,
    rx_time: RadioInstant,
    diagnostics: &Diagnostics,
    bias: &RangeBias,
) -> Arrival {
    let Diagnostics { rx_power_dbm, first_path_power_dbm, .. } = *diagnostics;
    let late = bias.metres(rx_power_dbm) / METRES_PER_TICK as f32;
    let instant = rx_time.plus(RadioDuration::from_ticks(-(late as i64)));
    Arrival { source, number, frame, instant, rx_power_dbm, first_path_power_dbm }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AT: RadioInstant = RadioInstant::from_ticks(1 << 39);

    /// Two metres too long at −80 dBm and below, none at −60.
    const BIAS: RangeBias =
        RangeBias { table: &[0.0, 2.0], first_dbm: -60.0, step_db: 20.0, estimates: &[], first_metre_dbm: 0.0 };

    fn diagnostics(rx_power_dbm: f32) -> Diagnostics {
        Diagnostics { rx_power_dbm, ..Diagnostics::default() }
    }

    #[test]
    fn sync_frames_are_reported_while_tags_blink() {
        let mut arrivals = Arrivals::default();
        let sync_frame = |arrivals: &mut Arrivals, superframe| {
            arrivals.begin();
            arrivals.sync_frame((7, superframe), AT, &diagnostics(-60.0), &BIAS);
            arrivals.next().is_some()
        };
        assert!(!sync_frame(&mut arrivals, 65_500));
        arrivals.begin();
        arrivals.blink((9, 3), 65_500, AT, &diagnostics(-80.0), &BIAS);
        let blink = arrivals.next().unwrap();
        // Two metres are 2 / 0.00469 = 426 ticks.
        assert_eq!((blink.source, blink.number, AT.since(blink.instant).ticks()), (9, 3, 426));
        assert!(sync_frame(&mut arrivals, 65_501) && sync_frame(&mut arrivals, 64));
        arrivals.own = 64;
        arrivals.departure(1, AT);
        let own = arrivals.next().unwrap();
        assert_eq!((own.source, own.number, own.frame), (1, 64, ArrivedFrame::OwnSyncFrame));
        // 101 superframes after the blink.
        assert!(!sync_frame(&mut arrivals, 65));
        assert!(!sync_frame(&mut arrivals, 64), "nobody blinks any more");
    }

    #[test]
    fn two_reports_follow_an_event_and_the_oldest_arrivals_are_dropped() {
        let mut arrivals = Arrivals::default();
        let most = MAX_WAITING as u16;
        (0..most + 3).for_each(|number| arrivals.blink((9, number), number, AT, &diagnostics(-60.0), &BIAS));
        let mut numbers = std::vec::Vec::new();
        while {
            arrivals.begin();
            let before = numbers.len();
            numbers.extend(core::iter::from_fn(|| arrivals.next()).map(|arrival| arrival.number));
            assert!(numbers.len() <= before + 2);
            numbers.len() > before
        } {}
        assert!(numbers.iter().copied().eq(3..most + 3), "{numbers:?}");
    }
}
