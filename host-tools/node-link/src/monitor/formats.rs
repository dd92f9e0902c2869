//! Checks a frame of defmt before `defmt-decoder` decodes it.
//!
//! The decoder does not check the numbers in a frame. In a damaged frame, a length of 4 000 000 000 makes it request
//! 170 GB of memory, which ends the program, and nested frames make it recurse. So this module first walks through the
//! frame along its format strings. A frame whose numbers do not fit its bytes is malformed.

use std::collections::BTreeMap;

use defmt_parser::{Fragment, ParserMode, Type, get_max_bitfield_range};
use object::{Object, ObjectSection, ObjectSymbol};
use serde::Deserialize;

/// The maximum depth of nested formats. The formats of this project have a depth of five.
const MAX_DEPTH: usize = 24;

/// The format strings of an image, by their numbers in frames.
#[derive(Default)]
pub(super) struct Formats {
    timestamp: Option<String>,
    formats: BTreeMap<u16, String>,
}

/// The name of a symbol of defmt.
#[derive(Deserialize)]
struct Symbol {
    tag: String,
    data: String,
}

impl Formats {
    /// Finds the formats as `defmt-decoder` does: from the symbols in defmt's sections, whose names are JSON.
    pub(super) fn of(elf: &object::File<'_>) -> Self {
        let mut found = Self::default();
        let ours = |name: &str| name == ".defmt" || name.starts_with(".defmt.");
        let sections: Vec<_> =
            elf.sections().filter(|section| section.name().is_ok_and(ours)).map(|section| section.index()).collect();
        for symbol in elf.symbols() {
            if !symbol.section_index().is_some_and(|index| sections.contains(&index)) {
                continue;
            }
            let Ok(Ok(Symbol { tag, data })) = symbol.name().map(serde_json::from_str) else { continue };
            match (tag.as_str(), u16::try_from(symbol.address())) {
                ("defmt_timestamp", _) => found.timestamp = Some(data),
                // A value, not a format.
                ("defmt_bitflags_value", _) => {}
                (_, Ok(number)) => _ = found.formats.insert(number, data),
                // Frames cannot refer to this symbol.
                (_, Err(_)) => {}
            }
        }
        found
    }

    /// Whether the numbers of a frame fit its bytes.
    pub(super) fn fit(&self, frame: &[u8]) -> bool {
        let mut walk = Walk { formats: self, most: frame.len(), rest: frame };
        walk.frame().is_some()
    }
}

struct Walk<'a> {
    formats: &'a Formats,
    /// The maximum number of elements of a slice: the number of bytes of the frame, although some elements take no
    /// bytes.
    most: usize,
    rest: &'a [u8],
}

impl<'a> Walk<'a> {
    fn frame(&mut self) -> Option<()> {
        let format = self.format()?;
        if let Some(timestamp) = &self.formats.timestamp {
            self.arguments(timestamp, 0)?;
        }
        self.arguments(format, 0)
    }

    fn skip(&mut self, bytes: usize) -> Option<&'a [u8]> {
        let (skipped, rest) = self.rest.split_at_checked(bytes)?;
        self.rest = rest;
        Some(skipped)
    }

    fn number16(&mut self) -> Option<u16> {
        self.skip(2)?.try_into().ok().map(u16::from_le_bytes)
    }

    fn length(&mut self) -> Option<usize> {
        self.skip(4)?.try_into().ok().map(|bytes| u32::from_le_bytes(bytes) as usize)
    }

    fn format(&mut self) -> Option<&'a str> {
        let number = self.number16()?;
        self.formats.formats.get(&number).map(String::as_str)
    }

    /// The variant of an enumeration, `A|B{=u8}`, or the format itself.
    fn variant(&mut self, format: &'a str) -> Option<&'a str> {
        let bars = format.matches('|').count();
        let variant = match bars {
            0 => return Some(format),
            1..=0xFF => self.skip(1)?.first().copied()?.into(),
            0x100..=0xFFFF => self.number16()?.into(),
            _ => return None,
        };
        format.split('|').nth(variant)
    }

    fn arguments(&mut self, format: &str, depth: usize) -> Option<()> {
        if depth > MAX_DEPTH {
            return None;
        }
        let fragments = defmt_parser::parse(format, ParserMode::ForwardsCompatible).ok()?;
        let mut parameters = BTreeMap::<usize, Vec<_>>::new();
        for fragment in fragments {
            if let Fragment::Parameter(parameter) = fragment {
                parameters.entry(parameter.index).or_default().push(parameter);
            }
        }
        for same in parameters.values() {
            match &same.first()?.ty {
                // Several bit fields of one argument are sent once, from the first byte needed to the last.
                Type::BitField(_) if same.iter().all(|parameter| matches!(parameter.ty, Type::BitField(_))) => {
                    let (begin, end) = get_max_bitfield_range(same.iter())?;
                    let bytes = usize::from(end.checked_sub(1)? / 8).checked_sub(usize::from(begin / 8))? + 1;
                    self.skip(bytes.next_power_of_two())?;
                }
                Type::BitField(_) => return None,
                other => self.argument(other, depth)?,
            }
        }
        Some(())
    }

    fn argument(&mut self, argument: &Type, depth: usize) -> Option<()> {
        match argument {
            Type::BitField(_) => return None,
            Type::Bool | Type::I8 | Type::U8 => _ = self.skip(1)?,
            Type::I16 | Type::U16 | Type::IStr => _ = self.skip(2)?,
            Type::I32 | Type::U32 | Type::Isize | Type::Usize | Type::F32 | Type::Char => _ = self.skip(4)?,
            Type::I64 | Type::U64 | Type::F64 => _ = self.skip(8)?,
            Type::I128 | Type::U128 => _ = self.skip(16)?,
            Type::Str | Type::U8Slice => {
                let length = self.length()?;
                self.skip(length)?;
            }
            Type::U8Array(length) => _ = self.skip(*length)?,
            Type::Debug | Type::Display => {
                let length = self.rest.iter().position(|&byte| byte == 0xFF)?;
                self.skip(length + 1)?;
            }
            Type::Format => {
                let format = self.format()?;
                let format = self.variant(format)?;
                self.arguments(format, depth + 1)?;
            }
            Type::FormatSlice => {
                let length = self.length()?;
                self.elements(length, depth)?;
            }
            Type::FormatArray(length) => self.elements(*length, depth)?,
            Type::FormatSequence => loop {
                let number = self.number16()?;
                if number == 0 {
                    break;
                }
                let format = self.formats.formats.get(&number)?;
                self.arguments(format, depth + 1)?;
            },
        }
        Some(())
    }

    fn elements(&mut self, count: usize, depth: usize) -> Option<()> {
        let format = self.format()?;
        if count > self.most {
            return None;
        }
        for _ in 0..count {
            let variant = self.variant(format)?;
            self.arguments(variant, depth + 1)?;
        }
        Some(())
    }
}
