//! The files of a recording: their names, and where the stream of a folder is.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use wire::telemetry::{Address, Message};

use recording::folder::SETTINGS;

/// The received bytes.
pub const STREAM: &str = "telemetry.bin";
/// When the host received each frame of [`STREAM`].
pub const TIMES: &str = "telemetry.times.csv";
/// The positions of the anchors.
pub const ANCHORS: &str = "anchors.csv";

/// The true positions of a simulation.
pub const TRUTH: &str = "truth.csv";

/// Whether a file is a table of a recording, which can be made again from the received bytes.
pub fn is_table(name: &str) -> bool {
    let table = name.strip_suffix(".csv");
    name == ANCHORS || table.is_some_and(|name| Message::tables().any(|table| table.name == name))
}

/// The node of a simulation whose received bytes are in a file of this name, where it is not [`STREAM`].
fn other_node(name: &str) -> Option<Address> {
    name.strip_prefix("telemetry-")?.strip_suffix(".bin")?.parse().ok()
}

/// The received bytes of the other nodes in the folder of a simulation, by their addresses.
pub fn other_nodes(folder: &Path) -> BTreeMap<u16, PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.filter_map(|entry| Some((other_node(entry.file_name().to_str()?)?.0, entry.path()))).collect()
}

/// Whether `record`, `simulate` or `example` write a file of this name.
pub fn is_of_recording(name: &str) -> bool {
    is_table(name) || other_node(name).is_some() || [STREAM, TIMES, TRUTH, SETTINGS, "beacons.csv"].contains(&name)
}

/// The name of a part of a rotated recording: `000001`.
pub fn part_name(number: u32) -> String {
    format!("{number:06}")
}

/// The parts of a rotated recording, by their numbers.
pub fn parts(folder: &Path) -> Vec<(u32, PathBuf)> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut parts: Vec<_> = entries
        .filter_map(|entry| {
            let number = entry.file_name().to_str()?.parse().ok()?;
            let is_part = entry.file_name() == *part_name(number) && entry.path().is_dir();
            is_part.then(|| (number, entry.path()))
        })
        .collect();
    parts.sort();
    parts
}

/// The folders of a recording in their order: the parts of a rotated one, else the folder itself.
pub fn folders(folder: &Path) -> Vec<PathBuf> {
    // A part may have been cut short before its first byte.
    let parts: Vec<_> =
        parts(folder).into_iter().map(|(_, part)| part).filter(|part| part.join(STREAM).exists()).collect();
    if parts.is_empty() || folder.join(STREAM).exists() { vec![folder.to_owned()] } else { parts }
}
