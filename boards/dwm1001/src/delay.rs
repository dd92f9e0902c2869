//! Waits with a resolution of a microsecond: TIMER1 counts microseconds of the 32 MHz crystal, with two compare
//! registers for each delay.
//!
//! If a node may rest in long waits ([`Delay::rest`]), the executor's clock on the RTC counts them. TIMER1 and the
//! crystal are then off until shortly before the end, which saves some 0.6 mA.
//!
//! The executor's own clock has ticks of 30.5 µs, and its waits may end two ticks late: 61 µs of the 150 µs that a node
//! has between a decision to transmit and the first pulse.

use core::future::poll_fn;
use core::pin::Pin;
use core::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use core::task::{Context, Poll};

use embassy_nrf::interrupt::Priority;
use embassy_nrf::interrupt::typelevel::{self, Interrupt};
#[cfg(not(feature = "ble"))]
use embassy_nrf::pac::clock::vals::HfclkstatSrc;
use embassy_nrf::pac::{CLOCK, TIMER1, timer::vals};
use embassy_nrf::{Peri, peripherals};
use embassy_sync::waitqueue::AtomicWaker;
use embassy_time::{Duration, Instant, Timer};
use embedded_hal_async::delay::DelayNs;

const DELAYS: usize = 2;
static WAKERS: [AtomicWaker; DELAYS] = [const { AtomicWaker::new() }; DELAYS];

/// The longest single wait, microseconds. It is less than half the range of 32 bits.
const LONGEST_US: u32 = 1 << 30;

/// Waits shorter than this keep TIMER1 and the crystal on, microseconds.
const LONG_US: u32 = 3_000;
/// Longer waits keep them on for this time before their end: the crystal starts within 0.4 ms.
const STARTING_US: u32 = 1_000;
/// Whether long waits are rests.
static RESTS: AtomicBool = AtomicBool::new(false);
/// The number of waits in progress.
static WAITS: AtomicU8 = AtomicU8::new(0);

/// The crystal is off, as a rest wants it, unless …
static RESTING: AtomicBool = AtomicBool::new(false);
/// … the chip's own radio needs it.
static HELD: AtomicBool = AtomicBool::new(false);

/// One of two delays, for one task.
pub struct Delay {
    index: usize,
}

/// A wait in progress. It is dropped at its end, or when the wait is cancelled.
struct Waiting;

impl Waiting {
    fn begin() -> Self {
        WAITS.fetch_add(1, Ordering::Relaxed);
        Self
    }

    fn is_alone() -> bool {
        WAITS.load(Ordering::Relaxed) == 1
    }
}

impl Drop for Waiting {
    fn drop(&mut self) {
        WAITS.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Keeps TIMER1 and the crystal off while it exists. The processor then runs from the RC oscillator of 64 MHz.
struct FastClocksOff;

impl FastClocksOff {
    fn begin() -> Self {
        TIMER1.tasks_stop().write_value(1);
        // A timer that is only stopped still requests its clock (anomaly 78).
        TIMER1.tasks_shutdown().write_value(1);
        RESTING.store(true, Ordering::Relaxed);
        if !HELD.load(Ordering::Relaxed) {
            CLOCK.tasks_hfclkstop().write_value(1);
        }
        Self
    }
}

impl Drop for FastClocksOff {
    fn drop(&mut self) {
        RESTING.store(false, Ordering::Relaxed);
        CLOCK.tasks_hfclkstart().write_value(1);
        TIMER1.tasks_start().write_value(1);
    }
}

/// Keeps the crystal on while it exists, also while the ranging task rests. One task below that one may hold it.
#[cfg(not(feature = "ble"))]
pub(crate) struct Crystal;

#[cfg(not(feature = "ble"))]
impl Crystal {
    /// Returns when the crystal runs.
    pub(crate) async fn hold() -> Self {
        HELD.store(true, Ordering::Relaxed);
        CLOCK.tasks_hfclkstart().write_value(1);
        let this = Self;
        while !is_running() {
            // It starts within 0.4 ms.
            Timer::after_micros(400).await;
        }
        this
    }
}

#[cfg(not(feature = "ble"))]
impl Drop for Crystal {
    fn drop(&mut self) {
        // The ranging task may end its rest at any instant, and needs the crystal from then on.
        critical_section::with(|_| {
            HELD.store(false, Ordering::Relaxed);
            if RESTING.load(Ordering::Relaxed) {
                CLOCK.tasks_hfclkstop().write_value(1);
            }
        });
    }
}

/// Whether the 64 MHz clock comes from the crystal.
#[cfg(not(feature = "ble"))]
fn is_running() -> bool {
    let clock = CLOCK.hfclkstat().read();
    clock.state() && clock.src() == HfclkstatSrc::Xtal
}

impl Delay {
    pub(super) fn take(
        _timer: Peri<'static, peripherals::TIMER1>,
        _binding: impl typelevel::Binding<typelevel::TIMER1, InterruptHandler>,
    ) -> [Self; DELAYS] {
        TIMER1.mode().write(|w| w.set_mode(vals::Mode::Timer));
        TIMER1.bitmode().write(|w| w.set_bitmode(vals::Bitmode::_32bit));
        // 16 MHz / 2⁴.
        TIMER1.prescaler().write(|w| w.set_prescaler(4));
        TIMER1.tasks_clear().write_value(1);
        TIMER1.tasks_start().write_value(1);
        typelevel::TIMER1::set_priority(Priority::P2);
        typelevel::TIMER1::unpend();
        // SAFETY: the interrupt's handler is bound.
        unsafe { typelevel::TIMER1::enable() };
        core::array::from_fn(|index| Self { index })
    }

    /// The compare register of a delay. The register after it captures the count.
    fn compare(&self) -> usize {
        2 * self.index
    }

    fn count(&mut self) -> u32 {
        let capture = self.compare() + 1;
        TIMER1.tasks_capture(capture).write_value(1);
        TIMER1.cc(capture).read()
    }

    fn is_over(&mut self, end: u32) -> bool {
        // The end has passed if the difference is less than half the range.
        self.count().wrapping_sub(end) <= u32::MAX / 2
    }

    /// Lets long waits be rests from now on, also those of the other delay. Call this only if the RTC has a crystal of
    /// its own and nothing else needs the 32 MHz crystal.
    pub fn rest(&self) {
        RESTS.store(true, Ordering::Relaxed);
    }

    async fn wait_long(&mut self, mut us: u64) {
        while us > u64::from(LONGEST_US) {
            us -= u64::from(LONGEST_US);
            self.wait(LONGEST_US).await;
        }
        self.wait(us as u32).await;
    }

    async fn wait(&mut self, us: u32) {
        let _waiting = Waiting::begin();
        let rests = us >= LONG_US && RESTS.load(Ordering::Relaxed) && Waiting::is_alone();
        let left = if rests { Self::rested(us).await } else { us };
        self.count_down(left).await;
    }

    /// Rests for nearly `us` microseconds. Returns the time that is left.
    async fn rested(us: u32) -> u32 {
        let begin = Instant::now();
        let fast_clocks = FastClocksOff::begin();
        Timer::at(begin + Duration::from_micros(u64::from(us - STARTING_US))).await;
        drop(fast_clocks);
        us.saturating_sub(u32::try_from(begin.elapsed().as_micros()).unwrap_or(u32::MAX))
    }

    async fn count_down(&mut self, us: u32) {
        // The microsecond that has begun does not count.
        let end = self.count().wrapping_add(us).wrapping_add(1);
        let compare = self.compare();
        TIMER1.events_compare(compare).write_value(0);
        TIMER1.cc(compare).write_value(end);
        poll_fn(|context| {
            WAKERS[self.index].register(context.waker());
            TIMER1.intenset().write(|w| w.set_compare(compare, true));
            // The end may have passed before the register was set.
            if self.is_over(end) { Poll::Ready(()) } else { Poll::Pending }
        })
        .await;
        TIMER1.intenclr().write(|w| w.set_compare(compare, true));
    }
}

impl DelayNs for Delay {
    fn delay_ns(&mut self, ns: u32) -> impl Future<Output = ()> {
        Outlined(self.wait_long(u64::from(ns).div_ceil(1000)))
    }

    fn delay_us(&mut self, us: u32) -> impl Future<Output = ()> {
        Outlined(self.wait_long(us.into()))
    }

    fn delay_ms(&mut self, ms: u32) -> impl Future<Output = ()> {
        Outlined(self.wait_long(1000 * u64::from(ms)))
    }
}

/// A future whose code exists only once in the image: the driver of the DW1000 waits in many places.
struct Outlined<F>(F);

impl<F: Future> Future for Outlined<F> {
    type Output = F::Output;

    #[inline(never)]
    fn poll(self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<F::Output> {
        // SAFETY: the field is not moved while the whole is pinned.
        unsafe { self.map_unchecked_mut(|this| &mut this.0) }.poll(context)
    }
}

/// The handler of TIMER1's interrupt.
pub struct InterruptHandler;

impl typelevel::Handler<typelevel::TIMER1> for InterruptHandler {
    unsafe fn on_interrupt() {
        for (index, waker) in WAKERS.iter().enumerate() {
            let compare = 2 * index;
            if TIMER1.events_compare(compare).read() != 0 {
                TIMER1.events_compare(compare).write_value(0);
                TIMER1.intenclr().write(|w| w.set_compare(compare, true));
                waker.wake();
            }
        }
    }
}
