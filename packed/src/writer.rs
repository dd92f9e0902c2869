//! Numbers in, bytes out.

/// A buffer and how much of it is written.
#[derive(Debug)]
pub struct Writer<'b> {
    buffer: &'b mut [u8],
    /// `None` once something has not fitted.
    written: Option<usize>,
}

impl<'b> Writer<'b> {
    /// At the beginning of `buffer`.
    pub fn new(buffer: &'b mut [u8]) -> Self {
        Self { buffer, written: Some(0) }
    }

    /// How many bytes were written; `None` where they did not fit.
    pub fn written(&self) -> Option<usize> {
        self.written
    }

    /// Appends bytes.
    pub fn bytes(&mut self, bytes: &[u8]) {
        self.written = self.written.and_then(|begin| {
            let end = begin + bytes.len();
            self.buffer.get_mut(begin..end)?.copy_from_slice(bytes);
            Some(end)
        });
    }

    /// Appends an integer: seven bits a byte, the lowest first, the highest bit set where more follow.
    pub fn long_varint(&mut self, mut value: u64) {
        while value > 0x7F {
            self.bytes(&[value as u8 | 0x80]);
            value >>= 7;
        }
        self.bytes(&[value as u8]);
    }

    /// The same, of 32 bits.
    pub fn varint(&mut self, value: u32) {
        self.long_varint(value.into());
    }
}
