//! The lines to the DW1000.

use core::cell::RefCell;
use core::convert::Infallible;
use core::future::poll_fn;
use core::task::{Poll, Waker};

use baliza_dw1000::driver::{ClockedSpi, ResetLine, SpiClock};
use critical_section::Mutex;
use embedded_hal::digital;
use embedded_hal_async::digital::Wait;
use embedded_hal_async::spi::{self, SpiDevice};
use heapless::Vec;
use qemu_link::{MAX_MESSAGE, MAX_OPERATIONS, Operation, Request, WorldAnswer};

use super::clock::Pause;
use super::pipe::PIPE;

/// SPI to the DW1000. Transactions block, as on the boards.
pub struct Bus;

impl spi::ErrorType for Bus {
    type Error = Infallible;
}

impl SpiDevice for Bus {
    async fn transaction(&mut self, operations: &mut [spi::Operation<'_, u8>]) -> Result<(), Infallible> {
        transact(operations);
        Ok(())
    }
}

/// Not inlined, as on the boards.
#[inline(never)]
fn transact(operations: &mut [spi::Operation<'_, u8>]) {
    let _pause = Pause::begin();
    let mut described = Vec::<Operation, MAX_OPERATIONS>::new();
    let mut sent = Vec::<u8, { MAX_MESSAGE / 2 }>::new();
    let mut describe = |operation: Operation, bytes: &[u8]| {
        described.push(operation).ok()?;
        sent.extend_from_slice(bytes).ok()
    };
    for operation in operations.iter() {
        let within = match operation {
            spi::Operation::Write(bytes) => describe(Operation::Write(bytes.len() as u32), bytes),
            spi::Operation::Read(bytes) => describe(Operation::Read(bytes.len() as u32), &[]),
            spi::Operation::TransferInPlace(bytes) => describe(Operation::Transfer(bytes.len() as u32), bytes),
            spi::Operation::Transfer(read, write) if read.len() == write.len() => {
                describe(Operation::Transfer(write.len() as u32), write)
            }
            spi::Operation::Transfer(..) => None,
            spi::Operation::DelayNs(ns) => describe(Operation::DelayNs(*ns), &[]),
        };
        within.expect("the driver's transactions are few and short");
    }
    PIPE.ask(Request::Transaction { operations: &described, sent: &sent }, |answer| {
        let mut received = answer.body;
        let mut fill = |into: &mut [u8]| {
            let (first, rest) = received.split_at(into.len());
            into.copy_from_slice(first);
            received = rest;
        };
        for operation in operations {
            match operation {
                spi::Operation::Read(into)
                | spi::Operation::TransferInPlace(into)
                | spi::Operation::Transfer(into, _) => fill(into),
                spi::Operation::Write(_) | spi::Operation::DelayNs(_) => {}
            }
        }
    });
}

impl ClockedSpi for Bus {
    fn set_clock(&mut self, clock: SpiClock) -> Result<(), Infallible> {
        let fast = match clock {
            SpiClock::Slow => false,
            SpiClock::Fast => true,
        };
        PIPE.ask(Request::Clock { fast }, |_| ());
        Ok(())
    }
}

/// The line that resets the DW1000.
pub struct Reset;

impl ResetLine for Reset {
    fn pull_low(&mut self) {
        PIPE.ask(Request::Reset { low: true }, |_| ());
    }

    fn release(&mut self) {
        PIPE.ask(Request::Reset { low: false }, |_| ());
    }
}

/// The task that waits for the line to be high.
static WAITING: Mutex<RefCell<Option<Waker>>> = Mutex::new(RefCell::new(None));

/// Whether a task waits for the line to be high.
pub(super) fn is_awaited() -> bool {
    critical_section::with(|token| WAITING.borrow_ref(token).is_some())
}

/// The line was high: wakes the task that waits for it.
pub(super) fn wake() {
    if let Some(waker) = critical_section::with(|token| WAITING.borrow_ref_mut(token).take()) {
        waker.wake();
    }
}

/// The DW1000's interrupt line. Its level is that of the world's last answer.
pub struct Interrupt;

impl digital::ErrorType for Interrupt {
    type Error = Infallible;
}

/// A wait for the line. When it is dropped, at its end or cancelled, no task waits any more.
struct Waiting;

impl Drop for Waiting {
    fn drop(&mut self) {
        let _pause = Pause::begin();
        // The waker is dropped outside the critical section.
        let _ = critical_section::with(|token| WAITING.borrow_ref_mut(token).take());
    }
}

impl Interrupt {
    async fn high() {
        let _waiting = Waiting;
        let mut armed = false;
        poll_fn(|context| {
            let _pause = Pause::begin();
            let woken = armed && !is_awaited();
            if woken || PIPE.says(WorldAnswer::IRQ_IS_HIGH) {
                return Poll::Ready(());
            }
            armed = true;
            critical_section::with(|token| *WAITING.borrow_ref_mut(token) = Some(context.waker().clone()));
            Poll::Pending
        })
        .await;
    }
}

/// Checks the line each microsecond: the world reports no falling edge, and the driver waits for none.
async fn low() {
    while PIPE.says(WorldAnswer::IRQ_IS_HIGH) {
        embassy_time::Timer::after_micros(1).await;
    }
}

impl Wait for Interrupt {
    async fn wait_for_high(&mut self) -> Result<(), Infallible> {
        Self::high().await;
        Ok(())
    }

    async fn wait_for_low(&mut self) -> Result<(), Infallible> {
        low().await;
        Ok(())
    }

    async fn wait_for_rising_edge(&mut self) -> Result<(), Infallible> {
        low().await;
        Self::high().await;
        Ok(())
    }

    async fn wait_for_falling_edge(&mut self) -> Result<(), Infallible> {
        Self::high().await;
        low().await;
        Ok(())
    }

    async fn wait_for_any_edge(&mut self) -> Result<(), Infallible> {
        if PIPE.says(WorldAnswer::IRQ_IS_HIGH) { self.wait_for_low().await } else { self.wait_for_high().await }
    }
}
