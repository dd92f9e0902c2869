//! `baliza station`: back-up, restoring, export.

use crate::serve::{Station, recorded};
use crate::support::{Folder, Run, root};

/// A folder with the store `tags.db` of a station that has played the recording `run`. Returns the positions of the
/// recording as its file has them: x and y, metres.
pub fn with_store() -> (Folder, Vec<[f64; 2]>) {
    with_store_of("")
}

/// The same with more flags of `serve`.
fn with_store_of(flags: &str) -> (Folder, Vec<[f64; 2]>) {
    let folder = Folder::with(&[("rooms.csv", "room,x_m,y_m\nhall,-5,-5\nhall,30,-5\nhall,30,30\nhall,-5,30\n")]);
    let positions = recorded(&folder, 4);
    let station = Station::start(&folder, &format!("run --store tags.db --rooms rooms.csv {flags}"));
    let path = "/api/v1/tags/0x1001/positions?site=site&limit=1000";
    station.wait(path, |history| history.as_array().is_some_and(|rows| rows.len() >= positions.len()));
    // It works while the station runs.
    folder.run("station backup --store tags.db --out running.db").ok();
    let (code, said) = station.stop();
    assert_eq!(code, Some(0), "{said}");
    (folder, positions)
}

fn table(folder: &Folder, name: &str) -> Run {
    Run { code: Some(0), stdout: String::from_utf8(folder.read(name)).expect("UTF-8"), stderr: String::new() }
}

/// Asserts that an export has the positions of the recording, to a millimetre. A round without a position, which is in
/// an export with measurements, is a row with a reason.
fn assert_exported(folder: &Folder, name: &str, positions: &[[f64; 2]]) {
    let table = table(folder, &format!("{name}/positions.csv"));
    let reasons = table.column("reason");
    let rows = table.numbers("x_m").into_iter().zip(table.numbers("y_m"));
    let (with, without): (Vec<_>, Vec<_>) = rows.zip(&reasons).partition(|(_, reason)| reason.is_empty());
    assert!(without.iter().all(|((x, y), _)| x.is_nan() && y.is_nan()), "{}", table.stdout);
    let exported: Vec<_> = with.into_iter().map(|(at, _)| at).collect();
    assert_eq!(exported.len(), positions.len());
    for ((x, y), [x_m, y_m]) in exported.into_iter().zip(positions) {
        assert!((x - x_m).abs() < 1.5e-3 && (y - y_m).abs() < 1.5e-3, "{x},{y} is not {x_m},{y_m}");
    }
    let times = table.numbers("t_s");
    // Later than the beginning of 2026.
    assert!(times.is_sorted() && times[0] > 1_767_225_600.0, "{times:?}");
    let has_room =
        table.column("room").into_iter().zip(&reasons).all(|(room, reason)| (room == "hall") == reason.is_empty());
    assert!(has_room, "{}", table.stdout);
}

#[test]
fn an_export_is_a_folder_that_other_commands_read() {
    let (folder, positions) = with_store();
    folder.run("station export --store tags.db --out all").ok();
    assert_exported(&folder, "all", &positions);
    folder.run("plot all").ok();
    assert!(folder.read("all/picture.png").starts_with(b"\x89PNG"));
    let rooms = folder.run("classify-rooms --positions all/positions.csv --outlines all/outlines.csv").ok();
    assert_eq!(rooms.column("room").len(), positions.len());
    assert!(rooms.column("room").iter().all(|room| *room == "hall"), "{}", rooms.stdout);

    // A part: from the eleventh position on, before the twenty-first.
    let times = table(&folder, "all/positions.csv").numbers("t_s");
    let utc = |t_s: f64| station_core::Utc::clamped((t_s * 1e3).round() as i64 * 1000);
    let (from, to) = (utc(times[10]), utc(times[20]));
    folder.run(&format!("station export --store tags.db --site site --from {from} --to {to} --out part")).ok();
    assert_eq!(table(&folder, "part/positions.csv").numbers("t_s"), times[10..20]);

    for (arguments, expected) in [
        ("--store tags.db --out all", "--force"),
        ("--store tags.db --site attic --out new", "attic"),
        ("--store tags.db --tag 0x1002 --out new", "0x1002"),
        ("--store tags.db --to 2026-01-01T00:00:00Z --out new", "no positions in this time"),
        ("--store tags.db --from 2026-01-02T00:00:00Z --to 2026-01-01T00:00:00Z --out new", "--to"),
        ("--store tags.db --from yesterday --out new", "RFC 3339"),
        ("--store missing.db --out new", "missing.db"),
    ] {
        folder.run(&format!("station export {arguments}")).refused(expected);
    }
    let names = folder.names();
    assert!(!names.iter().any(|name| name == "new" || name == "missing.db" || name.contains("tmp")), "{names:?}");
}

/// Three anchors all but in a line, so that ranges fit two places until the tag has moved.
const LINE: &str = r#"
[network]
pan = 1

[[node]]
name = "anchor-1"
board = "dwm1001"
role = "anchor"
address = 0x0101
position_m = [0.0, 0.0, 2.4]

[[node]]
name = "anchor-2"
board = "dwm1001"
role = "anchor"
address = 0x0102
position_m = [5.0, 0.05, 2.4]

[[node]]
name = "anchor-3"
board = "dwm1001"
role = "anchor"
address = 0x0103
position_m = [10.0, 0.0, 2.4]

[[node]]
name = "tag-1"
board = "dwm1001"
role = "tag"
address = 0x1001
rate_hz = 10
height_m = 1.2
"#;

#[test]
fn an_export_says_which_positions_are_doubtful() {
    let folder = Folder::with(&[("line.toml", LINE)]);
    folder.run("simulate --site line.toml --seconds 4 --fidelity air --out run --quiet").ok();
    let doubts = |name: &str| -> Vec<(String, [f64; 2])> {
        let table = table(&folder, name);
        let others = table.numbers("alt_x_m").into_iter().zip(table.numbers("alt_y_m")).map(|(x, y)| [x, y]);
        let rows = table.column("reason").into_iter().zip(table.column("flag")).zip(others);
        rows.filter(|((reason, _), _)| reason.is_empty()).map(|((_, flag), at)| (flag.to_owned(), at)).collect()
    };
    let recorded = doubts("run/positions.csv");
    assert!(recorded.iter().any(|(flag, [x, y])| flag == "ambiguous" && x.is_finite() && y.is_finite()));
    let station = Station::start(&folder, "run --store tags.db");
    let path = "/api/v1/tags/0x1001/positions?site=site&limit=1000";
    station.wait(path, |history| history.as_array().is_some_and(|rows| rows.len() >= recorded.len()));
    station.stop();
    folder.run("station export --store tags.db --out all").ok();
    let exported = doubts("all/positions.csv");
    assert_eq!(exported.len(), recorded.len());
    for (is, expected) in exported.iter().zip(&recorded) {
        let at = is.1.iter().zip(expected.1).all(|(is, m)| (is - m).abs() < 1e-3 || is.is_nan() && m.is_nan());
        assert!(at && is.0 == expected.0, "{is:?} is not {expected:?}");
    }
}

/// The values of a column of ranges, each with the number of its round and its anchor, in this order.
fn by_round(ranges: &Run, column: &str) -> Vec<(usize, String, f64)> {
    let epochs = ranges.column("epoch");
    let round_of = |row: usize| epochs[..=row].windows(2).filter(|two| two[0] != two[1]).count();
    let rows = ranges.column("anchor").into_iter().zip(ranges.numbers(column)).enumerate();
    let mut rows: Vec<_> = rows.map(|(row, (anchor, value))| (round_of(row), anchor.to_owned(), value)).collect();
    rows.sort_by(|a, b| (a.0, &a.1).cmp(&(b.0, &b.1)));
    rows
}

#[test]
fn kept_measurements_are_exported_as_the_recording_that_they_came_from() {
    let (folder, positions) = with_store_of("--measurement-days 9");
    let said = folder.run("station export --store tags.db --out all").ok().stderr;
    assert!(said.contains("measurements") && !said.contains("left out"), "{said}");
    assert_exported(&folder, "all", &positions);
    let (recorded, exported) = (table(&folder, "run/ranges.csv"), table(&folder, "all/ranges.csv"));
    // The recording has all digits, telemetry tenths of millimetres and hundredths of dB and of ppm, the store whole
    // millimetres: halves of them, 0.05 mm + 0.5 mm.
    for (column, greatest) in
        [("range_m", 0.000_551), ("rx_power_dbm", 0.005_01), ("fp_power_dbm", 0.005_01), ("clock_offset_ppm", 0.005_01)]
    {
        let (kept, was) = (by_round(&exported, column), by_round(&recorded, column));
        let names = |rows: &[(usize, String, f64)]| rows.iter().map(|row| (row.0, row.1.clone())).collect::<Vec<_>>();
        assert_eq!(names(&kept), names(&was));
        let is_near = kept.iter().zip(&was).all(|(kept, was)| (kept.2 - was.2).abs() <= greatest);
        assert!(is_near, "{column}: {kept:?} is not {was:?}");
    }
    // The ranges are solved again, in the same rounds.
    let [again, was] = ["all", "run"].map(|folder_name| folder.run(&format!("solve {folder_name} --json")).ok().json());
    assert_eq!((&again[0]["epochs"], &again[0]["fixed"]), (&was[0]["epochs"], &was[0]["fixed"]));
}

#[test]
fn kept_sightings_are_exported_with_the_places_of_their_beacons() {
    let folder = Folder::with(&[]);
    let scenario = root().join("examples/both.toml");
    folder
        .run(&format!("simulate --scenario {} --seconds 4 --fidelity air --out run --quiet", scenario.display()))
        .ok();
    // The last of six beacons has no place.
    let first = "[network]\npan = 1\nregion = \"none\"\n[[node]]\nname = \"door\"\nboard = \"esp32c3\"\n\
                 role = \"beacon\"\nuuid = \"c2a8ad55-8a2f-4bb4-9c52-6b3cd7a0e511\"\nmajor = 1\nminor = 1\n\
                 position_m = [1, 0.5, 2.2]\n";
    let place = |minor| format!("[[beacon]]\nmajor = 1\nminor = {minor}\nposition_m = [{minor}, 0.5, 2.2]\n");
    folder.write("site.toml", (2..6).map(place).fold(first.to_owned(), |text, place| text + &place).as_bytes());
    let mut station = Station::start(&folder, "run --store tags.db --site site.toml --measurement-days 9");
    let recorded = table(&folder, "run/rssi.csv");
    let (beacons, rssi_dbm) = (recorded.column("beacon"), recorded.numbers("rssi_dbm"));
    let positions = table(&folder, "run/positions.csv").numbers("x_m").into_iter().filter(|x| x.is_finite()).count();
    let path = "/api/v1/tags/0x1001/positions?site=site&limit=1000";
    station.wait(path, |history| history.as_array().is_some_and(|rows| rows.len() >= positions));
    // Sightings may come after the last position.
    station.wait_for_line("run: it has ended");
    assert_eq!(station.stop().0, Some(0));
    let said = folder.run("station export --store tags.db --out all").ok().stderr;
    let count = beacons.iter().filter(|beacon| **beacon == "1-6").count();
    assert!(count > 10 && said.contains(&format!("{count} measurements to 1-6 are left out")), "{said}");
    let exported = table(&folder, "all/rssi.csv");
    let sorted = |rows: Vec<(&str, f64)>| {
        let mut rows: Vec<_> = rows.into_iter().map(|(beacon, rssi)| format!("{beacon} {rssi}")).collect();
        rows.sort();
        rows
    };
    let kept = exported.column("beacon").into_iter().zip(exported.numbers("rssi_dbm")).collect();
    let was = beacons.into_iter().zip(rssi_dbm).filter(|(beacon, _)| *beacon != "1-6").collect();
    assert_eq!(sorted(kept), sorted(was));
    assert_eq!(table(&folder, "all/beacons.csv").numbers("x_m"), [1.0, 2.0, 3.0, 4.0, 5.0]);
    folder.run("ble solve all").ok();
}

#[test]
fn a_back_up_of_a_running_station_becomes_a_store_again() {
    let (folder, positions) = with_store();
    folder.run("station restore running.db --store again.db").ok();
    folder.run("station export --store again.db --out all").ok();
    assert_exported(&folder, "all", &positions);
    let before = folder.read("again.db");
    folder.write("text.db", b"not a store, but long enough to be read as the head of one".repeat(20).as_slice());
    for (arguments, expected) in [
        ("backup --store tags.db --out running.db", "running.db: it is there already"),
        ("backup --store missing.db --out new.db", "missing.db"),
        ("backup --store tags.db --out nowhere/new.db", "nowhere"),
        ("backup --store tags.db --out -", "a file is needed"),
        ("restore running.db --store again.db", "again.db is there already"),
        ("restore missing.db --store new.db", "missing.db"),
    ] {
        folder.run(&format!("station {arguments}")).refused(expected);
    }
    let run = folder.run("station restore text.db --store new.db");
    assert!(run.code != Some(0) && run.stderr.contains("text.db"), "{run:?}");
    assert_eq!(folder.read("again.db"), before);
    let names = folder.names();
    assert!(!names.iter().any(|name| name.starts_with("new.db") || name.contains(".part")), "{names:?}");
}
