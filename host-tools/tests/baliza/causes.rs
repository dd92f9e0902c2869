//! What is odd about files is said on standard error with its likely cause, and what cannot be solved says why.

use crate::support::{Folder, Run};

const ANCHORS: &str = "anchor,x_m,y_m,z_m\na,0,0,2.5\nb,6,0,0.5\nc,6,8,2.5\nd,0,8,0.5\n";

/// The ranges from 2, 3, 1 to the anchors of a file, in two epochs.
fn ranges(anchors: &str) -> String {
    let mut text = "epoch,t_s,anchor,range_m\n".to_owned();
    for epoch in 0..2 {
        for row in anchors.lines().skip(1) {
            let fields: Vec<&str> = row.split(',').collect();
            let [x, y, z] = [1, 2, 3].map(|at| fields[at].parse::<f64>().expect("a number"));
            let range_m = ((x - 2.0).powi(2) + (y - 3.0).powi(2) + (z - 1.0).powi(2)).sqrt();
            text += &format!("{epoch},{epoch},{},{range_m:.4}\n", fields[0]);
        }
    }
    text
}

fn run_of(anchors: &str, ranges: &str, arguments: &str) -> Run {
    let folder = Folder::with(&[("anchors.csv", anchors), ("ranges.csv", ranges)]);
    folder.run(&format!("{arguments} --anchors anchors.csv --ranges ranges.csv"))
}

fn warnings(run: &Run) -> Vec<&str> {
    run.stderr.lines().filter_map(|line| line.strip_prefix("warning: ")).collect()
}

/// Asserts that there is exactly this warning, and exit code 0, whichever command reads the files.
fn warned(anchors: &str, ranges: &str, arguments: &str, begins: &str) {
    for command in ["solve", "track"] {
        let run = run_of(anchors, ranges, &format!("{command} {arguments}")).ok();
        assert!(matches!(warnings(&run)[..], [one] if one.starts_with(begins)), "{begins}: {run:?}");
    }
}

#[test]
fn the_document_of_json_has_the_warnings() {
    let flat = "anchor,x_m,y_m,z_m\na,0,0,2.5\nb,6,0,2.5\nc,6,8,2.5\nd,0,8,2.501\n";
    for command in ["solve --json", "track --json --quiet"] {
        let document = run_of(flat, &ranges(flat), command).ok().document();
        let warning = document["warnings"][0].as_str().expect("a warning");
        assert!(warning.starts_with("the anchors lie in one plane"), "{document}");
        let document = run_of(ANCHORS, &ranges(ANCHORS), command).ok().document();
        assert!(document.get("warnings").is_none(), "{document}");
    }
}

#[test]
fn a_truth_that_has_nothing_in_common_with_the_ranges_is_named() {
    let files = [("anchors.csv", ANCHORS), ("ranges.csv", &ranges(ANCHORS))];
    let folder = Folder::with(&files);
    let solve = "solve --anchors anchors.csv --ranges ranges.csv --truth truth.csv";
    folder.write("truth.csv", b"epoch,t_s,x_m,y_m,z_m\n8,100,2,3,1\n9,101,2,3,1\n");
    let run = folder.run(solve).ok();
    let expected = "no epoch has a true position, so there are no errors: the ranges have 0 to 1 s, the truth has 100 to 101 s, \
                    and their epochs have other names; --time-offset-s adds seconds to the times of the truth";
    assert_eq!(warnings(&run), [expected]);
    assert_eq!(warnings(&folder.run(&format!("{solve} --time-offset-s=-100")).ok()), [""; 0]);
    folder.write("truth.csv", b"epoch,t_s,x_m,y_m,z_m\n1,100,2,3,1\n");
    assert_eq!(warnings(&folder.run(solve).ok()), [""; 0], "it is joined by epoch");
}

#[test]
fn a_height_beyond_the_ranges_is_named() {
    let run = run_of(ANCHORS, &ranges(ANCHORS), "solve --dims 2 --height-m 120");
    let said = "ranges-disjoint: the ranges cannot meet: is the tag's height (--height-m) right, ";
    assert!(run.code == Some(1) && run.stderr.contains(said), "{run:?}");
}

#[test]
fn a_number_that_stands_for_no_range_is_named() {
    // Anchor d is not heard in both epochs, which a program writes as -1.
    let good = ranges(ANCHORS);
    let lines = good.lines().map(|line| {
        if line.contains(",d,") { format!("{},-1", line.rsplit_once(',').expect("a range").0) } else { line.to_owned() }
    });
    let run = run_of(ANCHORS, &(lines.collect::<Vec<_>>().join("\n") + "\n"), "solve --dims 2 --height-m 1").ok();
    let expected = "2 of 8 ranges are exactly -1: does -1 stand for none? Leave the field empty, or the row out";
    assert!(warnings(&run).contains(&expected), "{run:?}");
}

#[test]
fn a_good_recording_gets_no_warning() {
    let run = run_of(ANCHORS, &ranges(ANCHORS), "solve").ok();
    assert_eq!(warnings(&run), [""; 0]);
    let [x, y] = [run.numbers("x_m")[0], run.numbers("y_m")[0]];
    assert!((x - 2.0).abs() < 0.01 && (y - 3.0).abs() < 0.01, "{run:?}");
}

#[test]
fn anchors_in_one_plane_or_on_one_line_are_named() {
    let flat = "anchor,x_m,y_m,z_m\na,0,0,2.5\nb,6,0,2.5\nc,6,8,2.5\nd,0,8,2.501\n";
    warned(flat, &ranges(flat), "", "the anchors lie in one plane, so that the distance of the tag from that plane");
    for told in ["solve --side below", "solve --dims 2 --height-m 1"] {
        assert_eq!(warnings(&run_of(flat, &ranges(flat), told).ok()), [""; 0], "{told}");
    }
    // Half a metre beside a line of 30 m.
    let line = "anchor,x_m,y_m,z_m\na,0,0,2.5\nb,10,0.5,2.5\nc,20,0,2.5\nd,30,0.5,2.5\n";
    let run = run_of(line, &ranges(line), "solve --dims 2 --height-m 1").ok();
    assert!(warnings(&run)[0].starts_with("the anchors lie nearly on one line"), "{run:?}");
}

#[test]
fn slant_ranges_in_the_plane_are_named() {
    warned(ANCHORS, &ranges(ANCHORS), "--dims 2", "--dims 2 without a height takes slant ranges for horizontal ones");
}

#[test]
fn another_unit_is_named() {
    let ranges = ranges(ANCHORS);
    let times = |text: &str, columns: &[usize], factor: f64| -> String {
        let row = |(number, row): (usize, &str)| {
            let fields = row.split(',').enumerate().map(|(at, field)| match field.parse::<f64>() {
                Ok(value) if number > 0 && columns.contains(&at) => (factor * value).to_string(),
                Ok(_) | Err(_) => field.to_owned(),
            });
            fields.collect::<Vec<_>>().join(",") + "\n"
        };
        text.lines().enumerate().map(row).collect()
    };
    let said = |anchors: &str, ranges: &str| {
        let run = run_of(anchors, ranges, "solve");
        let warnings = warnings(&run);
        let [one] = warnings[..] else { panic!("{run:?}") };
        (run.code, one.rsplit(": ").next().expect("a question").to_owned())
    };
    let asked = |what: &str| format!("are {what}? Metres are expected");
    assert_eq!(said(ANCHORS, &times(&ranges, &[3], 1000.0)), (Some(1), asked("the ranges in millimetres")));
    assert_eq!(said(ANCHORS, &times(&ranges, &[3], 100.0)), (Some(1), asked("the ranges in centimetres")));
    assert_eq!(said(&times(ANCHORS, &[1, 2, 3], 100.0), &ranges), (Some(1), asked("the anchors in centimetres")));
    assert_eq!(said(&times(ANCHORS, &[1, 2, 3], 1000.0), &ranges), (Some(1), asked("the anchors in millimetres")));
}

#[test]
fn two_anchors_at_one_place_are_named() {
    let twice = format!("{ANCHORS}e,6,8,2.5\n");
    warned(&twice, &ranges(&twice), "", "the anchors c and e are both at 6.00, 8.00, 2.50 m");
}

#[test]
fn of_two_ranges_of_one_anchor_the_median_counts() {
    let good = ranges(ANCHORS);
    // Of 3 m too long, right and 5 m too short, the right one is the median.
    let first = good.lines().nth(1).expect("a row");
    let (row, range_m) = first.rsplit_once(',').expect("a range");
    let range_m: f64 = range_m.parse().expect("a number");
    let repeated = format!("{good}{row},{}\n{row},{}\n", range_m + 3.0, range_m - 5.0);
    warned(
        ANCHORS,
        &repeated,
        "",
        "epochs have several ranges of one anchor at one time, of which the median counts and 2",
    );
    let (once, twice) = (run_of(ANCHORS, &good, "solve").ok(), run_of(ANCHORS, &repeated, "solve").ok());
    assert_eq!(once.stdout, twice.stdout);
}

#[test]
fn times_that_differ_within_an_epoch_and_negative_ranges_are_named() {
    let good = ranges(ANCHORS);
    let differs = good.replacen("0,0,a", "0,-5,a", 1).replacen("0,0,b", "0,99,b", 1);
    warned(
        ANCHORS,
        &differs,
        "",
        "1 of the epochs have rows whose times differ by more than 1 s, the first is 0 with -5 to 99 s",
    );
    let negative = good.replacen("0,0,d,", "0,0,d,-", 1);
    let run = run_of(ANCHORS, &negative, "solve").ok();
    assert!(
        warnings(&run)[0].starts_with("1 of the ranges are negative, the first is -5.4083 m to anchor d in epoch 0"),
        "{run:?}"
    );
}

#[test]
fn a_recording_without_any_position_fails_and_says_why() {
    let two = "epoch,t_s,anchor,range_m\n0,0,a,5\n0,0,b,5\n1,1,a,5\n1,1,b,5\n";
    let run = run_of(ANCHORS, two, "solve");
    assert_eq!(run.code, Some(1), "{run:?}");
    let why = run.stderr.lines().last().expect("a line");
    assert!(
        why.contains("none of 2 epochs has a position; 2 of them: too-few-anchors: at least 4 anchors are needed"),
        "{why}"
    );
    assert_eq!(run.column("reason"), ["too-few-anchors"; 2], "the rows are written all the same");
    let near = run_of(ANCHORS, &ranges(ANCHORS), "solve --method nls-ccv");
    assert!(near.code == Some(1) && near.stderr.contains("needs a column los"), "{near:?}");
    let beacons = "beacon,x_m,y_m\na,0,0\nb,4,0\nc,0,4\n";
    let folder = Folder::with(&[("beacons.csv", beacons), ("rssi.csv", "epoch,t_s,beacon,rssi_dbm\n0,0,a,-60\n")]);
    let run = folder.run("ble solve --beacons beacons.csv --rssi rssi.csv --method weighted-linear");
    assert_eq!(run.code, Some(1), "{run:?}");
    assert!(run.stderr.contains("too-few-anchors: at least 3 beacons are needed"), "{run:?}");
}

#[test]
fn levels_without_their_minus_are_refused() {
    let folder = Folder::with(&[
        ("beacons.csv", "beacon,x_m,y_m,rssi_1m_dbm\na,0,0,-59\n"),
        ("rssi.csv", "epoch,t_s,beacon,rssi_dbm\n0,0,a,127\n0,0,a,62\n"),
    ]);
    let run = folder.run("ble solve --beacons beacons.csv --rssi rssi.csv");
    let line = "rssi.csv:3: rssi_dbm 62 is no level in dBm, which is below 0: is the minus sign missing?\n";
    assert_eq!((run.code, run.stderr.as_str()), (Some(2), line));
    // Receivers report single values like this.
    folder.write("rssi.csv", b"epoch,t_s,beacon,rssi_dbm\n0,0,a,-62\n0,0,a,-61\n0,0,a,42\n");
    let run = folder.run("ble solve --beacons beacons.csv --rssi rssi.csv");
    assert!(!run.stderr.contains("minus"), "{run:?}");
    folder.write("beacons.csv", b"beacon,x_m,y_m,rssi_1m_dbm\na,0,0,59\n");
    let run = folder.run("ble solve --beacons beacons.csv --rssi rssi.csv");
    let line = "beacons.csv:2: rssi_1m_dbm 59 is no level in dBm, which is below 0: is the minus sign missing?\n";
    assert_eq!((run.code, run.stderr.as_str()), (Some(2), line));
}

#[test]
fn negative_deviations_and_outlines_that_cross_are_named() {
    let folder = Folder::with(&[
        ("p.csv", "epoch,t_s,method,x_m,y_m,sigma_x_m,sigma_y_m\n0,0,m,1,2,0.1,-0.1\n1,1,m,3,4,0.1,0.1\n"),
        (
            "good.csv",
            "room,x_m,y_m\nhall,0,0\nhall,4,0\nhall,4,4\nhall,0,4\nattic,4,0\nattic,8,0\nattic,8,4\nattic,4,4\n",
        ),
        ("bow.csv", "room,x_m,y_m\nhall,0,0\nhall,4,4\nhall,4,0\nhall,0,4\n"),
        ("over.csv", "room,x_m,y_m\nhall,0,0\nhall,4,0\nhall,4,4\nattic,3,1\nattic,8,0\nattic,8,4\n"),
    ]);
    let negative =
        "1 of the positions have a negative standard deviation, the first is that of epoch 0: its magnitude counts";
    let run = folder.run("plot --positions p.csv --out p.svg").ok();
    assert_eq!(warnings(&run), [negative]);
    let of = |outlines: &str| folder.run(&format!("classify-rooms --positions p.csv --outlines {outlines}")).ok();
    assert_eq!(warnings(&of("good.csv")), [negative]);
    let bow = "the outline of room hall crosses itself: give its corners in their order along the walls";
    assert_eq!(warnings(&of("bow.csv")), [bow, negative]);
    let over = "the outlines of the rooms hall and attic cross: a position in both counts for both";
    assert_eq!(warnings(&of("over.csv")), [over, negative]);
}

#[test]
fn a_simulation_without_positions_says_why() {
    let why = |arguments: &str, scenario: &str| {
        let folder = Folder::with(&[("s.toml", scenario)]);
        let run = folder.run(&format!("simulate --fidelity air --json {arguments}"));
        assert_eq!(run.object()["fixes"], 0, "{run:?}");
        (run.code, warnings(&run).join("|"), run.stderr)
    };
    let few = "no positions: a tag has 2 anchors in its network, and a position needs 3: add anchors";
    assert_eq!(why("--anchors 2 --seconds 1", ""), (Some(1), String::new(), format!("baliza: {few}\n")));
    let anchors = ["0, 0", "9, 0", "9, 9", "0, 9"]
        .map(|at| format!("[[node]]\nrole = \"anchor\"\nposition_m = [{at}, 2]\n"))
        .concat();
    // 4000 m from the nearest anchor.
    let tag = "[[node]]\nrole = \"tag\"\nsimulation = { path_m = [[4009, 9, 2]] }\n";
    // A file may mean it.
    let (code, far, _) = why("--scenario s.toml --seconds 1", &format!("{anchors}{tag}"));
    assert_eq!(code, Some(0));
    assert!(far.starts_with("no positions: no anchor answered any tag; the nearest is 4000 m away"), "{far}");
}
