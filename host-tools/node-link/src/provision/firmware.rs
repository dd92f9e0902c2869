//! An image that is flashed: where it is, and whether it is for a node.

use std::path::{Path, PathBuf};

use object::elf::{PT_LOAD, SHF_ALLOC};
use object::read::elf::{ElfFile32, ProgramHeader};
use object::{Endianness, Object, ObjectSection, ObjectSymbol, SectionFlags};
use wire::config::{Board, Flasher, Role};

use super::Node;

use recording::UserError;
use recording::{IMAGE_BYTES, read_limited};

/// The crates of the apps, as the symbols of an image have their names.
const TAG: &str = "firmware_tag";
const BEACON: &str = "firmware_beacon";
const SCANNER: &str = "firmware_scanner";
const GATEWAY: &str = "firmware_gateway";

/// An image's ELF file.
#[derive(Clone, Debug)]
pub struct Firmware {
    /// The file.
    pub file: PathBuf,
    /// Its bytes.
    pub elf: Vec<u8>,
    /// The contents of the flash: addresses and bytes.
    pub segments: Vec<(u32, Vec<u8>)>,
    /// The board that it is for.
    pub board: Board,
}

impl Firmware {
    /// The names of images for a node, the best first: a tag that scans needs Bluetooth, a node with Wi-Fi needs that.
    pub fn names(board: Board, node: &Node) -> Vec<String> {
        let name = board.name();
        match &node.record.role {
            Role::Anchor { .. } if node.wifi.is_some() => vec![format!("anchor-{name}-wifi.elf")],
            Role::Tag(_) if node.wifi.is_some() => vec![format!("tag-{name}-wifi.elf")],
            Role::Anchor { .. } => vec![format!("anchor-{name}.elf")],
            Role::Advertiser(_) => vec![format!("beacon-{name}.elf")],
            Role::Scanner => vec![format!("scanner-{name}.elf")],
            Role::Tag(tag) if tag.scan.is_some() => vec![format!("tag-{name}-ble.elf")],
            Role::Tag(_) => vec![format!("tag-{name}.elf"), format!("tag-{name}-ble.elf")],
        }
    }

    /// Looks for the image of a node in these folders.
    ///
    /// # Errors
    /// None of them has it.
    pub fn find(folders: &[PathBuf], board: Board, node: &Node) -> Result<PathBuf, UserError> {
        let names = Self::names(board, node);
        let all = names.iter().flat_map(|name| folders.iter().map(move |folder| folder.join(name)));
        all.clone().find(|file| file.is_file()).ok_or_else(|| {
            let folders = folders.iter().map(|folder| folder.display().to_string()).collect::<Vec<_>>().join(", ");
            let what = format!(
                "no {} in {folders}: build it with `cargo xtask firmware {}`, or name the folder of a release",
                names.join(" or "),
                board.name()
            );
            UserError::flag("--images", what)
        })
    }

    /// Reads an ELF file, and checks that it is for the board and for the node's role.
    ///
    /// # Errors
    /// The file cannot be read, is no ELF file, or is for another board or role.
    pub fn read(file: &Path, board: Board, node: &Node) -> Result<Self, UserError> {
        let elf = read_limited(file, IMAGE_BYTES)?;
        Self::parse(file, elf, board, node).map_err(|what| UserError::file(file, what))
    }

    /// Whether a bootloader loads it, so that it goes to flash in another format.
    pub fn is_for_bootloader(&self) -> bool {
        matches!(self.board.spec().flasher, Flasher::Espflash(_))
    }

    fn parse(file: &Path, elf: Vec<u8>, board: Board, node: &Node) -> Result<Self, String> {
        let no_elf = |_| "not an ELF file of a 32-bit chip: give the .elf, not a .bin or .hex made of it".to_owned();
        let object = ElfFile32::<Endianness>::parse(&elf[..]).map_err(no_elf)?;
        let memory = board.spec().memory;
        let is_loaded = |flags| matches!(flags, SectionFlags::Elf { sh_flags } if sh_flags & u64::from(SHF_ALLOC) != 0);
        for section in object.sections().filter(|section| is_loaded(section.flags()) && section.size() > 0) {
            if !memory.holds(section.address(), section.size()) {
                let (name, at) = (section.name().unwrap_or("a section"), section.address());
                return Err(format!("no image for {}: {name} at {at:#x} is outside of its memories", board.name()));
            }
        }
        let has = |app: &str| object.symbols().any(|symbol| symbol.name().is_ok_and(|name| name.contains(app)));
        // A scanner is made of parts of a tag, and an anchor of none that others do not have.
        let apps = [("scanner", SCANNER), ("beacon", BEACON), ("tag", TAG)];
        let found = apps.into_iter().find(|(_, app)| has(app)).map(|(role, _)| role);
        let is_right = match &node.record.role {
            Role::Tag(_) => matches!(found, None | Some("tag")),
            Role::Anchor { .. } => found.is_none(),
            Role::Advertiser(_) => matches!(found, None | Some("beacon")),
            Role::Scanner => found == Some("scanner"),
        };
        if !is_right {
            let (role, has) = (found.unwrap_or("node"), "and the node has another role");
            return Err(format!("an image for a {role}, {has}"));
        }
        if node.wifi.is_some() && !has(GATEWAY) {
            return Err("an image without Wi-Fi, and the node has `wifi = true`".to_owned());
        }
        let endian = object.endian();
        let mut segments = Vec::new();
        for header in object.elf_program_headers().iter().filter(|header| header.p_type(endian) == PT_LOAD) {
            let data = header.data(endian, &elf[..]).map_err(|()| "a segment ends after the file: is it cut short?")?;
            if !data.is_empty() {
                // Where the bytes are in flash, from which the start-up code copies variables into RAM.
                segments.push((header.p_paddr(endian), data.to_vec()));
            }
        }
        if segments.is_empty() {
            return Err("it has no code".to_owned());
        }
        Ok(Self { file: file.to_owned(), elf, segments, board })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::provision::{EXAMPLE, Site, example};

    const TAG_SYMBOL: &str = "_ZN12firmware_tag3run17h0E";
    const BEACON_SYMBOL: &str = "_ZN15firmware_beacon3run17h0E";

    /// An executable with one section of code at an address and a symbol.
    fn elf(address: u64, symbol: &str) -> Vec<u8> {
        use object::write::elf::{FileHeader, ProgramHeader, SectionHeader, Sym, Writer};
        let mut bytes = Vec::new();
        let mut writer = Writer::new(Endianness::Little, false, &mut bytes);
        let (code, name) = (writer.add_section_name(b".text"), writer.add_string(symbol.as_bytes()));
        writer.reserve_file_header();
        writer.reserve_program_headers(1);
        let offset = writer.reserve(4, 4);
        let index = writer.reserve_section_index();
        writer.reserve_null_symbol_index();
        writer.reserve_symbol_index(None);
        writer.reserve_symtab_section_index();
        writer.reserve_symtab();
        writer.reserve_strtab_section_index();
        writer.reserve_strtab();
        writer.reserve_shstrtab_section_index();
        writer.reserve_shstrtab();
        writer.reserve_section_headers();
        let (os_abi, abi_version, e_type, e_machine) = (0, 0, object::elf::ET_EXEC, object::elf::EM_ARM);
        let header = FileHeader { os_abi, abi_version, e_type, e_machine, e_entry: address, e_flags: 0 };
        writer.write_file_header(&header).expect("a header");
        writer.write_align_program_headers();
        let (p_offset, p_vaddr, p_paddr) = (offset as u64, address, address);
        writer.write_program_header(&ProgramHeader {
            p_type: PT_LOAD,
            p_flags: 5,
            p_offset,
            p_vaddr,
            p_paddr,
            p_filesz: 4,
            p_memsz: 4,
            p_align: 4,
        });
        writer.pad_until(offset);
        writer.write(&[1, 2, 3, 4]);
        writer.write_null_symbol();
        let (section, st_shndx) = (Some(index), 0);
        let (st_info, st_other, st_value, st_size) = (0, 0, address, 4);
        writer.write_symbol(&Sym { name: Some(name), section, st_info, st_other, st_shndx, st_value, st_size });
        writer.write_strtab();
        writer.write_shstrtab();
        writer.write_null_section_header();
        writer.write_section_header(&SectionHeader {
            name: Some(code),
            sh_type: object::elf::SHT_PROGBITS,
            sh_flags: u64::from(SHF_ALLOC),
            sh_addr: address,
            sh_offset: offset as u64,
            sh_size: 4,
            sh_link: 0,
            sh_info: 0,
            sh_addralign: 4,
            sh_entsize: 0,
        });
        writer.write_symtab_section_header(1);
        writer.write_strtab_section_header();
        writer.write_shstrtab_section_header();
        bytes
    }

    fn nodes(text: &str) -> Vec<Node> {
        Site::parse("site.toml".as_ref(), text).expect("a site").nodes
    }

    /// The first anchor, the tag and the beacon of the example.
    fn of_the_example() -> [Node; 3] {
        let nodes = nodes(EXAMPLE);
        [0, 4, 5].map(|index: usize| nodes[index].clone())
    }

    fn with_wifi(role: &str) -> Node {
        let text =
            "[network]\npan = 1\nregion = \"eu\"\n[wifi]\nssid = \"a\"\nstation = \"b:1\"\n[[node]]\nwifi = true\n";
        nodes(&format!("{text}role = \"{role}\"\n")).remove(0)
    }

    #[test]
    fn an_image_is_refused_for_another_board_or_role() {
        let [anchor, tag, beacon] = of_the_example();
        // The DWM1001's flash begins at 0, the EVK1000's at 0x0800_0000, the ESP32-C3's code at 0x4200_0000.
        let by_wifi = with_wifi("anchor");
        let cases = [
            (0x4200_0100, "_ZN16firmware_gateway3run17h0E", Board::Esp32C3, &by_wifi, None),
            (
                0x4200_0100,
                "main",
                Board::Esp32C3,
                &by_wifi,
                Some("an image without Wi-Fi, and the node has `wifi = true`"),
            ),
            (0x100, TAG_SYMBOL, Board::Dwm1001, &tag, None),
            (0x100, "main", Board::Dwm1001, &anchor, None),
            (0x0800_0100, "main", Board::Evk1000, &anchor, None),
            (0x4200_0100, BEACON_SYMBOL, Board::Esp32C3, &beacon, None),
            (
                0x0800_0100,
                "main",
                Board::Dwm1001,
                &anchor,
                Some("no image for dwm1001: .text at 0x8000100 is outside of its memories"),
            ),
            (0x100, TAG_SYMBOL, Board::Dwm1001, &anchor, Some("an image for a tag, and the node has another role")),
            (
                0x4200_0100,
                BEACON_SYMBOL,
                Board::Esp32C3,
                &tag,
                Some("an image for a beacon, and the node has another role"),
            ),
        ];
        for (address, symbol, board, node, refused) in cases {
            let parsed = Firmware::parse("image.elf".as_ref(), elf(address, symbol), board, node);
            let expected =
                refused.map_or_else(|| Ok(vec![(address as u32, vec![1, 2, 3, 4])]), |what| Err(what.into()));
            assert_eq!(parsed.map(|firmware| firmware.segments), expected, "{symbol} at {address:#x}");
        }
        let text = Firmware::parse("image.hex".as_ref(), b":020000040000FA".to_vec(), Board::Dwm1001, &tag);
        assert!(text.expect_err("no ELF").starts_with("not an ELF file"));
    }

    #[test]
    fn a_tag_that_scans_gets_an_image_with_bluetooth() {
        let [anchor, tag, beacon] = of_the_example();
        assert_eq!(Firmware::names(Board::Evk1000, &anchor), ["anchor-evk1000.elf"]);
        assert_eq!(Firmware::names(Board::Esp32C6, &beacon), ["beacon-esp32c6.elf"]);
        assert_eq!(Firmware::names(Board::Dwm1001, &tag), ["tag-dwm1001-ble.elf"]);
        let silent = nodes(&example(Some(5))).pop().expect("the tag");
        assert_eq!(Firmware::names(Board::Dwm1001, &silent), ["tag-dwm1001.elf", "tag-dwm1001-ble.elf"]);
        assert_eq!(Firmware::names(Board::Esp32C3, &with_wifi("tag")), ["tag-esp32c3-wifi.elf"]);
        assert_eq!(Firmware::names(Board::Esp32C6, &with_wifi("anchor")), ["anchor-esp32c6-wifi.elf"]);
    }
}
