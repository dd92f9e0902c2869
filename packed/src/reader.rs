//! Bytes in, numbers out; zeros once the bytes have turned out to be no value.

/// What is left of the bytes.
#[derive(Clone, Debug)]
pub struct Reader<'a> {
    rest: &'a [u8],
    damaged: bool,
}

impl<'a> Reader<'a> {
    /// At the beginning of `bytes`.
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes, damaged: false }
    }

    /// The bytes make no value: from here on, all is zero and empty.
    #[inline(never)]
    pub fn refuse(&mut self) {
        *self = Self { rest: &[], damaged: true };
    }

    /// Whether all bytes were read, and made values.
    pub fn is_at_end(&self) -> bool {
        self.rest.is_empty() && !self.damaged
    }

    /// The next byte.
    #[inline(never)]
    pub fn byte(&mut self) -> u8 {
        match self.rest.split_first() {
            Some((&byte, rest)) => {
                self.rest = rest;
                byte
            }
            None => {
                self.refuse();
                0
            }
        }
    }

    /// The next bytes; none where there are not so many.
    #[inline(never)]
    pub fn bytes(&mut self, count: usize) -> &'a [u8] {
        match self.rest.split_at_checked(count) {
            Some((bytes, rest)) => {
                self.rest = rest;
                bytes
            }
            None => {
                self.refuse();
                &[]
            }
        }
    }

    /// The next integer: seven bits a byte, the lowest first, the highest bit set where more follow.
    #[inline(never)]
    pub fn long_varint(&mut self) -> u64 {
        let mut value = 0;
        for shift in (0..u64::BITS).step_by(7) {
            let byte = self.byte();
            let bits = u64::from(byte & 0x7F);
            if bits << shift >> shift != bits {
                break;
            }
            value |= bits << shift;
            if byte & 0x80 == 0 {
                return value;
            }
        }
        self.refuse();
        0
    }

    /// The same, of 32 bits at most.
    #[inline(never)]
    pub fn varint(&mut self) -> u32 {
        u32::try_from(self.long_varint()).unwrap_or_else(|_| {
            self.refuse();
            0
        })
    }
}
