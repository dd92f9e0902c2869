//! The instants from which a tag measures its own pace: its waits, its transmissions and the frames that it receives.

use crate::native::Network;
use crate::native::pace::Meter;
use crate::{Pace, RadioInstant};
use wire::uwb::native::RESPONSE_BYTES;

/// The instants of the last action.
#[derive(Clone, Debug, Default)]
pub(super) struct Stopwatch {
    /// The end of a wait or a window that leaves enough time for a transmission.
    pub(super) wake_at: Option<RadioInstant>,
    /// The radio reported when the command of the last transmission had reached it.
    pub(super) was_measured: bool,
    /// The last decision was made at the end of a wait or a window, and not after a frame.
    was_awaited: bool,
    /// When the receiver was on again after the last frame, if the radio reported it.
    listening_at: Option<RadioInstant>,
    /// The last received frame, until something else happens.
    received: Option<Received>,
}

/// The end of a frame.
#[derive(Clone, Copy, Debug)]
enum Received {
    InRound(RadioInstant),
    Other(RadioInstant),
}

impl Stopwatch {
    /// A step begins, at the end of a wait or a window or not.
    pub(super) fn begin(&mut self, was_awaited: bool) {
        (self.received, self.was_awaited) = (None, was_awaited);
    }

    /// A frame was received that ended at `ended`.
    pub(super) fn received(&mut self, ended: RadioInstant, is_in_round: bool, meter: &mut Meter) {
        self.received = Some(if is_in_round { Received::InRound(ended) } else { Received::Other(ended) });
        if let Some(listening) = self.listening_at.take() {
            meter.listened(listening.since(ended));
        }
    }

    /// Takes what the radio measured in the last action.
    pub(super) fn take(&mut self, pace: &Pace, network: &Network, meter: &mut Meter) {
        self.listening_at = pace.listening;
        self.was_measured = pace.armed.is_some();
        if let Some(armed) = pace.armed
            && let Some(wake) = self.wake_at.take()
        {
            meter.led(armed.since(wake), self.was_awaited);
        }
        if let (Some(ready), Some(received)) = (pace.ready, self.received) {
            let next = network.phy.airtime(RESPONSE_BYTES + network.code_bytes());
            match received {
                Received::InRound(ended) => meter.dealt_with(ready.since(ended), next),
                Received::Other(ended) => meter.dealt_with_other(ready.since(ended), next),
            }
        }
    }
}
