//! A chip for tests: its memory, with the RTT rings of a node in it.

use super::rtt::Memory;

/// A chip's memory with a node's RTT rings in it, as `rtt-target` keeps them: two of 63 bytes, and one in the other
/// direction.
pub struct Ram {
    bytes: Vec<u8>,
    block: usize,
    pub flash: Vec<(u64, Vec<u8>)>,
    pub plugged: bool,
    pub resets: u32,
}

const SIZE: usize = 64;
/// The control block with three descriptors.
const HEAD: usize = 24 + 3 * 24;

impl Ram {
    pub const BASE: u64 = 0x2000_0000;

    pub fn new(size: usize) -> Self {
        Self { bytes: vec![0; size], block: 0, flash: Vec::new(), plugged: true, resets: 0 }
    }

    /// The node starts and makes its control block here.
    pub fn start(&mut self, place: usize) {
        self.block = place;
        self.bytes[place..place + HEAD].fill(0);
        for channel in 0..3 {
            let buffer = Self::BASE as usize + place + HEAD + channel * SIZE;
            self.set(channel, 1, buffer);
            self.set(channel, 2, SIZE);
        }
        (self.bytes[place + 16], self.bytes[place + 20]) = (2, 1);
        self.bytes[place..place + 10].copy_from_slice(b"SEGGER RTT");
    }

    /// The node is in reset, and its control block does not exist yet.
    pub fn clear(&mut self) {
        self.bytes.fill(0);
    }

    pub fn unplug(&mut self) {
        self.plugged = false;
    }

    /// The node writes bytes into a ring; `false`: the ring has no room.
    pub fn send(&mut self, channel: usize, bytes: &[u8]) -> bool {
        let (write, read) = (self.get(channel, 3), self.get(channel, 4));
        if bytes.len() > (read + SIZE - write - 1) % SIZE {
            return false;
        }
        for (index, byte) in bytes.iter().enumerate() {
            self.bytes[self.block + HEAD + channel * SIZE + (write + index) % SIZE] = *byte;
        }
        self.set(channel, 3, (write + bytes.len()) % SIZE);
        true
    }

    /// The node reads what the host has sent.
    pub fn receive(&mut self) -> Vec<u8> {
        let (write, mut read) = (self.get(2, 3), self.get(2, 4));
        let mut bytes = Vec::new();
        while read != write {
            bytes.push(self.bytes[self.block + HEAD + 2 * SIZE + read]);
            read = (read + 1) % SIZE;
        }
        self.set(2, 4, read);
        bytes
    }

    fn word(&self, channel: usize, word: usize) -> std::ops::Range<usize> {
        let at = self.block + 24 + channel * 24 + word * 4;
        at..at + 4
    }

    fn get(&self, channel: usize, word: usize) -> usize {
        u32::from_le_bytes(self.bytes[self.word(channel, word)].try_into().expect("four bytes")) as usize
    }

    fn set(&mut self, channel: usize, word: usize, value: usize) {
        let at = self.word(channel, word);
        self.bytes[at].copy_from_slice(&(value as u32).to_le_bytes());
    }

    fn at(&mut self, address: u64, length: usize) -> anyhow::Result<&mut [u8]> {
        anyhow::ensure!(self.plugged, "the probe is gone");
        let region = |base: u64, bytes: &mut [u8]| -> Option<std::ops::Range<usize>> {
            let begin = usize::try_from(address.checked_sub(base)?).ok()?;
            bytes.get(begin..begin + length).map(|_| begin..begin + length)
        };
        if let Some(range) = region(Self::BASE, &mut self.bytes) {
            return Ok(&mut self.bytes[range]);
        }
        for (base, bytes) in &mut self.flash {
            if let Some(range) = region(*base, bytes) {
                return Ok(&mut bytes[range]);
            }
        }
        anyhow::bail!("no memory at {address:#x}")
    }
}

impl Memory for Ram {
    fn read(&mut self, address: u64, bytes: &mut [u8]) -> anyhow::Result<()> {
        bytes.copy_from_slice(self.at(address, bytes.len())?);
        Ok(())
    }

    fn write(&mut self, address: u64, bytes: &[u8]) -> anyhow::Result<()> {
        self.at(address, bytes.len())?.copy_from_slice(bytes);
        Ok(())
    }

    fn write_word(&mut self, address: u64, word: u32) -> anyhow::Result<()> {
        self.at(address, 4)?.copy_from_slice(&word.to_le_bytes());
        Ok(())
    }

    fn ram(&self) -> Vec<std::ops::Range<u64>> {
        std::iter::once(Self::BASE..Self::BASE + self.bytes.len() as u64).collect()
    }

    fn reset(&mut self) -> anyhow::Result<()> {
        self.resets += 1;
        Ok(())
    }
}
