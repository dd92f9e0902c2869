//! An image's ELF file: its build, the address of its RTT control block, and the table for its log.

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

use object::{Object, ObjectSection, ObjectSegment, ObjectSymbol, SegmentFlags};

use super::formats::Formats;
use super::table::Table;
use recording::UserError;
use recording::{IMAGE_BYTES, read_limited};

/// The section in which an image has its build.
const BUILD_SECTION: &str = ".baliza.build";

/// The build of an image.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Build(pub [u8; 8]);

impl fmt::Display for Build {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl fmt::Debug for Build {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Build({self})")
    }
}

/// The source location of a log line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SourceLocation {
    /// The file, as the compiler received it.
    pub file: String,
    /// The line, from 1.
    pub line: u64,
}

/// The features by which a chip's memory is compared with an image.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Marks {
    /// The address of its RTT control block.
    pub rtt: Option<u64>,
    /// Samples of its code and constants, by their addresses. Its build is among them where its bytes are contiguous.
    pub flash: Vec<(u64, Vec<u8>)>,
}

/// The data of an ELF file that the monitor needs.
pub struct Image {
    /// The file, as the user named it.
    pub file: PathBuf,
    /// Its build; `None`: the image is not from this project.
    pub build: Option<Build>,
    /// The features to compare with the chip.
    pub marks: Marks,
    pub(super) table: Table,
    pub(super) formats: Formats,
    pub(super) places: BTreeMap<u64, SourceLocation>,
}

impl Image {
    /// Reads an ELF file.
    ///
    /// # Errors
    /// The file cannot be read, is not an ELF file, or has no log that can be read.
    pub fn read(file: &Path) -> Result<Self, UserError> {
        let bytes = read_limited(file, IMAGE_BYTES)?;
        Self::parse(file, &bytes).map_err(|what| UserError::file(file, what))
    }

    pub(super) fn parse(file: &Path, bytes: &[u8]) -> Result<Self, String> {
        const GIVE: &str = "give the .elf that was flashed, of target/firmware, not a .bin or .hex made of it";
        let elf = object::File::parse(bytes).map_err(|_| format!("not an ELF file: {GIVE}"))?;
        let table = Table::parse(bytes)?;
        let build = elf.section_by_name(BUILD_SECTION);
        let build = build.and_then(|section| section.data().ok()?.first_chunk().copied()).map(Build);
        let rtt = elf.symbols().find(|symbol| symbol.name() == Ok("_SEGGER_RTT")).map(|symbol| symbol.address());
        let marks = Marks { rtt, flash: flash(&elf, build) };
        let places = table.locations(bytes).collect();
        Ok(Self { file: file.to_owned(), build, marks, formats: Formats::of(&elf), places, table })
    }
}

/// Windows at equal intervals in each flash segment, and the build wherever it is.
fn flash(elf: &object::File<'_>, build: Option<Build>) -> Vec<(u64, Vec<u8>)> {
    const WINDOW: usize = 64;
    const WINDOWS: usize = 8;
    let mut marks = Vec::new();
    for segment in elf.segments() {
        // The contents of a writable segment do not stay as in the file.
        let writable = matches!(segment.flags(), SegmentFlags::Elf { p_flags } if p_flags & object::elf::PF_W != 0);
        let Ok(data) = segment.data() else { continue };
        if writable || data.is_empty() {
            continue;
        }
        let stride = (data.len() / WINDOWS).max(WINDOW);
        let windows = data.chunks(stride).enumerate().map(|(index, chunk)| (index * stride, chunk));
        let windows = windows.map(|(at, chunk)| (at, chunk.get(..WINDOW).unwrap_or(chunk)));
        let builds = build
            .iter()
            .flat_map(|build| data.windows(build.0.len()).enumerate().filter(move |(_, window)| *window == build.0));
        marks.extend(windows.chain(builds).map(|(at, bytes)| (segment.address() + at as u64, bytes.to_vec())));
    }
    marks
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::super::testing::{BUILD, STATEMENTS, elf, elf_with};
    use super::{Build, Image, flash};

    fn refused(bytes: &[u8]) -> String {
        Image::parse(Path::new("image"), bytes).err().expect("it is refused")
    }

    #[test]
    fn the_build_and_the_control_block_of_an_image_are_read() {
        let image = Image::parse(Path::new("image"), &elf(Some(BUILD))).expect("an image");
        assert_eq!(image.build, Some(Build(BUILD)));
        assert_eq!(image.build.map(|build| build.to_string()), Some("1a2b3c4d5e6f7081".into()));
        assert_eq!(image.marks.rtt, Some(0x2000_0100));
        let foreign = Image::parse(Path::new("image"), &elf(None)).expect("an image");
        assert_eq!(foreign.build, None);
    }

    #[test]
    fn what_is_no_image_is_refused_with_what_to_do() {
        assert!(refused(b"S0030000FC").starts_with("not an ELF file: give the .elf that was flashed"));
        assert!(refused(b"").starts_with("not an ELF file"));
        assert!(refused(&elf(Some(BUILD))[..100]).contains("ELF"));
        let raw = elf_with(Some(BUILD), &STATEMENTS, "raw");
        assert!(refused(&raw).contains("raw encoding"));
        let mut without = object::write::Object::new(
            object::BinaryFormat::Elf,
            object::Architecture::Arm,
            object::Endianness::Little,
        );
        without.add_file_symbol(b"none".to_vec());
        assert!(refused(&without.write().expect("an ELF file")).starts_with("it has no defmt table"));
    }

    /// An executable for a 32-bit little-endian machine: a header, and a program header for each segment (address,
    /// flags, bytes).
    fn executable(segments: &[(u32, u32, &[u8])]) -> Vec<u8> {
        let mut elf = b"\x7FELF\x01\x01\x01\0\0\0\0\0\0\0\0\0".to_vec();
        let half = |elf: &mut Vec<u8>, values: &[u16]| values.iter().for_each(|value| elf.extend(value.to_le_bytes()));
        let word = |elf: &mut Vec<u8>, values: &[u32]| values.iter().for_each(|value| elf.extend(value.to_le_bytes()));
        // An executable for Arm, version 1; entry, program headers at 52, no section headers, flags.
        half(&mut elf, &[2, 40]);
        word(&mut elf, &[1, 0, 52, 0, 0]);
        half(&mut elf, &[52, 32, segments.len() as u16, 40, 0, 0]);
        let mut offset = 52 + 32 * segments.len() as u32;
        for (address, flags, bytes) in segments {
            let length = bytes.len() as u32;
            word(&mut elf, &[1, offset, *address, *address, length, length, *flags, 4]);
            offset += length;
        }
        segments.iter().for_each(|(.., bytes)| elf.extend(*bytes));
        elf
    }

    #[test]
    fn marks_are_of_what_the_chip_cannot_change() {
        let mut code = vec![0x11; 1000];
        code[500..508].copy_from_slice(&BUILD);
        // One segment is readable and executable, the other readable and writable.
        let bytes = executable(&[(0x1000, 5, &code), (0x2000_0000, 6, &BUILD)]);
        let elf = object::File::parse(&bytes[..]).expect("an ELF file");
        let marks = flash(&elf, Some(Build(BUILD)));
        // 1000 bytes have a window of 64 bytes every 125 bytes. The build follows.
        let expected: Vec<(u64, usize)> =
            (0..8).map(|window| (0x1000 + 125 * window, 64)).chain([(0x1000 + 500, 8)]).collect();
        assert_eq!(marks.iter().map(|(address, bytes)| (*address, bytes.len())).collect::<Vec<_>>(), expected);
        assert_eq!(marks.last().map(|(_, bytes)| bytes.as_slice()), Some(&BUILD[..]));
    }
}
