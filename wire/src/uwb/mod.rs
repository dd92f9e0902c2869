//! Frames as they are on the air, without their two check bytes: from bytes to a validated representation, and back.
//!
//! A parser accepts any bytes. If they are not exactly a frame of its kind, it returns the reason as a [`FrameError`].
//! `emit` writes a parsed frame back byte for byte. The header is that of IEEE 802.15.4-2011 data frames (5.2.1): one
//! PAN identifier, addresses of 16 or 64 bits, fields least significant byte first.

pub mod decaranging;
pub mod layout;
pub mod native;

use core::fmt;

use radio::MAX_FRAME;

/// The greatest number of anchors in one round.
pub const MAX_ROUND: usize = 8;

/// The 16-bit address of all nodes.
pub const BROADCAST: u16 = 0xFFFF;

/// Why bytes are not a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum FrameError {
    /// The bytes end within a field.
    Truncated,
    /// This many bytes follow the last field.
    TooLong(usize),
    /// Not an IEEE 802.15.4 data frame within one PAN, or not with the addresses of its kind.
    Header,
    /// No message has this code.
    Code(u8),
    /// A field has a value that its message cannot have.
    Field,
}

impl fmt::Display for FrameError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Truncated => f.write_str("the bytes end within a field"),
            Self::TooLong(bytes) => write!(f, "{bytes} bytes follow the last field"),
            Self::Header => f.write_str("no data frame within one PAN, or not with the addresses of its kind"),
            Self::Code(code) => write!(f, "no message has the code 0x{code:02X}"),
            Self::Field => f.write_str("a field has a value that its message cannot have"),
        }
    }
}

impl core::error::Error for FrameError {}

/// A buffer for a frame that is being written.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FrameBuffer(heapless::Vec<u8, MAX_FRAME>);

impl FrameBuffer {
    /// An empty buffer.
    #[inline]
    pub const fn new() -> Self {
        Self(heapless::Vec::new())
    }

    /// The bytes written.
    #[inline]
    pub fn bytes(&self) -> &[u8] {
        &self.0
    }

    #[inline]
    fn clear(&mut self) {
        self.0.clear();
    }

    #[inline]
    fn put(&mut self, bytes: &[u8]) {
        // The types of the representations bound their lengths to MAX_FRAME; the tests emit the longest of each.
        let fits = self.0.extend_from_slice(bytes).is_ok();
        debug_assert!(fits, "frame longer than {MAX_FRAME} bytes");
    }
}

/// Reads fields from the front of bytes; every read may fail.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reader<'a>(pub(crate) &'a [u8]);

impl<'a> Reader<'a> {
    #[inline]
    pub(crate) fn take<const N: usize>(&mut self) -> Result<[u8; N], FrameError> {
        let (head, rest) = self.0.split_first_chunk().ok_or(FrameError::Truncated)?;
        self.0 = rest;
        Ok(*head)
    }

    #[inline]
    pub(crate) fn u8(&mut self) -> Result<u8, FrameError> {
        self.take().map(|[byte]| byte)
    }

    #[inline]
    pub(crate) fn u16(&mut self) -> Result<u16, FrameError> {
        self.take().map(u16::from_le_bytes)
    }

    #[inline]
    pub(crate) fn u32(&mut self) -> Result<u32, FrameError> {
        self.take().map(u32::from_le_bytes)
    }

    #[inline]
    pub(crate) fn u64(&mut self) -> Result<u64, FrameError> {
        self.take().map(u64::from_le_bytes)
    }

    /// Checks that nothing is left: a frame longer than its kind is not of its kind.
    #[inline]
    pub(crate) fn end(self) -> Result<(), FrameError> {
        if self.0.is_empty() { Ok(()) } else { Err(FrameError::TooLong(self.0.len())) }
    }
}

/// An address.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Address {
    /// 16 bits, unique in a PAN; 0xFFFF is everyone.
    Short(u16),
    /// EUI-64.
    Extended(u64),
}

impl Address {
    /// The addressing mode's two bits.
    #[inline]
    const fn mode(self) -> u8 {
        match self {
            Self::Short(_) => 0b10,
            Self::Extended(_) => 0b11,
        }
    }

    #[inline]
    fn parse(mode: u8, reader: &mut Reader<'_>) -> Result<Self, FrameError> {
        match mode {
            0b10 => reader.u16().map(Self::Short),
            0b11 => reader.u64().map(Self::Extended),
            _ => Err(FrameError::Header),
        }
    }

    #[inline]
    fn emit(self, out: &mut FrameBuffer) {
        match self {
            Self::Short(address) => out.put(&address.to_le_bytes()),
            Self::Extended(address) => out.put(&address.to_le_bytes()),
        }
    }
}

/// The header of a data frame within one PAN.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Header {
    /// Sequence number.
    pub sequence: u8,
    /// PAN identifier of both ends.
    pub pan: u16,
    /// The address of the receiver.
    pub destination: Address,
    /// The address of the sender.
    pub source: Address,
}

/// Frame control, first byte: data frame, PAN identifier once; no security, nothing pending, no acknowledgement.
const DATA_IN_ONE_PAN: u8 = 0x41;

impl Header {
    /// Parses the header of a data frame. Returns it and the payload.
    ///
    /// # Errors
    /// If the bytes are too few, or another kind of frame.
    #[inline]
    pub fn parse(bytes: &[u8]) -> Result<(Self, &[u8]), FrameError> {
        let mut reader = Reader(bytes);
        let [kind, addressing, sequence] = reader.take()?;
        // Bits 0, 1 of the second byte are reserved; 4, 5 are the frame's version, which is 0 here.
        if kind != DATA_IN_ONE_PAN || addressing & 0x33 != 0 {
            return Err(FrameError::Header);
        }
        let pan = reader.u16()?;
        let destination = Address::parse(addressing >> 2 & 0b11, &mut reader)?;
        let source = Address::parse(addressing >> 6, &mut reader)?;
        Ok((Self { sequence, pan, destination, source }, reader.0))
    }

    #[inline]
    fn emit(&self, out: &mut FrameBuffer) {
        let addressing = self.destination.mode() << 2 | self.source.mode() << 6;
        out.put(&[DATA_IN_ONE_PAN, addressing, self.sequence]);
        out.put(&self.pan.to_le_bytes());
        self.destination.emit(out);
        self.source.emit(out);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headers_of_all_four_addressings_are_read_and_written() {
        let short = [0x41, 0x88, 7, 0xCA, 0xDE, 0x02, 0x01, 0x04, 0x03, 0xAA];
        let init = [0x41, 0x8C, 7, 0xCA, 0xDE, 8, 7, 6, 5, 4, 3, 2, 1, 0x04, 0x03, 0xAA];
        let long = [0x41, 0xCC, 7, 0xCA, 0xDE, 8, 7, 6, 5, 4, 3, 2, 1, 18, 17, 16, 15, 14, 13, 12, 11, 0xAA];
        let mixed = [0x41, 0xC8, 7, 0xCA, 0xDE, 0x02, 0x01, 18, 17, 16, 15, 14, 13, 12, 11, 0xAA];
        let (a, b) = (Address::Short(0x0102), Address::Short(0x0304));
        let (c, d) = (Address::Extended(0x0102_0304_0506_0708), Address::Extended(0x0B0C_0D0E_0F10_1112));
        let cases = [(&short[..], a, b), (&init[..], c, b), (&long[..], c, d), (&mixed[..], a, d)];
        for (bytes, destination, source) in cases {
            let (header, payload) = Header::parse(bytes).unwrap();
            assert_eq!(header, Header { sequence: 7, pan: 0xDECA, destination, source });
            assert_eq!(payload, [0xAA]);
            let mut out = FrameBuffer::new();
            header.emit(&mut out);
            assert_eq!(out.bytes(), &bytes[..bytes.len() - 1]);
            for cut in 0..bytes.len() - 1 {
                assert_eq!(Header::parse(&bytes[..cut]), Err(FrameError::Truncated), "cut to {cut}");
            }
        }
    }

    #[test]
    fn other_frames_are_not_data_frames() {
        // Acknowledgement, beacon, security on, two PANs, newer version, no destination.
        for (kind, addressing) in [(0x02, 0x00), (0x40, 0x88), (0x49, 0x88), (0x01, 0x88), (0x41, 0xA8), (0x41, 0x80)] {
            let mut bytes = [0; 24];
            bytes[..2].copy_from_slice(&[kind, addressing]);
            assert_eq!(Header::parse(&bytes), Err(FrameError::Header), "{kind:02x} {addressing:02x}");
        }
    }
}
