//! A node's radio and its delays.

use core::convert::Infallible;
use core::future::{Future, poll_fn};
use core::task::Poll;

use embassy_futures::select::select;
use embedded_hal_async::delay::DelayNs;
use ranging::Restart;
use ranging::radio::{Capabilities, MAX_FRAME, RangeBias};
use ranging::{Pace, Radio, RadioDuration, RadioInstant, ReceiveError, RxFrame, Start, TransmitError};

use crate::air::{Node, STARTING_US};
use crate::clock::{Crystal, span, ticks};
use crate::world::World;

/// The transmitting antenna delay of every radio, ticks, which is that of DWM1000-like boards.
pub const ANTENNA_DELAY: RadioDuration = RadioDuration::from_ticks(16_436);
/// From a command until the receiver is on.
const RECEIVER_ON_US: u64 = 5;
/// A slow clock of 32 768 Hz wakes a node, half a period late.
const WOKEN_LATE_US: u64 = 15;

/// The radio of a node in a [`World`].
pub struct AirRadio<'w> {
    world: &'w World,
    node: usize,
    pace: Pace,
}

impl<'w> AirRadio<'w> {
    pub(crate) fn new(world: &'w World, node: usize) -> Self {
        Self { world, node, pace: Pace::default() }
    }

    fn with<T>(&self, act: impl FnOnce(&mut Node) -> T) -> Option<T> {
        self.world.air.borrow_mut().nodes.get_mut(self.node).map(act)
    }

    fn crystal(&self) -> Crystal {
        self.with(|node| node.crystal).unwrap_or(Crystal { start: 0, fast_ppb: 0 })
    }

    fn global(&self, instant: RadioInstant) -> u64 {
        self.crystal().global(instant, self.world.now())
    }

    fn switch_off(&self) {
        self.with(Node::switch_off);
    }
}

impl Radio for AirRadio<'_> {
    type Error = Infallible;

    const CAPABILITIES: Capabilities = baliza_dw1000::CAPABILITIES;

    async fn now(&mut self) -> Result<RadioInstant, Infallible> {
        Ok(self.crystal().local(self.world.now()))
    }

    fn antenna_delay(&self) -> RadioDuration {
        ANTENNA_DELAY
    }

    fn range_bias(&self) -> RangeBias {
        baliza_dw1000::bias::of(&self.world.air.borrow().phy)
    }

    async fn transmit(
        &mut self,
        frame: &[u8],
        start: Start,
        listen: bool,
    ) -> Result<RadioInstant, TransmitError<Infallible>> {
        if frame.len() > MAX_FRAME {
            return Err(TransmitError::TooLong);
        }
        self.switch_off();
        self.pace = Pace::default();
        let commanded = self.world.now() + ticks(STARTING_US);
        if start != Start::Now {
            self.pace.armed = Some(self.crystal().local(commanded));
        }
        let soonest = commanded + span(self.world.air.borrow().phy.time_to_rmarker());
        let departure = match start {
            Start::Now => self.crystal().local(soonest),
            Start::At(at) => self.departure(at),
        };
        let rmarker = self.global(departure);
        // One tick is lost in the conversion between the two clocks.
        if rmarker + 1 < soonest {
            return Err(TransmitError::Late);
        }
        let end = self.world.air.borrow_mut().send(self.node, rmarker, frame);
        self.world.wait_until(end).await;
        if listen {
            let on = end + ticks(RECEIVER_ON_US);
            self.with(|node| (node.listening, node.stays_on) = (Some(on), true));
        }
        Ok(departure)
    }

    async fn receive<'b>(
        &mut self,
        buffer: &'b mut [u8; MAX_FRAME],
        start: Start,
        window: RadioDuration,
        keep_listening: bool,
    ) -> Result<RxFrame<'b>, ReceiveError<Infallible>> {
        self.pace = Pace::default();
        let on = match start {
            Start::Now => self.world.now(),
            Start::At(at) => self.global(at),
        };
        if on < self.world.now() {
            return Err(ReceiveError::Late);
        }
        self.with(|node| {
            node.listening.get_or_insert(on + ticks(RECEIVER_ON_US));
            node.stays_on = keep_listening;
        });
        let until = on + span(window);
        let arrival = poll_fn(|_| {
            let ready = self.with(|node| node.heard.front().map(|arrival| arrival.ready)).flatten();
            if ready.is_some_and(|ready| self.world.reached(ready)) {
                return Poll::Ready(self.with(|node| node.heard.pop_front()).flatten());
            }
            // If the node is reading a frame, the frame is awaited.
            if ready.is_none() && self.world.reached(until) { Poll::Ready(None) } else { Poll::Pending }
        })
        .await;
        if !keep_listening || arrival.is_none() {
            self.switch_off();
        }
        let Some(arrival) = arrival else { return Err(ReceiveError::Timeout) };
        self.pace.listening = arrival.listening.map(|on| self.crystal().local(on));
        let Some(received) = arrival.frame else { return Err(ReceiveError::Corrupt) };
        let Some(bytes) = buffer.get_mut(..received.bytes.len()) else { return Err(ReceiveError::Corrupt) };
        bytes.copy_from_slice(&received.bytes);
        Ok(RxFrame { bytes, rx_time: received.rx_time, diagnostics: received.diagnostics })
    }

    fn pace(&self) -> Pace {
        self.pace
    }

    async fn idle(&mut self) -> Result<(), Infallible> {
        self.switch_off();
        Ok(())
    }
}

impl Restart for AirRadio<'_> {
    async fn restart(&mut self) -> Result<(), Infallible> {
        self.switch_off();
        Ok(())
    }

    /// As on a chip, the clock shows another count after the sleep.
    async fn sleep(&mut self, micros: u32, roused: impl Future<Output = ()>) -> Result<bool, Infallible> {
        self.switch_off();
        select(self.world.wait_until(self.world.now() + ticks(micros.into())), roused).await;
        self.with(|node| {
            node.crystal.start = node.crystal.start.rotate_left(17) ^ self.world.now();
            node.naps += 1;
        });
        Ok(true)
    }
}

/// The delays of a node in a [`World`].
#[derive(Clone)]
pub struct AirDelay<'w>(&'w World);

impl<'w> AirDelay<'w> {
    pub(crate) fn new(world: &'w World) -> Self {
        Self(world)
    }
}

impl DelayNs for AirDelay<'_> {
    async fn delay_ns(&mut self, ns: u32) {
        self.delay_us(ns.div_ceil(1000)).await;
    }

    async fn delay_us(&mut self, us: u32) {
        let end = self.0.now() + ticks(u64::from(us) + WOKEN_LATE_US);
        self.0.wait_until(end).await;
    }

    async fn delay_ms(&mut self, ms: u32) {
        let end = self.0.now() + ticks(1000 * u64::from(ms) + WOKEN_LATE_US);
        self.0.wait_until(end).await;
    }
}
