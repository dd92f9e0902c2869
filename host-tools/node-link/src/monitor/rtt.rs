//! Reads the RTT rings through a small interface to the chip's memory.
//!
//! [`find`] looks for the control block. [`Rings::poll`] takes the bytes that the node has written, and frees their
//! room. probe-rs has its own reader (`probe_rs::rtt`). This module does not use it for two reasons. First, the reader
//! must continue across restarts of the node. This one reads the whole control block in one access at every poll, and
//! so detects a reset, a new image or a moved block at once. The reader of probe-rs keeps the descriptors that it read
//! when it attached, and fails with an error. Second, this one works with any [`Memory`], also with that of a test.

use std::ops::Range;

use anyhow::{Result, anyhow};

use super::source::NodeChannel;

/// The functions of a chip that the monitor needs.
pub trait Memory {
    /// Reads bytes.
    ///
    /// # Errors
    /// The probe or the chip does not answer, or there is no memory at the address.
    fn read(&mut self, address: u64, bytes: &mut [u8]) -> Result<()>;

    /// Writes bytes.
    ///
    /// # Errors
    /// As for reading.
    fn write(&mut self, address: u64, bytes: &[u8]) -> Result<()>;

    /// Writes a 32-bit word in the chip's byte order.
    ///
    /// # Errors
    /// As for reading.
    fn write_word(&mut self, address: u64, word: u32) -> Result<()>;

    /// The address ranges of its RAM.
    fn ram(&self) -> Vec<Range<u64>>;

    /// Resets the chip.
    ///
    /// # Errors
    /// As for reading.
    fn reset(&mut self) -> Result<()>;
}

const ID: &[u8; 16] = b"SEGGER RTT\0\0\0\0\0\0";
/// Size of the identifier and of the two numbers of channels, bytes.
const HEADER: usize = 24;
/// Size of name, buffer, size, write position, read position and flags, bytes.
const DESCRIPTOR: usize = 24;
/// The offsets of the write position and of the read position in a descriptor.
const WRITE: u64 = 12;
const READ: u64 = 16;
/// The channels of the log and of telemetry.
const CHANNELS: [NodeChannel; 2] = [NodeChannel::Log, NodeChannel::Telemetry];
/// More channels than any node has. A block with more is not a control block.
const MAX_CHANNELS: u32 = 32;
/// The number of bytes read at once while searching.
const STRIDE: usize = 4096;

/// Looks for the control block: at the address from the ELF file, else in all of RAM. `None`: the node has not created
/// it yet.
///
/// # Errors
/// No part of the memory can be read.
pub fn find(memory: &mut dyn Memory, expected: Option<u64>) -> Result<Option<Rings>> {
    let ram = memory.ram();
    if let Some(address) = expected {
        let rings = Rings::at(address, &ram);
        if rings.look(memory)?.is_some() {
            return Ok(Some(rings));
        }
    }
    let (mut failed, mut read_any) = (None, false);
    for region in &ram {
        match search(memory, region, &ram) {
            Ok(Some(rings)) => return Ok(Some(rings)),
            Ok(None) => read_any = true,
            // This bank may be switched off. The block may be in another bank.
            Err(error) => failed = Some(error),
        }
    }
    match failed {
        Some(error) if !read_any => Err(error),
        _ => Ok(None),
    }
}

fn search(memory: &mut dyn Memory, region: &Range<u64>, ram: &[Range<u64>]) -> Result<Option<Rings>> {
    let mut window = [0; STRIDE];
    let mut at = region.start;
    while at < region.end {
        let length = usize::try_from(region.end - at).unwrap_or(STRIDE).min(STRIDE);
        let window = window.get_mut(..length).unwrap_or_default();
        memory.read(at, window)?;
        for (offset, found) in window.windows(ID.len()).enumerate().step_by(4) {
            if found == ID {
                let rings = Rings::at(at + offset as u64, ram);
                if rings.look(memory)?.is_some() {
                    return Ok(Some(rings));
                }
            }
        }
        // The identifier may extend over two windows.
        let step = if length == STRIDE { STRIDE - ID.len() } else { length };
        at += step as u64;
    }
    Ok(None)
}

/// The rings of a control block.
pub struct Rings {
    address: u64,
    ram: Vec<Range<u64>>,
    /// The position up to which the host has read, by channel.
    read: [Option<u32>; 2],
}

/// The result of a poll of the rings.
#[derive(Debug, PartialEq, Eq)]
pub enum Polled {
    /// The bytes that the node has written since the last poll, by channel.
    Bytes {
        /// The channels with new bytes.
        bytes: Vec<(NodeChannel, Vec<u8>)>,
        /// The rings have begun again: the node has restarted, or another program also reads them.
        restarted: bool,
    },
    /// There is no control block any more: the node is starting, or runs another image.
    Gone,
}

#[derive(Clone, Copy)]
struct Ring {
    channel: usize,
    buffer: u64,
    size: u32,
    write: u32,
    read: u32,
}

impl Rings {
    fn at(address: u64, ram: &[Range<u64>]) -> Self {
        Self { address, ram: ram.to_vec(), read: [None; 2] }
    }

    /// The address of the control block.
    pub fn address(&self) -> u64 {
        self.address
    }

    /// Takes the available bytes.
    ///
    /// # Errors
    /// The memory cannot be read or written.
    pub fn poll(&mut self, memory: &mut dyn Memory) -> Result<Polled> {
        let Some(rings) = self.look(memory)? else { return Ok(Polled::Gone) };
        let (mut bytes, mut restarted) = (Vec::new(), false);
        for ring in rings {
            let (Some(known), Some(channel)) = (self.read.get_mut(ring.channel), CHANNELS.get(ring.channel)) else {
                continue;
            };
            restarted |= known.is_some_and(|known| known != ring.read);
            *known = Some(ring.write);
            let taken = ring.take(memory)?;
            if !taken.is_empty() {
                // The read position is written only after the bytes have been read. If the node restarts in between, it
                // gets a read position from before the restart, and sends invalid bytes once. The decoders skip these
                // bytes.
                let place = self.address + (HEADER + ring.channel * DESCRIPTOR) as u64 + READ;
                memory.write_word(place, ring.write)?;
                bytes.push((*channel, taken));
            }
        }
        Ok(Polled::Bytes { bytes, restarted })
    }

    /// Writes bytes of a host into the node's first ring in the other direction. Returns whether it had room for all of
    /// them; else it got none. A node of an older build has no such ring.
    ///
    /// # Errors
    /// The memory cannot be read or written.
    pub fn send(&self, memory: &mut dyn Memory, bytes: &[u8]) -> Result<bool> {
        let mut header = [0; HEADER];
        memory.read(self.address, &mut header)?;
        let (up, down) = (word(&header, ID.len()), word(&header, ID.len() + 4));
        if !header.starts_with(ID) || up > MAX_CHANNELS || down == 0 {
            return Ok(false);
        }
        let place = self.address + HEADER as u64 + u64::from(up) * DESCRIPTOR as u64;
        let mut descriptor = [0; DESCRIPTOR];
        memory.read(place, &mut descriptor)?;
        let ring = Ring::of(0, &descriptor);
        if ring.buffer == 0 || ring.size == 0 || !ring.possible(&self.ram) {
            return Ok(false);
        }
        // One place stays free: a full ring is not an empty one.
        let room = (ring.read + ring.size - ring.write - 1) % ring.size;
        if bytes.len() > room as usize {
            return Ok(false);
        }
        let until_end = (ring.size - ring.write) as usize;
        let (first, rest) = bytes.split_at(bytes.len().min(until_end));
        memory.write(ring.buffer + u64::from(ring.write), first)?;
        if !rest.is_empty() {
            memory.write(ring.buffer, rest)?;
        }
        memory.write_word(place + WRITE, (ring.write + bytes.len() as u32) % ring.size)?;
        Ok(true)
    }

    /// The rings at present; `None` where the block is not a valid control block.
    fn look(&self, memory: &mut dyn Memory) -> Result<Option<Vec<Ring>>> {
        let mut block = [0; HEADER + CHANNELS.len() * DESCRIPTOR];
        memory.read(self.address, &mut block)?;
        let (header, descriptors) = block.split_at(HEADER);
        let Some((id, counts)) = header.split_at_checked(ID.len()) else { return Ok(None) };
        let (up, down) = (word(counts, 0), word(counts, 4));
        if id != ID || !(1..=MAX_CHANNELS).contains(&up) || down > MAX_CHANNELS {
            return Ok(None);
        }
        let mut rings = Vec::new();
        for (channel, descriptor) in descriptors.chunks_exact(DESCRIPTOR).enumerate().take(up as usize) {
            let ring = Ring::of(channel, descriptor);
            if ring.buffer == 0 {
                continue;
            }
            if !ring.possible(&self.ram) {
                return Ok(None);
            }
            rings.push(ring);
        }
        Ok(Some(rings))
    }
}

impl Ring {
    fn of(channel: usize, descriptor: &[u8]) -> Self {
        let [buffer, size, write, read] = [4, 8, WRITE as usize, READ as usize].map(|at| word(descriptor, at));
        Self { channel, buffer: buffer.into(), size, write, read }
    }

    fn possible(&self, ram: &[Range<u64>]) -> bool {
        let end = self.buffer + u64::from(self.size);
        // Adjacent regions count as one, because a buffer may extend over two banks.
        let inside = |address: u64| ram.is_empty() || ram.iter().any(|region| region.contains(&address));
        self.write < self.size && self.read < self.size && inside(self.buffer) && inside(end - 1)
    }

    fn take(&self, memory: &mut dyn Memory) -> Result<Vec<u8>> {
        let parts =
            if self.write >= self.read { [self.read..self.write, 0..0] } else { [self.read..self.size, 0..self.write] };
        let mut bytes = Vec::new();
        for part in parts.into_iter().filter(|part| !part.is_empty()) {
            let begin = bytes.len();
            bytes.resize(begin + part.len(), 0);
            let to = bytes.get_mut(begin..).ok_or_else(|| anyhow!("no room"))?;
            memory.read(self.buffer + u64::from(part.start), to)?;
        }
        Ok(bytes)
    }
}

fn word(bytes: &[u8], at: usize) -> u32 {
    bytes.get(at..).and_then(|bytes| bytes.first_chunk()).copied().map_or(0, u32::from_le_bytes)
}

#[cfg(test)]
mod tests {
    use super::super::source::NodeChannel;
    use super::super::testing_chip::Ram;
    use super::{Memory, Polled, find};

    fn bytes(polled: Polled) -> Vec<(NodeChannel, Vec<u8>)> {
        match polled {
            Polled::Bytes { bytes, restarted: false } => bytes,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn the_block_is_at_the_elf_files_address_or_anywhere() {
        for place in [0, 0x0FF4, 0x1F00] {
            let mut ram = Ram::new(0x3000);
            assert!(find(&mut ram, None).expect("memory").is_none());
            ram.start(place);
            let expected = Ram::BASE + place as u64;
            for hint in [None, Some(expected), Some(Ram::BASE + 0x2800)] {
                let found = find(&mut ram, hint).expect("memory").expect("a control block");
                assert_eq!(found.address(), expected);
            }
        }
    }

    #[test]
    fn a_ring_is_read_round_its_end() {
        let mut ram = Ram::new(0x1000);
        ram.start(0);
        let mut rings = find(&mut ram, None).expect("memory").expect("a control block");
        assert!(bytes(rings.poll(&mut ram).expect("memory")).is_empty());
        // Each ring holds 63 bytes.
        for round in 0..20_u8 {
            let (log, telemetry) = (vec![round; 50], vec![round ^ 0x80; 17]);
            assert!(ram.send(0, &log) && ram.send(1, &telemetry));
            let read = bytes(rings.poll(&mut ram).expect("memory"));
            assert_eq!(read, [(NodeChannel::Log, log), (NodeChannel::Telemetry, telemetry)]);
        }
        assert!(ram.send(0, &[1; 63]) && !ram.send(0, &[2]));
    }

    #[test]
    fn a_restart_shows_as_a_block_that_is_gone_or_new() {
        let mut ram = Ram::new(0x1000);
        ram.start(0);
        let mut rings = find(&mut ram, None).expect("memory").expect("a control block");
        ram.send(0, b"before");
        rings.poll(&mut ram).expect("memory");
        ram.start(0);
        ram.send(0, b"after");
        let restarted = Polled::Bytes { bytes: vec![(NodeChannel::Log, b"after".to_vec())], restarted: true };
        assert_eq!(rings.poll(&mut ram).expect("memory"), restarted);
        ram.clear();
        assert_eq!(rings.poll(&mut ram).expect("memory"), Polled::Gone);
    }

    #[test]
    fn what_only_looks_like_a_block_is_none() {
        // Each word of the block in turn gets an impossible value: identifier, channels, size, write position, read
        // position.
        for (word, value) in
            [(0, 0), (4, 0), (4, 33), (5, 99), (8, 0), (8, u32::MAX), (9, 64), (10, 64), (7, 0x1000_0000)]
        {
            let mut ram = Ram::new(0x1000);
            ram.start(0x40);
            ram.write_word(Ram::BASE + 0x40 + 4 * word, value).expect("memory");
            assert!(find(&mut ram, None).expect("memory").is_none(), "word {word} = {value}");
        }
    }

    #[test]
    fn memory_that_cannot_be_read_is_an_error() {
        let mut ram = Ram::new(0x1000);
        ram.start(0);
        let mut rings = find(&mut ram, None).expect("memory").expect("a control block");
        ram.unplug();
        assert!(rings.poll(&mut ram).is_err());
        assert!(find(&mut ram, None).is_err());
    }
}
