//! The event log of a node. One call turns an event into a telemetry frame in a queue and, where a person wants to read
//! it, into a line of the log.
//!
//! Writing never waits: a full queue drops its oldest frames and counts them. The task with a channel to the host takes
//! the frames out with [`EventLog::drain`].

use core::cell::{Cell, RefCell};

use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::RawMutex;
use embedded_hal_async::delay::DelayNs;
use ranging::exchange::Link;
use wire::telemetry::log::{self, Line};
use wire::telemetry::{Body, Condition, Fix, FixLine, Hello, MAX_FRAME, Message, Queue, State, encode};

use crate::Counts;
use crate::lines::LinePace;
use crate::supervision::{Lights, Lit};

/// From one hello to the next, and from one message with the counters to the next, seconds.
const HELLO_S: u32 = 2;
const COUNTERS_S: u32 = 5;

/// The event log of a node, for a `static`. At most `BYTES` of frames wait.
pub struct EventLog<M: RawMutex, const BYTES: usize> {
    queue: Mutex<M, RefCell<Queue<BYTES>>>,
    lights: Mutex<M, Cell<Lights>>,
    fix_lines: Mutex<M, RefCell<LinePace>>,
}

impl<M: RawMutex, const BYTES: usize> EventLog<M, BYTES> {
    /// An empty event log.
    pub const fn new() -> Self {
        Self {
            queue: Mutex::new(RefCell::new(Queue::new())),
            lights: Mutex::new(Cell::new(Lights::new())),
            fix_lines: Mutex::new(RefCell::new(LinePace::new())),
        }
    }

    /// Writes an event that has a line in the log: the line and the telemetry frame.
    pub fn log(&self, body: impl Body + Line + Into<Message>) {
        body.log();
        self.send(body);
    }

    /// Sends an event that has no line in the log: only the telemetry frame.
    pub fn send(&self, body: impl Into<Message>) {
        self.queue_frame(&body.into());
    }

    /// Makes the frame first: on a chip no interrupt is served while the queue is locked. One function for all events.
    #[inline(never)]
    fn queue_frame(&self, message: &Message) {
        let mut frame = [0; MAX_FRAME];
        let frame = encode(message, &mut frame);
        self.queue.lock(|queue| queue.borrow_mut().push(frame));
    }

    /// Sends the result of a round in which `answered` anchors answered. The log gets a line as well if its last such
    /// line is old enough.
    pub fn fix(&self, fix: Fix, answered: u8) {
        if self.fix_lines.lock(|lines| lines.borrow_mut().is_due(fix.t_us)) {
            log::write(fix.severity(), &FixLine { fix, answered });
        }
        self.send(fix);
    }

    /// Reports a change of the node's state at `t_us`.
    pub fn state(&self, t_us: u64, is: Condition) {
        self.log(State { t_us, is });
        self.lights.lock(|lights| {
            let mut shown = lights.get();
            shown.show(is);
            lights.set(shown);
        });
    }

    /// Reports a change of the node's link to its network at `t_us`.
    pub fn link(&self, t_us: u64, link: Link) {
        let is = match link {
            Link::Paired(peer) => Condition::Paired(peer),
            Link::Lost(_) | Link::Unsynchronised => Condition::Searching,
            Link::Synchronised(coordinator) => Condition::Synchronised(coordinator),
            Link::Joined(slots) => Condition::Joined(slots),
            Link::NetworkFull => Condition::NetworkFull,
            Link::Unlisted => Condition::Unlisted,
            Link::Coordinating => Condition::Coordinating,
            Link::Following(coordinator) => Condition::Following(coordinator),
        };
        self.state(t_us, is);
    }

    /// The lights show where the node is, until `until_us`.
    pub fn identify(&self, until_us: u64) {
        self.lights.lock(|lights| {
            let mut shown = lights.get();
            shown.identify(until_us);
            lights.set(shown);
        });
    }

    /// What the lights show of the state that was reported last.
    pub fn lit(&self, t_us: u64) -> Lit {
        self.lights.lock(Cell::get).at(t_us)
    }

    /// Takes frames out, the oldest first, until `write` refuses one. `write` takes a whole frame or none. The queue is
    /// locked while `write` runs: it may copy into the channel's memory, and must not wait.
    pub fn drain(&self, mut write: impl FnMut(&[u8]) -> bool) {
        // The lock is released between frames.
        let one = |write: &mut dyn FnMut(&[u8]) -> bool| {
            self.queue.lock(|queue| {
                let mut queue = queue.borrow_mut();
                let written = queue.front().is_some_and(write);
                if written {
                    queue.pop();
                }
                written
            })
        };
        while one(&mut write) {}
    }

    /// Frames dropped so far, because the queue was full.
    pub fn dropped(&self) -> u32 {
        self.queue.lock(|queue| queue.borrow().dropped())
    }

    /// Sends the hello and the counters every few seconds, for ever. `hello`'s time is replaced by the present time.
    /// The first hello is not sent here: it is logged at the start.
    pub async fn keep_telling(
        &self,
        hello: Hello,
        counts: &Counts,
        clock: impl Fn() -> u64,
        mut delay: impl DelayNs,
    ) -> core::convert::Infallible {
        let mut seconds = 0_u32;
        loop {
            delay.delay_ms(1000).await;
            seconds = seconds.wrapping_add(1);
            if seconds.is_multiple_of(HELLO_S) {
                self.send(Hello { t_us: clock(), ..hello });
            }
            if seconds.is_multiple_of(COUNTERS_S) {
                self.log(counts.told(clock(), self.dropped()));
            }
        }
    }
}

impl<M: RawMutex, const BYTES: usize> Default for EventLog<M, BYTES> {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::cell::Cell;
    use core::future::{Future, poll_fn};
    use core::pin::pin;
    use core::task::Poll;
    use embassy_sync::blocking_mutex::raw::NoopRawMutex;
    use std::vec::Vec;
    use wire::telemetry::{Board, Decoder, Reset, ResetCause, Role};

    const HELLO: Hello =
        Hello { t_us: 0, eui: 1, address: 2, role: Role::Tag, board: Board::Simulated, build: [0; 8], keyed: false };

    fn messages<const BYTES: usize>(event_log: &EventLog<NoopRawMutex, BYTES>) -> Vec<Message> {
        let mut bytes = Vec::new();
        event_log.drain(|frame| {
            bytes.extend_from_slice(frame);
            true
        });
        let mut decoder = Decoder::new();
        bytes.into_iter().filter_map(|byte| decoder.feed(byte)).map(|message| message.unwrap()).collect()
    }

    #[test]
    fn entries_come_out_as_frames_in_their_order() {
        let event_log = EventLog::<NoopRawMutex, 512>::new();
        let reset = Reset { t_us: 1, cause: ResetCause::PowerOn, crash: None };
        event_log.log(reset);
        event_log.log(HELLO);
        event_log.state(3, Condition::Searching);
        let state = State { t_us: 3, is: Condition::Searching };
        assert_eq!(messages(&event_log), [Message::Reset(reset), Message::Hello(HELLO), Message::State(state)]);
        assert_eq!(messages(&event_log), []);
    }

    #[test]
    fn a_channel_that_is_full_gets_the_rest_later() {
        let event_log = EventLog::<NoopRawMutex, 512>::new();
        for t_us in 0..3 {
            event_log.state(t_us, Condition::Searching);
        }
        let room = Cell::new(2);
        let mut taken = 0;
        event_log.drain(|_| {
            let fits = room.get() > 0;
            room.set(room.get() - i32::from(fits));
            taken += i32::from(fits);
            fits
        });
        assert_eq!(taken, 2);
        assert_eq!(messages(&event_log), [Message::State(State { t_us: 2, is: Condition::Searching })]);
    }

    #[test]
    fn a_full_queue_drops_the_oldest_and_counts_them() {
        let event_log = EventLog::<NoopRawMutex, 256>::new();
        for t_us in 0..100 {
            event_log.state(t_us, Condition::Searching);
        }
        let left = messages(&event_log);
        assert_eq!(left.len() + event_log.dropped() as usize, 100);
        assert_eq!(left.last(), Some(&Message::State(State { t_us: 99, is: Condition::Searching })));
        assert!(event_log.dropped() > 0 && !left.is_empty());
    }

    /// A delay that advances the time by what it is asked to wait.
    struct Seconds<'c>(&'c Cell<u64>);

    impl DelayNs for Seconds<'_> {
        async fn delay_ns(&mut self, ns: u32) {
            self.0.set(self.0.get() + u64::from(ns / 1000));
            let mut waited = false;
            poll_fn(|_| if core::mem::replace(&mut waited, true) { Poll::Ready(()) } else { Poll::Pending }).await;
        }
    }

    #[test]
    fn who_is_speaking_and_the_counters_are_repeated() {
        let event_log = EventLog::<NoopRawMutex, 1024>::new();
        let (now, counts) = (Cell::new(0), Counts::new());
        counts.sent.add();
        let telling = event_log.keep_telling(HELLO, &counts, || now.get(), Seconds(&now));
        let mut telling = pin!(telling);
        let mut context = core::task::Context::from_waker(core::task::Waker::noop());
        while now.get() < 10_500_000 {
            assert!(telling.as_mut().poll(&mut context).is_pending());
        }
        let told = messages(&event_log);
        let hellos: Vec<u64> =
            told.iter().filter_map(|m| if let Message::Hello(h) = m { Some(h.t_us) } else { None }).collect();
        assert_eq!(hellos, [2_000_000, 4_000_000, 6_000_000, 8_000_000, 10_000_000]);
        let counters =
            told.iter().filter_map(|m| if let Message::Counters(c) = m { Some((c.t_us, c.sent)) } else { None });
        assert_eq!(counters.collect::<Vec<_>>(), [(5_000_000, 1), (10_000_000, 1)]);
    }
}
