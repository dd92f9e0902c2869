//! `baliza provision`: from a file written by people to a record, and back.

mod files;
mod models;
mod refused;

use std::fs;

use crate::support::{Folder, Run, root};

/// The record of the golden bytes in node-record's tests: an anchor at (1, 2.5, −0.5) m.
const ANCHOR: &str = r#"
[network]
pan = 0xDECA

[[node]]
name = "a"
board = "evk1000"
role = "anchor"
eui = "01-23-45-67-89-ab-cd-ef"
address = 0x0101
antenna_delay_ticks = 16_436
position_m = [1, 2.5, -0.5]
"#;

/// A site with every key.
const EVERYTHING: &str = r#"
[network]
pan = 0xBA11
mode = "decaranging-fast"
channel = 2
prf_mhz = 16
rate_kbps = 850
preamble_symbols = 256
preamble_code = 4
answer_us = 600
listen_again_us = 90
transmit_us = 300
beacon_key = "a00102030405060708090a0b0c0d0e0f"
region = "us"

[[node]]
name = "anchor"
board = "esp32c3"
role = "anchor"
eui = "0011223344556677"
address = 0x0101
antenna_delay_ticks = 16450
crystal_trim = 14
uwb_tx_power = 0x1F1F1F1F
pins = { sck = 6, mosi = 7, miso = 2, cs = 10, irq = 3, reset = 4 }
position_m = [0.1, 2.0, 3.3]

[[node]]
name = "tag"
board = "dwm1001"
role = "tag"
address = 0x0201
height_m = 1.2
rate_hz = 9.99
still_rate_hz = 0.13
sleep = true
anchors_per_round = 3
tell_distances = true
report_ranges = false
scan_interval_ms = 100
scan_window_ms = 30
solver = "b-wls-r"
scheme = "double-sided"

[[node]]
name = "beacon"
board = "esp32c6"
role = "beacon"
uuid = "c2a8ad55-8a2f-4bb4-9c52-6b3cd7a0e511"
major = 513
minor = 65535
measured_power_dbm = -65
interval_ms = 250
tx_power_dbm = -12
channels = [37, 39]
rotate_s = 900
position_m = [3.0, 2.0, 2.4]

[[anchor]]
address = 0x0102
position_m = [0.1, -0.7, 1e3]

[[beacon]]
major = 1
minor = 2
position_m = [0.0, 0.0, 2.0]
rssi_1m_dbm = -62.5
path_loss_exponent = 2.3
"#;

fn from_hex(text: &str) -> Vec<u8> {
    text.split_whitespace().map(|byte| u8::from_str_radix(byte, 16).expect("hexadecimal")).collect()
}

fn provisioned(text: &str) -> Folder {
    let folder = Folder::with(&[("site.toml", text)]);
    folder.run("provision --config site.toml --all --out records").ok();
    folder
}

/// Asserts that a run was refused with one line that begins with this text.
fn refused(run: &Run, begins: &str) {
    assert_eq!(run.code, Some(2), "{run:?}");
    assert!(run.stderr.starts_with(begins), "{}, not {begins}", run.stderr);
    assert_eq!(run.stderr.lines().count(), 1, "{}", run.stderr);
}

#[test]
fn a_record_has_the_bytes_that_another_program_wrote() {
    let folder = provisioned(ANCHOR);
    // See node-record's tests: a Python program wrote the body, and the header from its length 0x36, sequence 1, and
    // zlib's CRC-32.
    let body = "01 ef 9b af cd f8 ac d1 91 01  01 81 02   \
                01 01 00 00 80 3f 00 00 20 40 00 00 00 bf \
                ca bd 03 00 05 40 9a 35 80 01 00  00 00 00 \
                01 b4 80 01 00 00  00 00 00 00  00 00 00";
    let page = from_hex(&format!("42 4c 5a 52 02 00 36 00 01 00 00 00 f7 60 a4 3e {body}"));
    let file = folder.read("records/a.bin");
    assert_eq!(file.len(), 4096, "two pages of 2048 bytes");
    for half in file.chunks(2048) {
        assert_eq!(&half[..page.len()], page);
        assert!(half[page.len()..].iter().all(|byte| *byte == 0xFF));
    }
}

#[test]
fn a_record_of_version_1_is_read_and_provisioned_again() {
    // As the same program wrote it for version 1, whose default is 250, 40, 150 us.
    let body = "01 ef 9b af cd f8 ac d1 91 01  01 81 02   \
                01 01 00 00 80 3f 00 00 20 40 00 00 00 bf \
                ca bd 03 00 05 40 9a 35 80 01 00  fa 01 28 96 01 \
                01 b4 80 01 00 00  00 00 00 00";
    let mut page = from_hex(&format!("42 4c 5a 52 01 00 35 00 01 00 00 00 ad 7b bb 6b {body}"));
    page.resize(2048, 0xFF);
    let folder = Folder::with(&[]);
    folder.write("old.bin", &page.repeat(2));
    let check = folder.run("provision --check old.bin").ok();
    assert!(check.stdout.ends_with("at (1, 2.5, -0.5) m; version 1, sequence 1\n"), "{}", check.stdout);
    let shown = folder.run("provision --show old.bin --board evk1000").ok();
    assert!(!shown.stdout.contains("answer_us"), "{}", shown.stdout);
    folder.write("site.toml", shown.stdout.as_bytes());
    folder.run("provision --config site.toml --out new.bin").ok();
    let check = folder.run("provision --check new.bin").ok();
    assert!(check.stdout.ends_with("at (1, 2.5, -0.5) m; version 2, sequence 1\n"), "{}", check.stdout);
}

#[test]
fn the_example_provisions_without_a_warning() {
    let folder = Folder::with(&[]);
    let example = folder.run("provision --example").ok();
    folder.run("provision --example --out same.toml").ok();
    assert_eq!(folder.read("same.toml"), example.stdout.as_bytes());
    folder.run("provision --config same.toml --all --out records").ok();
    let nodes = ["anchor-1", "anchor-2", "anchor-3", "anchor-4", "beacon-1", "tag-1"];
    for name in nodes {
        let check = folder.run(&format!("provision --check records/{name}.bin")).ok();
        assert!(check.stdout.starts_with(&format!("records/{name}.bin: good: ")), "{}", check.stdout);
    }
    assert_eq!(fs::read_dir(folder.path("records")).expect("a folder").count(), nodes.len());
    let anchor = folder.run("provision --check records/anchor-2.bin").ok();
    let expected =
        "records/anchor-2.bin: good: anchor 0x0102 of network 0xBA11 at (6, 0, 2.4) m; version 2, sequence 1\n";
    assert_eq!(anchor.stdout, expected);
}

#[test]
fn the_example_fits_the_boards_that_there_are() {
    let folder = Folder::with(&[]);
    for (boards, anchors) in [(4, 3), (5, 4)] {
        let example = folder.run(&format!("provision --example --boards {boards}")).ok();
        folder.write("site.toml", example.stdout.as_bytes());
        let made = folder.run("provision --config site.toml --all --out records --force --json").ok();
        let names: Vec<_> = made.json().as_array().expect("a list").iter().map(|made| made["node"].clone()).collect();
        let expected: Vec<_> = (1..=anchors).map(|n| format!("anchor-{n}")).chain(["tag-1".to_owned()]).collect();
        assert_eq!(names, expected);
        assert!(!made.stderr.contains("warning"), "{}", made.stderr);
        let tag = folder.run("provision --show records/tag-1.bin --json").ok().object()["node"][0].clone();
        // Three ranges are enough in the plane only. Without a scan, the image is tag-dwm1001.elf.
        let height_m = if anchors == 3 { serde_json::json!(1.2) } else { serde_json::Value::Null };
        assert_eq!((&tag["height_m"], &tag["scan_interval_ms"]), (&height_m, &serde_json::Value::Null));
        folder.run("simulate --site site.toml --seconds 2 --out room").ok();
        fs::remove_dir_all(folder.path("room")).expect("removed");
    }
    refused(&folder.run("provision --example --boards 3"), "invalid value '3' for '--boards <4|5>'");
}

#[test]
fn names_come_back_from_the_sites_file() {
    let folder = provisioned(EVERYTHING);
    for node in ["anchor", "tag", "beacon"] {
        let shown = folder.run(&format!("provision --show records/{node}.bin --site site.toml --json")).ok().object();
        assert_eq!(shown["node"][0]["name"], node);
    }
}

#[test]
fn what_is_known_of_a_tags_place_is_in_its_record() {
    let known = "[area]\nx_m = [0.0, 6.5]\ny_m = [-1.0, 4.0]\nz_m = [0.0, 2.5]\n";
    let text = format!("{EVERYTHING}{known}").replace("height_m = 1.2\n", "height_m = 1.2\nheight_sigma_m = 0.25\n");
    let folder = provisioned(&text);
    let tag = folder.run("provision --show records/tag.bin --show-keys --json").ok().object();
    let area = serde_json::json!({ "x_m": [0.0, 6.5], "y_m": [-1.0, 4.0], "z_m": [0.0, 2.5] });
    assert_eq!((&tag["node"][0]["height_sigma_m"], &tag["area"]), (&serde_json::json!(0.25), &area));
    let shown = folder.run("provision --show records/tag.bin --show-keys").ok();
    folder.write("shown.toml", shown.stdout.as_bytes());
    folder.run("provision --config shown.toml --board dwm1001 --out again.bin").ok();
    assert!(folder.read("again.bin") == folder.read("records/tag.bin"), "{}", shown.stdout);
    let check = folder.run("provision --check again.bin").ok();
    assert!(check.stdout.ends_with("; version 3, sequence 1\n"), "{}", check.stdout);
}

#[test]
fn the_example_sites_provision() {
    let sites = fs::read_dir(root().join("examples/sites")).expect("examples/sites");
    let examples: Vec<_> = sites.map(|file| fs::read_to_string(file.expect("a file").path()).expect("text")).collect();
    assert_eq!(examples.len(), 4);
    for example in examples {
        // Everyone knows the key that is printed.
        let example = example.replace("beacon_key = \"0001", "beacon_key = \"a001");
        let folder = Folder::with(&[("site.toml", example.as_str())]);
        let board = if example.contains("board =") { "" } else { " --board esp32c6" };
        folder.run(&format!("provision --config site.toml --all --out records{board}")).ok();
    }
}

#[test]
fn show_and_provision_are_a_circle() {
    for (text, nodes) in [(EVERYTHING, vec!["anchor", "tag", "beacon"]), (ANCHOR, vec!["a"])] {
        let folder = provisioned(text);
        for node in nodes {
            let shown = folder.run(&format!("provision --show records/{node}.bin --show-keys")).ok();
            folder.write("shown.toml", shown.stdout.as_bytes());
            let board = folder.run("provision --config shown.toml --out again.bin");
            refused(&board, "--board: say what ");
            let board = if text == ANCHOR { "evk1000" } else { ["dwm1001", "esp32c6"][usize::from(node != "tag")] };
            folder.run(&format!("provision --config shown.toml --board {board} --out again.bin")).ok();
            assert!(folder.read("again.bin") == folder.read(&format!("records/{node}.bin")), "{}", shown.stdout);
            // The new record is shown as the same text.
            let again = folder.run("provision --show again.bin --show-keys").ok();
            assert_eq!(again.stdout, shown.stdout);
        }
    }
}

#[test]
fn every_key_of_a_site_is_in_the_record() {
    let folder = provisioned(EVERYTHING);
    let tag = folder.run("provision --show records/tag.bin --show-keys --json --board dwm1001").ok().object();
    let expected = serde_json::json!({
        "network": {
            "pan": 0xBA11, "region": "us", "mode": "decaranging-fast", "channel": 2, "prf_mhz": 16, "rate_kbps": 850,
            "preamble_symbols": 256, "preamble_code": 4, "answer_us": 600, "listen_again_us": 90, "transmit_us": 300,
            "beacon_key": "a00102030405060708090a0b0c0d0e0f",
        },
        "node": [{
            "name": "tag-0201", "board": "dwm1001", "role": "tag", "address": "0x0201", "height_m": 1.2, "rate_hz": 9.99,
            "still_rate_hz": 0.13, "sleep": true, "anchors_per_round": 3, "tell_distances": true, "tell_position": false, "report_ranges": false,
            "scan_interval_ms": 100, "scan_window_ms": 30, "solver": "b-wls-r", "scheme": "double-sided",
        }],
        // The listed anchors come first, then the nodes whose positions tags cannot receive from the nodes.
        "anchor": [
            { "address": "0x0102", "position_m": [0.1, -0.7, 1000.0] },
            { "address": "0x0101", "position_m": [0.1, 2.0, 3.3] },
        ],
        "beacon": [
            { "major": 1, "minor": 2, "position_m": [0.0, 0.0, 2.0], "rssi_1m_dbm": -62.5, "path_loss_exponent": 2.3 },
            { "major": 513, "minor": 65535, "position_m": [3.0, 2.0, 2.4] },
        ],
    });
    assert_eq!(tag, expected);

    let anchor = folder.run("provision --show records/anchor.bin --json").ok().object();
    let expected = serde_json::json!([{
        "name": "anchor-0101", "role": "anchor", "eui": "0011223344556677", "address": "0x0101", "antenna_delay_ticks": 16450,
        "crystal_trim": 14, "uwb_tx_power": 0x1F1F_1F1F, "position_m": [0.1, 2.0, 3.3],
        "pins": { "sck": 6, "mosi": 7, "miso": 2, "cs": 10, "irq": 3, "reset": 4 },
    }]);
    assert_eq!(anchor["node"], expected);
    assert_eq!(anchor["network"]["beacon_key"], serde_json::Value::Null, "an anchor has no use for it");
    assert_eq!(anchor["beacon"], serde_json::Value::Null);
}

#[test]
fn native_anchors_send_their_own_positions() {
    let text = EVERYTHING.replace("decaranging-fast", "native");
    let tag = provisioned(&text).run("provision --show records/tag.bin --json").ok().object();
    assert_eq!(tag["anchor"], serde_json::json!([{ "address": "0x0102", "position_m": [0.1, -0.7, 1000.0] }]));
}

#[test]
fn keys_are_hidden_and_a_hidden_key_is_none() {
    let folder = provisioned(EVERYTHING);
    let shown = folder.run("provision --show records/beacon.bin").ok();
    assert!(shown.stdout.contains("beacon_key = \"hidden\""), "{}", shown.stdout);
    assert!(!shown.stdout.contains("a00102"), "{}", shown.stdout);
    folder.write("shown.toml", shown.stdout.as_bytes());
    let run = folder.run("provision --config shown.toml --board esp32c6 --out again.bin");
    refused(&run, "shown.toml:15: beacon_key is hidden: ");
    let open = folder.run("provision --show records/beacon.bin --show-keys").ok();
    assert!(open.stdout.contains("beacon_key = \"a00102030405060708090a0b0c0d0e0f\""), "{}", open.stdout);
}

#[test]
fn the_key_of_the_frames_is_in_the_records_of_tags_and_anchors() {
    let key = "b00102030405060708090a0b0c0d0e0f";
    let text =
        EVERYTHING.replace("decaranging-fast", "native").replace("region = ", &format!("key = \"{key}\"\nregion = "));
    let folder = provisioned(&text);
    for (node, expected) in [("tag", Some(key)), ("anchor", Some(key)), ("beacon", None)] {
        let shown = folder.run(&format!("provision --show records/{node}.bin --show-keys --json")).ok().object();
        assert_eq!(shown["network"]["key"].as_str(), expected, "{node}");
    }
    let shown = folder.run("provision --show records/anchor.bin").ok();
    assert!(shown.stdout.contains("\nkey = \"hidden\"\n") && !shown.stdout.contains("b00102"), "{}", shown.stdout);
    folder.write("shown.toml", shown.stdout.as_bytes());
    let run = folder.run("provision --config shown.toml --board esp32c3 --out again.bin");
    refused(&run, "shown.toml:15: key is hidden: ");
    let shown = folder.run("provision --show records/tag.bin --show-keys").ok();
    folder.write("shown.toml", shown.stdout.as_bytes());
    folder.run("provision --config shown.toml --board dwm1001 --out again.bin").ok();
    assert!(folder.read("again.bin") == folder.read("records/tag.bin"), "{}", shown.stdout);
}

#[test]
fn a_node_with_wifi_has_settings_and_a_key_that_others_do_not_read() {
    let text = fs::read_to_string(root().join("examples/wifi.toml")).expect("the example");
    let folder = Folder::with(&[("site.toml", &text)]);
    let made = folder.run("provision --config site.toml --all --out records").ok();
    assert!(made.stderr.contains("made keys in gateways.toml for anchor-4: "), "{}", made.stderr);
    // The second time there are none to be made, and the record is the same.
    let first = folder.read("records/anchor-4.bin");
    let again = folder.run("provision --config site.toml --node anchor-4 --out again.bin").ok();
    assert!(!again.stderr.contains("made keys") && folder.read("again.bin") == first, "{}", again.stderr);
    let checked = folder.run("provision --check records/anchor-4.bin").ok();
    assert!(checked.stdout.contains(", by Wi-Fi to 192.168.1.20:7000; "), "{}", checked.stdout);
    let shown = folder.run("provision --show records/anchor-4.bin").ok();
    let keys = String::from_utf8(folder.read("gateways.toml")).expect("UTF-8");
    let key = keys.split("key = \"").nth(1).and_then(|rest| rest.split('"').next()).expect("a key");
    assert!(shown.stdout.contains("password = \"hidden\"\n") && !shown.stdout.contains(key), "{}", shown.stdout);
    let open = folder.run("provision --show records/anchor-4.bin --show-keys").ok();
    assert!(open.stdout.contains("password = \"its password\"\n") && open.stdout.contains(key), "{}", open.stdout);
    let record = folder.run("provision --show records/anchor-4.bin --json").ok().object();
    let station = serde_json::json!("192.168.1.20:7000");
    assert_eq!((&record["wifi"]["station"], &record["node"][0]["wifi"]), (&station, &true.into()));
    let without = folder.run("provision --show records/anchor-1.bin --json").ok().object();
    assert_eq!((&without["wifi"], &without["node"][0]["wifi"]), (&serde_json::Value::Null, &serde_json::Value::Null));
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        for file in ["gateways.toml", "records/anchor-4.bin", "again.bin"] {
            let mode = fs::metadata(folder.path(file)).expect("a file").permissions().mode();
            assert_eq!(mode & 0o77, 0, "{file}");
        }
    }
    let open_wifi = text.replace("gateways = ", "# gateways = ");
    folder.write("open.toml", open_wifi.as_bytes());
    let warned = folder.run("provision --config open.toml --node anchor-4 --out open.bin").ok();
    assert!(warned.stderr.contains("a station takes that with --open-udp only"), "{}", warned.stderr);
}

#[test]
fn one_of_several_nodes_is_named() {
    let folder = Folder::with(&[("site.toml", EVERYTHING)]);
    refused(
        &folder.run("provision --config site.toml --out x"),
        "--node: the file has 3 nodes, name one of anchor, tag, ",
    );
    refused(
        &folder.run("provision --config site.toml --node tags --out x"),
        "--node: there is no node tags; there are anchor, tag, ",
    );
    refused(&folder.run("provision --config site.toml --node tag"), "--config: say where the record goes");
    refused(&folder.run("provision --config site.toml --all"), "--all: say which folder");
    refused(
        &folder.run("provision --config site.toml --node tag --out nowhere/x"),
        "--out: the folder nowhere does not",
    );
    refused(&folder.run("provision --config missing.toml --out x"), "missing.toml: ");
    refused(&folder.run("provision"), "the following required arguments were not provided");
    folder.run("provision --config site.toml --node tag --out tag.bin --json").ok();
    assert_eq!(folder.names(), ["site.toml", "tag.bin"]);
    let made = folder.run("provision --config site.toml --all --out records --json").ok().json();
    let expected =
        serde_json::json!({ "node": "tag", "board": "dwm1001", "file": "records/tag.bin", "flash_address": 0x7E000 });
    assert_eq!(made[1], expected);
}

#[test]
fn the_board_of_the_flag_overrides_that_of_the_file() {
    let folder = Folder::with(&[("site.toml", EVERYTHING)]);
    let made = folder.run("provision --config site.toml --node tag --board esp32 --out tag.bin --json").ok().json();
    assert_eq!(
        (&made[0]["board"], &made[0]["flash_address"]),
        (&serde_json::json!("esp32"), &serde_json::json!(0x9000))
    );
    // The record is also checked against the board: the EVK1000 has no Bluetooth.
    let run = folder.run("provision --config site.toml --node tag --board evk1000 --out other.bin");
    refused(&run, "site.toml:40: scan_interval_ms is 100: ");
    assert_eq!(folder.names(), ["site.toml", "tag.bin"]);
}

#[test]
fn a_tag_that_advertises_its_positions_has_bluetooth_s_key_and_the_board_for_it() {
    let key = "beacon_key = \"a00102030405060708090a0b0c0d0e0f\"";
    let site = fs::read_to_string(root().join("examples/advertised.toml")).expect("the example");
    let site = site.replace("# beacon_key = \"…\"", key);
    let folder = provisioned(&site);
    for node in ["badge", "west"] {
        let shown = folder.run(&format!("provision --show records/{node}.bin --show-keys --json")).ok().object();
        assert_eq!(shown["network"]["beacon_key"], "a00102030405060708090a0b0c0d0e0f");
        let tells = (&shown["node"][0]["tell_position"], &shown["node"][0]["advertise_position"]);
        let expected = if node == "badge" { serde_json::json!(true) } else { serde_json::Value::Null };
        assert_eq!(tells, (&expected, &expected));
    }
    let of_anchor = folder.run("provision --show records/anchor-1.bin --show-keys --json").ok().object();
    assert_eq!(of_anchor["network"]["beacon_key"], serde_json::Value::Null);
    let refused_with = |text: &str, line: &str, what: &str| {
        let folder = Folder::with(&[("site.toml", text)]);
        let run = folder.run("provision --config site.toml --node badge --out badge.bin");
        let at = text.lines().count() - text.lines().rev().position(|other| other == line).expect("the line");
        refused(&run, &format!("site.toml:{at}: {what}"));
    };
    let badge = |more: &str| site.replace("sleep = true\n", &format!("sleep = true\n{more}\n"));
    refused_with(
        &badge("tell_distances = true"),
        "advertise_position = true",
        "advertise_position and tell_distances: a poll has room for one of them",
    );
    refused_with(
        &badge("scan_interval_ms = 100"),
        "advertise_position = true",
        "advertise_position is true: it must be absent beside scan_interval_ms",
    );
}
