//! An ideal air for nodes that run in one image, in virtual time. Nothing is lost, all nodes are ten metres apart, and
//! their clocks are one clock. A frame is received by every node whose receiver was on from the frame's beginning.
//!
//! [`World::run`] polls one future, which contains all nodes. When nothing is left to do at the present time, time
//! advances to the next event. All times are ticks of the clock, 1/63.8976 GHz.

use core::cell::{Cell, RefCell};
use core::convert::Infallible;
use core::future::{Future, poll_fn};
use core::pin::Pin;
use core::task::{Context, Poll, Waker};

use embedded_hal_async::delay::DelayNs;
use heapless::{Deque, Vec};
use ranging::radio::{Capabilities, MAX_FRAME, RangeBias};
use ranging::{
    Diagnostics, Pace, PhyConfig, Radio, RadioDuration, RadioInstant, ReceiveError, Restart, RxFrame, Start,
    TransmitError,
};

/// The transmitting antenna delay of every radio, which is that of DWM1000-like boards.
pub const ANTENNA_DELAY: RadioDuration = RadioDuration::from_ticks(16_436);
/// The greatest number of nodes.
const MAX_NODES: usize = 5;
/// Ten metres: 10 / 299 704 645 s.
const FLIGHT: u64 = 2132;
/// From the end of a frame until the node has read it: 120 µs. Together with [`STARTING`] this is less than the 250 µs
/// that a DWM1001 has for an answer.
const READING: u64 = ticks(120);
/// From a command until the first pulse can leave: 100 µs.
const STARTING: u64 = ticks(100);
/// From a command, or from the end of a frame that was sent, until the receiver is on: 5 µs.
const RECEIVER_ON: u64 = ticks(5);
/// From the end of a frame until a receiver that stays on can receive the next one: 30 µs.
const LISTEN_AGAIN: u64 = ticks(30);
/// A slow clock of 32 768 Hz wakes a node, half a period late: 15 µs.
const WOKEN_LATE: u64 = ticks(15);
/// Two receive buffers: a third frame that ends before the first is read is lost.
const BUFFERS: usize = 2;
/// The chip's estimate for −77 dBm, where its range bias is zero (PRF 64), and a first path that is 2 dB weaker. The
/// clocks do not differ, but the arithmetic must not calculate with zeros: the ranges are wrong by a few decimetres.
const DIAGNOSTICS: (f32, f32, f32) = (-81.5, -83.5, 8.0);

/// Converts microseconds to ticks.
const fn ticks(micros: u64) -> u64 {
    micros * 638_976 / 10
}

fn span(duration: RadioDuration) -> u64 {
    u64::try_from(duration.ticks()).unwrap_or(0)
}

/// A frame on the air, or received.
#[derive(Clone)]
struct Frame {
    sender: usize,
    begin: u64,
    rmarker: u64,
    end: u64,
    bytes: Vec<u8, MAX_FRAME>,
}

/// A node's receiver.
#[derive(Default)]
struct Receiver {
    /// The time since which it is on.
    on: Option<u64>,
    /// It stays on after a frame.
    stays_on: bool,
    /// The received frames, each with the time at which the node has read it.
    heard: Deque<(u64, Frame), BUFFERS>,
}

impl Receiver {
    fn switch_off(&mut self) {
        self.on = None;
        self.heard.clear();
    }

    fn take(&mut self, frame: &Frame) {
        if self.on.is_none_or(|since| since > frame.begin + FLIGHT) {
            return;
        }
        let end = frame.end + FLIGHT;
        let previous = self.heard.back().map_or(0, |(ready, _)| *ready);
        // A full buffer loses the frame.
        let _ = self.heard.push_back((end.max(previous) + READING, frame.clone()));
        self.on = self.stays_on.then_some(end + LISTEN_AGAIN);
    }
}

/// The air and its time.
pub struct World {
    phy: PhyConfig,
    now: Cell<u64>,
    /// The earliest time that a future waits for.
    next: Cell<u64>,
    receivers: RefCell<Vec<Receiver, MAX_NODES>>,
    /// Each node sends one frame at a time.
    flying: RefCell<Vec<Frame, MAX_NODES>>,
}

impl World {
    /// An air without nodes.
    pub fn new(phy: PhyConfig) -> Self {
        let (receivers, flying) = (RefCell::default(), RefCell::default());
        Self { phy, now: Cell::new(0), next: Cell::new(0), receivers, flying }
    }

    /// Adds a node and returns its radio. `None` if there are too many nodes.
    pub fn add(&self) -> Option<AirRadio<'_>> {
        let mut receivers = self.receivers.borrow_mut();
        receivers.push(Receiver::default()).ok()?;
        Some(AirRadio { world: self, node: receivers.len() - 1, pace: Pace::default() })
    }

    /// A delay in this world.
    pub fn delay(&self) -> AirDelay<'_> {
        AirDelay(self)
    }

    /// Microseconds since the beginning.
    pub fn now_us(&self) -> u64 {
        self.now.get() * 10 / ticks(10)
    }

    /// Runs for `micros` microseconds. Wakers do nothing here: the future is polled at every time that any of its parts
    /// waits for.
    pub fn run(&self, micros: u64, mut future: Pin<&mut impl Future>) {
        let end = ticks(micros);
        let mut context = Context::from_waker(Waker::noop());
        while self.now.get() < end {
            self.next.set(end);
            if future.as_mut().poll(&mut context).is_ready() {
                return;
            }
            let landing = self.flying.borrow().iter().map(|frame| frame.end + FLIGHT).min();
            self.now.set(self.next.get().min(landing.unwrap_or(end)));
            self.land();
        }
    }

    /// Delivers the frames that have passed all nodes.
    fn land(&self) {
        self.flying.borrow_mut().retain(|frame| {
            let flies = frame.end + FLIGHT > self.now.get();
            if !flies {
                let mut receivers = self.receivers.borrow_mut();
                let others = receivers.iter_mut().enumerate().filter(|(node, _)| *node != frame.sender);
                others.for_each(|(_, receiver)| receiver.take(frame));
            }
            flies
        });
    }

    /// Whether a time is reached. A future that also waits for something else registers both.
    fn reached(&self, time: u64) -> bool {
        let reached = self.now.get() >= time;
        if !reached {
            self.next.set(self.next.get().min(time));
        }
        reached
    }

    async fn wait_until(&self, time: u64) {
        poll_fn(|_| if self.reached(time) { Poll::Ready(()) } else { Poll::Pending }).await;
    }

    /// The time of an instant that is near.
    fn time_of(&self, instant: RadioInstant) -> u64 {
        self.now.get().saturating_add_signed(instant.since(RadioInstant::from_ticks(self.now.get())).ticks())
    }
}

/// The radio of a node.
pub struct AirRadio<'w> {
    world: &'w World,
    node: usize,
    pace: Pace,
}

impl AirRadio<'_> {
    fn with<T>(&self, act: impl FnOnce(&mut Receiver) -> T) -> Option<T> {
        self.world.receivers.borrow_mut().get_mut(self.node).map(act)
    }

    /// The first frame that has been read by `until`. A frame that is being read then is awaited.
    async fn next(&self, until: u64) -> Option<Frame> {
        poll_fn(|_| {
            let ready = self.with(|receiver| receiver.heard.front().map(|(ready, _)| *ready)).flatten();
            if ready.is_some_and(|ready| self.world.reached(ready)) {
                return Poll::Ready(self.with(|receiver| receiver.heard.pop_front()).flatten().map(|(_, frame)| frame));
            }
            if ready.is_none() && self.world.reached(until) { Poll::Ready(None) } else { Poll::Pending }
        })
        .await
    }
}

impl Radio for AirRadio<'_> {
    type Error = Infallible;

    const CAPABILITIES: Capabilities = baliza_dw1000::CAPABILITIES;

    async fn now(&mut self) -> Result<RadioInstant, Infallible> {
        Ok(RadioInstant::from_ticks(self.world.now.get()))
    }

    fn antenna_delay(&self) -> RadioDuration {
        ANTENNA_DELAY
    }

    fn range_bias(&self) -> RangeBias {
        baliza_dw1000::bias::of(&self.world.phy)
    }

    async fn transmit(
        &mut self,
        frame: &[u8],
        start: Start,
        listen: bool,
    ) -> Result<RadioInstant, TransmitError<Infallible>> {
        self.with(Receiver::switch_off);
        let begin = self.world.now.get() + STARTING;
        let armed = (start != Start::Now).then(|| RadioInstant::from_ticks(begin));
        self.pace = Pace { armed, ..Pace::default() };
        let to_rmarker = span(self.world.phy.time_to_rmarker());
        let rmarker = match start {
            Start::Now => begin + to_rmarker,
            Start::At(at) => self.world.time_of(self.departure(at)),
        };
        if rmarker < begin + to_rmarker {
            return Err(TransmitError::Late);
        }
        let end = rmarker + span(self.world.phy.time_after_rmarker(frame.len() as u16 + 2));
        let bytes = Vec::from_slice(frame).map_err(|_| TransmitError::TooLong)?;
        let frame = Frame { sender: self.node, begin: rmarker - to_rmarker, rmarker, end, bytes };
        // Each node sends one frame at a time.
        let _ = self.world.flying.borrow_mut().push(frame);
        self.world.wait_until(end).await;
        if listen {
            self.with(|receiver| (receiver.on, receiver.stays_on) = (Some(end + RECEIVER_ON), true));
        }
        Ok(RadioInstant::from_ticks(rmarker))
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
            Start::Now => self.world.now.get(),
            Start::At(at) => self.world.time_of(at),
        };
        if on < self.world.now.get() {
            return Err(ReceiveError::Late);
        }
        self.with(|receiver| {
            receiver.on.get_or_insert(on + RECEIVER_ON);
            receiver.stays_on = keep_listening;
        });
        let received = self.next(on + span(window)).await;
        if !keep_listening || received.is_none() {
            self.with(Receiver::switch_off);
        }
        let Some(frame) = received else { return Err(ReceiveError::Timeout) };
        self.pace.listening = keep_listening.then(|| RadioInstant::from_ticks(frame.end + FLIGHT + LISTEN_AGAIN));
        let Some(bytes) = buffer.get_mut(..frame.bytes.len()) else { return Err(ReceiveError::Corrupt) };
        bytes.copy_from_slice(&frame.bytes);
        let (rx_power_dbm, first_path_power_dbm, clock_offset_ppm) = DIAGNOSTICS;
        let diagnostics =
            Diagnostics { rx_power_dbm, first_path_power_dbm, clock_offset_ppm, ..Diagnostics::default() };
        Ok(RxFrame { bytes, rx_time: RadioInstant::from_ticks(frame.rmarker + FLIGHT), diagnostics })
    }

    fn pace(&self) -> Pace {
        self.pace
    }

    async fn idle(&mut self) -> Result<(), Infallible> {
        self.with(Receiver::switch_off);
        Ok(())
    }
}

impl Restart for AirRadio<'_> {
    async fn restart(&mut self) -> Result<(), Infallible> {
        self.idle().await
    }
}

/// The delays of a node.
pub struct AirDelay<'w>(&'w World);

impl DelayNs for AirDelay<'_> {
    async fn delay_ns(&mut self, ns: u32) {
        self.delay_us(ns.div_ceil(1000)).await;
    }

    async fn delay_us(&mut self, us: u32) {
        self.0.wait_until(self.0.now.get() + ticks(us.into()) + WOKEN_LATE).await;
    }

    async fn delay_ms(&mut self, ms: u32) {
        self.0.wait_until(self.0.now.get() + ticks(1000 * u64::from(ms)) + WOKEN_LATE).await;
    }
}
