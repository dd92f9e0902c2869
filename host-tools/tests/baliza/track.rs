//! `baliza track`, and the benchmarks of tracks.

use std::fmt::Write as _;

use crate::nlos::responses;
use crate::support::{Folder, replay};

const ANCHORS: &str = "anchor,x_m,y_m,z_m\na,100,200,2.5\nb,110,200,2.5\nc,110,208,0.5\nd,100,208,0.5\n";

/// A tag that goes east at 1 m/s from (102, 203, 1), with 20 rounds a second and ranges exact to the millimetre. The
/// third round is lost.
fn recording() -> (String, String) {
    let anchors = [[100.0, 200.0, 2.5], [110.0, 200.0, 2.5], [110.0, 208.0, 0.5], [100.0, 208.0, 0.5]];
    let (mut ranges, mut truth) = ("epoch,t_s,anchor,range_m\n".to_owned(), "epoch,t_s,x_m,y_m,z_m\n".to_owned());
    for k in 0..60 {
        let t = 0.05 * f64::from(k);
        let at = [102.0 + t, 203.0, 1.0];
        let _ = writeln!(truth, "{k},{t},{},{},{}", at[0], at[1], at[2]);
        for (name, anchor) in ["a", "b", "c", "d"].iter().zip(anchors) {
            let square: f64 = at.iter().zip(anchor).map(|(t, a)| (t - a) * (t - a)).sum();
            // A range that was lost is an empty field.
            let range = if k == 2 { String::new() } else { format!("{:.3}", square.sqrt()) };
            let _ = writeln!(ranges, "{k},{t},{name},{range}");
        }
    }
    (ranges, truth)
}

#[test]
fn a_walk_is_followed_and_a_lost_round_is_bridged() {
    let (ranges, truth) = recording();
    let folder = Folder::with(&[("a.csv", ANCHORS), ("r.csv", &ranges), ("t.csv", &truth)]);
    let arguments = "track --anchors a.csv --ranges r.csv --truth t.csv --dims 2 --height-m 1";
    let run = folder.run(arguments).ok();
    assert_eq!(run.column("method"), ["track"; 60]);
    assert_eq!(run.column("used")[2..4], ["0", "4"]);
    assert!(run.numbers("error_m").iter().skip(10).all(|error| *error < 0.03), "{:?}", run.numbers("error_m"));
    assert!(run.numbers("sigma_x_m").iter().all(|sigma| (0.001..0.5).contains(sigma)));
    let json = folder.run(&format!("{arguments} --json")).ok().json();
    let object = json[0].as_object().expect("an object");
    let mut keys: Vec<_> = object.keys().map(String::as_str).collect();
    keys.sort_unstable();
    let plane = ["mae_xy_m", "p50_xy_m", "p90_xy_m", "rmse_xy_m", "inside_1_sigma", "nees", "time_offset_s"];
    let mut expected =
        [&["epochs", "findings", "fixed", "mae_m", "method", "p50_m", "p90_m", "rmse_m"], &plane[..]].concat();
    expected.sort_unstable();
    assert_eq!(keys, expected);
    assert_eq!((&object["method"], &object["epochs"], &object["fixed"]), (&"track".into(), &60.into(), &60.into()));
    // Epochs in another order in the file are processed in the order of their times.
    let (header, rows) = ranges.split_once('\n').expect("a header");
    let backwards: String = rows.lines().rev().map(|row| format!("{row}\n")).collect();
    folder.write("backwards.csv", format!("{header}\n{backwards}").as_bytes());
    let again = folder.run(&format!("{} --json", arguments.replace("r.csv", "backwards.csv"))).ok().json();
    assert_eq!((again[0]["epochs"].as_u64(), again[0]["fixed"].as_u64()), (Some(60), Some(60)), "{again}");
    // The runs differ only in the order of the anchors within a round.
    let [rmse_m, again_m] = [&json, &again].map(|json| json[0]["rmse_m"].as_f64().expect("a number"));
    assert!((rmse_m - again_m).abs() < 1e-3, "{rmse_m} {again_m}");
    // A flag of former versions changes nothing.
    assert_eq!(folder.run(&format!("{arguments} --consistency --json")).ok().json(), json);
}

#[test]
fn a_classifier_whose_features_no_range_has_changes_nothing() {
    let (ranges, _) = recording();
    // Two of the links are blocked by their powers.
    let ranges = ranges.replace("range_m\n", "range_m,rx_power_dbm,fp_power_dbm\n");
    let powers = ranges.lines().map(|row| match row.split(',').nth(2) {
        Some("a" | "b") => format!("{row},-80,-96\n"),
        Some("c" | "d") => format!("{row},-80,-81\n"),
        Some(_) | None => format!("{row}\n"),
    });
    let cir = responses(1, 4);
    let files = [("a.csv", ANCHORS), ("r.csv", &*powers.collect::<String>()), ("cir.csv", &*cir)];
    let folder = Folder::with(&files);
    folder.run("nlos train --cir cir.csv --classifiers skewness --out m").ok();
    let arguments = "track --anchors a.csv --ranges r.csv --dims 2 --height-m 1";
    let run = folder.run(&format!("{arguments} --model m --classifier skewness:1")).ok();
    assert!(run.stderr.contains("no range of the recording tells"), "{}", run.stderr);
    assert_eq!(run.stdout, folder.run(arguments).ok().stdout);
}

#[test]
fn without_enough_ranges_there_is_a_row_with_a_reason() {
    let ranges = "epoch,t_s,anchor,range_m\n0,0,a,5\n0,0,b,5\n1,nan,a,5\n";
    let folder =
        Folder::with(&[("a.csv", ANCHORS), ("r.csv", "epoch,t_s,anchor,range_m\n0,0,a,5\n0,0,b,5\n1,-7,a,5\n")]);
    let run = folder.run("track --anchors a.csv --ranges r.csv --dims 2 --height-m 1");
    assert_eq!((run.column("x_m"), run.column("reason")), (vec![""; 2], vec!["too-few-anchors"; 2]));
    assert_eq!(run.code, Some(1), "{run:?}");
    folder.write("r.csv", ranges.as_bytes());
    let run = folder.run("track --anchors a.csv --ranges r.csv");
    assert_eq!((run.code, run.stdout.as_str()), (Some(2), ""));
    assert!(run.stderr.starts_with("r.csv:4:"), "{}", run.stderr);
}

#[test]
fn the_engine_reaches_its_accuracy_on_recorded_ranges_and_knows_it() {
    replay("track", [0.085, 0.09, 0.08, 0.125], |name, summary| {
        // The mean squared error in units of the covariance is 2 where the covariance is right. Places at rest are few:
        // all errors of one are alike.
        let nees = summary["nees"].as_f64().expect("a number");
        assert!((0.5..=4.0).contains(&nees), "{name}: {nees}");
    });
}

#[test]
fn detection_in_the_papers_filter_takes_two_thirds_of_the_error_away() {
    let folder = Folder::with(&[]);
    let json = folder.run("bench garcia --rooms 4 --seed 2 --json").ok().object();
    let score = |way: &str| {
        let list = json["scores"].as_array().expect("a list");
        list.iter().find(|score| score["way"] == way).unwrap_or_else(|| panic!("no {way}")).clone()
    };
    // Four rooms of 48 points of 100 measurements; table II of E. Garcia et al. (2015).
    assert_eq!(score("ekf")["positions"], 19_200);
    assert_eq!((&score("ekf")["printed_x_m"], &score("no-mitigation")["printed_y_m"]), (&0.43.into(), &0.85.into()));
    assert!(score("ekf")["reduction"].as_f64().expect("a number") >= 0.67, "{json}");
    assert_eq!(
        folder.run("bench garcia --rooms 1 --json").ok().stdout,
        folder.run("bench garcia --rooms 1 --json").ok().stdout
    );
}

#[test]
fn leaving_blocked_ranges_out_brings_the_iterated_filter_to_the_printed_error() {
    let json = Folder::with(&[]).run("bench barral --seed 3 --json").ok().json();
    let mae = |algorithm: &str, configuration: &str| {
        let list = json.as_array().expect("a list");
        let row = list.iter().find(|row| row["algorithm"] == algorithm && row["configuration"] == configuration);
        row.and_then(|row| row["mae_m"].as_f64()).unwrap_or_else(|| panic!("no {algorithm} {configuration}"))
    };
    // Table 4 of V. Barral et al. (Sensors 19, 2019): 0.381 m with all ranges, 0.084 m without those classified as
    // blocked.
    assert!((0.25..0.55).contains(&mae("iekf", "no-ignore")), "{json}");
    assert!(mae("iekf", "ignore") <= 0.084, "{json}");
    // Corrections learnt elsewhere increase the error.
    assert!(mae("iekf", "ignore-mitigate") > mae("iekf", "ignore"));
    assert!(mae("engine", "weigh") < 0.9 * mae("engine", "no-ignore"));
}
