//! A beacon's radio. It sends an event after every interval plus a random delay. An event uses one channel after the
//! other.

use std::cell::RefCell;
use std::convert::Infallible;
use std::rc::Rc;
use std::task::{Poll, Waker};
use std::time::Duration;

use firmware_beacon::{Advertise, Advertisement};
use rand::Rng;

use super::Bluetooth;
use super::channel::{Channel, Link, Medium};
use crate::TrueTime;
use crate::air::{Path, Wall};
use crate::random::{Purpose, stream};

/// The random delay of an event (Bluetooth Core 5.4, volume 6, part B, 4.4.2.2.1).
const DELAY: Duration = Duration::from_millis(10);
/// From the end of an advertisement on one channel to its beginning on the next.
const HOP: Duration = Duration::from_micros(250);

/// Where a beacon is and how strongly it sends.
pub struct Sender {
    /// The beacon's number, which selects its random draws.
    pub number: u64,
    /// Where it is.
    pub path: Path,
    /// RSSI at 1 m in line of sight, the mean over all positions, dBm.
    pub rssi_1m_dbm: f64,
    link: Link,
}

impl Sender {
    /// Draws the random fields of the paths from this beacon.
    pub fn new(medium: Medium, seed: u64, number: u64, path: Path, rssi_1m_dbm: f64) -> Self {
        Self { number, path, rssi_1m_dbm, link: Link::draw(medium, seed, number) }
    }

    pub(super) fn rssi_dbm(&self, walls: &[Wall], to: [f64; 3], channel: Channel, time: TrueTime) -> f64 {
        self.link.rssi_dbm(walls, (self.path.at(time), self.rssi_1m_dbm), to, channel)
    }
}

/// What the radio sends.
#[derive(Clone)]
struct Going {
    data: Rc<[u8]>,
    interval: Duration,
    channels: Vec<Channel>,
}

#[derive(Default)]
struct State {
    going: Option<Going>,
    /// Counts the changes. A change ends an event that is under way.
    changes: u64,
    waker: Option<Waker>,
}

/// A beacon's radio; clones are the same one.
#[derive(Clone)]
pub struct Advertiser {
    air: Bluetooth,
    sender: Rc<Sender>,
    state: Rc<RefCell<State>>,
}

impl Advertiser {
    pub(super) fn new(air: Bluetooth, sender: Sender) -> Self {
        Self { air, sender: Rc::new(sender), state: Rc::default() }
    }

    /// Sends these bytes from now on, or nothing.
    pub fn send(&self, going: Option<(&[u8], Duration, [bool; 3])>) {
        let mut state = self.state.borrow_mut();
        state.going = going.map(|(data, interval, channels)| Going {
            data: data.into(),
            interval,
            channels: Channel::ALL
                .into_iter()
                .zip(channels)
                .filter(|(_, on)| *on)
                .map(|(channel, _)| channel)
                .collect(),
        });
        state.changes += 1;
        if let Some(waker) = state.waker.take() {
            waker.wake();
        }
    }

    /// Sends these bytes once on each channel, and returns after the last. `before` passes before each.
    pub async fn send_once(&self, data: &[u8], mut before: impl AsyncFnMut()) {
        let data: Rc<[u8]> = data.into();
        for channel in Channel::ALL {
            before().await;
            self.pause(self.air.send(&self.sender, channel, &data)).await;
        }
    }

    /// Serves the radio for ever.
    pub async fn serve(&self) -> Infallible {
        let mut draws = stream(self.air.world.seed(), Purpose::Advertiser, self.sender.number);
        let interval = self.going().await.0.interval;
        // Beacons were switched on at arbitrary times, so the first event has a random delay.
        self.pause(interval.mul_f64(draws.random())).await;
        loop {
            let begun = self.air.world.now();
            let (going, change) = self.going().await;
            for channel in &going.channels {
                if self.state.borrow().changes == change {
                    let took = self.air.send(&self.sender, *channel, &going.data);
                    self.pause(took + HOP).await;
                }
            }
            let next = begun + going.interval + DELAY.mul_f64(draws.random());
            self.air.world.sleep_until(next).await;
        }
    }

    async fn pause(&self, duration: Duration) {
        self.air.world.sleep_until(self.air.world.now() + duration).await;
    }

    /// Waits until there is something to send, and returns it.
    async fn going(&self) -> (Going, u64) {
        std::future::poll_fn(|context| {
            let mut state = self.state.borrow_mut();
            match state.going.clone() {
                Some(going) => Poll::Ready((going, state.changes)),
                None => {
                    state.waker = Some(context.waker().clone());
                    Poll::Pending
                }
            }
        })
        .await
    }
}

impl Advertise for Advertiser {
    type Error = Infallible;

    async fn start(&mut self, advertisement: &Advertisement) -> Result<(), Infallible> {
        let bits = advertisement.channels.bits();
        let interval = Duration::from_millis(advertisement.interval_ms.into());
        self.send(Some((&advertisement.data, interval, [bits & 1 != 0, bits & 2 != 0, bits & 4 != 0])));
        Ok(())
    }

    async fn stop(&mut self) -> Result<(), Infallible> {
        self.send(None);
        Ok(())
    }
}
