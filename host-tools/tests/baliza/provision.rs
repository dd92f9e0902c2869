//! `baliza provision`: from a file written by people to a record, and back.

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
fn a_record_of_version_1_is_read_and_provisioned_anew() {
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
fn the_example_provisions_without_a_word() {
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
fn everything_that_is_said_is_in_the_record() {
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
            "still_rate_hz": 0.13, "sleep": true, "anchors_per_round": 3, "tell_distances": true, "report_ranges": false,
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
fn the_region_is_asked_for_once_and_only_of_nodes_that_transmit() {
    let said = |text: &str, arguments: &str| {
        let folder = Folder::with(&[("site.toml", text)]);
        folder.run(&format!("provision --config site.toml {arguments}")).ok().stderr
    };
    let all = said(&EVERYTHING.replace("region = \"us\"", ""), "--all --out records");
    assert_eq!(all.matches("warning: region is missing in [network], ").count(), 1, "{all}");
    let beacon = said(&EVERYTHING.replace("region = \"us\"", ""), "--node beacon --out b.bin");
    assert!(!beacon.contains("warning"), "{beacon}");
    let tag = said(EVERYTHING, "--node tag --out t.bin");
    assert!(!tag.contains("warning"), "{tag}");
    let anchor = said(EVERYTHING, "--node anchor --out a.bin");
    assert!(anchor.contains("warning: uwb_tx_power of anchor: measure "), "{anchor}");
    let wide = ANCHOR.replace("pan = 0xDECA", "pan = 0xDECA\nregion = \"eu\"\nchannel = 7");
    let wide = said(&wide, "--out a.bin");
    assert!(wide.contains("warning: channel 7 begins at 5.95 GHz"), "{wide}");
}

#[test]
fn native_anchors_tell_their_places_themselves() {
    let text = EVERYTHING.replace("decaranging-fast", "native");
    let tag = provisioned(&text).run("provision --show records/tag.bin --json").ok().object();
    assert_eq!(tag["anchor"], serde_json::json!([{ "address": "0x0102", "position_m": [0.1, -0.7, 1000.0] }]));
}

#[test]
fn a_network_to_listen_to_has_rounds() {
    for (said, rounds_hz) in [("listening\"", 10.0), ("listening\"\nrounds_hz = 6.25", 6.25)] {
        let text = EVERYTHING.replace("decaranging-fast\"", said).replace("b-wls-r", "track");
        let tag = provisioned(&text).run("provision --show records/tag.bin --json").ok().object();
        assert_eq!(tag["network"]["mode"], "listening");
        assert_eq!(tag["network"]["rounds_hz"], rounds_hz);
    }
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
fn what_is_wrong_is_said_with_its_line() {
    let cases = [
        ("pan = 0xDECA", "pan = 0x1DECA", "site.toml:3: pan is 0x1DECA: it must be a whole number, 0 to 65535"),
        ("pan = 0xDECA", "pan = 0xFFFF", "site.toml:3: pan is 0xFFFF: it must be less than"),
        ("pan = 0xDECA", "", "site.toml:2: pan is missing"),
        ("pan = 0xDECA", "pan = 1\nchanel = 5", "site.toml:4: unknown key chanel; channel is near it"),
        ("pan = 0xDECA", "pan = 1\nzzz = 5", "site.toml:4: unknown key zzz; there are pan, region, mode, "),
        ("pan = 0xDECA", "pan = 1\nmode = \"nativ\"", "site.toml:4: mode is \"nativ\": it must be one of \"native\", "),
        ("pan = 0xDECA", "pan = 1\nrate_kbps = 110", "site.toml:2: preamble_symbols is 128: it must be 1024 or more"),
        ("pan = 0xDECA", "pan = 1\nrounds_hz = 5", "site.toml:4: rounds_hz is for mode = \"listening\""),
        (
            "pan = 0xDECA",
            "pan = 1\nmode = \"listening\"\nrounds_hz = 0",
            "site.toml:5: rounds_hz is 0: it must be 0.13 to 1000",
        ),
        ("pan = 0xDECA", "pan = 1\nprf_mhz = 32", "site.toml:4: prf_mhz is 32: it must be 16 or 64"),
        (
            "pan = 0xDECA",
            "pan = 1\nanswer_us = 250\nlisten_again_us = 40\ntransmit_us = 300",
            "site.toml:6: transmit_us is 300: it must be answer_us at most",
        ),
        (
            "pan = 0xDECA",
            "pan = 1\ntransmit_us = 300",
            "site.toml:4: transmit_us alone: answer_us, listen_again_us and transmit_us are pinned together",
        ),
        (
            "pan = 0xDECA",
            "pan = 1\nregion = \"europe\"",
            "site.toml:4: region is \"europe\": it must be one of \"eu\", \"us\", \"japan\", \"none\"",
        ),
        (
            "pan = 0xDECA",
            "pan = 1\nregion = \"eu\"\nchannel = 2",
            "site.toml:5: channel is 2: it must be 5 or 7 in region \"eu\": on 1 to 4, ",
        ),
        (
            "pan = 0xDECA",
            "pan = 1\nregion = \"japan\"",
            "site.toml:2: channel is 5: it must be one that region \"japan\" permits: ",
        ),
        ("pan = 0xDECA", "pan = 1\npan = 2", "site.toml:4: duplicate key"),
        ("pan = 0xDECA", "pan = ", "site.toml:3: "),
        ("[network]", "[netwrok]", "site.toml:2: unknown key netwrok; network is near it"),
        ("[[node]]", "[[nodes]]", "site.toml:5: unknown key nodes; node is near it"),
        ("\"evk1000\"", "\"evb1000\"", "site.toml:7: board is \"evb1000\": it must be one of \"dwm1001\", "),
        ("\"anchor\"", "\"anker\"", "site.toml:8: role is \"anker\": it must be "),
        ("role = \"anchor\"", "", "site.toml:5: role is missing"),
        ("-cd-ef", "-cd", "site.toml:9: eui is \"01-23-45-67-89-ab-cd\": it must be 16 hexadecimal digits"),
        ("0x0101", "0xFFFF", "site.toml:10: address is 0xFFFF: it must be less than 0xFFFE"),
        ("0x0101", "-1", "site.toml:10: address is -1: it must be a whole number, 0 to 65535"),
        ("0x0101", "true", "site.toml:10: address is true: it must be a whole number, 0 to 65535"),
        ("16_436", "1.5", "site.toml:11: antenna_delay_ticks is 1.5: it must be a whole number"),
        ("[1, 2.5, -0.5]", "[1, 2.5]", "site.toml:12: position_m is [1, 2.5]: it must be three numbers"),
        ("[1, 2.5, -0.5]", "[1, 2.5, nan]", "site.toml:12: position_m is NaN: it must be finite"),
        ("[1, 2.5, -0.5]", "[1, 2.5, 9e3]", "site.toml:12: position_m is 9000: it must be finite and within 8388 m"),
        ("[1, 2.5, -0.5]", "[1, 2.5, 0]\nrate_hz = 1", "site.toml:13: rate_hz is a key of a node whose role is tag"),
        ("[1, 2.5, -0.5]", "[1, 2.5, 0]\npins = { sck = 1 }", "site.toml:13: mosi is missing"),
        ("[1, 2.5, -0.5]", "[1, 2.5, 0]\npins = 3", "site.toml:13: pins is 3: it must be a table"),
        ("[[node]]", "[node]", "site.toml:5: there may be several of [node]: put it in two brackets"),
        ("name = \"a\"", "name = \"../a\"", "site.toml:6: name is \"../a\": it must be letters"),
    ];
    for (right, wrong, said) in cases {
        let folder = Folder::with(&[("site.toml", &ANCHOR.replacen(right, wrong, 1))]);
        let run = folder.run("provision --config site.toml --all --out records");
        refused(&run, said);
        assert_eq!(folder.names(), ["site.toml"], "{said}");
    }
}

#[test]
fn tags_and_beacons_are_refused_with_their_lines() {
    let cases = [
        ("rate_hz = 9.99", "rate_hz = 0.1", ":34: rate_hz is 0.1: it must be 0.13 to 1000"),
        ("rate_hz = 9.99", "rate_hz = \"often\"", ":34: rate_hz is \"often\": it must be a number"),
        ("still_rate_hz = 0.13", "still_rate_hz = 20", ":35: still_rate_hz is 20: it must be rate_hz at most"),
        ("anchors_per_round = 3", "anchors_per_round = 9", ":37: anchors_per_round is 9: it must be 1 to 8"),
        (
            "solver = \"b-wls-r\"",
            "solver = \"b-wlsr\"",
            ":42: solver is \"b-wlsr\": it must be one of \"track\", \"robust\", ",
        ),
        (
            "solver = \"b-wls-r\"",
            "solver = \"nls\"",
            ":42: solver is \"nls\": it must be one of \"track\", \"robust\", ",
        ),
        ("scheme = \"double-sided\"", "scheme = 2", ":43: scheme is 2: it must be text in quotation marks"),
        ("\"decaranging-fast\"", "\"listening\"", ":42: solver is b-wls-r: it must be track in mode \"listening\""),
        ("sleep = true", "sleep = 1", ":36: sleep is 1: it must be true or false"),
        ("scan_window_ms = 30", "scan_window_ms = 101", ":41: scan_window_ms is 101: it must be 3 to the interval"),
        ("scan_interval_ms = 100\n", "", ":28: scan_window_ms without scan_interval_ms"),
        ("channels = [37, 39]", "channels = [36]", ":55: channels has 36: it must be a list of 37, 38, 39"),
        ("channels = [37, 39]", "channels = []", ":55: channels is 0: it must be one of 37, 38, 39 at least"),
        ("tx_power_dbm = -12", "tx_power_dbm = 30", ":54: tx_power_dbm is 30: it must be -40 to 20"),
        ("beacon_key = ", "# ", ":45: beacon_key is absent: it must be there where"),
        ("0x0102", "0xFFFE", ":59: address is 0xFFFE: it must be less than 0xFFFE"),
        ("2.3", "0", ":63: path_loss_exponent is 0: it must be 0.5 to 10"),
        ("address = 0x0201", "address = 0x0101", ":28: the address 0x0101 is the same as anchor's in line 16"),
        ("name = \"tag\"", "name = \"anchor\"", ":28: the name anchor is the same as anchor's in line 16"),
        ("name = \"tag\"\n", "", ":28: name is missing"),
        ("board = \"dwm1001\"", "board = \"evk1000\"", ":40: scan_interval_ms is 100: it must be absent: this board"),
        (
            "board = \"esp32c3\"",
            "board = \"dwm1001\"",
            ":25: sck is 6: it must be absent: this board's DW1000 is wired",
        ),
        ("cs = 10", "cs = 18", ":25: cs is 18: it must be a free pin of the chip's"),
        ("cs = 10", "cs = 7", ":25: cs is 7: it must be a pin that no other signal has"),
    ];
    for (right, wrong, said) in cases {
        let folder = Folder::with(&[("site.toml", &EVERYTHING.replacen(right, wrong, 1))]);
        let run = folder.run("provision --config site.toml --all --out records");
        refused(&run, &format!("site.toml{said}"));
        assert_eq!(folder.names(), ["site.toml"], "{said}");
    }
}

#[test]
fn a_tag_is_told_of_24_beacons_at_most() {
    let beacons: String =
        (0..25).map(|n| format!("[[beacon]]\nmajor = 9\nminor = {n}\nposition_m = [0, 0, 0]\n")).collect();
    let folder = Folder::with(&[("site.toml", &format!("{EVERYTHING}{beacons}"))]);
    // The list has one beacon already, and each of these has four lines: the beacon with minor 23 is the 25th.
    let lines = EVERYTHING.lines().count();
    let run = folder.run("provision --config site.toml --all --out records");
    refused(&run, &format!("site.toml:{}: a tag can be told of 24 beacons, this is one more", lines + 1 + 23 * 4));
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
fn the_board_that_is_asked_for_counts_more_than_the_file_s() {
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
fn intel_hex_is_the_same_record_with_its_address() {
    let folder = Folder::with(&[("site.toml", ANCHOR)]);
    folder.run("provision --config site.toml --format hex --out a.hex").ok();
    folder.run("provision --config site.toml --format bin --out a.bin").ok();
    let text = String::from_utf8(folder.read("a.hex")).expect("text");
    assert!(text.starts_with(":020000040803EF\n:10F00000424C5A52"), "{text}");
    let show = |file: &str| folder.run(&format!("provision --show {file}")).ok().stdout;
    assert_eq!(show("a.hex"), show("a.bin"));
    folder.run("provision --check a.hex").ok();
    folder.write("bad.hex", text.replacen("424C", "424D", 1).as_bytes());
    refused(&folder.run("provision --check bad.hex"), "bad.hex:2: ");
    refused(&folder.run("provision --show bad.hex"), "bad.hex:2: ");
}

/// Sets the checksum of the record at the beginning of a page, by the definition of CRC-32.
fn seal(page: &mut [u8]) {
    let length = usize::from(u16::from_le_bytes([page[6], page[7]]));
    let covered = page[..12].iter().chain(&page[16..16 + length]);
    let crc = covered.fold(u32::MAX, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xEDB8_8320 } else { crc >> 1 })
    });
    page[12..16].copy_from_slice(&(!crc).to_le_bytes());
}

#[test]
fn files_that_are_not_good_are_told_apart() {
    let folder = provisioned(ANCHOR);
    let good = folder.read("records/a.bin");
    let check = |bytes: &[u8], said: &str| {
        folder.write("x.bin", bytes);
        let run = folder.run("provision --check x.bin");
        refused(&run, &format!("x.bin: {said}"));
        assert_eq!(run.stdout, "");
        let json = folder.run("provision --check x.bin --json");
        assert_eq!((json.code, &json.object()["good"]), (Some(2), &serde_json::json!(false)));
    };
    let mut old = good.clone();
    for page in old.chunks_mut(2048) {
        page[4] = 0;
        seal(page);
    }
    check(&old, "the record is of version 0, this program reads versions 1 to 2");
    check(&good[..3000], "the file is cut short: 3000 bytes are no whole pages");
    check(&good[..50], "the record is damaged or cut short: its checksum is wrong");
    check(&[], "there is no record: the flash is erased");
    check(&[0xFF; 8192], "there is no record: the flash is erased");
    check(b"not a record", "this is no node record: it does not begin as one");
    for bit in (0..69 * 8).step_by(37) {
        let mut flipped = good.clone();
        flipped[bit / 8] ^= 1 << (bit % 8);
        check(
            &flipped,
            "page 1 of 2: the record is damaged or cut short: its checksum is wrong; the other page is whole",
        );
        // A node would continue with the other page, and so does --show.
        folder.run("provision --show x.bin").ok();
    }
    let mut both = good.clone();
    both[20] ^= 1;
    both[2048 + 20] ^= 1;
    check(&both, "the record is damaged or cut short: its checksum is wrong");
    refused(&folder.run("provision --show x.bin"), "x.bin: the record is damaged");
    refused(&folder.run("provision --check missing.bin"), "missing.bin: ");
    let run = folder.run("provision --check records/a.bin --json").ok().object();
    assert_eq!((&run["good"], &run["sequence"]), (&serde_json::json!(true), &serde_json::json!(1)));
}

#[test]
fn a_good_record_may_be_for_another_board() {
    let folder = provisioned(EVERYTHING);
    folder.run("provision --check records/tag.bin --board dwm1001").ok();
    let run = folder.run("provision --check records/tag.bin --board evk1000");
    refused(&run, "records/tag.bin: a good record, but not for evk1000: tag.scan.interval_ms is 100: ");
}

#[cfg(feature = "probe")]
#[test]
fn probes_and_chips_that_are_not_there_are_said() {
    let folder = Folder::with(&[("site.toml", ANCHOR)]);
    refused(&folder.run("monitor --chip nosuch"), "--chip: probe-rs knows no chip nosuch");
    refused(&folder.run("monitor --probe nonsense"), "--probe: \"nonsense\": ");
    let run = folder.run("provision --config site.toml --write --chip STM32F105XX");
    refused(&run, "--chip: probe-rs knows no chip STM32F105XX; near it are STM32F105");
    // This probe is not connected, whatever else is.
    let run = folder.run("provision --config site.toml --write --probe ffff:ffff:nobody");
    assert!(run.code == Some(1) || run.code == Some(2), "{run:?}");
    let said = ["baliza: no debug probe found: plug in", "--probe: no probe ffff:ffff:nobody; found: "];
    assert!(said.iter().any(|said| run.stderr.starts_with(said)), "{}", run.stderr);
}

#[cfg(not(feature = "probe"))]
#[test]
fn without_the_feature_probe_a_command_that_needs_a_probe_says_so() {
    let folder = Folder::with(&[("site.toml", ANCHOR)]);
    for arguments in ["monitor", "provision --config site.toml --write", "provision --read --board dwm1001"] {
        let run = folder.run(arguments);
        assert_eq!((run.code, run.stdout.as_str()), (Some(1), ""), "{arguments}: {run:?}");
        let said = "baliza: this program was built without the feature probe, so it does not reach debug probes: ";
        assert!(run.stderr.starts_with(said) && run.stderr.lines().count() == 1, "{arguments}: {run:?}");
    }
}

#[test]
fn reading_a_record_needs_a_board_that_a_probe_can_read() {
    let folder = Folder::with(&[]);
    refused(&folder.run("provision --read --board esp32c3"), "--read: a probe does not read an ESP's flash: ");
    refused(&folder.run("provision --read"), "the following required arguments were not provided: --board");
}

/// A tag, a beacon that is a node, and a listed beacon.
const WITH_BEACONS: &str = r#"
beacons_csv = "calibrated.csv"

[network]
pan = 0xBA11

[[node]]
name = "tag"
board = "dwm1001"
role = "tag"
scan_interval_ms = 100
scan_window_ms = 50

[[beacon]]
major = 7
minor = 1
position_m = [1, 2, 3]
path_loss_exponent = 2.5
"#;

#[test]
fn calibrated_beacons_go_into_the_tags_record() {
    let calibrated =
        "beacon,x_m,y_m,z_m,rssi_1m_dbm,path_loss_exponent\n000000b0-7-1,9,9,,-61.5,3\n7-2,4,5,2.5,-55,2.25\n";
    let folder = Folder::with(&[("site.toml", WITH_BEACONS), ("calibrated.csv", calibrated)]);
    folder.run("provision --config site.toml --out tag.bin").ok();
    let json = folder.run("provision --show tag.bin --json").ok().object();
    // The listed values have precedence, and the missing ones come from the calibration. The other beacon is added.
    let expected = serde_json::json!([
        { "major": 7, "minor": 1, "position_m": [1.0, 2.0, 3.0], "rssi_1m_dbm": -61.5, "path_loss_exponent": 2.5 },
        { "major": 7, "minor": 2, "position_m": [4.0, 5.0, 2.5], "rssi_1m_dbm": -55.0, "path_loss_exponent": 2.25 },
    ]);
    assert_eq!(json["beacon"], expected, "{json}");

    let refused = |text: &str, said: &str| {
        folder.write("calibrated.csv", text.as_bytes());
        let run = folder.run("provision --config site.toml --out other.bin");
        assert_eq!((run.code, run.stderr.trim_end()), (Some(2), said));
    };
    refused(
        "beacon,x_m,y_m\n7-3,4,5\n",
        "site.toml:2: beacon 7-3 of the file has no z_m: say there how high it is, or list it as [[beacon]]",
    );
    refused(
        "beacon,x_m,y_m,z_m\nB,4,5,2\n",
        "calibrated.csv: beacon \"B\" is not named by its numbers: major-minor, or network-major-minor as decode has it",
    );
}

/// A file of two classifiers that a node can hold, one that is too large and one of a kind that a node cannot hold.
fn classifiers() -> Vec<u8> {
    use positioning_core::nlos::{Feature, Input, Inputs, Kind, Model, Nearest, Platt, PowerDifference, Skewness};
    let inputs = Inputs([Input { feature: Feature::Kurtosis, mean: 3.0, deviation: 1.0 }].into_iter().collect());
    let kinds = [
        Kind::PowerDifference(PowerDifference::default()),
        Kind::Skewness(Skewness::default()),
        Kind::Nearest(Nearest { inputs: inputs.clone(), neighbours: 3, los: &[0; 300], nlos: &[1; 300] }),
        Kind::Nearest(Nearest { inputs, neighbours: 47, los: &[0; 94], nlos: &[] }),
    ];
    let encoded = kinds.map(|kind| {
        let mut buffer = [0; 1024];
        Model { kind, calibration: Platt::NONE }.encode(&mut buffer).expect("it fits").to_vec()
    });
    encoded.concat()
}

#[test]
fn a_classifier_goes_beside_the_record_of_a_tag() {
    let site = |lines: &str| {
        format!("[network]\npan = 0xBA11\n\n[[node]]\nname = \"t\"\nboard = \"dwm1001\"\nrole = \"tag\"\n{lines}")
    };
    let folder = Folder::with(&[("site.toml", &site(""))]);
    folder.write("nlos.model", &classifiers());
    folder.run("provision --config site.toml --out plain.bin").ok();
    folder.write("site.toml", site("nlos_model = \"nlos.model\"\nnlos_classifier = \"skewness\"\n").as_bytes());
    for (format, file) in [("bin", "t.bin"), ("hex", "t.hex")] {
        folder.run(&format!("provision --config site.toml --format {format} --out {file}")).ok();
        let run = folder.run(&format!("provision --show {file}")).ok();
        assert!(run.stdout.contains("\n# nlos_model: skewness (skewness_near)\n"), "{}", run.stdout);
        let run = folder.run(&format!("provision --show {file} --json")).ok();
        assert_eq!(run.object()["nlos_model"], "skewness (skewness_near)");
        let run = folder.run(&format!("provision --check {file}")).ok();
        assert!(run.stdout.contains(", with skewness (skewness_near); version 2"), "{}", run.stdout);
    }
    // The record itself is the same as without the classifier, and the 30 bytes of the classifier follow it.
    let (plain, with) = (folder.read("plain.bin"), folder.read("t.bin"));
    let model = folder.read("nlos.model");
    assert_eq!(plain[..1280], with[..1280]);
    assert_eq!(with[1280..1310], model[25..55]);
    assert!(with[1310..4096].iter().chain(&plain[1280..4096]).all(|byte| *byte == 0xFF));
    let mut damaged = with.clone();
    damaged[1290] ^= 1;
    folder.write("damaged.bin", &damaged);
    refused(
        &folder.run("provision --check damaged.bin"),
        "damaged.bin: page 1 of 2: the record is whole, but beside it is ",
    );

    for (lines, said) in [
        (
            "nlos_model = \"nlos.model\"\n",
            "site.toml:8: nlos_model: ./nlos.model: it has several classifiers, name one of ",
        ),
        ("nlos_model = \"no.model\"\n", "site.toml:8: nlos_model: ./no.model: cannot open it: "),
        ("nlos_model = \"plain.bin\"\n", "site.toml:8: nlos_model: ./plain.bin: not a model"),
        ("nlos_classifier = \"skewness\"\n", "site.toml:8: nlos_classifier without nlos_model: "),
        (
            "nlos_model = \"nlos.model\"\nnlos_classifier = \"nearest-reduced\"\n",
            "site.toml:8: nlos_model has 632 bytes: a node has room for 400",
        ),
        (
            "nlos_model = \"nlos.model\"\nnlos_classifier = \"nearest\"\n",
            "site.toml:8: nlos_model is nearest, which nodes do not hold: it must be power-difference, skewness, logistic or quantised",
        ),
    ] {
        folder.write("site.toml", site(lines).as_bytes());
        refused(&folder.run("provision --config site.toml --out x.bin"), &said.replace("./", ""));
    }
    folder.write("site.toml", ANCHOR.replace("position_m", "nlos_model = \"nlos.model\"\nposition_m").as_bytes());
    refused(
        &folder.run("provision --config site.toml --out x.bin"),
        "site.toml:12: nlos_model is a key of a node whose role is tag",
    );
}

#[test]
fn two_nodes_of_one_address_and_keys_that_everyone_knows_are_refused() {
    let site = |key: &str, one: &str, other: &str| {
        format!(
            "[network]\npan = 1\n{key}\n[[node]]\nname = \"a\"\nrole = \"anchor\"\n{one}\n[[node]]\nname = \"b\"\nrole = \
             \"anchor\"\n{other}\n"
        )
    };
    let (low, high) = ("eui = \"0011223344550102\"", "eui = \"0a11223344550102\"");
    let cases = [
        (
            site("", low, "address = 0x0102"),
            "site.toml:8: the address 0x0102, which a node without address takes from its EUI, is the same as a's in line 4",
        ),
        (
            site("", low, high),
            "site.toml:8: the address 0x0102, which a node without address takes from its EUI, is the same as a's in line 4",
        ),
        (
            site("beacon_key = \"00000000000000000000000000000000\"", low, ""),
            "site.toml:3: beacon_key is the same byte sixteen times: make one",
        ),
        (
            site("beacon_key = \"000102030405060708090a0b0c0d0e0f\"", low, ""),
            "site.toml:3: beacon_key is the one that is printed in the examples: make one",
        ),
    ];
    for (text, line) in cases {
        let folder = Folder::with(&[("site.toml", &text)]);
        refused(&folder.run("provision --config site.toml --all --board dwm1001 --out records"), line);
    }
    let apart = site("", low, &format!("{high}\naddress = 0x0103"));
    let folder = Folder::with(&[("site.toml", &apart)]);
    folder.run("provision --config site.toml --all --board dwm1001 --out records").ok();
}

#[test]
fn sites_that_are_hardly_meant_get_a_warning() {
    let anchor = |number: u8, position: &str| {
        format!("[[node]]\nname = \"a{number}\"\nrole = \"anchor\"\naddress = {number}\n{position}\n")
    };
    let tag = |height: &str| format!("[[node]]\nname = \"t\"\nrole = \"tag\"\naddress = 99\n{height}\n");
    let beacon = "[[node]]\nname = \"b\"\nrole = \"beacon\"\nuuid = \"c2a8ad558a2f4bb49c526b3cd7a0e511\"\nmajor = 1\nminor = 1\n";
    let corners = ["[0, 0, 2.4]", "[6, 0, 2.4]", "[6, 4, 2.4]", "[0, 4, 2.4]"].map(|at| format!("position_m = {at}"));
    let flat: String = (1..).zip(&corners).map(|(number, position)| anchor(number, position)).collect();
    let steep = flat.replace("[0, 4, 2.4]", "[0, 4, 0.6]");
    let cases = [
        (steep.clone() + &tag(""), None),
        (flat.clone() + &tag(""), Some("the anchors lie in one plane, so that the height of t is uncertain")),
        (flat.clone() + &tag("height_m = 1.2"), None),
        (flat.clone() + &tag("height_m = 120"), Some("height_m of t is 120: is it in metres?")),
        (
            steep.replace("[6, 0, 2.4]", "[600, 0, 240]") + &tag(""),
            Some("position_m of a2 has 600, farther than 300 m"),
        ),
        (
            steep.clone() + &anchor(5, &corners[0]) + &tag(""),
            Some("the anchors a1 and a5 are both at 0.00, 0.00, 2.40 m"),
        ),
        (anchor(1, "") + &anchor(2, "") + &anchor(3, "") + &tag(""), Some("no anchor has a position_m")),
        (anchor(1, &corners[0]) + &anchor(2, &corners[1]) + &tag(""), Some("there are only 2 anchors")),
        (steep.clone() + beacon + "measured_power_dbm = 59\n", Some("measured_power_dbm of b is 59")),
        (steep + beacon + "measured_power_dbm = -59\n", None),
    ];
    for (nodes, warning) in cases {
        let text = format!("[network]\npan = 1\nregion = \"eu\"\n{nodes}");
        let folder = Folder::with(&[("site.toml", &text)]);
        let run = folder.run("provision --config site.toml --all --board esp32c3 --out records").ok();
        let warnings: Vec<&str> = run.stderr.lines().filter_map(|line| line.strip_prefix("warning: ")).collect();
        match warning {
            Some(begins) => assert!(matches!(warnings[..], [one] if one.starts_with(begins)), "{begins}: {warnings:?}"),
            None => assert!(warnings.is_empty(), "{warnings:?}"),
        }
    }
}

#[test]
fn all_records_of_a_folder_are_of_one_file() {
    let folder = Folder::with(&[]);
    folder.run("provision --example --out site.toml").ok();
    folder.run("provision --config site.toml --all --out records").ok();
    folder.write("records/notes.bin", b"mine");
    folder.run("provision --config site.toml --node tag-1 --out records/spare.bin").ok();
    // Without --force, a record of a node that the file does not have is no reason to go on.
    let site = String::from_utf8(folder.read("site.toml")).expect("text");
    folder.write("renamed.toml", site.replace("name = \"anchor-4\"", "name = \"door\"").as_bytes());
    let again = "provision --config renamed.toml --all --out records";
    refused(&folder.run(again), "--out: records has anchor-1.bin already; --force replaces it");
    folder.run(&format!("{again} --force")).ok();
    let mut names: Vec<_> = std::fs::read_dir(folder.path("records"))
        .expect("the folder")
        .map(|entry| entry.expect("an entry").file_name().into_string().expect("UTF-8"))
        .collect();
    names.sort();
    // Neither anchor-4 nor the spare record is left; what is no record stays.
    let expected = ["anchor-1", "anchor-2", "anchor-3", "beacon-1", "door", "notes", "tag-1"];
    assert_eq!(names, expected.map(|name| format!("{name}.bin")));
}
