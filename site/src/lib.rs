//! A site: the nodes of a network, the beacons and receivers around them, and what a simulation adds, in one TOML file.
//!
//! A text becomes a [`SiteFile`], and with the calibrated beacons that it names a [`Site`]: nodes with the config
//! records that `baliza provision` writes, receivers, and the table `[simulation]`. Errors have a line and say what to
//! write. `docs/use/site.md` has the keys of nodes, `docs/use/scenarios.md` those of simulations.
#![forbid(unsafe_code)]

mod document;
mod file;
mod lists;
mod moved;
mod network;
mod node;
mod receivers;
mod role_keys;
mod simulation;
mod values;
mod wifi;

pub use document::{KeyLines, SiteError};
pub use file::{Purpose, Site, SiteFile};
pub use lists::{Calibrated, Lists};
pub use network::{HIDDEN, LISTENING, SIMULATED_NETWORK, mode_name};
pub use node::{BLINK, Node, NodeFiles, SIMULATED_UUID};
pub use receivers::Receiver;
pub use simulation::{
    AirModel, Attacker, Bluetooth, Carrier, Fault, FaultKind, Fidelity, Format, Material, NodeSimulation, Sensor,
    SimulatedBoard, Simulation, Wall,
};

/// An example file to start from: four anchors, a tag and a beacon, with comments.
pub const EXAMPLE: &str = include_str!("example.toml");

/// The example for this number of boards: a tag and anchors, of which three need the tag's height. `None`: the whole.
pub fn example(boards: Option<u8>) -> String {
    let Some(boards) = boards else { return EXAMPLE.to_owned() };
    let (anchors, without) =
        if boards < 5 { ("three", "name = \"anchor-4\"") } else { ("four", "name = \"beacon-1\"") };
    let is_left_out = |part: &&str| part.contains("name = \"beacon-1\"") || part.contains(without);
    let parts: Vec<&str> = EXAMPLE.trim_end().split("\n\n").filter(|part| !is_left_out(part)).collect();
    let text = parts.join("\n\n").replace(
        "# A site: four anchors in the corners of a room, a tag, a beacon.",
        &format!("# A site: {anchors} anchors in the corners of a room, a tag."),
    );
    let text = if boards < 5 { text.replace("# height_m = 1.2 ", "height_m = 1.2   ") } else { text };
    text.lines().filter(|line| !line.starts_with("scan_")).flat_map(|line| [line, "\n"]).collect()
}

/// The key of the copy of a site's names and positions that a recording has. A site's file has no such key.
const COPY: &str = "known";

/// Whether a text is the copy of a site's names and positions, not the site's file.
pub fn is_copy(text: &str) -> bool {
    document::Document { text }.lines().1.contains_key(COPY)
}

/// A TOML text as a type, with the errors of a site.
///
/// # Errors
/// The text is not TOML, or not of the type.
pub fn read_toml<T: serde::de::DeserializeOwned>(text: &str) -> Result<T, SiteError> {
    document::Document { text }.read()
}
