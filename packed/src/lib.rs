//! Values as bytes and back: what lies in a node's flash. Bytes flow in and out, and values out and in.
//!
//! The format is [postcard](https://postcard.jamesmunns.com)'s, which the tests compare with: integers as varints, options as 00 or 01,
//! variants by number, floats little-endian, lists after their length. `serde` spells out every type, which takes 10 kB of an image for
//! a node's record; here a type is a list of its fields ([`packed!`]), and a [`Reader`] that has met damage gives zeros to the end, so
//! that damage is looked for once and not after each field.
#![no_std]
#![forbid(unsafe_code)]

mod fields;
mod reader;
mod writer;

pub use reader::Reader;
pub use writer::Writer;

/// What can be written as bytes, and read from bytes that it may borrow.
pub trait Packed<'a>: Sized {
    /// Appends the value.
    fn write(&self, writer: &mut Writer<'_>);

    /// Takes the value. What it is where the bytes make none says nothing: the reader knows that they are damaged.
    fn read(reader: &mut Reader<'a>) -> Self;
}

/// Writes a value to the beginning of `buffer`; how many bytes that are, `None` where they do not fit.
pub fn write<'a>(value: &impl Packed<'a>, buffer: &mut [u8]) -> Option<usize> {
    let mut writer = Writer::new(buffer);
    value.write(&mut writer);
    writer.written()
}

/// Reads a value from all of `bytes`; `None` where they make none, or more than one.
pub fn read<'a, T: Packed<'a>>(bytes: &'a [u8]) -> Option<T> {
    let mut reader = Reader::new(bytes);
    let value = T::read(&mut reader);
    reader.is_at_end().then_some(value)
}

/// Makes a type [`Packed`] by its fields in order, or by its variants with their numbers, the first of which is 0.
#[macro_export]
macro_rules! packed {
    (struct $name:ident $(<$life:lifetime>)? { $($field:ident),* $(,)? }) => {
        impl<'packed> $crate::Packed<'packed> for $crate::packed!(@type $name 'packed $($life)?) {
            fn write(&self, writer: &mut $crate::Writer<'_>) {
                // Names all fields: one that is forgotten does not compile.
                let Self { $($field),* } = self;
                $($crate::Packed::write($field, writer);)*
            }

            fn read(reader: &mut $crate::Reader<'packed>) -> Self {
                $(let $field = $crate::Packed::read(reader);)*
                Self { $($field),* }
            }
        }
    };
    (enum $name:ident $(<$life:lifetime>)? {
        $($number:literal = $variant:ident $(($item:ident))? $({ $($field:ident),* })?),* $(,)?
    }) => {
        impl<'packed> $crate::Packed<'packed> for $crate::packed!(@type $name 'packed $($life)?) {
            fn write(&self, writer: &mut $crate::Writer<'_>) {
                match self {
                    $(Self::$variant $(($item))? $({ $($field),* })? => {
                        writer.varint($number);
                        $($crate::Packed::write($item, writer);)?
                        $($($crate::Packed::write($field, writer);)*)?
                    })*
                }
            }

            fn read(reader: &mut $crate::Reader<'packed>) -> Self {
                const { assert!([$($number),*][0] == 0, "a damaged reader says 0") };
                loop {
                    match reader.varint() {
                        $($number => {
                            $(let $item = $crate::Packed::read(reader);)?
                            $($(let $field = $crate::Packed::read(reader);)*)?
                            return Self::$variant $(($item))? $({ $($field),* })?;
                        })*
                        _ => reader.refuse(),
                    }
                }
            }
        }
    };
    (@type $name:ident $packed:lifetime) => { $name };
    (@type $name:ident $packed:lifetime $life:lifetime) => { $name<$packed> };
}
