//! One register access is one SPI transaction, and every transaction is counted.

use core::ops::Range;

use embedded_hal_async::spi::{Operation, SpiDevice};

use super::Error;
use super::register::Register;

/// The greatest SPI clock that the chip accepts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum SpiClock {
    /// At most 3 MHz: the chip runs from its crystal, as after reset and waking.
    Slow,
    /// At most 20 MHz: the chip's clock PLL has locked.
    Fast,
}

/// An SPI device whose clock the driver changes when the chip's own clock does.
pub trait ClockedSpi: SpiDevice {
    /// Sets the clock of the following transactions as `clock` allows.
    ///
    /// # Errors
    /// If the bus cannot use this clock.
    fn set_clock(&mut self, clock: SpiClock) -> Result<(), Self::Error>;
}

/// Edges one, two, four and eight bits apart.
const PATTERN: u64 = 0xAA55_33CC_0FF0_00FF;

/// The fastest clock, MHz, at which the chip returns what was written to it: `wanted`, or as many halves of it as its
/// wires demand, but not less than `sure`. For boards whose wires may be too long: call it when the driver first asks
/// for the fast clock. The register that it uses, EUI, is written after that.
///
/// `exchange` makes one transaction at a clock: it sends the bytes, and replaces them by what it receives.
///
/// # Errors
/// If an exchange fails.
pub fn fastest_clock<E>(
    wanted: u32,
    sure: u32,
    mut exchange: impl FnMut(u32, &mut [u8]) -> Result<(), E>,
) -> Result<u32, E> {
    let mut mhz = wanted;
    while mhz > sure && !returns(|bytes| exchange(mhz, bytes))? {
        mhz /= 2;
    }
    Ok(mhz.max(sure))
}

/// Whether the chip returns 64 patterns.
fn returns<E>(mut exchange: impl FnMut(&mut [u8]) -> Result<(), E>) -> Result<bool, E> {
    const EUI: u8 = 0x01;
    const WRITE: u8 = 0x80;
    for shift in 0..u64::BITS {
        let pattern = PATTERN.rotate_left(shift).to_le_bytes();
        let (mut written, mut read) = ([EUI | WRITE; 9], [EUI; 9]);
        written[1..].copy_from_slice(&pattern);
        exchange(&mut written)?;
        exchange(&mut read)?;
        if read[1..] != pattern {
            return Ok(false);
        }
    }
    Ok(true)
}

/// The line that resets the chip. It is pulled low or left floating, never driven high (DW1000 data sheet, RSTn).
pub trait ResetLine {
    /// Pulls the line low.
    fn pull_low(&mut self);
    /// Leaves the line floating.
    fn release(&mut self);
}

/// A board without the line: the driver resets the chip over SPI, which it does in any case.
impl ResetLine for () {
    fn pull_low(&mut self) {}
    fn release(&mut self) {}
}

/// The traffic on the bus since the driver was created; wraps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Traffic {
    /// SPI transactions.
    pub transactions: u32,
    /// Bytes, headers included.
    pub bytes: u32,
}

/// The longest header, and the longest data: a receive buffer's frame, or a part of the accumulator with its dummy
/// byte.
const LONGEST: usize = 3 + 129;

pub(super) struct Bus<S> {
    pub spi: S,
    pub traffic: Traffic,
    /// Header and data as they are on the bus. Every transaction is one operation on one block of memory, which a bus
    /// with direct memory access starts once. The buffer is here so that no future of the driver contains it.
    buffer: [u8; LONGEST],
}

impl<S: SpiDevice> Bus<S> {
    pub fn new(spi: S) -> Self {
        Self { spi, traffic: Traffic::default(), buffer: [0; LONGEST] }
    }

    fn count(&mut self, bytes: usize) {
        self.traffic.transactions = self.traffic.transactions.wrapping_add(1);
        self.traffic.bytes = self.traffic.bytes.wrapping_add(bytes as u32);
    }

    /// Writes the header of an access to `length` bytes into the buffer. Returns the range of these bytes in the
    /// buffer.
    fn prepare(&mut self, register: Register, write: bool, length: usize) -> Range<usize> {
        let (header, header_length) = register.header(write);
        self.count(header_length + length);
        self.buffer[..3].copy_from_slice(&header);
        header_length..header_length + length
    }

    /// Reads a register of a known length.
    pub async fn read<const N: usize>(&mut self, register: Register) -> Result<[u8; N], Error<S::Error>> {
        const { assert!(N + 3 <= LONGEST) };
        let mut value = [0; N];
        value.copy_from_slice(self.read_slice(register, N).await?);
        Ok(value)
    }

    /// Reads up to 129 bytes; one function for all lengths.
    pub async fn read_slice(&mut self, register: Register, length: usize) -> Result<&[u8], Error<S::Error>> {
        let datum = self.prepare(register, false, length);
        // The chip ignores the bytes sent after the header.
        self.spi.transfer_in_place(&mut self.buffer[..datum.end]).await?;
        Ok(&self.buffer[datum])
    }

    /// Writes up to 129 bytes.
    pub async fn write(&mut self, register: Register, data: &[u8]) -> Result<(), Error<S::Error>> {
        let datum = self.prepare(register, true, data.len());
        self.buffer[datum.clone()].copy_from_slice(data);
        self.spi.write(&self.buffer[..datum.end]).await?;
        Ok(())
    }

    /// Writes one register after the other.
    pub async fn write_each(&mut self, writes: &[(Register, &[u8])]) -> Result<(), Error<S::Error>> {
        for (register, data) in writes {
            self.write(*register, data).await?;
        }
        Ok(())
    }

    /// Holds the chip-select line low for a time without clocking.
    pub async fn hold_select(&mut self, nanoseconds: u32) -> Result<(), Error<S::Error>> {
        self.count(0);
        self.spi.transaction(&mut [Operation::DelayNs(nanoseconds)]).await?;
        Ok(())
    }
}
