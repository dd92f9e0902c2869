//! What values are made of: integers, floats, options, lists.

use heapless::Vec;

use crate::{Packed, Reader, Writer};

impl Packed<'_> for u8 {
    fn write(&self, writer: &mut Writer<'_>) {
        writer.bytes(&[*self]);
    }

    fn read(reader: &mut Reader<'_>) -> Self {
        reader.byte()
    }
}

impl Packed<'_> for i8 {
    fn write(&self, writer: &mut Writer<'_>) {
        writer.bytes(&self.to_le_bytes());
    }

    fn read(reader: &mut Reader<'_>) -> Self {
        reader.byte().cast_signed()
    }
}

impl Packed<'_> for bool {
    fn write(&self, writer: &mut Writer<'_>) {
        writer.bytes(&[(*self).into()]);
    }

    #[inline(never)]
    fn read(reader: &mut Reader<'_>) -> Self {
        match reader.byte() {
            0 => false,
            1 => true,
            _ => {
                reader.refuse();
                false
            }
        }
    }
}

impl Packed<'_> for u16 {
    fn write(&self, writer: &mut Writer<'_>) {
        writer.varint((*self).into());
    }

    #[inline(never)]
    fn read(reader: &mut Reader<'_>) -> Self {
        Self::try_from(reader.varint()).unwrap_or_else(|_| {
            reader.refuse();
            0
        })
    }
}

impl Packed<'_> for u32 {
    fn write(&self, writer: &mut Writer<'_>) {
        writer.varint(*self);
    }

    fn read(reader: &mut Reader<'_>) -> Self {
        reader.varint()
    }
}

impl Packed<'_> for u64 {
    fn write(&self, writer: &mut Writer<'_>) {
        writer.long_varint(*self);
    }

    fn read(reader: &mut Reader<'_>) -> Self {
        reader.long_varint()
    }
}

impl Packed<'_> for f32 {
    fn write(&self, writer: &mut Writer<'_>) {
        writer.bytes(&self.to_le_bytes());
    }

    #[inline(never)]
    fn read(reader: &mut Reader<'_>) -> Self {
        reader.bytes(4).first_chunk().map_or(0.0, |bytes| Self::from_le_bytes(*bytes))
    }
}

impl<'a, T: Packed<'a>> Packed<'a> for Option<T> {
    fn write(&self, writer: &mut Writer<'_>) {
        self.is_some().write(writer);
        if let Some(value) = self {
            value.write(writer);
        }
    }

    fn read(reader: &mut Reader<'a>) -> Self {
        bool::read(reader).then(|| T::read(reader))
    }
}

impl<'a, T: Packed<'a>, const N: usize> Packed<'a> for [T; N] {
    fn write(&self, writer: &mut Writer<'_>) {
        self.iter().for_each(|value| value.write(writer));
    }

    fn read(reader: &mut Reader<'a>) -> Self {
        core::array::from_fn(|_| T::read(reader))
    }
}

impl<'a> Packed<'a> for &'a [u8] {
    fn write(&self, writer: &mut Writer<'_>) {
        write_length(self.len(), writer);
        writer.bytes(self);
    }

    fn read(reader: &mut Reader<'a>) -> Self {
        let length = reader.varint();
        reader.bytes(length as usize)
    }
}

impl<'a> Packed<'a> for &'a str {
    fn write(&self, writer: &mut Writer<'_>) {
        self.as_bytes().write(writer);
    }

    fn read(reader: &mut Reader<'a>) -> Self {
        core::str::from_utf8(Packed::read(reader)).unwrap_or_else(|_| {
            reader.refuse();
            ""
        })
    }
}

impl<'a, T: Packed<'a>, const N: usize> Packed<'a> for Vec<T, N> {
    fn write(&self, writer: &mut Writer<'_>) {
        write_length(self.len(), writer);
        self.iter().for_each(|value| value.write(writer));
    }

    fn read(reader: &mut Reader<'a>) -> Self {
        let mut list = Self::new();
        for _ in 0..reader.varint() {
            if list.push(T::read(reader)).is_err() {
                reader.refuse();
                break;
            }
        }
        list
    }
}

/// A length; a list's or slice's fits 32 bits, or its bytes do not fit the buffer.
fn write_length(length: usize, writer: &mut Writer<'_>) {
    writer.long_varint(length as u64);
}
