//! Intel HEX of an image: the bytes of its flash with their addresses, for flashers that take no ELF file.

use anyhow::{Context, Result};
use ihex::Record;
use object::Endianness;
use object::elf::PT_LOAD;
use object::read::elf::{ElfFile32, ProgramHeader};

/// The data bytes of a record.
const RECORD_BYTES: usize = 16;

/// The Intel HEX of an ELF file's contents.
///
/// # Errors
/// The bytes are no ELF file of a 32-bit chip.
pub fn intel_hex(elf: &[u8]) -> Result<String> {
    let file = ElfFile32::<Endianness>::parse(elf).context("no ELF file of a 32-bit chip")?;
    let endian = file.endian();
    let mut loads = Vec::new();
    for header in file.elf_program_headers().iter().filter(|header| header.p_type(endian) == PT_LOAD) {
        let data = header.data(endian, elf).ok().context("a segment ends after the file")?;
        // Where the bytes are in flash, from which the start-up code copies variables into RAM.
        loads.push((header.p_paddr(endian), data));
    }
    loads.sort_by_key(|(address, _)| *address);
    let mut records = Vec::new();
    let mut upper = None;
    for (start, data) in loads {
        let mut at = start;
        let mut left = data;
        while !left.is_empty() {
            let [high @ .., _, _] = at.to_be_bytes();
            if upper.replace(high) != Some(high) {
                records.push(Record::ExtendedLinearAddress(u16::from_be_bytes(high)));
            }
            let offset = at as u16;
            // A record does not cross a boundary of 64 KiB.
            let most = RECORD_BYTES.min(0x1_0000 - usize::from(offset));
            let (value, rest) = left.split_at(most.min(left.len()));
            records.push(Record::Data { offset, value: value.to_vec() });
            at = at.checked_add(value.len() as u32).context("a segment ends after the address space")?;
            left = rest;
        }
    }
    records.push(Record::EndOfFile);
    ihex::create_object_file_representation(&records).context("cannot write Intel HEX")
}

#[cfg(test)]
mod tests {
    use super::intel_hex;

    /// An ELF file with the given segments: load address and bytes.
    fn elf(segments: &[(u32, &[u8])]) -> Vec<u8> {
        let mut file = b"\x7FELF\x01\x01\x01\0\0\0\0\0\0\0\0\0".to_vec();
        let half = |value: u16| value.to_le_bytes();
        let word = |value: u32| value.to_le_bytes();
        file.extend([half(2), half(40)].concat());
        file.extend([word(1), word(0), word(52), word(0), word(0)].concat());
        file.extend([half(52), half(32), half(segments.len() as u16), half(40), half(0), half(0)].concat());
        let mut at = 52 + 32 * segments.len() as u32;
        for (address, bytes) in segments {
            let length = bytes.len() as u32;
            file.extend([1, at, 0x2000_0000, *address, length, length, 4, 4].map(word).concat());
            at += length;
        }
        segments.iter().for_each(|(_, bytes)| file.extend_from_slice(bytes));
        file
    }

    #[test]
    fn segments_are_at_their_load_addresses_and_cross_64_kib_in_two_records() {
        // Sums of records by hand: 0x100 − the sum of the bytes, modulo 256.
        let hex = intel_hex(&elf(&[(0x0000_FFFE, &[1, 2, 3]), (0x0000_0010, &[0xAA])])).expect("an ELF file");
        let expected =
            [":020000040000FA", ":01001000AA45", ":02FFFE000102FE", ":020000040001F9", ":0100000003FC", ":00000001FF"];
        assert_eq!(hex.lines().collect::<Vec<_>>(), expected);
    }

    #[test]
    fn what_is_no_elf_file_is_refused() {
        assert!(intel_hex(b"no ELF file").is_err());
    }
}
