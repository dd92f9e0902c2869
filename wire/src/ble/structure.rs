//! AD structures: advertising data is a sequence of them. Each has a length, a type and data (Bluetooth Core 5.4,
//! volume 3, part C, section 11).

use core::fmt;

/// One AD structure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Structure<'a> {
    /// The AD type, a number of the Bluetooth SIG.
    pub kind: u8,
    /// Its contents; may be empty.
    pub data: &'a [u8],
}

/// A structure announces more bytes than there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Truncated {
    /// The announced number of bytes after the length.
    pub announced: u8,
    /// The number of bytes present after the length.
    pub present: usize,
}

impl fmt::Display for Truncated {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "an AD structure of {} bytes is cut after {}", self.announced, self.present)
    }
}

/// The structures of advertising data, in their order. A length of zero ends them early, according to the standard. A
/// truncated structure ends them with an error.
#[derive(Clone, Debug)]
pub struct Structures<'a> {
    rest: &'a [u8],
}

impl<'a> Structures<'a> {
    /// Over the data of an advertisement.
    pub fn new(advertising_data: &'a [u8]) -> Self {
        Self { rest: advertising_data }
    }
}

impl<'a> Iterator for Structures<'a> {
    type Item = Result<Structure<'a>, Truncated>;

    fn next(&mut self) -> Option<Self::Item> {
        let (&length, rest) = core::mem::take(&mut self.rest).split_first()?;
        let Some((structure, rest)) = rest.split_at_checked(length.into()) else {
            return Some(Err(Truncated { announced: length, present: rest.len() }));
        };
        let (&kind, data) = structure.split_first()?;
        self.rest = rest;
        Some(Ok(Structure { kind, data }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    #[test]
    fn structures_come_in_their_order_until_a_length_of_zero() {
        // Flags; the complete local name "tag"; the end; bytes after the end, which are ignored.
        let bytes = [2, 0x01, 0x06, 4, 0x09, b't', b'a', b'g', 0, 9, 9];
        let found: Vec<_> = Structures::new(&bytes).collect();
        assert_eq!(found, [Ok(Structure { kind: 0x01, data: &[0x06] }), Ok(Structure { kind: 0x09, data: b"tag" })]);
    }

    #[test]
    fn a_structure_may_be_a_type_alone() {
        let found: Vec<_> = Structures::new(&[1, 0x0A]).collect();
        assert_eq!(found, [Ok(Structure { kind: 0x0A, data: &[] })]);
    }

    #[test]
    fn a_truncated_structure_is_an_error_and_the_end() {
        let found: Vec<_> = Structures::new(&[2, 0x01, 0x06, 5, 0x09, b't']).collect();
        assert_eq!(found, [Ok(Structure { kind: 0x01, data: &[0x06] }), Err(Truncated { announced: 5, present: 2 })]);
    }

    proptest! {
        #[test]
        fn structures_of_any_bytes_lie_within_them(bytes in proptest::collection::vec(any::<u8>(), 0..64)) {
            let mut taken = 0;
            for structure in Structures::new(&bytes).flatten() {
                prop_assert_eq!(structure.kind, bytes[taken + 1]);
                prop_assert_eq!(structure.data, &bytes[taken + 2..taken + 1 + usize::from(bytes[taken])]);
                taken += 2 + structure.data.len();
            }
            prop_assert!(taken <= bytes.len());
        }
    }
}
