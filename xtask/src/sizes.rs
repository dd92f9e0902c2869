//! `cargo xtask sizes`: where an image's flash is spent. The input is images. The output is a table of kibibytes by
//! purpose.
//!
//! Code counts for the source in which it was written. Where the compiler has inlined functions, the innermost counts
//! that is not in a general library. Code without a source is that of the makers' Bluetooth controllers.

use baliza_report::MarkdownTable;
use std::path::Path;

use addr2line::Loader;
use anyhow::{Context, Result, anyhow};
use object::read::{Object, ObjectSection};
use object::{File, SectionFlags, elf};

use crate::firmware;

/// Images that users choose between.
const IMAGES: [&str; 2] = ["tag-dwm1001", "tag-dwm1001-ble"];

/// Purposes of code, and the prefixes of the paths of their sources; the first match counts.
const PURPOSES: [(&str, &[&str]); 10] = [
    ("DW1000: driver", &["dw1000/", "radio/"]),
    ("Exchanges: frames, slots, networks, times of flight", &["ranging/", "wire/src/uwb"]),
    ("Line of sight", &["positioning-core/src/nlos", "firmware-tag/src/sounding"]),
    ("Beacons: RSSI, positions by it, rooms, scans", &["positioning-core/src/ble", "wire/src/ble"]),
    (
        "Engine: tracks",
        &[
            "positioning-core/src/engine",
            "positioning-core/src/locator",
            "positioning-core/src/measurement",
            "positioning-core/src/track",
        ],
    ),
    ("Config record and models in flash", &["wire/src/config", "positioning-core/src/stored", "crc-"]),
    ("Solvers", &["positioning-core/"]),
    (
        "Telemetry and log",
        &[
            "wire/src/telemetry",
            "firmware-common/src/event_log",
            "firmware-common/src/lines",
            "firmware-common/src/reporter",
            "cobs-",
            "defmt",
            "rtt-target",
        ],
    ),
    ("Node: tasks, settings, supervision", &["firmware-"]),
    ("Bluetooth: commands and events", &["bt-hci", "nrf-sdc", "nrf-mpsl", "esp-radio", "boards/dwm1001/src/bluetooth"]),
];
const BOARD: &str = "Board: processor, buses, executor";
const ARITHMETIC: &str = "Arithmetic and memory by software";
const WITHOUT_SOURCE: &str = "Without source: Bluetooth controller, boot code";
const CONSTANTS: &str = "Constants: tables, texts, places of panics, initial values";

/// General sources, whose code counts for its callers wherever it was inlined.
const SHARED: [&str; 10] = [
    "rustc/",
    "library/",
    "heapless-",
    "postcard-",
    "serde",
    "positioning-core/src/linalg",
    "positioning-core/src/real",
    "embassy-sync-",
    "embassy-futures-",
    "critical-section-",
];

/// Which images.
#[derive(clap::Args)]
pub struct Arguments {
    /// Images by name, as `cargo xtask firmware` prints them
    #[arg(default_values_t = IMAGES.map(String::from))]
    images: Vec<String>,
}

/// Builds the images, sums their code, and prints the table.
///
/// # Errors
/// An image cannot be built or read.
pub fn run(arguments: &Arguments) -> Result<()> {
    let weighed = arguments.images.iter().map(|name| weigh(&firmware::elf(name)?)).collect::<Result<Vec<_>>>()?;
    println!("\n{}", table(&arguments.images, &weighed));
    Ok(())
}

/// All rows of the table, from top to bottom.
fn rows() -> impl Iterator<Item = &'static str> {
    let named = PURPOSES.iter().map(|(name, _)| *name);
    named.chain([BOARD, ARITHMETIC, WITHOUT_SOURCE, CONSTANTS])
}

/// Bytes of an image, one entry a row.
fn weigh(file: &Path) -> Result<Vec<u64>> {
    let bytes = std::fs::read(file).with_context(|| format!("cannot read {}", file.display()))?;
    let image = File::parse(bytes.as_slice()).with_context(|| format!("{} is no ELF file", file.display()))?;
    let sources = Loader::new(file).map_err(|error| anyhow!("{}: {error}", file.display()))?;
    let mut weights = vec![0; rows().count()];
    let mut add = |row: &str, bytes: u64| {
        if let Some(place) = rows().position(|other| other == row) {
            weights[place] += bytes;
        }
    };
    for section in image.sections() {
        let SectionFlags::Elf { sh_flags } = section.flags() else { continue };
        if sh_flags & u64::from(elf::SHF_ALLOC) == 0 || section.kind().is_bss() {
            continue;
        }
        if sh_flags & u64::from(elf::SHF_EXECINSTR) == 0 {
            add(CONSTANTS, section.size());
            continue;
        }
        // The shortest instruction of either processor has two bytes.
        let end = section.address() + section.size();
        for address in (section.address()..end).step_by(2) {
            add(purpose(&sources, address)?, 2.min(end - address));
        }
    }
    Ok(weights)
}

/// The row of the instruction at an address.
fn purpose(sources: &Loader, address: u64) -> Result<&'static str> {
    let mut frames = sources.find_frames(address).map_err(|error| anyhow!("{address:#x}: {error}"))?;
    let (mut has_source, mut file) = (false, String::new());
    while let Some(frame) = frames.next().map_err(|error| anyhow!("{address:#x}: {error}"))? {
        let Some(path) = frame.location.and_then(|location| location.file) else { continue };
        has_source = true;
        file = path.trim_start_matches('/').to_owned();
        if !SHARED.iter().any(|shared| file.starts_with(shared)) {
            break;
        }
    }
    Ok(if has_source { of_file(&file) } else { WITHOUT_SOURCE })
}

/// The row of a source.
fn of_file(path: &str) -> &'static str {
    let fits = |begins: &&str| path.starts_with(*begins);
    if let Some((name, _)) = PURPOSES.iter().find(|(_, begins)| begins.iter().any(fits)) {
        name
    } else if SHARED.iter().any(fits) || path.starts_with("libm-") || path.contains("compiler-builtins") {
        ARITHMETIC
    } else {
        BOARD
    }
}

fn table(names: &[String], weighed: &[Vec<u64>]) -> String {
    let kib = |bytes: u64| if bytes == 0 { String::new() } else { format!("{:.1}", bytes as f64 / 1024.0) };
    let titles = names.iter().map(|name| format!("{name}:"));
    let mut table = MarkdownTable::new(std::iter::once("KiB of flash".to_owned()).chain(titles));
    let mut line = |row: &str, of: &dyn Fn(&Vec<u64>) -> u64| {
        let cells: Vec<_> = weighed.iter().map(|weights| kib(of(weights))).collect();
        table.row(format_args!("{row} | {}", cells.join(" | ")));
    };
    for (index, row) in rows().enumerate() {
        line(row, &|weights| weights[index]);
    }
    line("all", &|weights| weights.iter().sum());
    table.into_text()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_source_has_the_first_purpose_that_fits() {
        assert_eq!(of_file("dw1000/src/driver/receive.rs"), "DW1000: driver");
        assert_eq!(of_file("ranging/src/native/tag/mod.rs"), "Exchanges: frames, slots, networks, times of flight");
        assert_eq!(of_file("positioning-core/src/ble/posterior.rs"), "Beacons: RSSI, positions by it, rooms, scans");
        assert_eq!(of_file("positioning-core/src/engine/round.rs"), "Engine: tracks");
        assert_eq!(of_file("positioning-core/src/robust.rs"), "Solvers");
        assert_eq!(of_file("embassy-nrf-0.11.0/src/spim.rs"), BOARD);
        assert_eq!(of_file("rustc/0/library/core/src/slice.rs"), ARITHMETIC);
    }

    #[test]
    fn rows_without_bytes_are_empty_and_the_last_is_the_sum() {
        let mut weights = vec![0; rows().count()];
        (weights[0], weights[1]) = (1024, 512);
        let table = table(&["tag".to_owned()], &[weights]);
        assert!(table.starts_with("| KiB of flash | tag |\n|---|---:|\n| DW1000: driver | 1.0 |\n"), "{table}");
        assert!(table.contains("| Solvers |  |\n") && table.ends_with("| all | 1.5 |\n"), "{table}");
    }
}
