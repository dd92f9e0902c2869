//! `[[receiver]]`: fixed Bluetooth receivers at known places. Only the station uses them; no node's record has them.

use std::collections::HashMap;

use serde::{Deserialize, Deserializer};
use wire::telemetry::Address;

use crate::document::{KeyLines, SiteError};
use crate::values::Exactly;

/// The greatest coordinate, metres: the station's.
const FARTHEST_M: f64 = 1e6;
/// The longest name, bytes: the station's.
const LONGEST_NAME: usize = 64;

/// `[[receiver]]`.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Receiver {
    /// The name under which it posts what it receives.
    pub name: String,
    /// Its position, metres.
    #[serde(deserialize_with = "numbers")]
    pub position_m: [f64; 3],
    /// The RSSI of a usual device one metre from it, dBm.
    pub rssi_1m_dbm: Option<f64>,
    /// The path loss exponent of what it receives, 2 in free space.
    pub path_loss_exponent: Option<f64>,
}

fn numbers<'de, D: Deserializer<'de>>(from: D) -> Result<[f64; 3], D::Error> {
    Exactly::deserialize(from).map(|Exactly(numbers)| numbers)
}

/// Checks the receivers, whose lines are `lines`.
///
/// # Errors
/// The first line that is wrong.
pub(crate) fn check(receivers: &[Receiver], lines: &[KeyLines]) -> Result<(), SiteError> {
    let mut before = HashMap::new();
    for (receiver, lines) in receivers.iter().zip(lines) {
        let name = &receiver.name;
        receiver.check().map_err(|(key, what)| SiteError::at(lines.of(key), format!("{key} is {what}")))?;
        if let Some(line) = before.insert(name, lines.line) {
            let what = format!("the name {name} is the same as the receiver's in line {line}");
            return Err(SiteError::at(lines.of("name"), what));
        }
    }
    Ok(())
}

impl Receiver {
    /// The error is a key, and what is wrong with its value.
    fn check(&self) -> Result<(), (&'static str, String)> {
        let Self { name, position_m, rssi_1m_dbm, path_loss_exponent } = self;
        if !(1..=LONGEST_NAME).contains(&name.len()) || name.chars().any(char::is_control) {
            let must = format!("it must be 1 to {LONGEST_NAME} bytes without control characters");
            return Err(("name", format!("{name:?}: {must}")));
        }
        if is_other_node(name) {
            return Err(("name", format!("{name:?}: it must not be that of an anchor, a tag or a beacon")));
        }
        if let Some(metres) = position_m.iter().find(|metres| !(metres.abs() <= FARTHEST_M)) {
            return Err(("position_m", format!("{metres}: it must be finite and within 1000 km of the origin")));
        }
        check_path_loss([*rssi_1m_dbm, *path_loss_exponent])
    }
}

/// Checks RSSI at one metre, dBm, and path-loss exponent. The error is a key, and what is wrong with its value.
pub(crate) fn check_path_loss(
    [rssi_1m_dbm, path_loss_exponent]: [Option<f64>; 2],
) -> Result<(), (&'static str, String)> {
    if let Some(dbm) = rssi_1m_dbm.filter(|dbm| !(-127.0..=-1.0).contains(dbm)) {
        return Err(("rssi_1m_dbm", format!("{dbm}: it must be -127 to -1")));
    }
    if let Some(exponent) = path_loss_exponent.filter(|exponent| !(0.1..=20.0).contains(exponent)) {
        return Err(("path_loss_exponent", format!("{exponent}: it must be 0.1 to 20")));
    }
    Ok(())
}

/// Whether the station calls an anchor, a tag (`0x0101`) or a beacon (`1-7`) so.
fn is_other_node(name: &str) -> bool {
    let is_address = name.parse().is_ok_and(|address: Address| address.to_string() == name);
    let numbers = name.split_once('-').map(|(major, minor)| [major, minor].map(str::parse::<u16>));
    is_address || matches!(numbers, Some([Ok(_), Ok(_)]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Purpose, Site};

    fn parse(text: &str) -> Result<Site, SiteError> {
        Site::parse(text, Purpose::Nodes)
    }

    const KITCHEN: &str = "[[receiver]]\nname = \"kitchen\"\nposition_m = [5.5, 2, 2.1]\n";
    const NODE: &str = "[network]\npan = 1\nregion = \"none\"\n[[node]]\nboard = \"dwm1001\"\nrole = \"tag\"\n\
                        address = 0x0201\n";

    #[test]
    fn receivers_need_no_network_and_have_two_optional_keys() {
        let more = "[[receiver]]\nname = \"living room\"\nposition_m = [-1e6, 1e6, 0]\nrssi_1m_dbm = -61\n\
                    path_loss_exponent = 2.2\n";
        for before in ["", NODE] {
            let site = parse(&format!("{before}{KITCHEN}{more}")).expect("it is right");
            assert_eq!(site.nodes.is_empty(), before.is_empty());
            let receiver = |name: &str, position_m, rssi_1m_dbm, path_loss_exponent| Receiver {
                name: name.to_owned(),
                position_m,
                rssi_1m_dbm,
                path_loss_exponent,
            };
            assert_eq!(
                site.receivers,
                [
                    receiver("kitchen", [5.5, 2.0, 2.1], None, None),
                    receiver("living room", [-1e6, 1e6, 0.0], Some(-61.0), Some(2.2)),
                ]
            );
        }
    }

    #[test]
    fn a_wrong_receiver_is_refused_with_its_line() {
        let long = format!("\"{}\"", "k".repeat(65));
        let (second, must) = (KITCHEN.to_owned() + KITCHEN, "it must not be that of an anchor, a tag or a beacon");
        let cases = [
            (
                "\"kitchen\"",
                "\"\"",
                "line 2: name is \"\": it must be 1 to 64 bytes without control characters".to_owned(),
            ),
            ("\"kitchen\"", &long, format!("line 2: name is {long}: it must be 1 to 64 bytes")),
            ("\"kitchen\"", "\"a\\tb\"", "line 2: name is \"a\\tb\": it must be 1 to 64 bytes".to_owned()),
            ("\"kitchen\"", "\"0x0101\"", format!("line 2: name is \"0x0101\": {must}")),
            ("\"kitchen\"", "\"1-7\"", format!("line 2: name is \"1-7\": {must}")),
            ("\"kitchen\"", "7", "line 2: name is 7: it must be text in quotation marks".to_owned()),
            ("name = \"kitchen\"\n", "", "line 1: name is missing".to_owned()),
            ("5.5", "nan", "line 3: position_m is NaN: it must be finite and within 1000 km of the origin".to_owned()),
            ("5.5", "-inf", "line 3: position_m is -inf: it must be finite".to_owned()),
            ("5.5", "1000001", "line 3: position_m is 1000001: it must be finite and within 1000 km".to_owned()),
            (
                "[5.5, 2, 2.1]",
                "[5.5, 2]",
                "line 3: position_m is [5.5, 2]: it must be three numbers, [x, y, z]".to_owned(),
            ),
            ("2.1]", "2.1]\nrssi_1m_dbm = 61", "line 4: rssi_1m_dbm is 61: it must be -127 to -1".to_owned()),
            (
                "2.1]",
                "2.1]\npath_loss_exponent = 0",
                "line 4: path_loss_exponent is 0: it must be 0.1 to 20".to_owned(),
            ),
            ("2.1]", "2.1]\nheight_m = 2", "line 4: unknown key height_m".to_owned()),
            (KITCHEN, &second, "line 5: the name kitchen is the same as the receiver's in line 1".to_owned()),
            (KITCHEN, "", "there is no [[node]]; only [[receiver]] and [geographic_origin] can be alone".to_owned()),
            (KITCHEN, &NODE[NODE.find("[[node]]").expect("a node")..], "line 1: network is missing".to_owned()),
            (
                "[[receiver]]",
                "[network]\npan = 1\nrounds_hz = 5\n[[receiver]]",
                "line 3: rounds_hz is for mode".to_owned(),
            ),
        ];
        for (right, wrong, said) in cases {
            let error = parse(&KITCHEN.replacen(right, wrong, 1)).expect_err(&said).to_string();
            assert!(error.starts_with(&said), "{said}\n{error}");
        }
        let anchor = "[[anchor]]\naddress = 1\nposition_m = [0, 0, 0]\n";
        let error = parse(&format!("{KITCHEN}{anchor}")).expect_err("an anchor is for nodes").to_string();
        assert!(error.starts_with("there is no [[node]]"), "{error}");
    }

    #[test]
    fn names_with_digits_are_those_of_receivers() {
        for name in ["12", "1-hall", "hall-1", "1-2-3", "0xhall", "1-70000"] {
            parse(&KITCHEN.replace("kitchen", name)).expect(name);
        }
    }

    #[test]
    fn a_scanner_is_a_node_with_the_keys_of_a_receiver() {
        let scanner = "[network]\npan = 1\nregion = \"none\"\n[[node]]\nname = \"kitchen\"\nrole = \"scanner\"\n\
                       board = \"esp32c3\"\naddress = 0x3001\nposition_m = [1, 2, 2.5]\nrssi_1m_dbm = -61\n";
        let node = parse(scanner).expect("a site").nodes.remove(0);
        assert_eq!(node.record.role, wire::config::Role::Scanner);
        let of_station = (node.position_m, node.rssi_1m_dbm, node.path_loss_exponent);
        assert_eq!(of_station, (Some([1.0, 2.0, 2.5]), Some(-61.0), None));
        for (from, to, said) in [
            (
                "esp32c3",
                "dwm1001",
                "line 6: role is scanner: it must be on an ESP32: no other board has an image of a scanner",
            ),
            ("-61", "61", "line 10: rssi_1m_dbm is 61: it must be -127 to -1"),
            (
                "rssi_1m_dbm = -61",
                "rate_hz = 1",
                "line 10: rate_hz is a key of a node whose role is tag, this one's is scanner",
            ),
            (
                "\"scanner\"",
                "\"anchor\"",
                "line 10: rssi_1m_dbm is a key of a node whose role is scanner, this one's is anchor",
            ),
        ] {
            assert_eq!(parse(&scanner.replacen(from, to, 1)).expect_err(said).to_string(), said);
        }
    }
}
