//! The position of a tag in a Bluetooth advertisement: phones and scanners near it read it without a gateway.
//!
//! The advertising data is one AD structure with data of a manufacturer, 31 bytes, as many as an advertisement may have.
//! Numbers are little-endian.
//!
//! | offset | bytes | what |
//! |---|---|---|
//! | 0 | 1 | 30, the length |
//! | 1 | 1 | 0xFF, data of a manufacturer |
//! | 2 | 2 | 0xFFFF, no company (Bluetooth Assigned Numbers, 7: for tests) |
//! | 4 | 1 | 0xB in the higher half; in the lower half the number of anchors that the round asked |
//! | 5 | 2 | network (PAN) |
//! | 7 | 2 | short address of the tag |
//! | 9 | 2 | round, as the tag counts them |
//! | 11 | 16 | [`PolledPosition`], as in a poll, of this round |
//! | 27 | 4 | code, or zeros without a key |
//!
//! With the key that the site's Bluetooth nodes share, the code is the first half of an integrity code over the bytes 4 to
//! 26. Its nonce is (lowest byte first): tag (2), round (2), zeros. It shows that a tag of the site sent the position at some
//! time: who recorded an advertisement can send it again.

use crate::ble::{Structure, Structures};
use crate::uwb::native::{MakeCode, Nonce, PolledPosition};

const MANUFACTURER: u8 = 0xFF;
const NO_COMPANY: [u8; 2] = [0xFF; 2];
/// In the higher half of the byte: this is the position of a tag.
const MARK: u8 = 0xB0;
/// Bytes that the code covers.
const COVERED: usize = 23;

/// The position of a tag, as it advertises it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TagPosition {
    /// The tag's network (PAN).
    pub pan: u16,
    /// Short address of the tag.
    pub tag: u16,
    /// The round of the position, as the tag counts it.
    pub round: u16,
    /// Anchors that the round asked, at most 15.
    pub asked: u8,
    /// The position.
    pub position: PolledPosition,
}

impl TagPosition {
    /// Bytes of the advertising data.
    pub const BYTES: usize = 31;

    /// The advertising data, with the code of a key.
    pub fn emit(&self, key: Option<(&[u8; 16], MakeCode)>) -> [u8; Self::BYTES] {
        let mut bytes = [0; Self::BYTES];
        let [head @ .., _, _, _, _] = &mut bytes;
        let (structure, covered) = head.split_at_mut(4);
        structure.copy_from_slice(&[Self::BYTES as u8 - 1, MANUFACTURER, NO_COMPANY[0], NO_COMPANY[1]]);
        let (numbers, position) = covered.split_at_mut(7);
        let [[a, b], [c, d], [e, f]] = [self.pan, self.tag, self.round].map(u16::to_le_bytes);
        numbers.copy_from_slice(&[MARK | self.asked.min(0x0F), a, b, c, d, e, f]);
        position.copy_from_slice(&self.position.0);
        if let Some((key, make_code)) = key {
            let [first, second, third, fourth, ..] = make_code(key, &self.nonce(), [covered, &[]]);
            bytes[4 + COVERED..].copy_from_slice(&[first, second, third, fourth]);
        }
        bytes
    }

    /// The position in the data of an advertisement, if there is one. With a key a position with another code is none.
    pub fn parse(advertising_data: &[u8], key: Option<(&[u8; 16], MakeCode)>) -> Option<Self> {
        let of_maker = |structure: &Structure<'_>| structure.kind == MANUFACTURER;
        let data = Structures::new(advertising_data).map_while(Result::ok).find(of_maker)?.data;
        let (covered, sent) = data.strip_prefix(&NO_COMPANY)?.split_last_chunk::<4>()?;
        let &[mark, a, b, c, d, e, f, ref position @ ..] = covered else { return None };
        let position = PolledPosition(position.try_into().ok()?);
        let [pan, tag, round] = [[a, b], [c, d], [e, f]].map(u16::from_le_bytes);
        let found = Self { pan, tag, round, asked: mark & 0x0F, position };
        if mark & 0xF0 != MARK || position.outcome().is_err() {
            return None;
        }
        let is_of = |(key, make_code): (_, MakeCode)| make_code(key, &found.nonce(), [covered, &[]]).starts_with(sent);
        key.is_none_or(is_of).then_some(found)
    }

    fn nonce(&self) -> Nonce {
        let mut nonce = [0; 13];
        let ([a, b], [c, d]) = (self.tag.to_le_bytes(), self.round.to_le_bytes());
        nonce[..4].copy_from_slice(&[a, b, c, d]);
        nonce
    }
}

#[cfg(test)]
mod tests {
    use aes::Aes128;
    use aes::cipher::KeyInit;
    use ccm::aead::AeadInOut;
    use ccm::consts::{U8, U13};
    use hex_literal::hex;
    use proptest::prelude::*;

    use super::*;
    use crate::uwb::native::software_code;

    const KEY: [u8; 16] = *b"key of this site";

    const KEYED: Option<(&[u8; 16], MakeCode)> = Some((&KEY, software_code));
    const PLAIN: Option<(&[u8; 16], MakeCode)> = None;

    fn told() -> TagPosition {
        // The position of the poll of the wire format's examples: 1.000, -0.001 and 8.388 m.
        let position = PolledPosition(hex!("E80300 FFFFFF C42000 69A000 400000 80"));
        TagPosition { pan: 0xBA12, tag: 0x1001, round: 300, asked: 4, position }
    }

    #[test]
    fn the_bytes_are_those_of_the_documentation() {
        let covered = hex!("B4 12BA 0110 2C01 E80300 FFFFFF C42000 69A000 400000 80");
        let mut expected = [0; 31];
        expected[..4].copy_from_slice(&hex!("1E FF FFFF"));
        expected[4..27].copy_from_slice(&covered);
        assert_eq!(told().emit(PLAIN), expected);
        let groups = expected.chunks(4).map(|group| group.iter().map(|byte| std::format!("{byte:02X}")).collect());
        let groups: std::vec::Vec<std::string::String> = groups.collect();
        let page = include_str!("../../../docs/reference/wire-format.md");
        assert!(page.contains(&std::format!("`{}`", groups.join(" "))), "{groups:?}");
        // The crate `ccm`, with the nonce by hand: 0x1001, 300 = 0x012C.
        let reference: ccm::Ccm<Aes128, U8, U13> = KeyInit::new(&KEY.into());
        let nonce = hex!("0110 2C01 000000000000000000");
        let code = reference.encrypt_inout_detached(&nonce.into(), &covered, (&mut [][..]).into()).unwrap();
        expected[27..].copy_from_slice(&code[..4]);
        assert_eq!(told().emit(KEYED), expected);
    }

    #[test]
    fn a_reader_with_the_key_takes_no_other_bytes_and_one_without_takes_all() {
        let (plain, coded) = (told().emit(PLAIN), told().emit(KEYED));
        assert_eq!([&plain, &coded].map(|bytes| TagPosition::parse(bytes, PLAIN)), [Some(told()); 2]);
        assert_eq!([&plain, &coded].map(|bytes| TagPosition::parse(bytes, KEYED)), [None, Some(told())]);
        for bit in 8 * 4..8 * TagPosition::BYTES {
            let mut forged = coded;
            forged[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(TagPosition::parse(&forged, KEYED), None, "bit {bit}");
        }
    }

    #[test]
    fn flags_may_come_before_it_and_cut_or_strange_data_are_none() {
        let whole = told().emit(KEYED);
        let after_flags: std::vec::Vec<u8> = hex!("02 01 06").into_iter().chain(whole).collect();
        assert_eq!(TagPosition::parse(&after_flags, KEYED), Some(told()));
        assert!((0..whole.len()).all(|length| TagPosition::parse(&whole[..length], PLAIN).is_none()));
        // The length of an iBeacon, another company, another mark, and coordinates that are none.
        for (at, byte) in [(0, 26), (2, 0x4C), (4, 0xA4)] {
            let mut other = whole;
            other[at] = byte;
            assert_eq!(TagPosition::parse(&other, PLAIN), None, "byte {at}");
        }
        let mut nowhere = whole;
        nowhere[11..20].copy_from_slice(&hex!("000080 000080 000080"));
        assert_eq!(TagPosition::parse(&nowhere, PLAIN), None);
    }

    proptest! {
        #[test]
        fn any_bytes_are_a_position_or_none(bytes in proptest::collection::vec(any::<u8>(), 0..40)) {
            let _ = TagPosition::parse(&bytes, PLAIN);
        }
    }
}
