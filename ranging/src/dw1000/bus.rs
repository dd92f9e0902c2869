//! One register access is one SPI transaction, and every transaction is counted.

use embedded_hal_async::spi::{Operation, SpiDevice};

use super::Error;
use super::register::Register;

/// How fast the chip lets itself be clocked.
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
    /// The following transactions are clocked as `clock` allows.
    fn set_clock(&mut self, clock: SpiClock) -> Result<(), Self::Error>;
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

/// What has gone over the bus since the driver was made; wraps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Traffic {
    /// SPI transactions.
    pub transactions: u32,
    /// Bytes, headers included.
    pub bytes: u32,
}

/// The longest header and datum that go out as one buffer, which costs a bus with direct memory access one start.
const SHORT: usize = 16;

pub(super) struct Bus<S> {
    pub spi: S,
    pub traffic: Traffic,
}

impl<S: SpiDevice> Bus<S> {
    pub fn new(spi: S) -> Self {
        Self { spi, traffic: Traffic::default() }
    }

    fn count(&mut self, bytes: usize) {
        self.traffic.transactions = self.traffic.transactions.wrapping_add(1);
        self.traffic.bytes = self.traffic.bytes.wrapping_add(bytes as u32);
    }

    /// Reads a short register, up to 13 bytes.
    pub async fn read<const N: usize>(&mut self, register: Register) -> Result<[u8; N], Error<S::Error>> {
        const { assert!(N + 3 <= SHORT) };
        let (buffer, header_length) = self.read_short(register, N).await?;
        let mut value = [0; N];
        value.copy_from_slice(&buffer[header_length..header_length + N]);
        Ok(value)
    }

    /// Header and `length` bytes as they were on the bus, and the header's length; one piece of code for all lengths.
    async fn read_short(&mut self, register: Register, length: usize) -> Result<([u8; SHORT], usize), Error<S::Error>> {
        let (header, header_length) = register.header(false);
        let mut buffer = [0; SHORT];
        buffer[..3].copy_from_slice(&header);
        self.count(header_length + length);
        self.spi.transfer_in_place(&mut buffer[..header_length + length]).await?;
        Ok((buffer, header_length))
    }

    /// Reads any number of bytes.
    pub async fn read_into(&mut self, register: Register, data: &mut [u8]) -> Result<(), Error<S::Error>> {
        let (header, header_length) = register.header(false);
        self.count(header_length + data.len());
        self.spi.transaction(&mut [Operation::Write(&header[..header_length]), Operation::Read(data)]).await?;
        Ok(())
    }

    /// Writes any number of bytes.
    pub async fn write(&mut self, register: Register, data: &[u8]) -> Result<(), Error<S::Error>> {
        let (header, header_length) = register.header(true);
        let length = header_length + data.len();
        self.count(length);
        if length <= SHORT {
            let mut buffer = [0; SHORT];
            buffer[..3].copy_from_slice(&header);
            buffer[header_length..length].copy_from_slice(data);
            self.spi.write(&buffer[..length]).await?;
        } else {
            self.spi.transaction(&mut [Operation::Write(&header[..header_length]), Operation::Write(data)]).await?;
        }
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
