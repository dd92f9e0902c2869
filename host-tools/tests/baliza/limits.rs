//! Files that claim absurd numbers or sizes end in time, with a line that says what is allowed or with a result.

use std::fmt::Write as _;
use std::io::Read;
use std::process::Stdio;
use std::time::{Duration, Instant};

use crate::support::{Folder, PATIENCE, Run};

const ANCHORS: &str = "anchor,x_m,y_m,z_m\na,0,0,2\nb,10,0,2.5\nc,10,8,2\nd,0,8,3\n";
const RANGES: &str = "epoch,t_s,anchor,range_m\n0,0,a,5.5\n0,0,b,8.1\n0,0,c,8.2\n0,0,d,5.6\n";
const TRUTH: &str = "epoch,t_s,x_m,y_m,z_m\n0,0,3.5,3.5,1\n";
const BEACONS: &str =
    "beacon,x_m,y_m,z_m,rssi_1m_dbm,path_loss_exponent\n0,0,0,2,-59,2\n1,4,0,2,-59,2\n2,4,4,2,-58,2.1\n";
const RSSI: &str =
    "epoch,t_s,beacon,rssi_dbm\n0,0,0,-55\n0,0.1,1,-60\n0,0.2,2,-65\n1,1,0,-56\n1,1.1,1,-61\n1,1.2,2,-62\n";
const WALLS: &str = "x1_m,y1_m,x2_m,y2_m,attenuation_db\n0,2,4,2,3.5\n1,0,1,4,5\n";
const FINGERPRINTS: &str = "point,room,x_m,y_m,beacon,rssi_dbm,t_s\np,hall,0,0,0,-50,0\np,hall,0,0,1,-61,0\n\
                            q,attic,3,3,0,-64,0\nq,attic,3,3,2,-58,1\n";

fn good() -> Folder {
    Folder::with(&[
        ("anchors.csv", ANCHORS),
        ("ranges.csv", RANGES),
        ("truth.csv", TRUTH),
        ("beacons.csv", BEACONS),
        ("rssi.csv", RSSI),
        ("walls.csv", WALLS),
        ("fingerprints.csv", FINGERPRINTS),
        ("positions.csv", "epoch,t_s,method,x_m,y_m,sigma_x_m,sigma_y_m\n0,0,m,1,2,0.1,0.1\n1,1,m,3,4,0.1,0.1\n"),
        ("outlines.csv", "room,x_m,y_m\nhall,0,0\nhall,4,0\nhall,4,4\n"),
        ("points.csv", "point,x_m,y_m\np,0,0\nq,1,0\n"),
    ])
}

/// Runs `baliza`, which must end before the patience does.
pub fn in_time(folder: &Folder, arguments: &str) -> Run {
    let mut command = folder.command(arguments);
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("baliza runs");
    let (mut out, mut err) = (child.stdout.take().expect("piped"), child.stderr.take().expect("piped"));
    let stdout = std::thread::spawn(move || {
        let mut text = String::new();
        out.read_to_string(&mut text).expect("UTF-8");
        text
    });
    let stderr = std::thread::spawn(move || {
        let mut text = String::new();
        err.read_to_string(&mut text).expect("UTF-8");
        text
    });
    let begun = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait().expect("a child") {
            break status;
        }
        if begun.elapsed() > PATIENCE {
            child.kill().expect("a child");
            panic!("{arguments}: still runs after {PATIENCE:?}");
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    let [stdout, stderr] = [stdout, stderr].map(|text| text.join().expect("read"));
    Run { code: status.code(), stdout, stderr }
}

fn refused(run: &Run, line: &str) {
    assert_eq!((run.code, run.stdout.as_str(), run.stderr.as_str()), (Some(2), "", format!("{line}\n").as_str()));
}

const SOLVE: &str = "solve --anchors anchors.csv --ranges ranges.csv --truth truth.csv --plot out.svg";
const TRACK: &str = "track --anchors anchors.csv --ranges ranges.csv --truth truth.csv --plot out.svg";
const BLE_SOLVE: &str = "ble solve --beacons beacons.csv --rssi rssi.csv --walls walls.csv --plot out.svg";
const CALIBRATE: &str =
    "calibrate path-loss --beacons beacons.csv --fingerprints fingerprints.csv --walls walls.csv --plot out.svg";
const PLOT: &str = "plot --positions positions.csv --out out.svg";

#[test]
fn numbers_that_no_site_has_are_refused_with_their_line_and_the_bound() {
    let cases = [
        (SOLVE, "anchors.csv", "a,0,0,2", "a,1.1e7,0,2", r#"anchors.csv:2: x_m "1.1e7" is not within ±10000 km"#),
        (SOLVE, "ranges.csv", "a,5.5", "a,100000.1", r#"ranges.csv:2: range_m "100000.1" is not within ±100 km"#),
        (SOLVE, "ranges.csv", "0,0,a", "0,1e300,a", r#"ranges.csv:2: t_s "1e300" is not within ±1e11 s"#),
        (SOLVE, "truth.csv", "3.5,3.5", "3.5,1e160", r#"truth.csv:2: y_m "1e160" is not within ±10000 km"#),
        (TRACK, "truth.csv", "3.5,3.5", "3.5,1e308", r#"truth.csv:2: y_m "1e308" is not within ±10000 km"#),
        (TRACK, "anchors.csv", "10,8,2", "10,8,1e12", r#"anchors.csv:4: z_m "1e12" is not within ±10000 km"#),
        (BLE_SOLVE, "beacons.csv", "0,0,0,2", "0,0,1e308,2", r#"beacons.csv:2: y_m "1e308" is not within ±10000 km"#),
        (
            BLE_SOLVE,
            "beacons.csv",
            "-59,2",
            "-59,1e300",
            r#"beacons.csv:2: path_loss_exponent "1e300" is not within ±100"#,
        ),
        (BLE_SOLVE, "rssi.csv", "-65", "-1e300", r#"rssi.csv:4: rssi_dbm "-1e300" is not within ±1000 dB"#),
        (CALIBRATE, "beacons.csv", "4,0,2", "-1e300,0,2", r#"beacons.csv:3: x_m "-1e300" is not within ±10000 km"#),
        (CALIBRATE, "beacons.csv", "2,-59", "2,9e18", r#"beacons.csv:2: rssi_1m_dbm "9e18" is not within ±1000 dB"#),
        (CALIBRATE, "walls.csv", "1,4,5", "1,4,1e300", r#"walls.csv:3: attenuation_db "1e300" is not within ±1000 dB"#),
        (PLOT, "positions.csv", "m,1,2", "m,1,1e308", r#"positions.csv:2: y_m "1e308" is not within ±10000 km"#),
        (PLOT, "positions.csv", "m,1,2", "m,-1e12,2", r#"positions.csv:2: x_m "-1e12" is not within ±10000 km"#),
        (
            PLOT,
            "positions.csv",
            "0.1,0.1",
            "1e300,0.1",
            r#"positions.csv:2: sigma_x_m "1e300" is not within ±10000 km"#,
        ),
    ];
    for (command, file, right, wrong, line) in cases {
        let folder = good();
        let text = String::from_utf8(folder.read(file)).expect("UTF-8");
        assert!(text.contains(right), "{file}: {right}");
        folder.write(file, text.replacen(right, wrong, 1).as_bytes());
        refused(&in_time(&folder, command), line);
        assert!(!folder.path("out.svg").exists());
    }
}

#[test]
fn the_greatest_numbers_that_are_allowed_are_drawn_in_time() {
    let far =
        "epoch,t_s,method,x_m,y_m,sigma_x_m,sigma_y_m\n0,-1e11,m,-1e7,1e7,1e7,1e-9\n1,1e11,m,1e7,-1e7,1e7,1e-300\n";
    let folder = good();
    folder.write("positions.csv", far.as_bytes());
    folder.write("truth.csv", b"epoch,t_s,x_m,y_m,z_m\n0,-1e11,1e7,1e-300,1e7\n1,1e11,-1e7,5e-324,-1e7\n");
    in_time(&folder, "plot --positions positions.csv --truth truth.csv --anchors anchors.csv --out out.svg").ok();
    let svg = String::from_utf8(folder.read("out.svg")).expect("UTF-8");
    assert!(!svg.contains("NaN") && !svg.contains("inf"));
    folder.write(
        "beacons.csv",
        b"beacon,x_m,y_m,rssi_1m_dbm,path_loss_exponent\n0,1e7,-1e7,20,100\n1,-1e7,1e7,-1000,1e-300\n",
    );
    folder.write("walls.csv", b"x1_m,y1_m,x2_m,y2_m,attenuation_db\n-1e7,-1e7,1e7,1e7,1000\n");
    for command in [BLE_SOLVE, CALIBRATE] {
        let run = in_time(&folder, command).ok();
        assert!(!run.stdout.contains("NaN") && !run.stdout.contains("inf"), "{command}: {}", run.stdout);
    }
}

#[test]
fn other_separators_are_recognised() {
    let command = "solve --anchors anchors.csv --ranges ranges.csv";
    let cases = [
        (
            ';',
            r#"anchors.csv:1: no column anchor in the header "anchor;x_m;y_m;z_m"; separated by `;`? commas are expected"#,
        ),
        (
            '\t',
            r#"anchors.csv:1: no column anchor in the header "anchor\tx_m\ty_m\tz_m"; separated by tabs? commas are expected"#,
        ),
    ];
    for (separator, line) in cases {
        let folder = good();
        folder.write("anchors.csv", ANCHORS.replace(',', &separator.to_string()).as_bytes());
        refused(&in_time(&folder, command), line);
    }
    let folder = good();
    folder.write("ranges.csv", b"epoch,t_s,anchor,range_m\n0,0,a,5,5\n");
    refused(
        &in_time(&folder, command),
        "ranges.csv:2: 5 fields where the header has 4; decimal commas? points are expected",
    );
    folder.write("ranges.csv", b"epoch,t_s,anchor,range_m\n0,0,a,\"5,5\"\n");
    refused(
        &in_time(&folder, command),
        r#"ranges.csv:2: range_m "5,5" is not a number; a decimal comma? a point is expected"#,
    );
}

#[test]
fn scenarios_of_absurd_numbers_are_refused_with_their_line() {
    let cases = [
        ("cpu_slowdown = 1e300", "s.toml:2: cpu_slowdown is 1e300: it must be at most 1000"),
        ("seconds = 1e18", "s.toml:2: seconds is 1e18: it must be at most 1000000"),
        (
            "[simulation.board]\nspi_hz = 0",
            "s.toml:2: [simulation.board] begins a table: it must be text in quotation marks, as a key",
        ),
        ("[simulation.bluetooth]\nshadowing_db = 1e300", "s.toml:3: shadowing_db is 1e300: it must be at most 1000000"),
        (
            "[simulation.bluetooth]\npath_loss_exponent = inf",
            "s.toml:3: path_loss_exponent is inf: it must be at most 1000000",
        ),
        (
            "[[node]]\nrole = \"tag\"\nsimulation = { path_m = [[1, 1, 1], [2, 2, 2]], speed_m_s = 1e300 }",
            "s.toml:4: speed_m_s is 1e300: it must be at most 1000000",
        ),
        (
            "[[node]]\nrole = \"anchor\"\nposition_m = [1e300, 0, 0]",
            "s.toml:4: position_m is inf: it must be finite and within 8388 m of the origin",
        ),
    ];
    for (text, line) in cases {
        let rest = "[[node]]\nrole = \"anchor\"\nposition_m = [0, 0, 2]\n[[node]]\nrole = \"tag\"\n";
        let folder = Folder::with(&[("s.toml", &format!("[simulation]\n{text}\n{rest}"))]);
        refused(&in_time(&folder, "simulate --scenario s.toml --seconds 1"), line);
    }
}

/// A file of this header and a row for each number.
fn many(header: &str, count: usize, row: impl Fn(usize) -> String) -> String {
    let mut text = format!("{header}\n");
    for number in 0..count {
        let _ = writeln!(text, "{}", row(number));
    }
    text
}

#[test]
fn a_megabyte_of_names_is_read_in_time() {
    let folder = good();
    let write = |name: &str, text: String| folder.write(name, text.as_bytes());
    write("outlines.csv", many("room,x_m,y_m", 100_000, |n| format!("{n},0,0")));
    let run = in_time(&folder, "classify-rooms --positions positions.csv --outlines outlines.csv");
    refused(&run, "outlines.csv: room \"0\" has fewer than three corners");
    write("points.csv", many("point,x_m,y_m,from_s", 100_000, |n| format!("{n},0,0,0")));
    folder.write("telemetry.bin", b"");
    let run = in_time(&folder, "survey fingerprints --points points.csv --file telemetry.bin --out new.csv");
    assert_eq!((run.code, run.stderr.lines().count()), (Some(0), 100_001), "{:.200}", run.stderr);
    let row = |n: usize| format!("{n},{n},5,{},-80,{}", n % 2, -81 - (n % 7) as i64);
    write("ranges.csv", many("epoch,anchor,range_m,los,rx_power_dbm,fp_power_dbm", 40_000, row));
    in_time(&folder, "nlos train --ranges ranges.csv --classifiers power-difference --out m").ok();
    // As many beacons as a survey may have, and one more than that.
    let fingerprints = |beacons: usize| {
        many("point,x_m,y_m,beacon,rssi_dbm,t_s", 40_000, |n| {
            format!("p{},{},0,{},-60,0", n % 2000, n % 2000, n % beacons)
        })
    };
    write("fingerprints.csv", fingerprints(4096));
    write("beacons.csv", many("beacon,x_m,y_m", 4096, |n| format!("{n},{},1", n % 50)));
    in_time(&folder, "calibrate path-loss --beacons beacons.csv --fingerprints fingerprints.csv --walls walls.csv")
        .ok();
    write("beacons.csv", many("beacon,x_m,y_m", 40_000, |n| format!("{n},{},1", n % 50)));
    let run = in_time(&folder, "calibrate path-loss --beacons beacons.csv --fingerprints fingerprints.csv");
    refused(&run, "beacons.csv: 40000 beacons, where at most 4096 are allowed");
}

#[test]
fn a_matrix_that_does_not_fit_is_refused_before_it_is_made() {
    let folder = good();
    let row = |beacons: usize| move |n: usize| format!("p{n},{n},0,hall,{},-60,0", n % beacons);
    let header = "point,x_m,y_m,room,beacon,rssi_dbm,t_s";
    let commands = [
        "ble map --fingerprints f.csv --out new.map",
        "ble rooms --fingerprints f.csv --leave-one-out",
        "ble fingerprint --fingerprints f.csv --leave-one-out",
        "coverage --fingerprints f.csv",
        "calibrate path-loss --beacons beacons.csv --fingerprints f.csv",
    ];
    for command in commands {
        folder.write("f.csv", many(header, 40_000, row(40_000)).as_bytes());
        refused(&in_time(&folder, command), "f.csv: 40000 beacons, where at most 4096 are allowed");
        folder.write("f.csv", many(header, 40_000, row(4000)).as_bytes());
        refused(
            &in_time(&folder, command),
            "f.csv: 160000000 points times beacons, where at most 10000000 are allowed",
        );
    }
}

#[test]
#[cfg(unix)]
fn a_device_in_place_of_a_document_is_refused_in_time() {
    let folder = good();
    folder.write(
        "site.toml",
        b"[network]\npan = 1\n[[node]]\nname = \"t\"\nrole = \"tag\"\neui = \"0200000000000001\"\nnlos_model = \"/dev/zero\"\n",
    );
    for (command, line) in [
        ("simulate --scenario /dev/zero", "/dev/zero: it is larger than 8 MiB: is it the right file?"),
        ("provision --config /dev/zero --all --out new", "/dev/zero: it is larger than 8 MiB: is it the right file?"),
        (
            "nlos eval --model /dev/zero --ranges ranges.csv",
            "/dev/zero: it is larger than 8 MiB: is it the right file?",
        ),
    ] {
        refused(&in_time(&folder, command), line);
    }
    let run = in_time(&folder, "provision --config site.toml --all --out new");
    refused(&run, "site.toml:7: nlos_model: /dev/zero: it is larger than 8 MiB: is it the right file?");
}
