//! A small image for tests: an ELF file with a log's symbols, written by the `object` crate, and the frames of its
//! node, written byte by byte.

use object::write::{Object, Symbol, SymbolSection};
use object::{Architecture, BinaryFormat, Endianness, SectionKind, SymbolFlags, SymbolKind, SymbolScope};

pub const BUILD: [u8; 8] = [0x1A, 0x2B, 0x3C, 0x4D, 0x5E, 0x6F, 0x70, 0x81];
pub const OTHER_BUILD: [u8; 8] = [0x3C, 0x4D, 0, 0, 0, 0, 0, 1];

/// The log's statements: number, level, format.
pub const STATEMENTS: [(u16, &str, &str); 9] = [
    (1, "defmt_info", "hello {=u8}"),
    (2, "defmt_warn", "{=str} is {=bool}"),
    (3, "defmt_error", "values {=[?]}"),
    (4, "defmt_info", "{=?}"),
    // Interned strings: the formats of values.
    (5, "defmt_prim", "{=u16}"),
    (6, "defmt_derived", "Some({=?})|None"),
    (7, "defmt_derived", "{=?}"),
    (8, "defmt_info", "flags {0=0..4} {0=9..12}"),
    (9, "defmt_debug", "fix x={=u8}"),
];

/// An ELF file with the statements, the time stamp of this project's images and a build.
pub fn elf(build: Option<[u8; 8]>) -> Vec<u8> {
    elf_with(build, &STATEMENTS, "rzcobs")
}

pub fn elf_with(build: Option<[u8; 8]>, statements: &[(u16, &str, &str)], encoding: &str) -> Vec<u8> {
    let mut elf = Object::new(BinaryFormat::Elf, Architecture::Arm, Endianness::Little);
    if let Some(build) = build {
        let section = elf.add_section(Vec::new(), b".baliza.build".to_vec(), SectionKind::Other);
        elf.set_section_data(section, build.to_vec(), 1);
    }
    let section = elf.add_section(Vec::new(), b".defmt".to_vec(), SectionKind::Other);
    elf.set_section_data(section, vec![0; 64], 1);
    let symbol = |name: String, value: u64, section| Symbol {
        name: name.into_bytes(),
        value,
        size: 1,
        kind: SymbolKind::Data,
        scope: SymbolScope::Linkage,
        weak: false,
        section,
        flags: SymbolFlags::None,
    };
    let timestamp = [(40, "defmt_timestamp", "{=u64:us}")];
    for (index, (number, tag, data)) in statements.iter().chain(&timestamp).enumerate() {
        let name =
            format!(r#"{{"package":"p","tag":"{tag}","data":"{data}","disambiguator":"{index}","crate_name":"c"}}"#);
        elf.add_symbol(symbol(name, (*number).into(), SymbolSection::Section(section)));
    }
    for name in ["_defmt_version_ = 4".to_owned(), format!("_defmt_encoding_ = {encoding}")] {
        elf.add_symbol(symbol(name, 0, SymbolSection::Absolute));
    }
    elf.add_symbol(symbol("_SEGGER_RTT".into(), 0x2000_0100, SymbolSection::Absolute));
    elf.write().expect("an ELF file")
}

/// A frame of the log, with its zero: the statement's number, the time and the arguments, little-endian, encoded by
/// rzCOBS.
pub fn frame(statement: u16, t_us: u64, arguments: &[u8]) -> Vec<u8> {
    let plain = [&statement.to_le_bytes(), &t_us.to_le_bytes()[..], arguments].concat();
    let mut frame = rzcobs::encode(&plain);
    frame.push(0);
    frame
}

/// The bytes of a telemetry frame.
pub fn telemetry_frame(message: &wire::telemetry::Message) -> Vec<u8> {
    wire::telemetry::encode(message, &mut [0; wire::telemetry::MAX_FRAME]).to_vec()
}

pub fn hello(t_us: u64, build: [u8; 8]) -> wire::telemetry::Message {
    wire::telemetry::Message::Hello(wire::telemetry::Hello {
        t_us,
        eui: 0xDECA_0000_0000_1234,
        address: 0x1234,
        role: wire::telemetry::Role::Tag,
        board: wire::telemetry::Board::Dwm1001,
        build,
        keyed: false,
    })
}

/// A position at (x, 4.05, 1.5) m: deviations of 3, 4 and 0 cm are 5 cm together; ten ranges, six used.
pub fn fix(t_us: u64, x_m: f64) -> wire::telemetry::Message {
    wire::telemetry::Message::Fix(wire::telemetry::Fix {
        t_us,
        round: 7,
        age_us: 12_400,
        asked: 10,
        outcome: wire::telemetry::Outcome::Position {
            position_tenth_mm: [(x_m * 1e4).round() as i32, 40_500, 15_000],
            deviation_tenth_mm: [300, 400, 0],
            correlation_127ths: [0; 3],
            used: 0b11_0111_1000,
            quality_255ths: 200,
        },
        solver: wire::telemetry::Solver::BWls,
        doubt: wire::telemetry::Doubt::None,
    })
}
