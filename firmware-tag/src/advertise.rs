//! Advertises a tag's positions by Bluetooth, each once and as it is computed: `wire::ble::TagPosition`.

use core::convert::Infallible;

use embassy_sync::blocking_mutex::raw::RawMutex;
use embedded_hal_async::delay::DelayNs;
use ranging::exchange::RoundFix;
use wire::ble::TagPosition;
use wire::config::Record;
use wire::uwb::native::{MakeCode, PolledPosition};

use crate::{Measured, TaskChannels};

/// From one advertisement to the next at least, milliseconds; Bluetooth allows 20. A tag that finds more positions advertises
/// the newest.
const LEAST_INTERVAL_MS: u32 = 50;

/// A radio that sends an advertisement on each of its three channels, which nobody can connect to or ask for more.
#[allow(async_fn_in_trait, reason = "nodes run on one core; no future crosses a thread")]
pub trait Advertiser {
    /// Sends these advertising data once.
    async fn advertise(&mut self, data: &[u8; TagPosition::BYTES]);
}

/// A position to be advertised.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Found {
    pub(crate) round: u16,
    pub(crate) asked: u8,
    pub(crate) position: PolledPosition,
}

impl Found {
    /// That of a round with these measurements.
    pub(crate) const fn of(fix: &RoundFix, measured: &Measured<'_>) -> Self {
        let RoundFix { round, position } = *fix;
        Self { round, asked: measured.asked(), position: position.of_rounds_ago(0) }
    }
}

/// Who advertises.
#[derive(Clone, Copy)]
pub struct Sender {
    pan: u16,
    tag: u16,
    key: Option<[u8; 16]>,
    make_code: MakeCode,
}

impl Sender {
    /// The tag with this record and this address, whose board makes codes so.
    pub const fn new(record: &Record, tag: u16, make_code: MakeCode) -> Self {
        Self { pan: record.network.pan, tag, key: record.beacon_key, make_code }
    }

    /// Seldom and slow: for size.
    #[cold]
    #[inline(never)]
    fn emit(&self, found: Found) -> [u8; TagPosition::BYTES] {
        let Found { round, asked, position } = found;
        let key = self.key.as_ref().map(|key| (key, self.make_code));
        TagPosition { pan: self.pan, tag: self.tag, round, asked, position }.emit(key)
    }
}

/// The task of the advertiser.
pub async fn run<M: RawMutex>(
    channels: &TaskChannels<M>,
    sender: Sender,
    mut advertiser: impl Advertiser,
    mut delay: impl DelayNs,
) -> Infallible {
    loop {
        let found = channels.next_found().await;
        advertiser.advertise(&sender.emit(found)).await;
        delay.delay_ms(LEAST_INTERVAL_MS).await;
    }
}

#[cfg(test)]
mod tests {
    use core::cell::{Cell, RefCell};
    use core::future::{Future, poll_fn};
    use core::pin::pin;
    use core::task::{Context, Poll, Waker};
    use std::vec::Vec;

    use embassy_sync::blocking_mutex::raw::NoopRawMutex;
    use wire::uwb::native::software_code;

    use super::*;

    /// Notes when it was asked to send which round.
    struct Noting<'c>(&'c Cell<u64>, &'c RefCell<Vec<(u64, u16)>>);

    impl Advertiser for Noting<'_> {
        async fn advertise(&mut self, data: &[u8; TagPosition::BYTES]) {
            let sent = TagPosition::parse(data, Some((b"key of this site", software_code))).expect("the key's code");
            assert_eq!((sent.pan, sent.tag, sent.asked), (0xBA12, 0x1001, 4));
            self.1.borrow_mut().push((self.0.get(), sent.round));
        }
    }

    struct Passing<'c>(&'c Cell<u64>);

    impl DelayNs for Passing<'_> {
        async fn delay_ns(&mut self, ns: u32) {
            let end_ms = self.0.get() + u64::from(ns) / 1_000_000;
            poll_fn(|_| if self.0.get() >= end_ms { Poll::Ready(()) } else { Poll::Pending }).await;
        }
    }

    #[test]
    fn each_position_is_advertised_once_and_of_too_many_the_newest() {
        let (now_ms, sent) = (Cell::new(0), RefCell::new(Vec::new()));
        let channels = TaskChannels::<NoopRawMutex>::new();
        let sender = Sender { pan: 0xBA12, tag: 0x1001, key: Some(*b"key of this site"), make_code: software_code };
        let mut running = pin!(run(&channels, sender, Noting(&now_ms, &sent), Passing(&now_ms)));
        let position = PolledPosition::new([1.0, 2.0, 3.0], [[0.0; 3]; 3], false).expect("a position");
        for ms in 0..2000 {
            now_ms.set(ms);
            // A position every 20 ms in the first second, one every 500 ms in the second.
            if ms % if ms < 1000 { 20 } else { 500 } == 0 {
                channels.tell_found(Some(Found { round: ms as u16, asked: 4, position }));
            }
            assert!(running.as_mut().poll(&mut Context::from_waker(Waker::noop())).is_pending());
        }
        // 50 ms after each the newest of those that came since: at 50 that of 40, at 100 that of 100, …
        let first: Vec<_> = (0..20).map(|i| (50 * i, (50 * i - 50 * i % 20) as u16)).collect();
        let sent = sent.borrow();
        assert_eq!(sent[..20], first);
        assert_eq!(sent[20..], [(1000, 1000), (1500, 1500)]);
    }
}
