//! The bytes are those of `postcard`, which reads and writes the same types by `serde`.

use std::fmt::Debug;

use heapless::Vec;
use packed::{Packed, Reader, Writer, packed, read, write};
use serde::{Deserialize, Serialize};

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Inner {
    small: u16,
    wide: u64,
    signed: i8,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
enum Choice {
    Nothing,
    One(Inner),
    Two { level: f32, maybe: Option<u32> },
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct Outer<'a> {
    choice: Choice,
    list: Vec<Choice, 3>,
    place: [f32; 3],
    flag: bool,
    #[serde(borrow)]
    bytes: &'a [u8],
    #[serde(borrow)]
    name: &'a str,
}

packed!(struct Inner { small, wide, signed });
packed!(enum Choice { 0 = Nothing, 1 = One(inner), 2 = Two { level, maybe } });
packed!(struct Outer<'a> { choice, list, place, flag, bytes, name });

fn examples() -> [Outer<'static>; 4] {
    let inner = |small, wide| Inner { small, wide, signed: -5 };
    let of = |choice: Choice, list: &[Choice], bytes| Outer {
        choice,
        list: list.iter().cloned().collect(),
        place: [1.5, -0.0, 3.0e30],
        flag: list.is_empty(),
        bytes,
        name: if bytes.is_empty() { "" } else { "baño" },
    };
    let two = |maybe| Choice::Two { level: -59.5, maybe };
    [
        of(Choice::Nothing, &[], &[]),
        // The edges of varints: seven bits, eight, all of them.
        of(Choice::One(inner(127, 128)), &[two(None), two(Some(u32::MAX))], &[0xFF; 200]),
        of(two(Some(0)), &[Choice::Nothing, Choice::One(inner(u16::MAX, u64::MAX)), two(Some(300))], &[1]),
        of(Choice::One(inner(0, 1 << 63)), &[], &[2, 3]),
    ]
}

fn bytes_of<'a>(value: &impl Packed<'a>) -> std::vec::Vec<u8> {
    let mut buffer = [0; 512];
    let length = write(value, &mut buffer).expect("it fits");
    buffer[..length].to_vec()
}

#[test]
fn the_bytes_are_those_of_postcard() {
    for value in examples() {
        let bytes = bytes_of(&value);
        assert_eq!(postcard::to_slice(&value, &mut [0; 512]).expect("it fits"), bytes, "{value:?}");
        assert_eq!(read::<Outer<'_>>(&bytes), Some(value));
    }
}

#[test]
fn what_is_cut_short_or_too_long_is_no_value() {
    for value in examples() {
        let mut bytes = bytes_of(&value);
        for length in 0..bytes.len() {
            assert_eq!(read::<Outer<'_>>(&bytes[..length]), None, "{length} of {value:?}");
        }
        assert_eq!(write(&value, &mut [0; 512][..bytes.len() - 1]), None);
        bytes.push(0);
        assert_eq!(read::<Outer<'_>>(&bytes), None);
    }
}

/// What `postcard` takes of bytes that somebody else wrote, this takes, and the other way round; but for integers that are
/// longer than they need be, of which `postcard` refuses some.
#[test]
fn damaged_bytes_are_read_as_postcard_reads_them() {
    let (mut alike, mut refused) = (0, 0);
    for value in examples() {
        let whole = bytes_of(&value);
        for place in 0..whole.len() {
            for changed in 0..=255 {
                let mut bytes = whole.clone();
                bytes[place] = changed;
                let theirs = postcard::take_from_bytes::<Outer<'_>>(&bytes).ok().filter(|(_, rest)| rest.is_empty());
                match (read::<Outer<'_>>(&bytes), theirs) {
                    // Written again and not compared, since a float may have become no number.
                    (Some(ours), Some((theirs, _))) => {
                        assert_eq!(bytes_of(&ours), postcard::to_slice(&theirs, &mut [0; 512]).expect("it fits"));
                        alike += 1;
                    }
                    (None, None) => refused += 1,
                    (Some(ours), None) => assert!(bytes_of(&ours).len() < bytes.len(), "{bytes:?}"),
                    (None, Some(theirs)) => panic!("{theirs:?} is not read"),
                }
            }
        }
    }
    assert!(alike > 10_000 && refused > 10_000, "{alike} {refused}");
}

fn refuses<'a, T: Packed<'a> + PartialEq + Debug>(bytes: &'a [u8]) {
    assert_eq!(read::<T>(bytes), None, "{bytes:?}");
}

#[test]
fn numbers_that_do_not_fit_are_refused() {
    refuses::<bool>(&[2]);
    // 65,536, and 2³².
    refuses::<u16>(&[0x80, 0x80, 0x04]);
    refuses::<u32>(&[0x80, 0x80, 0x80, 0x80, 0x10]);
    // 2⁶⁴, and eleven bytes.
    refuses::<u64>(&[0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x02]);
    refuses::<u64>(&[0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x80, 0x00]);
    refuses::<Choice>(&[3]);
    refuses::<Vec<u8, 2>>(&[3, 0, 0, 0]);
}

#[test]
fn a_damaged_reader_gives_zeros_to_the_end() {
    let mut reader = Reader::new(&[7, 9, 1, 1, 1]);
    assert_eq!(Choice::read(&mut reader), Choice::Nothing);
    assert_eq!((reader.byte(), reader.varint(), reader.bytes(2)), (0, 0, &[][..]));
    assert!(!reader.is_at_end());
    let mut buffer = [0; 3];
    let mut writer = Writer::new(&mut buffer);
    writer.bytes(&[1, 2, 3, 4]);
    7_u8.write(&mut writer);
    assert_eq!(writer.written(), None, "what has not fitted is missing for good");
}
