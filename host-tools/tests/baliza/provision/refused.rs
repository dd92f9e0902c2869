//! Sites that are wrong, or have a probable mistake.

use super::{ANCHOR, EVERYTHING, provisioned, refused};
use crate::support::Folder;

#[test]
fn a_missing_region_is_reported_once_and_only_for_nodes_that_transmit() {
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
fn a_network_to_listen_to_has_rounds() {
    for (said, rounds_hz) in [("listening\"", 10.0), ("listening\"\nrounds_hz = 6.25", 6.25)] {
        let text = EVERYTHING.replace("decaranging-fast\"", said).replace("b-wls-r", "track");
        let tag = provisioned(&text).run("provision --show records/tag.bin --json").ok().object();
        assert_eq!(tag["network"]["mode"], "listening");
        assert_eq!(tag["network"]["rounds_hz"], rounds_hz);
    }
}

#[test]
fn an_error_in_a_site_has_its_line() {
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
            "site.toml:4: region is \"europe\": it must be one of \"eu\", \"us\", \"japan\", \"china\", \"none\"",
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
        (
            "[1, 2.5, -0.5]",
            "[1,0, 2,5, -0,5]",
            "site.toml:12: position_m is [1,0, 2,5, -0,5]: it must be three numbers, [x, y, z], with decimal points",
        ),
        ("16_436", "0", "site.toml:11: antenna_delay_ticks is 0, which makes ranges 154 m too long: "),
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
        ("sleep = true", "sleep = yes", ":36: sleep is yes: it must be true or false, a number, or text in quotation"),
        (
            "height_m = 1.2",
            "height_m = 1.2\nheight_sigma_m = 3.5",
            ":34: height_sigma_m is 3.5: it must be 0.01 to 1, beside height_m",
        ),
        ("height_m = 1.2", "height_sigma_m = 0.3", ":33: height_sigma_m is 0.3: it must be 0.01 to 1, beside height_m"),
        (
            "[network]",
            "[area]\nx_m = [6, 0]\ny_m = [0, 4]\n[network]",
            ":3: x_m is [6, 0]: it must be the least and the greatest x_m, within 8388 m",
        ),
        ("[network]", "[area]\nx_m = [0, 6, 0, 4]\ny_m = [0, 4]\n[network]", ":3: x_m is [0, 6, 0, 4]: it must be two"),
        ("[[node]]\nname = \"tag\"", "[node]\nname = \"tag\"", ":28: there may be several of [node]: put it in two"),
        ("0.1, -0.7, 1e3", "0,1, -0,7, 1e3", ":61: position_m is [0,1, -0,7, 1e3]: it must be three numbers"),
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
fn positions_in_other_units_are_refused() {
    let site = |metre: f64| {
        let corners =
            [[0.0, 0.0, 2.4], [6.0, 0.0, 2.4], [6.0, 4.0, 2.4], [0.0, 4.0, 0.6]].map(|at| at.map(|c| c * metre));
        let anchor = |(number, at): (usize, [f64; 3])| {
            format!("[[node]]\nname = \"a{number}\"\nrole = \"anchor\"\naddress = {number}\nposition_m = {at:?}\n")
        };
        let anchors: String = corners.into_iter().enumerate().map(anchor).collect();
        Folder::with(&[("site.toml", &format!("[network]\npan = 1\nregion = \"eu\"\n{anchors}"))])
    };
    let run = "provision --config site.toml --all --board dwm1001 --out records";
    site(1.0).run(run).ok();
    for (metre, apart) in [(100.0, "400"), (1000.0, "4000")] {
        let folder = site(metre);
        let said =
            format!("site.toml:8: the nearest two anchors are {apart} m from each other, and ranges reach 300 m at");
        refused(&folder.run(run), &said);
        assert_eq!(folder.names(), ["site.toml"]);
    }
}

#[test]
fn the_origin_alone_is_a_site_without_nodes() {
    let origin = "[geographic_origin]\nlatitude_deg = 40.3\nlongitude_deg = -3.7\ny_azimuth_deg = 0\n";
    let folder = Folder::with(&[("site.toml", origin)]);
    refused(&folder.run("provision --config site.toml --all --out records"), "site.toml: there is no [[node]]");
    // Names of it can be read, though there are none.
    folder.write("anchors.csv", b"anchor,x_m,y_m,z_m\na,0,0,2\nb,6,0,2\nc,0,6,2\n");
    folder.write("ranges.csv", b"epoch,t_s,anchor,range_m\n0,0,a,4\n0,0,b,4\n0,0,c,4\n");
    folder.run("solve --anchors anchors.csv --ranges ranges.csv --dims 2 --height-m 1 --site site.toml").ok();
}

#[test]
fn a_tags_record_has_24_beacons_at_most() {
    let beacons: String =
        (0..25).map(|n| format!("[[beacon]]\nmajor = 9\nminor = {n}\nposition_m = [0, 0, 0]\n")).collect();
    let folder = Folder::with(&[("site.toml", &format!("{EVERYTHING}{beacons}"))]);
    // The list has one beacon already, and each of these has four lines: the beacon with minor 23 is the 25th.
    let lines = EVERYTHING.lines().count();
    let run = folder.run("provision --config site.toml --all --out records");
    refused(&run, &format!("site.toml:{}: a tag's record holds 24 beacons, and this is one more", lines + 1 + 23 * 4));
}

#[test]
fn a_site_of_receivers_has_nothing_to_provision() {
    let folder = Folder::with(&[("site.toml", "[[receiver]]\nname = \"hall\"\nposition_m = [0, 0, 2]\n")]);
    refused(&folder.run("provision --config site.toml --all --out records"), "site.toml: there is no [[node]]");
    assert_eq!(folder.names(), ["site.toml"]);
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
        (
            site("key = \"000102030405060708090a0b0c0d0e0f\"", low, ""),
            "site.toml:3: key is the one that is printed in the examples: make one",
        ),
        (
            site("mode = \"decaranging\"\nkey = \"100102030405060708090a0b0c0d0e0f\"", low, ""),
            "site.toml:4: key is given: it must be absent in mode decaranging, whose frames have no code",
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
fn sites_with_a_probable_mistake_get_a_warning() {
    let anchor = |number: u8, position: &str| {
        format!("[[node]]\nname = \"a{number}\"\nrole = \"anchor\"\naddress = {number}\n{position}\n")
    };
    let tag = |height: &str| format!("[[node]]\nname = \"t\"\nrole = \"tag\"\naddress = 99\n{height}\n");
    let beacon = "[[node]]\nname = \"b\"\nrole = \"beacon\"\nuuid = \"c2a8ad558a2f4bb49c526b3cd7a0e511\"\nmajor = 1\nminor = 1\n";
    let corners = ["[0, 0, 2.4]", "[6, 0, 2.4]", "[6, 4, 2.4]", "[0, 4, 2.4]"].map(|at| format!("position_m = {at}"));
    let flat: String = (1..).zip(&corners).map(|(number, position)| anchor(number, position)).collect();
    let steep = flat.replace("[0, 4, 2.4]", "[0, 4, 0.6]");
    let line = steep.replace(", 4, ", ", 0.05, ").replace("[6, 0.05", "[3, 0.05").replace("[0, 0.05", "[4, 0.05");
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
        (
            anchor(1, &corners[0]) + &anchor(2, &corners[1]) + &anchor(3, &corners[2]) + &tag(""),
            Some("there are only 3 anchors, but t needs the ranges of 4: give it the height"),
        ),
        (anchor(1, &corners[0]) + &anchor(2, &corners[1]) + &anchor(3, &corners[2]) + &tag("height_m = 1.2"), None),
        (
            steep.clone() + &anchor(5, "") + &tag(""),
            Some("no position_m of a5: tags do not use ranges to an anchor without one, measure where a5 is"),
        ),
        (steep.clone() + &anchor(5, "") + &tag("") + "[[anchor]]\naddress = 5\nposition_m = [3, 0, 2]\n", None),
        (line.clone() + &tag(""), Some("the anchors lie nearly on one line, so that each position has a mirror image")),
        (line + &tag("") + "[area]\nx_m = [0, 6]\ny_m = [0, 4]\n", None),
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
