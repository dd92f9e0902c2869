//! `--site`: the names of nodes, beacons and rooms; and one spelling of addresses.

use std::collections::BTreeSet;

use wire::telemetry::{
    BeaconId, Board, Condition, Hello, Message, Role, Room, RoomEstimate, RoomProbability, Sighting, State,
};

use crate::messages::{difference, range, stream};
use crate::support::Folder;

const KEY: &str = "00112233445566778899aabbccddeeff";

/// Two anchors, one of which does not know its position, a tag and a beacon.
const SITE: &str = r#"
[network]
pan = 0xBA11
region = "eu"
mode = "native"
channel = 5
prf_mhz = 64
rate_kbps = 6810
preamble_symbols = 128
beacon_key = "00112233445566778899aabbccddeeff"
key = "00112233445566778899aabbccddeeff"

[[node]]
name = "door"
board = "dwm1001"
role = "anchor"
address = 0x0101

[[node]]
name = "window"
board = "dwm1001"
role = "anchor"
address = 0x0102
position_m = [6.0, 0.5, 2.4]

[[node]]
name = "trolley"
board = "dwm1001"
role = "tag"
address = 0x0201
scan_interval_ms = 100

[[node]]
name = "shelf"
board = "esp32c3"
role = "beacon"
uuid = "c2a8ad55-8a2f-4bb4-9c52-6b3cd7a0e511"
major = 1
minor = 7
position_m = [3.0, 2.0, 2.4]
"#;

/// The tag's telemetry of half a second.
fn sent() -> Vec<Message> {
    let eui = 0x1020_5F12_3456_7890;
    let beacon = BeaconId { network: 0xC2A8_AD55, major: 1, minor: 7 };
    let likely = |room, probability_255ths| RoomProbability { room, probability_255ths };
    vec![
        Message::Hello(Hello {
            t_us: 100_000,
            eui,
            address: 0x0201,
            role: Role::Tag,
            board: Board::Dwm1001,
            build: [1; 8],
            keyed: false,
        }),
        Message::State(State { t_us: 200_000, is: Condition::Synchronised(0x0101) }),
        range(400_000, 0x0102).into(),
        range(400_000, 0x0103).into(),
        difference(400_000, 0x0101, 0x0101).into(),
        difference(400_000, 0x0101, 0x0102).into(),
        Message::Sighting(Sighting { t_us: 450_000, beacon, rssi_dbm: -67, measured_power_dbm: -59 }),
        Message::Room(Room { t_us: 500_000, is: RoomEstimate::Between([likely(0, 204), likely(1, 51)]) }),
    ]
}

fn text(folder: &Folder, file: &str) -> String {
    String::from_utf8(folder.read(file)).expect("text")
}

#[test]
fn monitor_shows_names_beside_addresses() {
    let folder = Folder::with(&[("site.toml", SITE)]);
    folder.write("telemetry.bin", &stream(&sent()));
    let run = folder.run("monitor --file telemetry.bin --site site.toml").ok();
    for line in [
        "hello tag trolley (0x0201) on dwm1001",
        "state synchronised with the network of door (0x0101)\n",
        "range window (0x0102) 4.500 ±0.030 m",
        "range 0x0103 4.500 ±0.030 m",
        "tdoa  door (0x0101) polls",
        "tdoa  window (0x0102) -1.234 ±0.030 m from door (0x0101)",
        "ble   shelf (c2a8ad55-1-7) -67 dBm",
        // The site has no model of rooms.
        "room  0 (80 %) or 1 (20 %)\n",
    ] {
        assert!(run.stdout.contains(line), "{line}\n{}", run.stdout);
    }
    // The keys of a program are the addresses, with names or without.
    for format in ["jsonl", "csv --table ranges"] {
        let run = |more: &str| folder.run(&format!("monitor --file telemetry.bin --format {format}{more}")).ok().stdout;
        assert_eq!(run(""), run(" --site site.toml"));
    }
}

#[test]
fn rooms_have_the_names_of_the_sender() {
    let known = "[[known]]\nname = \"trolley\"\naddress = \"0x0201\"\nrooms = [\"kitchen\", \"entrance hall\"]\n";
    let of =
        |other: &str| format!("{known}\n[[known]]\nname = \"cart\"\naddress = \"0x0202\"\nrooms = [\"{other}\"]\n");
    let folder = Folder::with(&[("site.toml", &of("attic"))]);
    let room = sent().pop().expect("a room");
    folder.write("both.bin", &stream(&sent()));
    folder.write("room.bin", &stream(&[room]));
    let shown = |file: &str| folder.run(&format!("monitor --file {file} --site site.toml")).ok().stdout;
    assert!(shown("both.bin").ends_with("room  kitchen (80 %) or entrance hall (20 %)\n"));
    // The sender is not known, and tags have different rooms.
    assert!(shown("room.bin").ends_with("room  0 (80 %) or 1 (20 %)\n"));
    folder.write("site.toml", known.as_bytes());
    assert!(shown("room.bin").ends_with("room  kitchen (80 %) or entrance hall (20 %)\n"));
}

#[test]
fn a_recording_has_names_and_places_of_its_site_but_no_keys() {
    let origin = "[geographic_origin]\nlatitude_deg = 40.332\nlongitude_deg = -3.766\ny_azimuth_deg = 12.5\n";
    let receiver = "[[receiver]]\nname = \"hall\"\nposition_m = [1.0, 2.5, 2.0]\nrssi_1m_dbm = -61.0\n\n";
    let folder = Folder::with(&[("site.toml", &format!("{SITE}{receiver}{origin}"))]);
    folder.write("telemetry.bin", &stream(&sent()));
    let run = folder.run("record --file telemetry.bin --site site.toml --out walk").ok();
    assert!(run.stderr.contains("node: tag trolley (0x0201) on dwm1001"), "{}", run.stderr);
    // No anchor and no site gives the position of 0x0103.
    assert!(run.stderr.contains("left out: 1 ranges to 0x0103, whose positions are unknown"), "{}", run.stderr);
    assert_eq!(text(&folder, "walk/anchors.csv"), "anchor,x_m,y_m,z_m\n0x0102,6.0000,0.5000,2.4000\n");
    let copy = text(&folder, "walk/site.toml");
    assert_eq!(
        copy.split_once("\n\n").map(|(_, tables)| tables),
        Some(format!(
            "[[known]]\nname = \"door\"\naddress = \"0x0101\"\n\n\
             [[known]]\nname = \"window\"\naddress = \"0x0102\"\nposition_m = [6.0, 0.5, 2.4]\n\n\
             [[known]]\nname = \"trolley\"\naddress = \"0x0201\"\n\n\
             [[known]]\nname = \"shelf\"\nbeacon = \"1-7\"\nposition_m = [3.0, 2.0, 2.4]\n\
             rssi_1m_dbm = -59.0\n\n\
             [[known]]\nreceiver = \"hall\"\nposition_m = [1.0, 2.5, 2.0]\nrssi_1m_dbm = -61.0\n\n{origin}"
        ))
        .as_deref(),
        "{copy}"
    );
    assert!(!copy.contains(KEY) && !copy.contains("key =") && !copy.contains("pan"), "{copy}");
    // The folder names its nodes.
    for command in ["monitor --file walk", "decode walk", "replay walk --speed 1000000", "record --finish walk"] {
        let run = folder.run(command).ok();
        assert!((run.stdout + &run.stderr).contains("tag trolley (0x0201)"), "{command}");
    }
    let positions = "anchor,x_m,y_m,z_m\n258,1,2,3\n";
    folder.write("surveyed.csv", positions.as_bytes());
    folder.run("record --file walk --anchors surveyed.csv --out again").ok();
    assert_eq!(text(&folder, "again/anchors.csv"), "anchor,x_m,y_m,z_m\n0x0102,1.0000,2.0000,3.0000\n");
    assert_eq!(text(&folder, "again/site.toml"), copy);
}

#[test]
fn the_users_own_site_file_in_a_folder_stays() {
    let folder = Folder::with(&[("names.toml", "[[known]]\nname = \"other\"\naddress = \"0x0102\"\n")]);
    folder.write("telemetry.bin", &stream(&sent()));
    std::fs::create_dir(folder.path("walk")).expect("made");
    folder.write("walk/site.toml", SITE.as_bytes());
    folder.run("record --file telemetry.bin --site names.toml --out walk").ok();
    assert_eq!(text(&folder, "walk/site.toml"), SITE);
}

#[test]
fn a_wrong_site_file_is_refused_with_its_line() {
    let folder = Folder::with(&[
        ("site.toml", &SITE.replace("role = \"tag\"", "role = \"tug\"")),
        ("copy.toml", "[[known]]\naddress = \"0x10000\"\n"),
        (
            "origin.toml",
            "[[known]]\naddress = \"0x0100\"\n\n\
             [geographic_origin]\nlatitude_deg = 151.2\nlongitude_deg = -33.9\ny_azimuth_deg = 0\n",
        ),
    ]);
    folder.write("telemetry.bin", &stream(&sent()));
    for (file, said) in [
        ("site.toml", "site.toml:29: "),
        ("copy.toml", "copy.toml:2: \"0x10000\" is not an address"),
        ("origin.toml", "origin.toml:4: latitude_deg = 151.2 is not between -90 and 90"),
    ] {
        let run = folder.run(&format!("monitor --file telemetry.bin --site {file}"));
        assert!(run.code == Some(2) && run.stderr.starts_with(said), "{run:?}");
    }
}

#[test]
fn pictures_and_summaries_show_names_and_files_keep_keys() {
    let anchors = "anchor,x_m,y_m,z_m\n257,0,0,2\n0x0102,6,0,2\n0x0103,6,4,2\n0x0104,0,4,1\n";
    // The tags are at (3, 2, 0) m and at (0, 0, 0) m; addresses are spelled in two ways.
    let ranges: String = [
        ("0x0201", [17.0_f64.sqrt(), 17.0_f64.sqrt(), 17.0_f64.sqrt(), 14.0_f64.sqrt()]),
        ("514", [2.0, 40.0_f64.sqrt(), 56.0_f64.sqrt(), 17.0_f64.sqrt()]),
    ]
    .iter()
    .flat_map(|(tag, ranges_m)| {
        let anchors = ["0x0101", "258", "0x0103", "0x0104"];
        anchors.into_iter().zip(ranges_m).map(move |(anchor, range_m)| format!("0,0.5,{anchor},{range_m},{tag}\n"))
    })
    .collect();
    let folder = Folder::with(&[("site.toml", SITE)]);
    std::fs::create_dir(folder.path("walk")).expect("made");
    folder.write("walk/anchors.csv", anchors.as_bytes());
    folder.write("walk/ranges.csv", format!("epoch,t_s,anchor,range_m,tag\n{ranges}").as_bytes());
    folder.write("walk/truth.csv", b"epoch,t_s,x_m,y_m,z_m,tag\n0,0.5,3,2,0,513\n0,0.5,0,0,0,514\n");

    let run = folder.run("solve walk --site site.toml --residuals --plot solved.svg").ok();
    assert_eq!(run.column("tag"), ["0x0201", "514"]);
    // The truth's tag 513 is 0x0201.
    assert!(run.numbers("error_m").iter().all(|error_m| *error_m < 0.01), "{}", run.stdout);
    for name in ["robust           trolley  ", "robust           514  ", "\ndoor  ", "\nwindow  ", "\n0x0103  "] {
        assert!(run.stderr.contains(name), "{name:?}\n{}", run.stderr);
    }
    let json = folder.run("solve walk --site site.toml --json").ok().json();
    assert_eq!((&json[0]["tag"], &json[1]["tag"]), (&"0x0201".into(), &"514".into()));

    // The folder's own file does as well as the flag.
    folder.write("walk/site.toml", SITE.as_bytes());
    folder.run("plot walk --out plotted.svg").ok();
    for picture in ["solved.svg", "plotted.svg"] {
        let svg = text(&folder, picture);
        for name in ["\ntrolley\n", "\ndoor\n", "\nwindow\n", "\n0x0103\n"] {
            assert!(svg.contains(name), "{picture}: {name:?}");
        }
        assert!(!svg.contains("0x0201") && !svg.contains("0x0102") && !svg.contains("\n257\n"), "{picture}");
    }
}

#[test]
fn an_address_is_spelled_alike_everywhere() {
    let folder = Folder::with(&[]);
    folder.run("simulate --tags 2 --anchors 4 --seconds 1 --out run --force").ok();
    let column = |file: &str, name: &str| -> BTreeSet<String> {
        let mut reader = csv::Reader::from_path(folder.path(file)).expect("a table");
        let at = reader.headers().expect("a header").iter().position(|column| column == name).expect("a column");
        reader.records().map(|row| row.expect("a row")[at].to_owned()).collect()
    };
    let anchors = BTreeSet::from(["0x0001", "0x0002", "0x0003", "0x0004"].map(str::to_owned));
    let tags = BTreeSet::from(["0x1001", "0x1002"].map(str::to_owned));
    assert_eq!(
        [column("run/anchors.csv", "anchor"), column("run/ranges.csv", "anchor")],
        [anchors.clone(), anchors.clone()]
    );
    assert_eq!([column("run/truth.csv", "tag"), column("run/positions.csv", "tag")], [tags.clone(), tags]);
    assert!(folder.path("run/telemetry-0x1002.bin").exists() && folder.path("run/telemetry-0x0001.bin").exists());

    let run = folder.run("decode run/telemetry-0x1002.bin").ok();
    assert!(run.stderr.contains("node: tag 0x1002 on simulated"), "{}", run.stderr);
    let messages: Vec<serde_json::Value> =
        run.stdout.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    let of = |kind: &str, key: &str| -> BTreeSet<String> {
        let messages = messages.iter().filter(|message| message["type"] == kind);
        messages.map(|message| message[key].as_str().expect("text").to_owned()).collect()
    };
    assert_eq!(of("range", "peer"), anchors);
    assert_eq!(of("hello", "address"), BTreeSet::from(["0x1002".to_owned()]));

    folder.run("record --file run/telemetry-0x1002.bin --out walk").ok();
    assert_eq!([column("walk/anchors.csv", "anchor"), column("walk/ranges.csv", "anchor")], [anchors.clone(), anchors]);
    let shown = folder.run("monitor --file run/telemetry-0x1002.bin").ok().stdout;
    assert!(shown.contains("hello tag 0x1002 on simulated") && shown.contains("range 0x0004 "), "{shown}");
}
