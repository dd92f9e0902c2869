//! Waits: two delays with a resolution of a nanosecond, like those of a DWM1001's timer with its compare registers, and
//! the executors' own clock.

use core::cell::RefCell;
use core::future::poll_fn;
use core::task::{Poll, Waker};

use critical_section::Mutex;
use embassy_time_driver::Driver;
use embedded_hal_async::delay::DelayNs;

use super::clock::{self, Pause};

const DELAYS: usize = 2;
/// The number of tasks that can wait by the executors' clock at a time.
const TASKS: usize = 6;

/// A task and the time when it must be woken.
struct Alarm {
    at_ns: u64,
    waker: Waker,
}

static ALARMS: Mutex<RefCell<[Option<Alarm>; DELAYS + TASKS]>> =
    Mutex::new(RefCell::new([const { None }; DELAYS + TASKS]));

/// The time of the earliest alarm, nanoseconds.
pub(super) fn first_ns() -> Option<u64> {
    critical_section::with(|token| ALARMS.borrow_ref(token).iter().flatten().map(|alarm| alarm.at_ns).min())
}

/// Wakes the tasks whose time has come.
pub(super) fn ring(now_ns: u64) {
    let due = |alarm: &mut Option<Alarm>| alarm.take_if(|alarm| alarm.at_ns <= now_ns);
    for place in 0..DELAYS + TASKS {
        if let Some(alarm) = critical_section::with(|token| due(&mut ALARMS.borrow_ref_mut(token)[place])) {
            alarm.waker.wake();
        }
    }
}

/// One of two delays, for one task. The alarm of a cancelled wait still wakes the task, unless the next wait has begun.
pub struct Delay {
    index: usize,
}

impl Delay {
    pub(super) fn take() -> [Self; DELAYS] {
        core::array::from_fn(|index| Self { index })
    }

    async fn until(&mut self, at_ns: u64) {
        poll_fn(|context| {
            let _pause = Pause::begin();
            if clock::now_ns() >= at_ns {
                return Poll::Ready(());
            }
            let alarm = Some(Alarm { at_ns, waker: context.waker().clone() });
            critical_section::with(|token| ALARMS.borrow_ref_mut(token)[self.index] = alarm);
            Poll::Pending
        })
        .await;
    }
}

/// The instant `us` microseconds from now, nanoseconds. The microsecond that has begun does not count.
fn after_us(us: u64) -> u64 {
    let _pause = Pause::begin();
    (clock::uptime_us() + us + 1) * 1000
}

impl DelayNs for Delay {
    async fn delay_ns(&mut self, ns: u32) {
        self.delay_us(ns.div_ceil(1000)).await;
    }

    async fn delay_us(&mut self, us: u32) {
        self.until(after_us(us.into())).await;
    }

    async fn delay_ms(&mut self, ms: u32) {
        self.until(after_us(1000 * u64::from(ms))).await;
    }
}

/// The executors' clock: microseconds.
struct Ticks;

impl Driver for Ticks {
    fn now(&self) -> u64 {
        clock::uptime_us()
    }

    fn schedule_wake(&self, at: u64, waker: &Waker) {
        let _pause = Pause::begin();
        let at_ns = at.saturating_mul(1000);
        critical_section::with(|token| {
            let mut alarms = ALARMS.borrow_ref_mut(token);
            let (_, tasks) = alarms.split_at_mut(DELAYS);
            // A task that waits for several instants is woken at the first, and then waits anew.
            let of_task = tasks.iter().position(|alarm| alarm.as_ref().is_some_and(|it| it.waker.will_wake(waker)));
            let place = of_task.or_else(|| tasks.iter().position(Option::is_none)).expect("there are few tasks");
            let at_ns = tasks[place].as_ref().map_or(at_ns, |alarm| alarm.at_ns.min(at_ns));
            tasks[place] = Some(Alarm { at_ns, waker: waker.clone() });
        });
    }
}

embassy_time_driver::time_driver_impl!(static TICKS: Ticks = Ticks);
