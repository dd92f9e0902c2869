//! The truth joined by time, the offset of its clock, and rounds of single ranges.

use std::fmt::Write as _;

use crate::support::Folder;

const ANCHORS: &str = "anchor,x_m,y_m,z_m\na,0,0,3\nb,10,0,2\nc,10,8,3\nd,0,8,1\n";
const CORNERS: [(&str, [f64; 3]); 4] =
    [("a", [0.0, 0.0, 3.0]), ("b", [10.0, 0.0, 2.0]), ("c", [10.0, 8.0, 3.0]), ("d", [0.0, 8.0, 1.0])];
const SOLVE: &str = "--anchors anchors.csv --ranges ranges.csv --truth truth.csv --dims 2";

/// The exact distance from an anchor to a tag, metres.
fn distance_m(anchor: [f64; 3], tag: [f64; 3]) -> f64 {
    anchor.iter().zip(tag).map(|(a, t)| (a - t) * (a - t)).sum::<f64>().sqrt()
}

/// Rounds of exact ranges to all anchors: their times and the tag's positions.
fn ranges(rounds: impl IntoIterator<Item = (f64, [f64; 3])>) -> String {
    let mut text = "epoch,t_s,anchor,range_m\n".to_owned();
    for (epoch, (t_s, tag)) in rounds.into_iter().enumerate() {
        for (anchor, at) in CORNERS {
            let _ = writeln!(text, "{epoch},{t_s:.3},{anchor},{:.4}", distance_m(at, tag));
        }
    }
    text
}

fn folder(ranges: &str, truth: &str) -> Folder {
    Folder::with(&[("anchors.csv", ANCHORS), ("ranges.csv", ranges), ("truth.csv", truth)])
}

fn near(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{found} is not {expected} ± {tolerance}");
}

#[test]
fn the_truth_has_its_own_rate_and_its_own_epochs() {
    // The truth goes from (3, 4, 1) to (4, 4, 1.4) in a second. The ranges are those of a tag 0.1 m beside it, at its
    // height: (3.25, 4.1, 1.1) at 0.25 s, (3.5, 4.1, 1.2) at 0.5 s. Half a second after the last row, nothing is known.
    let truth = "epoch,t_s,x_m,y_m,z_m\n0,0,3,4,1\n70,1,4,4,1.4\n";
    let rounds = [(0.25, [3.25, 4.1, 1.1]), (0.5, [3.5, 4.1, 1.2]), (1.5, [4.5, 4.1, 1.4])];
    let folder = folder(&ranges(rounds), truth);
    let run = folder.run(&format!("solve {SOLVE} --method nls --height-from-truth")).ok();
    // The rows of the truth are no epochs of the ranges, so they are no lost rounds.
    assert_eq!(run.column("epoch"), ["0", "1", "2"]);
    assert_eq!(run.column("reason"), ["", "", "height-unknown"]);
    let errors = run.numbers("error_m");
    near(errors[0], 0.1, 0.002);
    near(errors[1], 0.1, 0.002);
    assert!(errors[2].is_nan(), "{errors:?}");
    // A truth that is stamped 0.5 s late belongs to times that are 0.5 s earlier. At 0.25 s the tag is where the truth
    // is at 0.75 s: (3.75, 4), and the error is √(0.5² + 0.1²) = 0.5099.
    let run = folder.run(&format!("solve {SOLVE} --method nls --height-m 1.1 --time-offset-s -0.5")).ok();
    near(run.numbers("error_m")[0], 0.5099, 0.002);
    let json = folder.run(&format!("solve {SOLVE} --time-offset-s -0.5 --json")).ok().json();
    assert_eq!(json[0]["time_offset_s"], -0.5);
}

#[test]
fn a_gap_in_the_truth_of_a_moving_tag_is_no_truth() {
    let rounds = [(0.0, [3.0, 4.0, 1.0]), (2.0, [4.0, 4.0, 1.0]), (4.0, [5.0, 4.0, 1.0]), (9.0, [5.0, 4.0, 1.0])];
    // From 4 s to 14 s the tag rests.
    let truth = "epoch,t_s,x_m,y_m,z_m\np,0,3,4,1\nq,4,5,4,1\nr,14,5,4,1\n";
    let run = folder(&ranges(rounds), truth).run(&format!("solve {SOLVE} --method nls --height-m 1")).ok();
    let errors = run.numbers("error_m");
    assert!(errors[1].is_nan() && [0, 2, 3].iter().all(|at| errors[*at] < 0.002), "{errors:?}");
}

#[test]
fn clocks_without_a_common_second_are_joined_by_epoch() {
    let rounds = [(100.0, [3.0, 4.0, 1.0]), (101.0, [4.0, 4.0, 1.0])];
    let folder = folder(&ranges(rounds), "epoch,t_s,x_m,y_m,z_m\n0,0,3,4,1\n1,1,4,4.3,1\n");
    let run = folder.run(&format!("solve {SOLVE} --method nls --height-m 1")).ok();
    near(run.numbers("error_m")[1], 0.3, 0.002);
    assert!(run.stderr.contains("joined by epoch"), "{}", run.stderr);
    let json = folder.run(&format!("solve {SOLVE} --height-m 1 --json")).ok().json();
    assert!(json[0].get("time_offset_s").is_none(), "{json}");
}

/// A tag that goes round a circle of 3 m about (5, 4) in 20 s, to and fro.
fn circling(t_s: f64) -> [f64; 3] {
    let folded = (t_s.rem_euclid(30.0) - 15.0).abs();
    let (sin, cos) = (std::f64::consts::TAU * folded / 20.0).sin_cos();
    [5.0 + 3.0 * cos, 4.0 + 3.0 * sin, 1.0]
}

#[test]
fn the_offset_of_the_clocks_is_found_and_is_the_same_for_every_method() {
    // Ranges at 10 Hz for 60 s. The truth, at 7 Hz, is stamped 0.4 s late, which is 0.4 m at 0.94 m/s.
    let rounds = (0..600).map(|k| 0.1 * f64::from(k)).map(|t_s| (t_s, circling(t_s)));
    let mut truth = "epoch,t_s,x_m,y_m,z_m\n".to_owned();
    for k in 0..434 {
        let t_s = f64::from(k) / 7.0 - 1.0;
        let [x, y, z] = circling(t_s);
        let _ = writeln!(truth, "{k},{:.4},{x:.4},{y:.4},{z}", t_s + 0.4);
    }
    let folder = folder(&ranges(rounds), &truth);
    let arguments = format!("{SOLVE} --height-m 1 --time-offset-s auto --json");
    let solved = folder.run(&format!("solve {arguments} --method nls,robust")).ok();
    let (json, figure) = (solved.json(), |value: &serde_json::Value| value.as_f64().expect("a number"));
    near(figure(&json[0]["time_offset_s"]), -0.4, 0.005);
    assert!(figure(&json[0]["rmse_m"]) < 0.02 && figure(&json[1]["rmse_m"]) < 0.02, "{json}");
    assert!(solved.stderr.contains("is added to the times of the truth"), "{}", solved.stderr);
    let track = folder.run(&format!("track {arguments}")).ok().json();
    assert_eq!(
        (&json[1]["time_offset_s"], &json[0]["time_offset_s"]),
        (&track[0]["time_offset_s"], &track[0]["time_offset_s"])
    );
    // Nothing is added unless asked for: the tag's speed of 2 π · 3 ⁄ 20 = 0.942 m/s, times 0.4 s, along the circle, is
    // 0.376 m as a chord.
    let json = folder.run(&format!("solve {SOLVE} --height-m 1 --method nls --json")).ok().json();
    assert_eq!(json[0]["time_offset_s"], 0.0);
    near(figure(&json[0]["p50_m"]), 0.376, 0.005);
}

#[test]
fn a_tag_at_rest_gives_no_offset() {
    let rounds = (0..60).map(|k| (0.5 * f64::from(k), [3.0, 4.0, 1.0]));
    let truth = "epoch,t_s,x_m,y_m,z_m\n0,0,3,4,1\n1,30,3,4,1\n";
    let run = folder(&ranges(rounds), truth).run(&format!("solve {SOLVE} --height-m 1 --time-offset-s auto")).ok();
    assert!(run.stderr.contains("time offset: 0 s: the tag rests"), "{}", run.stderr);
}

/// Two rounds of one exact range an epoch, 20 ms apart and 100 ms between the rounds' begins, of a tag at (3, 4, 1).
fn single_ranges() -> String {
    let mut text = "epoch,t_s,anchor,range_m\n".to_owned();
    for k in 0..8_u32 {
        let (anchor, at) = CORNERS[k as usize % 4];
        let t_s = f64::from(k / 4) * 0.1 + f64::from(k % 4) * 0.02;
        let _ = writeln!(text, "{k},{t_s:.2},{anchor},{:.4}", distance_m(at, [3.0, 4.0, 1.0]));
    }
    text
}

#[test]
fn single_ranges_are_made_into_rounds() {
    let folder = folder(&single_ranges(), "epoch,t_s,x_m,y_m,z_m\n0,0,3,4,1\n90,1,3,4,1\n");
    let run = folder.run(&format!("solve {SOLVE} --method nls --height-m 1")).ok();
    // A round ends where anchor a repeats, and has the epoch and the time of its last range.
    assert_eq!((run.column("epoch"), run.column("t_s")), (vec!["3", "7"], vec!["0.06", "0.16"]));
    assert_eq!(run.column("used"), ["4", "4"]);
    assert!(run.numbers("error_m").iter().all(|error| *error < 0.002), "{}", run.stdout);
    // 1.5 · 4 anchors · 20 ms.
    assert!(run.stderr.contains("rounds of at most 0.120 s"), "{}", run.stderr);
    let run = folder.run(&format!("solve {SOLVE} --height-m 1 --group-s 0"));
    assert_eq!((run.code, run.column("reason")), (Some(1), vec!["too-few-anchors"; 8]));
    assert!(!run.stderr.contains("rounds of"), "{}", run.stderr);
    // 20 ms have passed at the second range of each pair, 40 ms at the next range.
    let run = folder.run(&format!("solve {SOLVE} --height-m 1 --group-s 0.03"));
    assert_eq!((run.code, run.column("epoch")), (Some(1), vec!["1", "3", "5", "7"]));
    // A track takes single ranges as they are, unless asked.
    assert_eq!(folder.run(&format!("track {SOLVE} --height-m 1")).ok().column("epoch").len(), 8);
    let run = folder.run(&format!("track {SOLVE} --height-m 1 --group-s 0.09")).ok();
    assert_eq!((run.column("epoch"), run.column("used")), (vec!["3", "7"], vec!["4", "4"]));
    let run = folder.run(&format!("solve {SOLVE} --group-s -1"));
    assert_eq!(run.code, Some(2), "{run:?}");
}

#[test]
fn a_track_takes_each_range_at_its_own_time() {
    // A tag at 2 m/s along the room. The four ranges of a round are 25 ms apart, and rounds are 100 ms apart: a
    // position of ranges that were taken as simultaneous would be the mean of four, 37 ms or 75 mm late.
    let mut text = "epoch,t_s,anchor,range_m\n".to_owned();
    let mut truth = "epoch,t_s,x_m,y_m,z_m\n".to_owned();
    for k in 0..140_u32 {
        let (anchor, at) = CORNERS[k as usize % 4];
        let t_s = 0.025 * f64::from(k);
        let tag = [1.5 + 2.0 * t_s, 4.0, 1.0];
        let _ = writeln!(text, "{},{t_s:.3},{anchor},{:.4}", k / 4, distance_m(at, tag));
        let _ = writeln!(truth, "{k},{t_s:.3},{:.4},4,1", tag[0]);
    }
    let run = folder(&text, &truth).run(&format!("track {SOLVE} --height-m 1")).ok();
    assert_eq!(run.column("t_s")[..2], ["0.075", "0.175"], "the time of the last range");
    let errors = run.numbers("error_m");
    assert!(errors.len() == 35 && errors[15..].iter().all(|error| *error < 0.03), "{errors:?}");
}

#[test]
fn a_picture_joins_positions_and_truth_by_time() {
    let truth = "epoch,t_s,x_m,y_m\n0,0,3,4\n9,2,5,4\n";
    // At 1 s, without an offset, the truth of 2 s between rows would be a gap; at 2 s it is (5, 4): an error of 0.25 m.
    let positions =
        "epoch,t_s,method,x_m,y_m,z_m,sigma_x_m,sigma_y_m,sigma_z_m,used,reason\n0,2,robust,5,4.25,,,,,4,\n";
    let folder = Folder::with(&[("truth.csv", truth), ("positions.csv", positions)]);
    folder.run("plot --positions positions.csv --truth truth.csv --out picture.svg").ok();
    assert!(String::from_utf8(folder.read("picture.svg")).expect("text").contains("0.250"));
    // With 2 s added, the first row is that of 2 s: √(2² + 0.25²) = 2.016.
    folder.run("plot --positions positions.csv --truth truth.csv --time-offset-s 2 --out picture.svg").ok();
    assert!(String::from_utf8(folder.read("picture.svg")).expect("text").contains("2.016"));
}
