//! Telemetry and log of a node, and the image that explains the log.

use std::path::PathBuf;
use std::sync::OnceLock;
use std::time::Duration;

use node_link::decode::{Stream, row};
use node_link::monitor::{Demux, Event, Image, Item, Lines, NodeChannel, Session, json, summary};
use node_link::provision::SiteNames;
use object::write::{Object, Symbol, SymbolSection};
use object::{Architecture, BinaryFormat, Endianness, SectionKind, SymbolFlags, SymbolKind, SymbolScope};

use super::folder;
use crate::nodes;

/// The first byte decides whether the rest is a stream, or bodies of frames.
pub fn decoded(input: &[u8]) {
    let Some((mode, rest)) = input.split_first() else { return };
    let mut stream = Stream::default();
    for byte in if mode & 1 == 0 { rest.to_vec() } else { nodes::framed(rest) } {
        let Some((stamp, message)) = stream.feed(byte) else { continue };
        assert!(stamp.t_s.is_finite());
        if let Some((table, fields)) = row(stamp, &message) {
            assert_eq!(fields.len(), table.header().len());
            assert!(fields.iter().all(|field| !field.contains("NaN") && field != "inf"), "{fields:?}");
        }
    }
    let _ = stream.summary().text(&SiteNames::default());
}

pub fn stream_seeds() -> Vec<Vec<u8>> {
    // A log line of the image below, written by hand: statement 1, 1,500,000 µs, argument 42.
    let line = [0x01, 0x60, 0xE3, 0x16, 0x62, 0x2A, 0x77, 0x00];
    nodes::stream_seeds().into_iter().chain([[&[0, 0xFF, 0][..], &line].concat()]).collect()
}

/// The first byte decides whether the rest is a mixture as from a serial port or frames of the log, and how the session
/// began.
pub fn monitored(input: &[u8]) {
    static IMAGE: OnceLock<PathBuf> = OnceLock::new();
    let Some((mode, rest)) = input.split_first() else { return };
    let image = Image::read(IMAGE.get_or_init(|| folder::file("image.elf", &image()))).expect("an image");
    let framed = |frame: &[u8]| [&[0xFF, 0][..], &rzcobs::encode(frame), &[0]].concat();
    let mixture = match mode & 1 {
        0 => rest.to_vec(),
        _ => rest.split(|byte| *byte == 0xA5).flat_map(framed).collect(),
    };
    let mut session = Session::new(Some(image), None, mode & 2 != 0);
    let mut events = vec![Event::Connected("a port".to_owned())];
    if mode & 4 == 0 {
        events.push(Event::Flashed { same: true });
    }
    let mut demux = Demux::default();
    mixture.chunks(64).for_each(|chunk| events.extend(demux.feed(chunk)));
    events.extend(demux.finish());
    events.push(Event::End);
    let mut lines = Lines::new(true, true);
    let mut now = Duration::ZERO;
    for event in events {
        now += Duration::from_millis(7);
        session.accept(now, event).expect("nothing is recorded");
        while let Some(item) = session.next(now) {
            show(&mut lines, &item);
        }
    }
    let _ = summary(&session.counts(), now);
}

fn show(lines: &mut Lines, item: &Item) {
    let Item::Node(output) = item else { return };
    let _ = lines.line(output);
    let text = json(output, None).expect("JSON");
    assert!(serde_json::from_slice::<serde_json::Value>(&text).is_ok());
}

/// An image, and a line of the log by it.
pub fn elf(input: &[u8]) {
    if let Ok(image) = Image::read(&folder::file("any.elf", input)) {
        let mut session = Session::new(Some(image), None, false);
        let line = stream_seeds().pop().unwrap_or_default();
        for event in [Event::Flashed { same: true }, Event::Bytes(NodeChannel::Log, line), Event::End] {
            session.accept(Duration::ZERO, event).expect("nothing is recorded");
        }
        let mut lines = Lines::new(true, true);
        while let Some(item) = session.next(Duration::ZERO) {
            show(&mut lines, &item);
        }
    }
}

pub fn elf_seeds() -> Vec<Vec<u8>> {
    vec![image()]
}

/// The statements of the image's log: their kinds and formats.
const STATEMENTS: [(&str, &str); 16] = [
    ("info", "hello {=u8}"),
    ("warn", "{=str} is {=bool}"),
    ("error", "values {=[?]}"),
    ("info", "{=?}"),
    ("prim", "{=u16}"),
    ("derived", "Some({=?})|None"),
    ("derived", "{=?}"),
    ("info", "flags {0=0..4} {0=9..12}"),
    ("info", "{=[u8]:x} {=[u8; 4]:a} {=f32} {=i64:us} {=u64:tms}"),
    ("info", "{=istr} {=char}"),
    ("derived", "A {{ x: {=i8}, y: {=[?;3]} }}|B|C({=str})"),
    ("info", "{=u128:#b} {=i128} {=f64}"),
    ("str", "interned"),
    ("info", "{=[?]} {=u32:ts}"),
    ("info", "at {=u64:iso8601ms}"),
    ("info", "{=__internal_Debug} {=__internal_Display} {=__internal_FormatSequence}"),
];

/// An ELF file with these statements.
fn image() -> Vec<u8> {
    let mut elf = Object::new(BinaryFormat::Elf, Architecture::Arm, Endianness::Little);
    let mut section = |name: &[u8], bytes: Vec<u8>| {
        let section = elf.add_section(Vec::new(), name.to_vec(), SectionKind::Other);
        elf.set_section_data(section, bytes, 1);
        section
    };
    section(b".baliza.build", vec![1; 8]);
    let log = section(b".defmt", vec![0; 64]);
    let symbol = |name: String, value: usize, section| Symbol {
        name: name.into_bytes(),
        value: value as u64,
        size: 1,
        kind: SymbolKind::Data,
        scope: SymbolScope::Linkage,
        weak: false,
        section,
        flags: SymbolFlags::None,
    };
    let timestamp = [(40, ("timestamp", "{=u64:us}"))];
    for (number, (kind, format)) in (1..).zip(STATEMENTS).chain(timestamp) {
        let name = format!(
            r#"{{"package":"p","tag":"defmt_{kind}","data":"{format}","disambiguator":"{number}","crate_name":"c"}}"#
        );
        elf.add_symbol(symbol(name, number, SymbolSection::Section(log)));
    }
    for name in ["_defmt_version_ = 4", "_defmt_encoding_ = rzcobs"] {
        elf.add_symbol(symbol(name.to_owned(), 0, SymbolSection::Absolute));
    }
    elf.write().expect("an ELF file")
}
