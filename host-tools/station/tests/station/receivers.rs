//! `baliza serve` with fixed Bluetooth receivers in the site's file.

use node_link::provision::Site;
use serde_json::{Value, json};

use crate::serve::Station;
use crate::support::{Folder, root};

/// Receivers at the corners of a square of 8 m.
const SITE: &str = r#"
[[receiver]]
name = "south-west"
position_m = [0.0, 0.0, 2.0]

[[receiver]]
name = "south-east"
position_m = [8.0, 0.0, 2.0]

[[receiver]]
name = "north-west"
position_m = [0.0, 8.0, 2.0]

[[receiver]]
name = "north-east"
position_m = [8.0, 8.0, 2.0]
rssi_1m_dbm = -59
"#;

const CORNERS: [&str; 4] = ["south-west", "south-east", "north-west", "north-east"];

/// Posts that all corners receive a device equally well, until it is located. Returns x and y, metres.
fn locate(station: &Station, device: &str) -> [f64; 2] {
    for corner in CORNERS {
        let samples = json!([{"device": device, "rssi_dbm": -75.0, "t_s": 0.0}]);
        let body = json!({"scenario": "site", "samples": samples}).to_string();
        station.send("POST", &format!("/api/v1/receivers/{corner}/sightings"), &body);
    }
    // Two receivers may give a position before all four do, a second later.
    let tags = station.wait("/api/v1/tags", |tags| position(tags, device)["used"] == 4);
    ["x_m", "y_m"].map(|key| position(&tags, device)[key].as_f64().expect("a number"))
}

fn position<'a>(tags: &'a Value, device: &str) -> &'a Value {
    let tag = tags.as_array().and_then(|tags| tags.iter().find(|tag| tag["tag"] == device));
    tag.map_or(&Value::Null, |tag| &tag["last_position"])
}

/// Waits until the station has a receiver at a place, metres.
fn wait_for(station: &Station, receiver: &str, position_m: [f64; 3]) {
    let is_it = |node: &Value| {
        node["node"] == receiver && node["role"] == "receiver" && node["position_m"] == json!(position_m)
    };
    station.wait("/api/v1/nodes?site=site", |nodes| nodes.as_array().is_some_and(|nodes| nodes.iter().any(is_it)));
}

#[test]
fn receivers_of_the_sites_file_locate_a_device_in_their_middle() {
    let folder = Folder::with(&[("site.toml", SITE)]);
    let station = Station::start(&folder, "--store tags.db --site site.toml");
    // The last one of the file.
    wait_for(&station, "north-east", [8.0, 8.0, 2.0]);
    // The square looks the same from all corners. North-east's RSSI at one metre is the usual one.
    let [x_m, y_m] = locate(&station, "watch");
    assert!((x_m - 4.0).abs() < 0.1 && (y_m - 4.0).abs() < 0.1, "{x_m} {y_m}");
    let (code, said) = station.stop();
    assert_eq!(code, Some(0), "{said}");
}

#[test]
fn scanners_locate_a_badge_in_their_middle_and_have_the_names_of_the_sites_file() {
    let folder = Folder::with(&[]);
    let example = root().join("examples/scanners.toml").display().to_string();
    let station = Station::start(&folder, &format!("--simulate {example}"));
    let tags = station.wait("/api/v1/tags", |tags| position(tags, "c2a8ad55-1-1")["used"] == 4);
    let [x_m, y_m] = ["x_m", "y_m"].map(|key| position(&tags, "c2a8ad55-1-1")[key].as_f64().expect("a number"));
    // By RSSI with 3 dB of shadowing, 6 m from each scanner.
    assert!((x_m - 5.0).hypot(y_m - 4.0) < 3.0, "{x_m} {y_m}");
    station.stop();
    let station = Station::start(&folder, &format!("--site {example}"));
    wait_for(&station, "0x3003", [9.7, 7.7, 2.2]);
    let nodes = station.json("/api/v1/nodes?site=site");
    let bedroom = nodes.as_array().and_then(|nodes| nodes.iter().find(|node| node["node"] == "0x3003"));
    assert_eq!(bedroom.expect("a node")["name"], "bedroom");
}

#[test]
fn where_the_api_has_placed_a_receiver_counts_more_than_the_sites_file() {
    let folder = Folder::with(&[("site.toml", SITE)]);
    let start = || Station::start(&folder, "--store tags.db --site site.toml");
    let (path, of_file, elsewhere) = ("/api/v1/nodes/site/north-east", [8.0, 8.0, 2.0], [8.0, 6.0, 2.0]);
    let station = start();
    wait_for(&station, "north-east", of_file);
    station.send("PUT", path, &json!({"role": "receiver", "position_m": elsewhere}).to_string());
    wait_for(&station, "north-east", elsewhere);
    station.stop();
    let station = start();
    let expected = "site: north-east stays where the API has placed it, which is not its place in --site; \
                DELETE /api/v1/nodes/site/north-east and a restart take that of the file\n";
    assert_eq!(station.said().matches("stays where").count(), 1, "{}", station.said());
    assert!(station.said().contains(expected), "{}", station.said());
    wait_for(&station, "north-east", elsewhere);
    station.send("DELETE", path, "");
    station.stop();
    let station = start();
    wait_for(&station, "north-east", of_file);
    assert!(!station.said().contains("stays where"), "{}", station.said());
}

#[test]
fn the_files_of_the_document_are_right() {
    let page = std::fs::read_to_string(root().join("docs/use/station/receivers.md")).expect("the page");
    let blocks: Vec<&str> = page.split("```toml\n").skip(1).filter_map(|rest| rest.split("```").next()).collect();
    assert!(!blocks.is_empty(), "the page shows how a receiver is written");
    for block in blocks {
        let site = Site::parse("site.toml".as_ref(), block).expect("a site");
        assert!(!site.receivers.is_empty(), "{block}");
    }
}
