//! `baliza survey fingerprints` from a recorded stream.

use wire::telemetry::{BeaconId, Sighting};

use crate::messages::frame;
use crate::support::Folder;

/// One minute of two beacons with ten adverts a second each. The second beacon is silent from 32 to 38 s.
fn stream() -> Vec<u8> {
    let mut bytes = Vec::new();
    for advert in 0..600_u64 {
        for minor in [1, 2] {
            if minor == 2 && (320..380).contains(&advert) {
                continue;
            }
            let beacon = BeaconId { network: 0xB0, major: 7, minor };
            let rssi_dbm = -60 - (advert % 2) as i8 - 4 * minor as i8;
            let sighting = Sighting { t_us: advert * 100_000, beacon, rssi_dbm, measured_power_dbm: -59 };
            bytes.extend(frame(&sighting.into()));
        }
    }
    bytes
}

const POINTS: &str = "point,room,x_m,y_m,from_s\na,hall,1,2,5\nb,attic,3,4,30\nc,attic,5,4,45\nd,attic,6,4,55\n";

#[test]
fn stays_of_a_recording_are_taken_or_refused_and_the_file_only_grows() {
    let before = "point,x_m,y_m,beacon,rssi_dbm\nc,5,4,000000b0-7-1,-64\n";
    let folder = Folder::with(&[("points.csv", POINTS), ("f.csv", before)]);
    folder.write("telemetry.bin", &stream());
    let survey = "survey fingerprints --file telemetry.bin --points points.csv";
    let run = folder.run(&format!("{survey} --out f.csv --json")).ok();
    assert!(run.stderr.contains("in the file already, not visited again: c"), "{run:?}");
    assert!(run.stderr.contains("d: the recording ends before its stay does"), "{run:?}");
    let json = run.json();
    assert_eq!((&json[0]["point"], &json[0]["taken"], &json[0]["beacons"]), (&"a".into(), &true.into(), &2.into()));
    assert_eq!((&json[1]["point"], &json[1]["taken"]), (&"b".into(), &false.into()));
    assert_eq!(json[1]["reasons"][0], "000000b0-7-2 is silent for 6.1 s from 1.9 s on");
    let text = String::from_utf8(folder.read("f.csv")).expect("text");
    assert!(text.starts_with(before), "{text}");
    // Ten seconds of two beacons with ten adverts a second. The columns are those of the existing file.
    assert_eq!(text.lines().count(), 2 + 200);
    assert_eq!(text.lines().nth(2), Some("a,1,2,000000b0-7-1,-64"));

    // Again: only the refused point is left, and the file does not change.
    let json = folder.run(&format!("{survey} --out f.csv --json")).ok().json();
    assert_eq!((json.as_array().map(Vec::len), &json[0]["point"]), (Some(1), &"b".into()));
    assert_eq!(String::from_utf8(folder.read("f.csv")).expect("text"), text);

    // A new file can be read as fingerprints with rooms.
    folder.run(&format!("{survey} --out new.csv")).ok();
    let json = folder.run("ble rooms --fingerprints new.csv --targets new.csv --json").ok().object();
    assert_eq!((&json["rooms"], &json["points"]), (&serde_json::json!(["hall", "attic"]), &2.into()));
}

#[test]
fn an_error_is_reported_before_anything_is_written() {
    let folder = Folder::with(&[("points.csv", "point,x_m,y_m\na,1,2\n"), ("other.csv", "some,thing\n1,2\n")]);
    folder.write("telemetry.bin", &stream());
    let refused = |arguments: &str, said: &str| {
        let run = folder.run(arguments);
        assert_eq!(run.code, Some(2), "{run:?}");
        assert!(run.stderr.contains(said), "{run:?}");
    };
    let begin = "survey fingerprints --file telemetry.bin";
    refused(&format!("{begin} --points points.csv --out f.csv"), "point \"a\" has no from_s");
    refused(&format!("{begin} --points points.csv --out f.csv --seconds 5"), "--seconds: only with a live node");
    refused(&format!("{begin} --out f.csv"), "--points: is needed with a recording");
    refused(&format!("{begin} --points points.csv --out other.csv"), "other.csv:1: no column point in the header");
    assert_eq!(folder.names(), ["other.csv", "points.csv", "telemetry.bin"]);
}

#[test]
fn a_source_that_is_not_there_is_said_before_a_point_is_asked_for() {
    let folder = Folder::with(&[]);
    let run = folder.run("survey fingerprints --serial /dev/nosuch --out f.csv");
    assert_eq!(run.code, Some(2), "{run:?}");
    assert!(run.stderr.starts_with("--serial: no port /dev/nosuch: plug in the board"), "{run:?}");
    // This probe is not connected, whatever else is.
    let run = folder.run("survey fingerprints --probe ffff:ffff:nobody --out f.csv");
    assert!(run.code != Some(0) && !run.stderr.contains("which point"), "{run:?}");
    assert!(folder.names().is_empty(), "{:?}", folder.names());
}
