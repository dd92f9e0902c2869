//! The effect of SPI transactions on the registers.
//!
//! A transaction is a header of one to three bytes and the data. Bit 7 of the first byte means a write, bit 6 announces
//! a second byte, and the rest is the register file. Bit 7 of the second byte announces a third. The other 7 bits of
//! the second byte and the 8 bits of the third are the offset (user manual, 2.2.1.2).

use super::bits::status;
use super::registers::{copy_out, file};
use super::{Chip, Trx};
use crate::time::TrueTime;
use crate::world::World;

/// A transaction's header as far as it was received.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Header {
    bytes: [u8; 3],
    count: usize,
}

/// The address of a transaction's read or write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Address {
    pub(crate) write: bool,
    file: u8,
    pub(crate) offset: usize,
}

/// How well the chip followed a transaction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Contact {
    /// The chip follows.
    Whole,
    /// Too fast for the chip, which misses edges.
    Garbled,
    /// The chip is off, in reset, starting or asleep. Its line stays low.
    Silent,
}

impl Header {
    /// Takes one more byte. Returns the address if the byte was the last of the header.
    pub(crate) fn push(&mut self, byte: u8) -> Option<Address> {
        self.bytes[self.count.min(2)] = byte;
        self.count += 1;
        let [first, second, third] = self.bytes;
        let complete = match self.count {
            1 => first & 0x40 == 0,
            2 => second & 0x80 == 0,
            _ => true,
        };
        complete.then_some(Address {
            write: first & 0x80 != 0,
            file: first & 0x3F,
            offset: usize::from(second & 0x7F) | usize::from(third) << 7,
        })
    }
}

impl Chip {
    /// A transaction of `bytes` bytes that kept the chip selected for `picoseconds` has ended. Returns how well the
    /// chip followed it.
    pub(crate) fn transacted(&mut self, world: &World, bytes: usize, picoseconds: u64, hz: u32) -> Contact {
        self.statistics.transactions += 1;
        self.statistics.spi_bytes += bytes as u64;
        if !self.power.answers() {
            self.statistics.deaf += 1;
            self.selected(world, picoseconds);
            self.settle(world);
            return Contact::Silent;
        }
        if !self.follows_spi(hz) {
            self.statistics.too_fast += 1;
            return Contact::Garbled;
        }
        Contact::Whole
    }

    /// Reads data that crossed the bus at `at`.
    pub(crate) fn read(&mut self, address: Address, at: TrueTime, out: &mut [u8]) {
        let offset = address.offset;
        match address.file {
            // The 125 MHz clock shows multiples of 512 ticks.
            file::SYS_TIME => copy_out(&(self.counter(at) & !511).to_le_bytes()[..5], offset, out),
            file::SYS_STATUS => copy_out(&self.status_word().to_le_bytes()[..5], offset, out),
            file::SYS_STATE => copy_out(&self.state_word(), offset, out),
            file::RX_FINFO => copy_out(&self.sets[self.host].info, offset, out),
            file::RX_BUFFER => copy_out(&*self.sets[self.host].buffer, offset, out),
            file::RX_FQUAL => copy_out(&self.sets[self.host].quality, offset, out),
            file::RX_TTCKI => copy_out(&self.sets[self.host].tracking_interval, offset, out),
            file::RX_TTCKO => copy_out(&self.sets[self.host].tracking_offset, offset, out),
            file::RX_TIME => copy_out(&self.sets[self.host].time, offset, out),
            file::ACC_MEM => self.read_accumulator(offset, out),
            file::SYS_CTRL => copy_out(&self.control_word().to_le_bytes(), offset, out),
            // Write-only.
            file::TX_BUFFER => out.fill(0),
            // EVC_CTRL's two bits clear themselves and read as zero.
            file::DIG_DIAG if offset < 4 => {
                copy_out(self.memory.file(file::DIG_DIAG), offset, out);
                let control = (4 - offset).min(out.len());
                out[..control].fill(0);
            }
            other => copy_out(self.memory.file(other), offset, out),
        }
    }

    /// Writes data.
    pub(crate) fn write(&mut self, world: &World, address: Address, data: &[u8]) {
        let Address { file, offset, .. } = address;
        let touches = |from: usize, to: usize| offset < to && offset + data.len() > from;
        if self.power.is_held() && !(file == file::PMSC && touches(0, 4)) {
            return;
        }
        match file {
            file::DEV_ID
            | file::SYS_TIME
            | file::RX_FINFO..=file::RX_TIME
            | file::TX_TIME
            | file::SYS_STATE
            | file::ACC_MEM => {}
            file::SYS_CTRL => {
                let mut command = [0; 4];
                for (slot, byte) in command.iter_mut().skip(offset).zip(data) {
                    *slot = *byte;
                }
                self.command(world, u32::from_le_bytes(command));
            }
            file::SYS_STATUS => {
                let mut ones = [0; 8];
                for (slot, byte) in ones.iter_mut().take(5).skip(offset).zip(data) {
                    *slot = *byte;
                }
                self.clear_status(u64::from_le_bytes(ones) & !status::READ_ONLY);
            }
            file::DIG_DIAG if touches(0, 4) => {
                self.memory.write(file, offset, data);
                // EVC_CLR.
                if self.memory.u8(file, 0) & 2 != 0 {
                    self.memory.write(file, 0x04, &[0; 0x18]);
                    let enabled = self.memory.u8(file, 0) & 1;
                    self.memory.write(file, 0, &[enabled]);
                }
            }
            _ => {
                self.memory.write(file, offset, data);
                match file {
                    file::PMSC if touches(0, 4) => self.clocks_written(world),
                    file::OTP_IF if touches(0x06, 0x08) => self.one_time_memory(world),
                    file::AON if touches(0x02, 0x03) => self.always_on(world),
                    file::TX_CAL if touches(0, 2) => self.convert(),
                    file::FS_CTRL if touches(0x0E, 0x0F) => self.trim(world.now()),
                    _ => {}
                }
            }
        }
        self.settle(world);
    }

    fn clear_status(&mut self, ones: u64) {
        self.status &= !ones;
        self.warnings &= !ones;
        self.sets[self.host].status &= !ones;
        if let Some(transmission) = &mut self.transmission {
            transmission.clear(ones);
        }
    }

    /// The accumulator: a dummy byte, then real and imaginary part of each sample, 16 bits each. Its clock must be
    /// forced on: FACE, AMCE (PMSC_CTRL0 bits 6 and 15), and the receiver's clock from the PLL (bits 3:2 = 10).
    fn read_accumulator(&mut self, offset: usize, out: &mut [u8]) {
        out.fill(0);
        let clocks = self.memory.u32(file::PMSC, 0);
        let clocked = clocks & 0x8040 == 0x8040 && clocks & 0b1100 == 0b1000;
        let Some(response) = self.response.as_ref().filter(|_| clocked) else { return };
        for (i, byte) in out.iter_mut().enumerate().skip(1) {
            let at = offset + i - 1;
            if at / 4 < response.length {
                let [re, im] = response.sample(at / 4);
                let ([r0, r1], [i0, i1]) = (re.to_le_bytes(), im.to_le_bytes());
                *byte = [r0, r1, i0, i1][at % 4];
            }
        }
    }

    /// TX_STATE, RX_STATE and PMSC_STATE.
    fn state_word(&self) -> [u8; 5] {
        let pmsc = match (self.on_pll(), self.trx) {
            (false, _) => 0,
            (true, Trx::Idle) => 1,
            (true, Trx::TxWait) => 2,
            (true, Trx::RxWait) => 3,
            (true, Trx::Tx) => 4,
            (true, Trx::Rx) => 5,
        };
        [u8::from(self.trx == Trx::Tx), u8::from(self.trx == Trx::Rx) * 5, pmsc, 0, 0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(bytes: &[u8]) -> Option<Address> {
        let mut header = Header::default();
        bytes.iter().find_map(|&b| header.push(b))
    }

    #[test]
    fn headers_of_the_manuals_examples() {
        // User manual, 2.2.1.2: read 0x00; read two bytes of 0x00 from 2; write 0x21 at 265 (low 7 bits 9, high 8 bits
        // 2).
        assert_eq!(parse(&[0x00]), Some(Address { write: false, file: 0, offset: 0 }));
        assert_eq!(parse(&[0x40, 0x02]), Some(Address { write: false, file: 0, offset: 2 }));
        assert_eq!(parse(&[0xE1, 0x89, 0x02]), Some(Address { write: true, file: 0x21, offset: 265 }));
        assert_eq!(parse(&[0xE1, 0x89]), None);
    }
}
