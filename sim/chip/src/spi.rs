//! The SPI bus between a processor and its chip, with the traits of `embedded-hal-async`.
//!
//! A transaction begins when the [`Processor`] has done the charged work. It takes the time that the board needs to set
//! up the transaction and each of its operations, plus eight clocks per byte, in virtual time. Data is read, and writes
//! take effect, at its end; only SYS_TIME is read at the first data byte. A transaction that the chip cannot follow
//! (too fast before the PLL has locked, above 20 MHz at any time) reads garbage and writes nothing. A chip that is off
//! or asleep reads as zeros.

use crate::chip::{Address, Chip, Contact, Header};
use crate::processor::Processor;
use crate::time::TrueTime;
use crate::world::World;
use embedded_hal::spi::{ErrorType, Operation};
use embedded_hal_async::spi::SpiDevice;
use std::cell::{Cell, RefCell};
use std::convert::Infallible;
use std::rc::Rc;

/// The processor's side of the bus.
pub struct SimSpi {
    world: World,
    chip: Rc<RefCell<Chip>>,
    clock: SpiClock,
    processor: Processor,
}

/// A node's bus clock. Applications keep a clone and raise the clock when the PLL has locked.
#[derive(Clone, Debug)]
pub struct SpiClock(Rc<Cell<u32>>);

impl SpiClock {
    pub(crate) fn new(hz: u32) -> Self {
        Self(Rc::new(Cell::new(hz.max(1))))
    }

    /// The clock, Hz.
    pub fn hz(&self) -> u32 {
        self.0.get()
    }

    /// Changes the clock, Hz; 0 counts as 1.
    pub fn set_hz(&self, hz: u32) {
        self.0.set(hz.max(1));
    }
}

impl SimSpi {
    pub(crate) fn new(world: World, chip: Rc<RefCell<Chip>>, clock: SpiClock, processor: Processor) -> Self {
        Self { world, chip, clock, processor }
    }

    /// The bus clock.
    pub fn clock(&self) -> SpiClock {
        self.clock.clone()
    }

    /// Picoseconds that `bytes` bytes take on the bus.
    fn bus_ps(&self, bytes: usize) -> u64 {
        self.processor.board().bytes_ps(bytes, self.clock.hz())
    }

    fn apply(&self, operations: &mut [Operation<'_, u8>], bytes: usize, selected_ps: u64) {
        let mut chip = self.chip.borrow_mut();
        match chip.transacted(&self.world, bytes, selected_ps, self.clock.hz()) {
            Contact::Whole => {}
            Contact::Garbled => return fill(operations, 0xA5),
            Contact::Silent => return fill(operations, 0),
        }
        let end = self.world.now();
        let mut header = Header::default();
        let mut address: Option<Address> = None;
        let mut pushed = 0;
        for operation in operations {
            let read_at = |left: usize| TrueTime::from_ps(end.as_ps().saturating_sub(self.bus_ps(left)));
            match operation {
                Operation::Write(sent) => {
                    let body = parse(&mut header, &mut address, sent, &mut pushed);
                    advance(&mut chip, &self.world, &mut address, body);
                }
                Operation::Read(into) => fetch(&mut chip, &mut address, read_at(bytes - pushed), into),
                Operation::Transfer(into, sent) => {
                    let before = pushed;
                    let body = parse(&mut header, &mut address, sent, &mut pushed);
                    let skipped = (pushed - before).min(into.len());
                    let (_, data) = into.split_at_mut(skipped);
                    exchange(&mut chip, &self.world, &mut address, read_at(bytes - pushed), data, body);
                }
                Operation::TransferInPlace(both) => {
                    let before = pushed;
                    let sent: Vec<u8> = both.to_vec();
                    let body = parse(&mut header, &mut address, &sent, &mut pushed);
                    let (_, data) = both.split_at_mut(pushed - before);
                    exchange(&mut chip, &self.world, &mut address, read_at(bytes - pushed), data, body);
                }
                Operation::DelayNs(_) => {}
            }
        }
    }
}

/// Takes the header's bytes from the sent bytes. The rest is data.
fn parse<'a>(header: &mut Header, address: &mut Option<Address>, sent: &'a [u8], pushed: &mut usize) -> &'a [u8] {
    let mut rest = sent;
    while let (None, [first, tail @ ..]) = (*address, rest) {
        *address = header.push(*first);
        *pushed += 1;
        rest = tail;
    }
    rest
}

fn advance(chip: &mut Chip, world: &World, address: &mut Option<Address>, data: &[u8]) {
    if let Some(at) = address.as_mut().filter(|_| !data.is_empty()) {
        if at.write {
            chip.write(world, *at, data);
        }
        at.offset += data.len();
    }
}

fn fetch(chip: &mut Chip, address: &mut Option<Address>, time: TrueTime, into: &mut [u8]) {
    into.fill(0);
    if let Some(at) = address.as_mut().filter(|a| !a.write) {
        chip.read(*at, time, into);
        at.offset += into.len();
    }
}

fn exchange(
    chip: &mut Chip,
    world: &World,
    address: &mut Option<Address>,
    time: TrueTime,
    into: &mut [u8],
    body: &[u8],
) {
    match address {
        Some(Address { write: true, .. }) => advance(chip, world, address, body),
        Some(Address { write: false, .. }) | None => fetch(chip, address, time, into),
    }
}

/// Fills the read buffers of a host if the chip does not respond.
fn fill(operations: &mut [Operation<'_, u8>], byte: u8) {
    for operation in operations {
        match operation {
            Operation::Read(into) | Operation::Transfer(into, _) | Operation::TransferInPlace(into) => into.fill(byte),
            Operation::Write(_) | Operation::DelayNs(_) => {}
        }
    }
}

impl ErrorType for SimSpi {
    type Error = Infallible;
}

impl SpiDevice for SimSpi {
    async fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), Infallible> {
        let (mut bytes, mut delay_ps, mut starts) = (0, 0, 0);
        for operation in operations.iter() {
            let length = match operation {
                Operation::Read(into) => into.len(),
                Operation::Write(sent) => sent.len(),
                Operation::Transfer(into, sent) => into.len().max(sent.len()),
                Operation::TransferInPlace(both) => both.len(),
                Operation::DelayNs(ns) => {
                    delay_ps += u64::from(*ns) * 1000;
                    0
                }
            };
            bytes += length;
            starts += usize::from(length > 0);
        }
        let selected_ps = self.bus_ps(bytes) + delay_ps;
        let setup_ps = self.processor.board().setup_ps(starts);
        self.world.pass(self.processor.occupy(self.world.now(), setup_ps + selected_ps)).await;
        self.apply(operations, bytes, selected_ps);
        Ok(())
    }
}
