//! An RSSI map and a model of rooms, from a survey into the flash of a tag, by `baliza provision` and in `baliza
//! simulate`.

use positioning_core::ble::fingerprint::{Point, encode};

use crate::support::{Folder, TWO_ROOMS};

/// Two rooms of three points, with ten adverts from each of the beacons 1-7 and 1-8. Their RSSI values decrease towards
/// the other room.
fn survey() -> String {
    let mut text = String::from("point,room,x_m,y_m,beacon,rssi_dbm,t_s\n");
    for (point, room, x, levels) in TWO_ROOMS {
        for advert in 0..10 {
            for (beacon, level) in ["1-7", "1-8"].iter().zip(levels) {
                text += &format!("{point},{room},{x},{},{beacon},{},{advert}\n", x % 2, level + advert % 3 - 1);
            }
        }
    }
    text
}

const MODELS: &str = "fingerprint_map = \"flat.map\"\nroom_model = \"flat.rooms\"\n";

/// A tag with these lines from line 8 on, and a beacon for each major and minor number.
fn site(lines: &str, beacons: &[(u16, u16)]) -> String {
    let head = "[network]\npan = 0xBA11\n\n[[node]]\nname = \"t\"\nboard = \"dwm1001\"\nrole = \"tag\"\n";
    let listed = |(major, minor): &(u16, u16)| {
        format!("\n[[beacon]]\nmajor = {major}\nminor = {minor}\nposition_m = [0.0, 0.0, 2.0]\n")
    };
    format!("{head}{lines}{}", beacons.iter().map(listed).collect::<String>())
}

/// A tag with a scan and a height.
fn scanning(lines: &str) -> String {
    format!("{lines}scan_interval_ms = 100\nheight_m = 1.2\n")
}

fn folder() -> Folder {
    let folder = Folder::with(&[("f.csv", &survey())]);
    folder.run("ble map --fingerprints f.csv --out flat.map").ok();
    folder.run("ble map --fingerprints f.csv --surveyed --out points.map").ok();
    folder.run("ble rooms --fingerprints f.csv --out flat.rooms").ok();
    folder
}

#[test]
fn a_map_and_rooms_go_beside_the_record_of_a_tag() {
    let folder = folder();
    folder.write("site.toml", site(&scanning(MODELS), &[(1, 7), (1, 8), (2, 9)]).as_bytes());
    for (format, file) in [("bin", "t.bin"), ("hex", "t.hex")] {
        let run = folder.run(&format!("provision --config site.toml --format {format} --out {file} --json")).ok();
        assert_eq!(run.json()[0]["flash_address"], 0x7C000);
        let run = folder.run(&format!("provision --show {file}")).ok();
        assert!(run.stdout.contains("\n# room_model: 2 rooms: hall, attic; beacons 1-7, 1-8\n"), "{}", run.stdout);
        let map = run.stdout.lines().find(|line| line.starts_with("# fingerprint_map: ")).expect("a map");
        assert!(map.ends_with(" m; beacons 1-7, 1-8"), "{map}");
        let json = folder.run(&format!("provision --show {file} --json")).ok().object();
        assert_eq!(json["room_model"], "2 rooms: hall, attic; beacons 1-7, 1-8");
        let run = folder.run(&format!("provision --check {file}")).ok();
        assert!(run.stdout.contains(", with a map and rooms; version 2"), "{}", run.stdout);
    }
    // The map is unchanged, after 16 bytes of the header, `some`, and two beacons with their length.
    let (file, map) = (folder.read("t.bin"), folder.read("flat.map"));
    assert_eq!((file.len(), &file[..4], &file[8192..8196]), (16_384, &b"BLZB"[..], &b"BLZR"[..]));
    assert_eq!(file[16..26], [1, 8, 1, 0, 7, 0, 1, 0, 8, 0]);
    let length = if map.len() < 128 { 1 } else { 2 };
    assert_eq!(file[26 + length..][..map.len()], map);

    let mut damaged = file;
    damaged[100] ^= 1;
    folder.write("damaged.bin", &damaged);
    let run = folder.run("provision --check damaged.bin");
    let said = "damaged.bin: the record is whole, but beside it is damaged models of beacons";
    assert_eq!((run.code, run.stderr.trim_end()), (Some(2), said));
    let run = folder.run("provision --show damaged.bin").ok();
    assert!(run.stdout.contains("# fingerprint_map: none: damaged models of beacons"), "{}", run.stdout);
}

#[test]
fn what_a_tag_cannot_use_is_refused_with_its_line() {
    let folder = folder();
    let both = &[(1, 7), (1, 8)];
    folder.write("short.map", &folder.read("flat.map")[..50]);
    let refused = |text: &str, said: &str| {
        folder.write("site.toml", text.as_bytes());
        let run = folder.run("provision --config site.toml --out x.bin");
        assert_eq!((run.code, run.stderr.trim_end()), (Some(2), said), "{text}");
    };
    let map = |file: &str| site(&scanning(&format!("fingerprint_map = \"{file}\"\n")), both);
    refused(&map("short.map"), "site.toml:8: fingerprint_map: short.map: a damaged map");
    refused(&map("f.csv"), "site.toml:8: fingerprint_map: f.csv: not a map of levels");
    refused(
        &map("points.map"),
        "site.toml:8: fingerprint_map: points.map: a map of surveyed points: a tag needs a lattice, made without --surveyed",
    );
    refused(
        &site(MODELS, both),
        "site.toml:8: fingerprint_map without scan_interval_ms: the tag does not listen to beacons",
    );
    refused(
        &site(&format!("{MODELS}scan_interval_ms = 100\n"), both),
        "site.toml:8: fingerprint_map without height_m: beacons give positions in the plane, at the height at which a tag is carried",
    );
    refused(
        &site(&scanning(MODELS), &[(1, 7)]),
        "site.toml:8: fingerprint_map has beacon 8, which is not in the tag's record: list it as [[beacon]]",
    );
    refused(
        &site(&scanning(MODELS), &[(1, 7), (1, 8), (2, 8)]),
        "site.toml:8: fingerprint_map has beacon 8, and the tag's record has two with that minor: change one",
    );
    refused(
        &site(&scanning("room_model = \"flat.rooms\"\n"), &[(2, 7), (1, 8)]),
        "site.toml:8: room_model has beacon 1-7, which is not in the tag's record: list it as [[beacon]]",
    );
    folder.run("ble rooms --fingerprints f.csv --method knn --out knn.rooms").ok();
    refused(
        &site(&scanning("room_model = \"knn.rooms\"\n"), both),
        "site.toml:8: room_model: knn.rooms: a model of the nearest fingerprints: a tag needs a support vector machine, made by --method svm",
    );
    refused(&site(&scanning("room_model = \"flat.map\"\n"), both), "site.toml:8: room_model: flat.map: not a model");
    let point = |index: usize| Point {
        position_m: [(index / 20) as f64, (index % 20) as f64],
        rssis: &[Some(-60.0), Some(-70.0)],
        deviations: &[3.0, 3.0],
    };
    let points: Vec<Point> = (0..201).map(point).collect();
    let mut buffer = [0; 4096];
    folder.write("large.map", encode(&points, &[7, 8], &[-90.0; 2], Some(1.0), &mut buffer).expect("it fits"));
    refused(&map("large.map"), "site.toml:8: fingerprint_map: large.map: a map of 201 points: a tag has time for 200");
}

#[test]
fn a_scenario_is_surveyed_and_its_tags_get_what_comes_of_it() {
    let beacon = |at: &str| format!("[[node]]\nrole = \"beacon\"\nposition_m = [{at}, 2]\n");
    let tag = "[[node]]\nrole = \"tag\"\nheight_m = 1.2\nscan_interval_ms = 1000\n";
    let simulation = "simulation = { path_m = [[1, 3, 1.2]] }\n[simulation]\nseconds = 5\nfidelity = \"air\"\n";
    let text = &(["0, 0", "4, 0", "4, 4", "0, 4"].map(beacon).concat() + tag + simulation);
    let outlines =
        "room,x_m,y_m\nwest,-1,-1\nwest,2,-1\nwest,2,5\nwest,-1,5\neast,2,-1\neast,3.5,-1\neast,3.5,5\neast,2,5\n";
    let folder = Folder::with(&[("s.toml", text), ("o.csv", outlines)]);
    let survey = "simulate --scenario s.toml --survey f.csv --survey-step-m 2 --survey-dwell-s 3 --survey-rooms o.csv";
    folder.run(survey).ok();
    let stays = String::from_utf8(folder.read("f.csv")).expect("text");
    assert!(stays.starts_with("point,room,x_m,y_m,beacon,rssi_dbm,t_s\n"));
    // Of nine points, three have x = 4, which is in no room.
    let points: std::collections::BTreeSet<_> =
        stays.lines().skip(1).map(|row| row.split(',').take(4).collect::<Vec<_>>().join(",")).collect();
    assert_eq!(points.len(), 6, "{points:?}");
    assert!(points.contains("p0,west,0.000,0.000") && points.contains("p5,east,2.000,4.000"), "{points:?}");
    // Four beacons, ten adverts a second, three seconds at six points, and one third of the channels received.
    let rows = stays.lines().count();
    assert!((500..1000).contains(&rows), "{rows}");
    folder.run("ble map --fingerprints f.csv --points 20 --out s.map").ok();
    folder.run("ble rooms --fingerprints f.csv --out s.rooms").ok();
    let with = |lines: &str| text.replace("scan_", &format!("{lines}\nscan_"));
    folder.write("s.toml", with("fingerprint_map = \"s.map\"\nroom_model = \"s.rooms\"").as_bytes());
    let json = folder.run("simulate --scenario s.toml --json").ok().object();
    assert!(json["bluetooth"]["by_beacons"]["fixes"].as_u64() > Some(6), "{json}");

    let refused = |text: &str, said: &str| {
        folder.write("s.toml", text.as_bytes());
        let run = folder.run("simulate --scenario s.toml --json");
        assert_eq!((run.code, run.stderr.trim_end()), (Some(2), said), "{text}");
    };
    refused(&with("fingerprint_map = \"s.rooms\""), "s.toml:16: fingerprint_map: s.rooms: not a map of levels");
    refused(
        &with("fingerprint_map = \"s.map\"").replacen("[4, 4, 2]", "[4, 4, 2]\nminor = 9", 1),
        "s.toml:17: fingerprint_map has beacon 3, which is not in the tag's record: list it as [[beacon]]",
    );
}
