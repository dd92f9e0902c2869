//! What `baliza decode`, `monitor`, `record` and `replay` have in common: the same streams, and the same errors.

use rand::{RngCore, SeedableRng};
use rand_pcg::Pcg64Mcg;
use serde_json::Value;
use wire::telemetry::{Difference, Message, Room, RoomEstimate, RoomProbability};

use crate::messages::{difference, frame, stream, walk, walk_folder};
use crate::support::Folder;

/// The telemetry of a tag about a round that it received without taking part: the poll of anchor 257, and that 258 is
/// 1.2345 m nearer.
fn received_round() -> Vec<Message> {
    let at = |peer, position| {
        let position_tenth_mm = Some(position);
        Message::Difference(Difference { round: 300, position_tenth_mm, ..difference(12_345_600, 257, peer) })
    };
    vec![at(257, [10_000, 20_000, 24_000]), at(258, [0, -125_000, 24_000])]
}

#[test]
fn what_a_listening_tag_measured_is_shown_tabled_and_recorded() {
    let folder = Folder::with(&[]);
    folder.write("tdoa.bin", &stream(&received_round()));
    let run = folder.run("decode --file tdoa.bin").ok();
    let lines: Vec<Value> = run.stdout.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    assert_eq!(
        (&lines[1]["type"], &lines[1]["reference"], &lines[1]["peer"]),
        (&"difference".into(), &"0x0101".into(), &"0x0102".into())
    );
    assert_eq!((&lines[1]["difference_m"], &lines[1]["peer_y_m"]), (&(-1.2345).into(), &(-12.5).into()));
    assert!(run.stderr.contains("2 difference"), "{}", run.stderr);
    let run = folder.run("decode --file tdoa.bin --format csv --table differences").ok();
    assert_eq!(
        (run.column("anchor"), run.column("difference_m")),
        (vec!["0x0101", "0x0102"], vec!["0.0000", "-1.2345"])
    );
    assert_eq!((run.column("reference"), run.column("rx_power_dbm")), (vec!["0x0101"; 2], vec!["-79.25"; 2]));
    folder.run("record --file tdoa.bin --out walk").ok();
    let text = |name: &str| String::from_utf8(folder.read(name)).expect("text");
    assert!(text("walk/anchors.csv").contains("0x0102,0.0000,-12.5000,2.4000"));
    assert_eq!(text("walk/differences.csv").lines().count(), 3);
}

#[test]
fn rooms_are_shown_tabled_and_recorded() {
    let [hall, attic] =
        [RoomProbability { room: 0, probability_255ths: 255 }, RoomProbability { room: 1, probability_255ths: 102 }];
    let at = |t_us, is| Message::Room(Room { t_us, is });
    let sent = [
        at(500_000, RoomEstimate::Unknown),
        at(1_000_000, RoomEstimate::Room(hall)),
        at(2_000_000, RoomEstimate::Between([hall, attic])),
    ];
    let folder = Folder::with(&[]);
    folder.write("rooms.bin", &stream(&sent));
    let run = folder.run("decode --file rooms.bin").ok();
    let lines: Vec<Value> = run.stdout.lines().map(|line| serde_json::from_str(line).expect("JSON")).collect();
    assert_eq!(
        lines[1],
        serde_json::json!({"type": "room", "t_s": 1.0, "is": "room", "rooms": [0], "probabilities": [1.0]})
    );
    assert_eq!((&lines[0]["rooms"], &lines[2]["rooms"]), (&serde_json::json!([]), &serde_json::json!([0, 1])));
    assert!(run.stderr.contains("3 room"), "{}", run.stderr);
    let run = folder.run("decode --file rooms.bin --format csv --table rooms").ok();
    assert_eq!((run.column("is"), run.column("room")), (vec!["unknown", "room", "between"], vec!["", "0", "0"]));
    assert_eq!((run.column("other_room"), run.column("other_probability")), (vec!["", "", "1"], vec!["", "", "0.400"]));
    let run = folder.run("monitor --file rooms.bin").ok();
    assert!(run.stdout.contains("0 (100 %) or 1 (40 %)"), "{}", run.stdout);
    let run = folder.run("record --file rooms.bin --out walk").ok();
    assert!(run.stderr.contains("recorded: 3 times in which room"), "{}", run.stderr);
    assert_eq!(String::from_utf8(folder.read("walk/rooms.csv")).expect("text").lines().count(), 4);
}

#[test]
fn random_bytes_are_counted_around_a_frame_and_refused_without_one() {
    let mut noise = vec![0; 1 << 20];
    Pcg64Mcg::seed_from_u64(2).fill_bytes(&mut noise);
    let folder = Folder::with(&[]);
    folder.write("noise.bin", &noise);
    let said = "noise.bin: this is no telemetry: there is no frame in 1048576 bytes\n";
    for command in [
        "decode noise.bin",
        "decode noise.bin --format csv --out a.csv",
        "replay noise.bin",
        "record --file noise.bin --out walk",
    ] {
        let run = folder.run(command);
        assert_eq!((run.code, run.stdout.as_str(), run.stderr.as_str()), (Some(2), "", said), "{command}");
    }
    assert_eq!(folder.names(), ["noise.bin", "walk"]);
    assert_eq!(std::fs::read_dir(folder.path("walk")).expect("a folder").count(), 0);
    folder.write("noise.bin", &[&noise[..], &[0], &frame(&walk()[0])].concat());
    let json = folder.run("decode --file noise.bin --json").ok().object();
    assert_eq!(json["frames"]["total"], 1);
    // One zero in 256 bytes ends a chunk: about four thousand chunks, of which few are too long.
    assert!((3000..5000).contains(&json["malformed"]["total"].as_u64().expect("a count")), "{json}");
    for key in ["total", "too_long", "cobs", "checksum"] {
        assert!(json["malformed"][key].as_u64() > Some(0), "{key} in {json}");
    }
    folder.write("empty.bin", b"");
    assert_eq!(folder.run("decode --file empty.bin").ok().stderr, "0 frames in 0 bytes\n");
}

/// A file that can be opened, but not read.
#[cfg(target_os = "linux")]
#[test]
fn a_failure_to_read_leaves_no_file() {
    let folder = Folder::with(&[]);
    folder.write("out.jsonl", b"before");
    for command in ["decode --file /proc/self/mem --out out.jsonl", "record --file /proc/self/mem --out walk"] {
        let run = folder.run(command);
        let said = "baliza: cannot read /proc/self/mem: ";
        assert!(run.code == Some(1) && run.stdout.is_empty() && run.stderr.starts_with(said), "{run:?}");
    }
    assert_eq!(folder.names(), ["out.jsonl", "walk"]);
    assert_eq!(folder.read("out.jsonl"), b"before");
    assert_eq!(std::fs::read_dir(folder.path("walk")).expect("a folder").count(), 0);
}

#[test]
fn wrong_arguments_are_refused_in_one_line_and_nothing_is_written() {
    let folder = walk_folder();
    folder.write("file", b"");
    folder.write("named.csv", b"anchor,x_m,y_m,z_m\nA1,0,0,0\n");
    let cases = [
        ("decode --file none.bin", "none.bin: cannot open it: "),
        ("decode --file none.bin --out out.jsonl", "none.bin: cannot open it: "),
        ("decode --file walk.bin --stdin", "the argument '--file <FILE>' cannot be used with '--stdin'"),
        ("decode --file walk.bin --table ranges", "--table: only with --format csv\n"),
        ("decode --file walk.bin --format xml", "invalid value 'xml' for '--format <FORMAT>'"),
        ("decode --file walk.bin --out none/out.jsonl", "--out: the folder none does not exist\n"),
        ("record --file none.bin --out walk", "none.bin: cannot open it: "),
        ("record --file walk.bin --stdin --out walk", "the argument '--file <FILE>' cannot be used with '--stdin'"),
        ("record --file walk.bin --out file", "--out: file is not a folder\n"),
        (
            "record --file walk.bin --out walk --anchors named.csv",
            "--anchors: anchor \"A1\" is not named by its short address",
        ),
        ("replay walk.bin --speed 0", "invalid value '0' for '--speed <X>'"),
        ("replay none.bin", "none.bin: cannot open it: "),
        ("replay walk.bin --raw --format csv", "the argument '--raw' cannot be used with '--format <FORMAT>'"),
    ];
    let before = folder.names();
    for (arguments, said) in cases {
        let run = folder.run(arguments);
        assert_eq!((run.code, run.stdout.as_str()), (Some(2), ""), "{arguments}: {run:?}");
        assert!(run.stderr.starts_with(said) && run.stderr.lines().count() == 1, "{arguments}: {}", run.stderr);
    }
    assert_eq!(folder.names(), before);
}
