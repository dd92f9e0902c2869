//! Keys of older files, and what to write instead.

use toml::de::DeTable;

use crate::document::{Document, SiteError, tables_of};

/// Keys of a table of older files, with their new names where these differ (`old new`), and where the new keys stand.
/// The outermost table has no name; a table within a table has dots.
struct Moved(&'static str, &'static [&'static str], &'static str);

const THERE: &str = "there";
const TAG: &str = "in the [[node]] of each tag";
const ANCHOR: &str = "in a [[node]] with role = \"anchor\"";
const BEACON: &str = "in a [[node]] with role = \"beacon\"";
const SIMULATION: &str = "in the table simulation of the [[node]]";
const LISTED: &str = "in a [[beacon]] with the same major and minor";

const SIMULATION_KEYS: [&str; 11] = [
    "seconds",
    "seed",
    "loss",
    "fidelity",
    "level fidelity",
    "air",
    "clock_ppm",
    "method",
    "weigh_nlos",
    "board",
    "cpu_slowdown",
];
const TAG_KEYS: [&str; 6] = ["height_m", "rate_hz", "still_rate_hz", "sleep", "scheme", "anchors_per_round"];
const BEACON_KEYS: [&str; 5] = ["at position_m", "address", "measured_power_dbm", "interval_ms", "channels"];
const LISTED_KEYS: [&str; 3] =
    ["listed_at position_m", "listed_rssi_1m_dbm rssi_1m_dbm", "listed_path_loss_exponent path_loss_exponent"];
const BLUETOOTH_KEYS: [&str; 4] = ["scan_interval_ms", "scan_window_ms", "map fingerprint_map", "rooms room_model"];

const MOVED: &[Moved] = &[
    Moved("", &SIMULATION_KEYS, "in [simulation]"),
    Moved("", &TAG_KEYS, TAG),
    Moved("", &["tag [[node]]"], "with role = \"tag\", and its path in its table simulation, with path_m for path"),
    Moved("", &["wall [[simulation.wall]]"], "with from_m and to_m"),
    Moved("", &["fault [[simulation.fault]]"], "with the same keys"),
    Moved(
        "",
        &["bluetooth [simulation.bluetooth]"],
        "with the same keys, but scans, map and rooms in each tag's [[node]]",
    ),
    Moved("network", &["preamble preamble_symbols", "code preamble_code"], THERE),
    Moved("simulation.network", &["preamble preamble_symbols", "code preamble_code"], THERE),
    Moved("simulation.wall", &["from from_m", "to to_m"], THERE),
    Moved("simulation.bluetooth", &BLUETOOTH_KEYS, TAG),
    Moved("anchor", &["at position_m", "board"], ANCHOR),
    Moved("anchor", &["network", "cpu_slowdown", "antenna_delay_ticks true_antenna_delay_ticks"], SIMULATION),
    Moved("beacon", &BEACON_KEYS, BEACON),
    Moved("beacon", &["format", "listed"], SIMULATION),
    Moved("beacon", &LISTED_KEYS, LISTED),
    Moved("node", &["at position_m"], THERE),
    Moved("node", &["path path_m"], "in its table simulation"),
    Moved("node.simulation", &["path path_m"], THERE),
];

/// An old key and the new one.
fn names(key: &'static str) -> (&'static str, &'static str) {
    key.split_once(' ').unwrap_or((key, key))
}

/// Refuses the first key of an older file.
///
/// # Errors
/// The line of the key, and what to write instead.
pub(crate) fn refuse_old_keys(document: Document<'_>) -> Result<(), SiteError> {
    // The type's parser explains what is no TOML.
    let Ok(root) = DeTable::parse(document.text) else { return Ok(()) };
    let mut found: Vec<(usize, String)> = Vec::new();
    for Moved(table, keys, now) in MOVED {
        for inner in tables(root.get_ref(), table) {
            for (key, _) in inner {
                let old = key.get_ref().as_ref();
                if let Some((_, new)) = keys.iter().map(|key| names(key)).find(|(name, _)| *name == old) {
                    found.push((key.span().start, format!("{old} is a key of older files: write {new} {now}")));
                }
            }
        }
    }
    if let Some(network) = root.get_ref().iter().find(|(key, _)| key.get_ref() == "network")
        && let Some(list) = network.1.get_ref().as_array()
    {
        let what = "there is one [network]: write [network], and [[simulation.network]] for its neighbours";
        found.extend(list.first().map(|first| (first.span().start, what.to_owned())));
    }
    let first = found.into_iter().min_by_key(|(start, _)| *start);
    first.map_or(Ok(()), |(start, what)| Err(SiteError::at(document.line(start), what)))
}

/// The tables with a name, which has dots for tables within tables.
fn tables<'r, 'i>(root: &'r DeTable<'i>, name: &str) -> Vec<&'r DeTable<'i>> {
    name.split('.').filter(|part| !part.is_empty()).fold(vec![root], |tables, part| {
        let inner = tables.into_iter().flat_map(|table| table.iter().find(|(key, _)| key.get_ref() == part));
        inner.flat_map(|(_, value)| tables_of(value).into_iter().map(|(_, table)| table)).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Purpose, Site};

    #[test]
    fn each_old_key_is_refused_with_its_line_and_the_new_one() {
        for Moved(table, keys, now) in MOVED {
            for (old, new) in keys.iter().map(|key| names(key)) {
                let header = match *table {
                    "" => String::new(),
                    name @ ("network" | "simulation.bluetooth") => format!("[{name}]\n"),
                    "node.simulation" => "[[node]]\nrole = \"tag\"\n[node.simulation]\n".to_owned(),
                    name => format!("[[{name}]]\n"),
                };
                let entry = if matches!(old, "tag" | "wall" | "fault") {
                    format!("[[{old}]]\n")
                } else if old == "bluetooth" {
                    format!("[{old}]\n")
                } else {
                    format!("{old} = 1\n")
                };
                let text = format!("# A comment.\n{header}{entry}");
                let error = Site::parse(&text, Purpose::Simulation).expect_err(&text);
                let line = text.lines().position(|line| line.trim_matches(['[', ']']).starts_with(old));
                assert_eq!(error.line, line.map(|line| line as u64 + 1), "{text}{error}");
                let message = format!("{old} is a key of older files: write {new} {now}");
                assert_eq!(error.message, message, "{text}");
            }
        }
    }

    #[test]
    fn the_first_of_several_old_keys_is_named() {
        let text = "[[anchor]]\nat = [0, 0, 2]\n[[tag]]\npath = [[1, 2, 1]]\n";
        let error = Site::parse(text, Purpose::Simulation).expect_err("it is old");
        assert_eq!(error.line, Some(2));
        let error = Site::parse("\n[[network]]\npreamble = 64\n", Purpose::Nodes).expect_err("it is old");
        assert!(error.line == Some(2) && error.message.contains("[[simulation.network]]"), "{error}");
    }
}
