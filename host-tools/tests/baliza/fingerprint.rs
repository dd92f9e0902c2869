//! `baliza ble fingerprint` and `baliza ble map`.

use positioning_core::ble::fingerprint::Map;

use crate::support::{Folder, Run, recording, root};

/// Four corners of a room of 10 m, two beacons at −60 … −80 dBm.
const SURVEY: &str = "point,x_m,y_m,beacon,rssi_dbm,t_s\n\
    a,0,0,7,-60,0\na,0,0,8,-60,0.1\nb,10,0,7,-80,0\nb,10,0,8,-60,0.1\n\
    c,0,10,7,-60,0\nc,0,10,8,-80,0.1\nd,10,10,7,-80,0\nd,10,10,8,-80,0.1\n";

const TARGETS: &str = "point,x_m,y_m,beacon,rssi_dbm,t_s\np,5,0,7,-70,0\np,5,0,8,-60,0.1\nq,1,1,7,127,0\n";

fn room() -> Folder {
    Folder::with(&[("survey.csv", SURVEY), ("targets.csv", TARGETS)])
}

#[test]
fn two_neighbours_alike_far_are_averaged_and_silence_is_a_reason() {
    // p is 10 dB from a and from b, and √(10² + 20²) dB from c and d.
    let run = room().run(
        "ble fingerprint --fingerprints survey.csv --targets targets.csv --k 2 --weighted --receiver-offset-db 0 --average trimmed",
    );
    let run = run.ok();
    assert_eq!(run.column("method"), ["w2nn", "w2nn"]);
    assert!((run.numbers("x_m")[0] - 5.0).abs() < 0.05 && run.numbers("y_m")[0].abs() < 0.05, "{run:?}");
    assert_eq!((run.column("x_m")[1], run.column("reason")[1]), ("", "no-beacon-heard"));
}

#[test]
fn json_has_the_keys_of_the_contract() {
    let run = room().run("ble fingerprint --fingerprints survey.csv --targets targets.csv --kernel all --json");
    let rows = run.ok().json();
    let names: Vec<&str> = rows.as_array().expect("a list").iter().filter_map(|row| row["method"].as_str()).collect();
    assert_eq!(names, ["w3nn", "w4nn", "w5nn", "3nn", "4nn", "5nn", "gp", "gp-walk"]);
    assert_eq!(
        (rows[1]["k"].as_u64(), rows[1]["points"].as_u64(), rows[1]["fixed"].as_u64()),
        (Some(4), Some(2), Some(1))
    );
    assert!(rows[6]["k"].is_null() && rows[6]["mae_m"].is_f64() && rows[6]["rmse_m"].is_f64(), "{rows}");
}

#[test]
fn flags_that_do_not_go_together_are_refused() {
    let refused = |arguments: &str, what: &str| {
        let run = room().run(&format!("ble fingerprint --fingerprints survey.csv {arguments}"));
        assert_eq!(run.code, Some(2), "{run:?}");
        assert!(run.stderr.contains(what) && run.stdout.is_empty(), "{run:?}");
    };
    refused("", "--targets");
    refused("--targets targets.csv --leave-one-out", "cannot be used with");
    refused("--targets targets.csv --kernel gp --k 3", "--kernel: --k and --weighted are for knn");
    refused(
        "--targets targets.csv --kernel gp-walk --particle-filter",
        "--particle-filter: gp-walk is a filter itself",
    );
    refused("--targets targets.csv --k 16", "--k");
    refused("--targets targets.csv --receiver-offset-db=-1", "it must be from 0 to 100");
    refused("--targets targets.csv --receiver-offset-db NaN", "is not a number");
    refused("--hold-out 5", "survey.csv:1: 4 points are too few to hold some out");
}

#[test]
fn surveys_that_make_no_map_are_refused_with_their_line() {
    let mute = "point,x_m,y_m,beacon,rssi_dbm\na,0,0,7,127\n";
    let crowd: String = (0..25).map(|beacon| format!("a,0,0,{beacon},-60\n")).collect();
    let crowd = format!("point,x_m,y_m,beacon,rssi_dbm\n{crowd}");
    for (survey, what) in [(mute, "no point hears any beacon"), (crowd.as_str(), "25 beacons; a map has at most 24")] {
        let folder = Folder::with(&[("survey.csv", survey), ("targets.csv", TARGETS)]);
        for command in ["fingerprint --targets targets.csv", "map --out room.map"] {
            let run = folder.run(&format!("ble {command} --fingerprints survey.csv"));
            assert_eq!((run.code, run.stderr), (Some(2), format!("survey.csv:1: {what}\n")));
        }
        assert_eq!(folder.names(), ["survey.csv", "targets.csv"]);
    }
}

#[test]
fn equal_runs_print_equal_bytes_and_draw() {
    let folder = room();
    let run = || {
        let picture = "--plot found.svg --out found.csv";
        folder
            .run(&format!(
                "ble fingerprint --fingerprints survey.csv --targets targets.csv --weighted --particle-filter {picture}"
            ))
            .ok();
        (folder.read("found.csv"), folder.read("found.svg"))
    };
    let first = run();
    assert_eq!(first, run());
    assert!(String::from_utf8(first.0).expect("UTF-8").contains("fp_w5nn"));
}

#[test]
fn a_map_is_what_a_node_reads() {
    let folder = room();
    let run = folder.run("ble map --fingerprints survey.csv --out room.map --json").ok();
    let summary = run.object();
    let bytes = folder.read("room.map");
    let (map, rest) = Map::decode(&bytes).expect("a map");
    assert!(map.has_deviations() && rest.is_empty() && map.points() <= 200);
    assert_eq!(map.identities().collect::<Vec<_>>(), [7, 8]);
    assert_eq!(
        (summary["points"].as_u64(), summary["bytes"].as_u64()),
        (Some(map.points() as u64), Some(bytes.len() as u64))
    );
    // RSSI values between the corners are between those of the corners.
    let nearest =
        map.positions::<f64>().position(|[x, y]| (x - 5.0).abs() < 0.5 && (y - 5.0).abs() < 0.5).expect("a middle");
    assert!(map.rssis::<f64>(nearest).all(|level| level.is_some_and(|level| (-76.0..=-62.0).contains(&level))));

    // A table of columns; lengths have millimetres.
    let run = folder.run("ble map --fingerprints survey.csv --out stepped.map --step-m 0.871").ok();
    let lines: Vec<Vec<&str>> = run.stderr.lines().map(|line| line.split_whitespace().collect()).collect();
    assert_eq!(lines[0][0], "surveyed", "{}", run.stderr);
    assert!(lines[1].contains(&"0.871"), "{}", run.stderr);
    assert!(run.stderr.ends_with("map: stepped.map, with the beacons 7, 8\n"), "{}", run.stderr);

    folder.run("ble map --fingerprints survey.csv --out points.map --surveyed").ok();
    let bytes = folder.read("points.map");
    let (map, _) = Map::decode(&bytes).expect("a map");
    assert_eq!((map.points(), map.has_deviations()), (4, false));
    assert_eq!(map.rssis::<f64>(1).collect::<Vec<_>>(), [Some(-80.0), Some(-60.0)]);
}

/// The summaries of a run.
fn figures(folder: &Folder, arguments: &str) -> serde_json::Value {
    folder.run(&format!("ble fingerprint {arguments} --json")).ok().json()
}

#[test]
fn a_map_that_was_written_finds_what_its_survey_finds() {
    // The same room on a site grid that begins a hundred kilometres away.
    let far = |text: &str| text.replace(",0,0,", ",100000,200000,").replace(",10,0,", ",100010,200000,");
    let far = |text: &str| far(text).replace(",0,10,", ",100000,200010,").replace(",10,10,", ",100010,200010,");
    let targets = TARGETS.replace(",5,0,", ",100005,200000,").replace(",1,1,", ",100001,200001,");
    let folders = [room(), Folder::with(&[("survey.csv", &far(SURVEY)), ("targets.csv", &targets)])];
    for folder in folders {
        folder.run("ble map --fingerprints survey.csv --out lattice.map").ok();
        folder.run("ble map --fingerprints survey.csv --out points.map --surveyed").ok();
        for (map, how) in [
            ("lattice", "--kernel gp"),
            ("lattice", "--kernel gp-walk"),
            ("points", "--k 3"),
            ("points", "--k 2 --weighted --particle-filter"),
        ] {
            let from = |source: &str| figures(&folder, &format!("--{source} --targets targets.csv {how}"));
            let (mut trained, mut read) = (from("fingerprints survey.csv"), from(&format!("map {map}.map")));
            if map == "lattice" {
                // What four points tell of the covariances when they are left out is not in the map.
                for rows in [&mut trained, &mut read] {
                    rows[0]["nees"].take();
                    rows[0]["inside_1_sigma"].take();
                }
            }
            assert_eq!(trained, read, "{map} {how}");
            assert!(trained[0]["mae_m"].as_f64().is_some_and(|mae_m| mae_m < 6.0), "{trained}");
        }
        let usual = figures(&folder, "--map points.map --targets targets.csv --kernel all");
        let names: Vec<&str> =
            usual.as_array().expect("a list").iter().filter_map(|row| row["method"].as_str()).collect();
        assert_eq!(names, ["w3nn", "w4nn", "w5nn", "3nn", "4nn", "5nn"]);
        assert_eq!(figures(&folder, "--map points.map --targets targets.csv")[0]["method"], "w5nn");
        assert_eq!(figures(&folder, "--map lattice.map --targets targets.csv")[0]["method"], "gp-walk");
    }
    let Some(recorded) = recording("linde_room") else { return };
    let folder = Folder::with(&[]);
    let [survey, targets] = ["fingerprints.csv", "targets.csv"].map(|file| recorded.join(file).display().to_string());
    folder.run(&format!("ble map --fingerprints {survey} --out room.map")).ok();
    let from = |source: &str| figures(&folder, &format!("--{source} --targets {targets} --kernel gp"));
    assert_eq!(from(&format!("fingerprints {survey}")), from("map room.map"));
}

#[test]
fn maps_of_another_kind_or_with_other_names_are_refused() {
    let folder = room();
    folder.run("ble map --fingerprints survey.csv --out lattice.map").ok();
    folder.run("ble map --fingerprints survey.csv --out points.map --surveyed").ok();
    folder.write("cut.map", &folder.read("lattice.map")[..40]);
    let refused = |arguments: &str, what: &str| {
        let run = folder.run(&format!("ble fingerprint --targets targets.csv {arguments}"));
        assert_eq!((run.code, run.stderr.trim_end()), (Some(2), what), "{arguments}");
    };
    refused(
        "--map lattice.map --k 3",
        "lattice.map: a map of a lattice, for gp and gp-walk, where 3nn wants one of surveyed points (ble map --surveyed)",
    );
    refused(
        "--map points.map --kernel gp",
        "points.map: a map of surveyed points, for knn, where gp wants one of a lattice",
    );
    refused("--map cut.map", "cut.map: a damaged map");
    refused("--map survey.csv", "survey.csv: not a map of levels");
    refused("--map lattice.map --beacon-names 7,8,9", "--beacon-names: 3 names of 2 beacons");
    // Beacons with other names are matched to the map's beacons by their minor numbers, or by the order of their names.
    let named = TARGETS.replace(",7,", ",north,").replace(",8,", ",south,");
    folder.write("named.csv", named.as_bytes());
    folder.write("minors.csv", TARGETS.replace(",7,", ",1-7,").replace(",8,", ",1-8,").as_bytes());
    let wanted = figures(&folder, "--map lattice.map --targets targets.csv");
    assert_eq!(figures(&folder, "--map lattice.map --targets minors.csv"), wanted);
    assert_eq!(figures(&folder, "--map lattice.map --targets named.csv --beacon-names north,south"), wanted);
}

/// A corridor of eleven points, 1 m apart. Beacon 7 has the same RSSI on both sides of the middle; beacon 8
/// distinguishes the sides.
fn corridor() -> String {
    let mut text = String::from("point,x_m,y_m,beacon,rssi_dbm,t_s\n");
    for x in 0..=10_i32 {
        let (alike, falls) = (-50 - 4 * (x - 5).abs(), -50 - 4 * x);
        text += &format!("{x},{x},1,7,{alike},0\n{x},{x},1,8,{falls},0.1\n");
    }
    text
}

#[test]
fn a_walker_does_not_pass_a_wall() {
    // The walker goes from x = 2, where both beacons are received, to the wall at 5.5, stays there for a while, and
    // goes back to 2. On the way, only beacon 7 is received, whose RSSI values would also fit a way through the wall to
    // x = 8. The RSSI values of the other walker change suddenly to those at x = 8, which fits only a way through the
    // wall.
    let way = [2, 2, 3, 4, 5, 5, 5, 5, 5, 5, 4, 3, 2];
    let walk: Vec<(i32, bool)> = way.into_iter().enumerate().map(|(second, x)| (x, second < 2)).collect();
    let rssi = |epochs: &[(i32, bool)]| {
        let mut text = String::from("epoch,t_s,beacon,rssi_dbm\n");
        for (epoch, (x, both)) in epochs.iter().enumerate() {
            text += &format!("{epoch},{epoch},7,{}\n", -50 - 4 * (x - 5).abs());
            if *both {
                text += &format!("{epoch},{epoch},8,{}\n", -50 - 4 * x);
            }
        }
        text
    };
    let jump: Vec<(i32, bool)> = [2, 2, 8, 8, 8, 8].map(|x| (x, true)).to_vec();
    let folder = Folder::with(&[
        ("survey.csv", &corridor()),
        ("walk.csv", &rssi(&walk)),
        ("jump.csv", &rssi(&jump)),
        ("walls.csv", "x1_m,y1_m,x2_m,y2_m\n5.5,-9,5.5,1\n5.5,1,5.5,9\n"),
    ]);
    let last = |arguments: &str| {
        let run =
            folder.run(&format!("ble fingerprint --fingerprints survey.csv --receiver-offset-db 0 {arguments}")).ok();
        *run.numbers("x_m").last().expect("a position")
    };
    let walks = "--rssi walk.csv --kernel gp-walk";
    let (open, walled) = (last(walks), last(&format!("{walks} --walls walls.csv")));
    assert!((walled - 2.0).abs() < 1.0 && open > walled + 1.0, "{open} {walled}");
    let jumps = "--rssi jump.csv --k 1 --particle-filter";
    let (open, walled) = (last(jumps), last(&format!("{jumps} --walls walls.csv")));
    assert!((open - 8.0).abs() < 1.0 && walled < 5.5, "{open} {walled}");
}

#[test]
fn epochs_count_in_order_of_time_and_those_without_one_by_themselves() {
    let rows = |order: &[i32], timed: bool| {
        let mut text = String::from("epoch,t_s,beacon,rssi_dbm\n");
        for x in order {
            let t_s = if timed { x.to_string() } else { String::new() };
            text += &format!("e{x},{t_s},7,{}\ne{x},{t_s},8,{}\n", -50 - 4 * (x - 5).abs(), -50 - 4 * x);
        }
        text
    };
    let truth: String = (1..=8).map(|x| format!("e{x},{x},{x},1\n")).collect();
    let folder = Folder::with(&[
        ("survey.csv", &corridor()),
        ("truth.csv", &format!("epoch,t_s,x_m,y_m\n{truth}")),
        ("walk.csv", &rows(&[1, 2, 3, 4, 5, 6, 7, 8], true)),
        ("mixed.csv", &rows(&[5, 1, 8, 2, 7, 3, 6, 4], true)),
        ("timeless.csv", &rows(&[1, 2, 3, 4, 5, 6, 7, 8], false)),
    ]);
    let of = |file: &str, how: &str| {
        figures(&folder, &format!("--fingerprints survey.csv --rssi {file} --truth truth.csv --kernel {how}"))
    };
    for how in ["gp-walk", "knn --particle-filter"] {
        assert_eq!(of("walk.csv", how), of("mixed.csv", how), "{how}");
    }
    // The captures are not connected: each is found as if it were alone.
    let timeless = of("timeless.csv", "gp-walk");
    assert!(timeless[0]["mae_m"].as_f64().is_some_and(|mae_m| mae_m < 1.0), "{timeless}");
}

/// Runs with the recording's files; a name in braces stands for one of them.
fn replay(name: &str, arguments: &str) -> Option<Run> {
    let folder = recording(name)?;
    let arguments = arguments.replace('{', &format!("{}/", folder.display())).replace('}', ".csv");
    Some(Folder::with(&[]).run(&arguments).ok())
}

/// Asserts that the only method finds every point with a mean absolute error of at most `reach_m`, metres.
fn reaches(name: &str, arguments: &str, reach_m: f64) {
    let Some(run) = replay(name, &format!("ble fingerprint --fingerprints {{fingerprints}} {arguments} --json")) else {
        return;
    };
    let rows = run.json();
    assert_eq!(rows[0]["fixed"], rows[0]["points"], "{rows}");
    let mae_m = rows[0]["mae_m"].as_f64().expect("a number");
    assert!(mae_m <= reach_m, "{name} {arguments}: {mae_m} m is more than {reach_m} m");
}

#[test]
fn recorded_targets_are_found() {
    reaches("linde_room", "--targets {targets} --kernel knn --k 5 --weighted --particle-filter", 1.10);
    reaches("linde_room", "--targets {targets} --kernel gp", 1.05);
    reaches("linde_room", "--targets {targets}", 1.05);
}

#[test]
fn another_receiver_is_found_as_well() {
    // The recorded targets, all 8 dB weaker: the offset is estimated.
    let Some(folder) = recording("linde_room") else { return };
    let targets = std::fs::read_to_string(folder.join("targets.csv")).expect("a file of text");
    let mut rows = targets.lines();
    let header = rows.next().expect("a header");
    let level = header.split(',').position(|column| column == "rssi_dbm").expect("levels");
    let weaker = rows.map(|row| {
        let fields = row.split(',').enumerate().map(|(at, field)| match field.parse::<f64>() {
            Ok(dbm) if at == level => (dbm - 8.0).to_string(),
            Ok(_) | Err(_) => field.to_owned(),
        });
        fields.collect::<Vec<_>>().join(",")
    });
    let weaker = std::iter::once(header.to_owned()).chain(weaker).collect::<Vec<_>>().join("\n");
    let survey = folder.join("fingerprints.csv").display().to_string();
    let run = Folder::with(&[("weaker.csv", &weaker)])
        .run(&format!("ble fingerprint --fingerprints {survey} --targets weaker.csv --kernel gp --json"));
    let mae_m = run.ok().json()[0]["mae_m"].as_f64().expect("a number");
    assert!(mae_m <= 1.1, "{mae_m} m");
}

#[test]
fn recorded_points_are_found_by_the_others() {
    reaches("linde_floor", "--leave-one-out --kernel gp", 1.2);
    reaches("linde_room", "--leave-one-out --kernel gp", 1.2);
}

/// The squared error over the covariance is 2 in the mean where the covariance is right.
#[test]
fn left_out_points_are_as_far_off_as_their_covariances_say() {
    let flat = root().join("examples/flat/fingerprints.csv");
    let neighbours = ["--kernel knn --k 3", "--kernel knn --k 3 --weighted", "--kernel knn --k 5 --weighted"];
    let mut surveys = vec![(flat, "--kernel all")];
    for name in ["linde_floor", "linde_room", "danis/survey"] {
        let Some(folder) = recording(name) else { continue };
        surveys.extend(neighbours.map(|kernel| (folder.join("fingerprints.csv"), kernel)));
    }
    for (survey, kernel) in surveys {
        let survey = survey.display();
        let run =
            Folder::with(&[]).run(&format!("ble fingerprint --fingerprints {survey} --leave-one-out --json {kernel}"));
        for row in run.ok().json().as_array().expect("methods") {
            let nees = row["nees"].as_f64().expect("a number");
            assert!((0.5..4.0).contains(&nees), "{survey}: {row}");
        }
    }
}

#[test]
fn a_recorded_robot_is_followed() {
    reaches("kolakowski", "--hold-out 5 --block 100 --kernel gp-walk", 0.85);
}

/// The summary of a recorded walk whose epochs are in the files with this ending. All RSSI values are `more_db`
/// stronger.
fn walk(name: &str, epochs: &str, more_db: f64) -> Option<serde_json::Value> {
    let floor = recording("danis")?;
    let rssi = std::fs::read_to_string(floor.join(format!("{name}/rssi{epochs}.csv"))).expect("a file of text");
    let (header, rows) = rssi.split_once('\n').expect("a header");
    let stronger = rows.lines().map(|row| {
        let (before, rssi_dbm) = row.rsplit_once(',').expect("fields");
        format!("{before},{}\n", rssi_dbm.parse::<f64>().expect("a number") + more_db)
    });
    let folder = Folder::with(&[("rssi.csv", &format!("{header}\n{}", stronger.collect::<String>()))]);
    let file = |file: &str| floor.join(file).display().to_string();
    let (survey, truth) = (file("survey/fingerprints.csv"), file(&format!("{name}/truth{epochs}.csv")));
    let how = format!("--fingerprints {survey} --rssi rssi.csv --truth {truth} --kernel gp-walk");
    Some(figures(&folder, &how)[0].clone())
}

#[test]
fn recorded_walks_are_followed_alike_in_short_and_in_long_epochs() {
    for epochs in ["", "_500"] {
        let (mut sum_m, mut count) = (0.0, 0.0);
        for name in ["straight_01", "straight_04", "straight_05"] {
            let Some(found) = walk(name, epochs, 0.0) else { return };
            let [mae_m, epochs, nees] = ["mae_m", "epochs", "nees"].map(|key| found[key].as_f64().expect("a number"));
            assert!(nees < 3.0, "{name}: {found}");
            (sum_m, count) = (sum_m + epochs * mae_m, count + epochs);
        }
        assert!(sum_m / count <= 1.2, "epochs{epochs}: {} m", sum_m / count);
    }
}

#[test]
fn another_receiver_walks_alike() {
    // Within what the prior of the offset says in the first seconds.
    let Some(same) = walk("straight_05", "_500", 0.0) else { return };
    let Some(other) = walk("straight_05", "_500", 8.0) else { return };
    let [same, other] = [same, other].map(|found| found["mae_m"].as_f64().expect("a number"));
    assert!((same - other).abs() < 0.1, "{same} m, {other} m");
}

#[test]
fn a_map_of_few_points_is_predicted() {
    let few = "ble map --fingerprints {fingerprints} --survey-points 12 --beacons {beacons} --out few.map --json";
    let Some(run) = replay("linde_floor", few) else { return };
    let summary = run.object();
    assert_eq!((summary["survey_points"].as_u64(), summary["found_points"].as_u64()), (Some(12), Some(25)));
    assert!(summary["mae_m"].as_f64().expect("a number") < 2.0, "{summary}");
}

#[test]
fn the_default_is_as_good_on_a_simulated_walk_as_solving_each_scan_by_itself() {
    let flat = root().join("examples/flat");
    let file = |name: &str| flat.join(name).display().to_string();
    let files = format!("--rssi {} --truth {}", file("walk/rssi.csv"), file("walk/truth.csv"));
    let figures = |kernel: &str| {
        let survey = file("fingerprints.csv");
        Folder::with(&[]).run(&format!("ble fingerprint --fingerprints {survey} {files} {kernel} --json")).ok().object()
    };
    let (walk, single) = (figures(""), figures("--kernel gp"));
    let rmse = |figures: &serde_json::Value| figures["rmse_m"].as_f64().expect("a number");
    assert!(rmse(&walk) <= rmse(&single), "{walk} {single}");
    // In the plane, 39 % of Gaussian errors are inside one standard deviation.
    assert!(walk["inside_1_sigma"].as_f64().is_some_and(|inside| inside >= 0.39), "{walk}");
}
