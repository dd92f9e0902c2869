//! A simulated chip that the driver accepts and that adds no instructions to the driver's. It has the registers that
//! the driver reads. Frames and ends of windows come when the script wants them. It counts every transaction.

use core::cell::Cell;
use core::convert::Infallible;
use core::future::poll_fn;
use core::task::Poll;

use baliza_dw1000::driver::{ClockedSpi, SpiClock};
use embedded_hal_async::delay::DelayNs;
use embedded_hal_async::digital::Wait;
use embedded_hal_async::spi::{ErrorType, Operation, SpiDevice};

use crate::instrument::{instructions, stamp, steps};

/// Bits of SYS_STATUS.
const CPLOCK: u32 = 1 << 1;
const TXFRS: u32 = 1 << 7;
const RECEIVED: u32 = 1 << 10 | 1 << 11 | 1 << 13 | 1 << 14;
const RXRFTO: u32 = 1 << 17;
const HSRBP: u32 = 1 << 30;
const ICRBP: u32 = 1 << 31;

/// The length of a 27-byte frame without its checksum.
pub const FRAME: usize = 25;

/// The next event that the script wants.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum NextEvent {
    /// The frame has been sent.
    Sent,
    /// A frame is received.
    Frame,
    /// The window ends.
    Timeout,
}

/// The chip, and the measurements around it.
pub struct ScriptedChip {
    status: Cell<u32>,
    time: u64,
    /// Whether waits end at once, because the chip is being started.
    pub starting: Cell<bool>,
    /// The next interrupt that the script lets come.
    pub next: Cell<Option<NextEvent>>,
    /// When the driver began to wait for the interrupt.
    pub waiting: Cell<Option<u32>>,
    /// When the driver continued after the interrupt.
    pub resumed: Cell<u32>,
    /// The counter's steps within transactions, and the number of transactions, since they were last taken.
    inside: Cell<(u32, u32)>,
}

impl ScriptedChip {
    /// A chip at its start.
    pub fn new() -> Self {
        Self {
            status: Cell::new(CPLOCK),
            time: 1 << 38,
            starting: Cell::new(true),
            next: Cell::new(None),
            waiting: Cell::new(None),
            resumed: Cell::new(0),
            inside: Cell::new((0, 0)),
        }
    }

    /// The instructions within transactions, and the number of transactions, since the last call.
    pub fn take_inside(&self) -> (u32, u32) {
        let (inside, transactions) = self.inside.take();
        (instructions(inside), transactions)
    }

    fn happen(&self, next: NextEvent) {
        let status = self.status.get();
        self.status.set(match next {
            NextEvent::Sent => status | TXFRS,
            NextEvent::Frame => (status | RECEIVED) ^ ICRBP,
            NextEvent::Timeout => status | RXRFTO,
        });
    }

    /// A byte of a register.
    fn byte(&self, file: u8, at: usize) -> u8 {
        let bytes = |value: u64| value.to_le_bytes().get(at).copied().unwrap_or(0);
        match file {
            0x00 => bytes(0xDECA_0130),
            0x06 => bytes(self.time),
            0x0F => bytes(self.status.get().into()),
            // 27 bytes, 118 preamble symbols, and a strong first path in weak noise.
            0x10 => bytes(FRAME as u64 + 2 | 118 << 20),
            0x11 => at as u8,
            0x12 => bytes(0x4E20_2328_2AF8_0034),
            0x15 => [0, 0, 0, 0, 0x41, 0xA0, 0xBB, 0xE0, 0x2E].get(at).copied().unwrap_or(0),
            0x27 => [0x50, 0x08, 0].get(at.wrapping_sub(0x28)).copied().unwrap_or(0),
            _ => 0,
        }
    }

    /// Writes a byte of a register.
    fn set(&self, file: u8, at: usize, byte: u8) {
        let status = self.status.get();
        match (file, at) {
            // Written ones clear the bits, except for the lock of the clock and the pointers.
            (0x0F, 0..=3) => {
                self.status.set(status & !(u32::from(byte) << (8 * at)) | status & (CPLOCK | HSRBP | ICRBP))
            }
            (0x0D, 3) if byte & 1 != 0 => self.status.set(status ^ HSRBP),
            _ => {}
        }
    }

    fn transact(&self, operations: &mut [Operation<'_, u8>]) {
        let mut header = [0; 3];
        let mut got = 0;
        let mut wanted = 1;
        let mut offset = 0;
        for operation in operations {
            let (write, read): (&[u8], _) = match operation {
                Operation::Write(bytes) => (bytes, None),
                Operation::TransferInPlace(bytes) => {
                    for byte in bytes.iter_mut() {
                        if got < wanted {
                            header[got] = *byte;
                            got += 1;
                            wanted = header_length(&header);
                            continue;
                        }
                        *byte = self.exchange(&header, offset, *byte);
                        offset += 1;
                    }
                    continue;
                }
                Operation::Read(bytes) => (&[], Some(bytes)),
                Operation::Transfer(..) | Operation::DelayNs(_) => continue,
            };
            for &byte in write {
                if got < wanted {
                    header[got] = byte;
                    got += 1;
                    wanted = header_length(&header);
                    continue;
                }
                self.exchange(&header, offset, byte);
                offset += 1;
            }
            for byte in read.into_iter().flat_map(|bytes| bytes.iter_mut()) {
                *byte = self.exchange(&header, offset, 0);
                offset += 1;
            }
        }
    }

    /// Exchanges a byte at this offset from the header's address.
    fn exchange(&self, header: &[u8; 3], offset: usize, byte: u8) -> u8 {
        let (file, begin) = (header[0] & 0x3F, sub_address(header));
        if header[0] & 0x80 != 0 {
            self.set(file, begin + offset, byte);
            return 0;
        }
        self.byte(file, begin + offset)
    }
}

impl Default for ScriptedChip {
    fn default() -> Self {
        Self::new()
    }
}

/// The bytes of a header (DW1000 user manual, 2.2.1.2).
fn header_length(header: &[u8; 3]) -> usize {
    match (header[0] & 0x40 != 0, header[1] & 0x80 != 0) {
        (false, _) => 1,
        (true, false) => 2,
        (true, true) => 3,
    }
}

fn sub_address(header: &[u8; 3]) -> usize {
    match header_length(header) {
        1 => 0,
        2 => usize::from(header[1]),
        _ => usize::from(header[1] & 0x7F) | usize::from(header[2]) << 7,
    }
}

/// The bus.
#[derive(Clone, Copy)]
pub struct Spi<'a>(pub &'a ScriptedChip);

impl ErrorType for Spi<'_> {
    type Error = Infallible;
}

impl SpiDevice for Spi<'_> {
    async fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), Infallible> {
        let begun = stamp();
        self.0.transact(operations);
        let (inside, transactions) = self.0.inside.get();
        self.0.inside.set((inside.wrapping_add(steps(begun, stamp())), transactions + 1));
        Ok(())
    }
}

impl ClockedSpi for Spi<'_> {
    fn set_clock(&mut self, _: SpiClock) -> Result<(), Infallible> {
        Ok(())
    }
}

/// The interrupt line. It is low until the script lets an event happen.
#[derive(Clone, Copy)]
pub struct Irq<'a>(pub &'a ScriptedChip);

impl embedded_hal::digital::ErrorType for Irq<'_> {
    type Error = Infallible;
}

impl Irq<'_> {
    async fn edge(&self) {
        poll_fn(|_| {
            let chip = self.0;
            match chip.next.take() {
                Some(next) => {
                    chip.resumed.set(stamp());
                    chip.happen(next);
                    Poll::Ready(())
                }
                None => {
                    chip.waiting.set(Some(stamp()));
                    Poll::Pending
                }
            }
        })
        .await;
    }
}

impl Wait for Irq<'_> {
    async fn wait_for_high(&mut self) -> Result<(), Infallible> {
        self.edge().await;
        Ok(())
    }

    async fn wait_for_low(&mut self) -> Result<(), Infallible> {
        self.edge().await;
        Ok(())
    }

    async fn wait_for_rising_edge(&mut self) -> Result<(), Infallible> {
        self.edge().await;
        Ok(())
    }

    async fn wait_for_falling_edge(&mut self) -> Result<(), Infallible> {
        self.edge().await;
        Ok(())
    }

    async fn wait_for_any_edge(&mut self) -> Result<(), Infallible> {
        self.edge().await;
        Ok(())
    }
}

/// The waits. They end at once while the chip is started, and later never.
#[derive(Clone, Copy)]
pub struct ChipDelay<'a>(pub &'a ScriptedChip);

impl DelayNs for ChipDelay<'_> {
    async fn delay_ns(&mut self, _: u32) {
        poll_fn(|_| if self.0.starting.get() { Poll::Ready(()) } else { Poll::Pending }).await;
    }

    async fn delay_us(&mut self, us: u32) {
        self.delay_ns(us).await;
    }

    async fn delay_ms(&mut self, ms: u32) {
        self.delay_ns(ms).await;
    }
}
