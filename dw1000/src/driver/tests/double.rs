//! A test double of the bus: it answers reads with prepared data, and records all transactions.

use core::cell::{Cell, RefCell};
use core::convert::Infallible;
use core::future::{pending, ready};
use std::collections::{HashMap, VecDeque};
use std::rc::Rc;
use std::vec::Vec;

use embassy_futures::{block_on, yield_now};
use embedded_hal::spi::{ErrorKind, ErrorType, Operation};
use embedded_hal_async::delay::DelayNs;
use embedded_hal_async::digital::Wait;
use embedded_hal_async::spi::SpiDevice;

use crate::driver::{ClockedSpi, Dw1000, SpiClock};
use radio::{Config, PhyConfig};

pub const SYS_STATUS: &[u8] = &[0x0F];

/// A transaction on the bus.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Seen {
    /// Header and data.
    Write(Vec<u8>),
    /// Header, and the number of bytes read.
    Read(Vec<u8>, usize),
    /// The chip-select line held low, nanoseconds.
    Hold(u32),
    Clock(SpiClock),
}

#[derive(Default)]
struct Inner {
    seen: Vec<Seen>,
    /// Answers to reads by header; the last one stays.
    answers: HashMap<Vec<u8>, VecDeque<Vec<u8>>>,
    /// Transactions that succeed before one fails.
    fail_after: Option<usize>,
}

#[derive(Clone, Default)]
pub struct Bus(Rc<RefCell<Inner>>);

impl Bus {
    /// Sets the answer to the next read with this header; the last answer is used for all further ones.
    pub fn answer(&self, header: &[u8], data: &[u8]) {
        self.0.borrow_mut().answers.entry(header.to_vec()).or_default().push_back(data.to_vec());
    }

    pub fn forget_answers(&self) {
        self.0.borrow_mut().answers.clear();
    }

    /// All transactions since the last call.
    pub fn seen(&self) -> Vec<Seen> {
        core::mem::take(&mut self.0.borrow_mut().seen)
    }

    pub fn fail_after(&self, transactions: Option<usize>) {
        self.0.borrow_mut().fail_after = transactions;
    }
}

/// The header's length, from its own bits.
fn header_length(bytes: &[u8]) -> usize {
    match bytes {
        [first, ..] if first & 0x40 == 0 => 1,
        [_, second, ..] if second & 0x80 == 0 => 2,
        _ => 3,
    }
}

impl ErrorType for Bus {
    type Error = ErrorKind;
}

impl SpiDevice for Bus {
    async fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), ErrorKind> {
        let mut inner = self.0.borrow_mut();
        if let Some(left) = inner.fail_after.as_mut() {
            match left.checked_sub(1) {
                Some(fewer) => *left = fewer,
                None => return Err(ErrorKind::Other),
            }
        }
        // One stream of bytes out, with the positions that the answer goes to.
        let mut out = Vec::new();
        let mut hold = None;
        for operation in operations.iter() {
            match operation {
                Operation::Write(data) => out.extend_from_slice(data),
                Operation::TransferInPlace(data) => out.extend_from_slice(data),
                Operation::Read(data) => out.resize(out.len() + data.len(), 0),
                Operation::DelayNs(nanoseconds) => hold = Some(*nanoseconds),
                Operation::Transfer(..) => unreachable!("not used by the driver"),
            }
        }
        if let Some(nanoseconds) = hold {
            inner.seen.push(Seen::Hold(nanoseconds));
            return Ok(());
        }
        let header = header_length(&out);
        if out[0] & 0x80 != 0 {
            inner.seen.push(Seen::Write(out));
            return Ok(());
        }
        let length = out.len() - header;
        inner.seen.push(Seen::Read(out[..header].to_vec(), length));
        let answer = match inner.answers.get_mut(&out[..header]) {
            Some(answers) if answers.len() > 1 => answers.pop_front().unwrap(),
            Some(answers) => answers[0].clone(),
            None => Vec::new(),
        };
        let mut stream = std::vec![0xEE; header];
        stream.extend(answer);
        stream.resize(header + length, 0);
        let mut at = 0;
        for operation in operations {
            match operation {
                Operation::Write(data) => at += data.len(),
                Operation::TransferInPlace(data) => {
                    let end = at + data.len();
                    data.copy_from_slice(&stream[at..end]);
                    at = end;
                }
                Operation::Read(data) => {
                    let end = at + data.len();
                    data.copy_from_slice(&stream[at..end]);
                    at = end;
                }
                Operation::DelayNs(_) | Operation::Transfer(..) => {}
            }
        }
        Ok(())
    }
}

impl ClockedSpi for Bus {
    fn set_clock(&mut self, clock: SpiClock) -> Result<(), ErrorKind> {
        self.0.borrow_mut().seen.push(Seen::Clock(clock));
        Ok(())
    }
}

/// The interrupt line: high, or never.
#[derive(Clone, Copy)]
pub struct Line(pub bool);

impl embedded_hal::digital::ErrorType for Line {
    type Error = Infallible;
}

impl Wait for Line {
    async fn wait_for_high(&mut self) -> Result<(), Infallible> {
        if self.0 { ready(Ok(())).await } else { pending().await }
    }
    async fn wait_for_low(&mut self) -> Result<(), Infallible> {
        pending().await
    }
    async fn wait_for_rising_edge(&mut self) -> Result<(), Infallible> {
        pending().await
    }
    async fn wait_for_falling_edge(&mut self) -> Result<(), Infallible> {
        pending().await
    }
    async fn wait_for_any_edge(&mut self) -> Result<(), Infallible> {
        pending().await
    }
}

/// A delay that records its waits, and lets the interrupt line act first a number of times.
#[derive(Clone)]
pub struct Delay {
    pub waits: Rc<RefCell<Vec<u32>>>,
    pub polls: Rc<Cell<u32>>,
}

impl Default for Delay {
    fn default() -> Self {
        Self { waits: Rc::default(), polls: Rc::new(Cell::new(1)) }
    }
}

impl DelayNs for Delay {
    async fn delay_ns(&mut self, nanoseconds: u32) {
        self.delay_us(nanoseconds / 1000).await;
    }
    async fn delay_us(&mut self, microseconds: u32) {
        self.waits.borrow_mut().push(microseconds);
        for _ in 0..self.polls.get() {
            yield_now().await;
        }
    }
    async fn delay_ms(&mut self, milliseconds: u32) {
        self.delay_us(milliseconds * 1000).await;
    }
}

pub type Driver = Dw1000<Bus, Line, (), Delay>;

/// An initialised driver, with its bus, whose record is empty, and the waits.
pub fn initialised(config: Config, interrupts: bool) -> (Driver, Bus, Delay) {
    let (bus, delay) = (Bus::default(), Delay::default());
    let mut driver = Dw1000::new(bus.clone(), Line(interrupts), (), delay.clone(), config);
    bus.answer(&[0x00], &[0x30, 0x01, 0xCA, 0xDE]);
    bus.answer(SYS_STATUS, &[0x02, 0, 0, 0]);
    block_on(driver.init()).unwrap();
    bus.seen();
    bus.forget_answers();
    delay.waits.borrow_mut().clear();
    (driver, bus, delay)
}

/// The same in the fast mode.
pub fn fast(interrupts: bool) -> (Driver, Bus, Delay) {
    initialised(Config::new(PhyConfig::FAST), interrupts)
}

pub fn write(bytes: &[u8]) -> Seen {
    Seen::Write(bytes.to_vec())
}

pub fn read(header: &[u8], length: usize) -> Seen {
    Seen::Read(header.to_vec(), length)
}
