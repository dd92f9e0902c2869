//! What scripts use: columns, keys, order, reasons, and positions that agree with a calculation by hand.

use crate::support::{Folder, Run};

/// Four anchors around the tag at (3, 4): 5 = √(3² + 4²) to (0, 0); 4 to (3, 0); 3 to (0, 4); 5 to (6, 8).
const ANCHORS: &str = "anchor,x_m,y_m,z_m\na,0,0,0\nb,3,0,0\nc,0,4,0\nd,6,8,0\n";
const RANGES: &str = "epoch,t_s,anchor,range_m\n7,0.5,a,5\n7,0.5,b,4\n7,0.5,c,3\n7,0.5,d,5\n";

/// Runs `solve` in the plane on these files.
fn solve(files: &[(&str, &str)], more: &str) -> Run {
    run(files, more).ok()
}

/// Runs `solve` on files that make no position at all: the rows are written, and the exit code is 1.
fn solve_nothing(files: &[(&str, &str)], more: &str) -> Run {
    let run = run(files, more);
    assert_eq!(run.code, Some(1), "{run:?}");
    run
}

fn run(files: &[(&str, &str)], more: &str) -> Run {
    Folder::with(files).run(&format!("solve --anchors anchors.csv --ranges ranges.csv {more}"))
}

fn near(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{found} is not {expected} ± {tolerance}");
}

#[test]
fn positions_have_the_columns_of_the_contract() {
    let columns = "epoch,t_s,method,x_m,y_m,z_m,sigma_x_m,sigma_y_m,sigma_z_m,used,reason";
    let run = solve(&[("anchors.csv", ANCHORS), ("ranges.csv", RANGES)], "--dims 2");
    assert_eq!(run.stdout.lines().next(), Some(format!("{columns},cov_xy_m2").as_str()));
    let truth = ("truth.csv", "epoch,t_s,x_m,y_m\n7,0.5,3,4\n");
    let run = solve(&[("anchors.csv", ANCHORS), ("ranges.csv", RANGES), truth], "--dims 2 --truth truth.csv");
    assert_eq!(run.stdout.lines().next(), Some(format!("{columns},error_m,cov_xy_m2").as_str()));
}

#[test]
fn exact_ranges_give_the_exact_position() {
    let run = solve(&[("anchors.csv", ANCHORS), ("ranges.csv", RANGES)], "--dims 2 --method lls,nls,b-wls,bb-nls");
    assert_eq!(run.column("method"), ["lls", "nls", "b-wls", "bb-nls"]);
    assert_eq!(run.column("epoch"), ["7"; 4]);
    assert_eq!(run.column("t_s"), ["0.5"; 4]);
    assert_eq!(run.column("used"), ["4"; 4]);
    assert_eq!((run.column("reason"), run.column("z_m")), (vec![""; 4], vec![""; 4]));
    for (x, y) in run.numbers("x_m").into_iter().zip(run.numbers("y_m")) {
        near(x, 3.0, 0.001);
        near(y, 4.0, 0.001);
    }
    assert!(run.numbers("sigma_x_m").iter().all(|sigma| (0.01..0.3).contains(sigma)), "{}", run.stdout);
}

#[test]
fn a_summary_for_reading_goes_to_standard_error() {
    let run = solve(&[("anchors.csv", ANCHORS), ("ranges.csv", RANGES)], "--dims 2");
    assert_eq!(run.stderr.lines().next().map(|line| line.split_whitespace().next()), Some(Some("method")));
    assert!(run.stderr.lines().nth(1).is_some_and(|line| line.starts_with("robust")), "{}", run.stderr);
}

#[test]
fn json_is_one_list_with_the_keys_of_the_contract() {
    let truth = ("truth.csv", "epoch,t_s,x_m,y_m\n7,0.5,3,4\n8,0.6,3,4\n");
    let files = [("anchors.csv", ANCHORS), ("ranges.csv", RANGES), truth];
    let run = solve(&files, "--dims 2 --truth truth.csv --method nls --json");
    let list = run.json();
    let object = list[0].as_object().expect("an object");
    for key in ["epochs", "fixed", "mae_m", "method", "p50_m", "p90_m", "rmse_m"] {
        assert!(object.contains_key(key), "{key}");
    }
    assert_eq!((&object["method"], &object["epochs"], &object["fixed"]), (&"nls".into(), &1.into(), &1.into()));
    near(object["rmse_m"].as_f64().expect("a number"), 0.0, 0.001);
    assert_eq!(run.stderr, "");

    let run = solve(&files, "--dims 2 --method all --json");
    let list = run.json();
    let methods: Vec<_> = list.as_array().expect("a list").iter().map(|object| object["method"].as_str()).collect();
    let expected = [
        "bounding-box",
        "lls",
        "nls",
        "nls-ccv",
        "b-wls",
        "b-wls-c",
        "b-wls-r",
        "bb-nls",
        "bb-nls-c",
        "bb-nls-r",
        "robust",
    ];
    assert_eq!(methods, expected.map(Some));
    assert!(list[0]["rmse_m"].is_null() && list[0]["p90_m"].is_null(), "no errors without truth");
}

#[test]
fn json_and_out_give_both() {
    let folder = Folder::with(&[("anchors.csv", ANCHORS), ("ranges.csv", RANGES)]);
    let run = folder.run("solve --anchors anchors.csv --ranges ranges.csv --dims 2 --json --out positions.csv").ok();
    assert!(run.json().is_array());
    let written = String::from_utf8(folder.read("positions.csv")).expect("text");
    assert_eq!(written, folder.run("solve --anchors anchors.csv --ranges ranges.csv --dims 2").ok().stdout);
    assert_eq!(folder.names(), ["anchors.csv", "positions.csv", "ranges.csv"], "nothing else is left behind");
}

#[test]
fn all_is_every_method_one_after_the_other() {
    let files = [("anchors.csv", ANCHORS), ("ranges.csv", RANGES)];
    let all = solve(&files, "--dims 2 --method all");
    let robust = solve(&files, "--dims 2 --method robust");
    assert_eq!(all.stdout.lines().last(), robust.stdout.lines().last());
    assert_eq!(all.stdout.lines().count(), 12);
}

#[test]
fn columns_are_found_by_name_in_files_of_other_programs() {
    let plain = solve(&[("anchors.csv", ANCHORS), ("ranges.csv", RANGES)], "--dims 2");
    let anchors =
        "\u{feff}z_m,colour,y_m,x_m,anchor\r\n0,red,0,0,a\r\n,,0,3,b\r\n\r\n0,\"blue, or so\",4,0,\"c\"\r\n0,,8,6,d";
    let ranges = "range_m, anchor ,remark,epoch,t_s\r\n5,a,,7,0.5\r\n\r\n4, b ,,7,\r\n3,c,\"a \"\"good\"\" one\",7,0.5\r\n5,d,,7,0.5\r\n";
    let odd = solve(&[("anchors.csv", anchors), ("ranges.csv", ranges)], "--dims 2");
    assert_eq!(plain.stdout, odd.stdout);
}

#[test]
fn epochs_keep_their_order_and_none_is_missing() {
    // Epoch 3 comes first, and its rows are not adjacent. Epoch 5 has two ranges. One range of epoch 9 is unknown.
    // Epochs 4 and 6 are only in the truth: nothing was measured, so they are no epochs.
    let ranges =
        "epoch,t_s,anchor,range_m\n3,0.1,a,5\n5,0.2,a,5\n3,,b,4\n5,,b,4\n3,,c,3\n3,,d,5\n9,0.9,a,5\n9,,b,\n9,,c,3\n";
    let truth = "epoch,t_s,x_m,y_m,z_m\n3,0.1,3,4,0\n4,0.15,3,4,0\n5,0.2,3,4,0\n6,0.25,3,4,0\n";
    let files = [("anchors.csv", ANCHORS), ("ranges.csv", ranges), ("truth.csv", truth)];
    let run = solve(&files, "--dims 2 --truth truth.csv");
    assert_eq!(run.column("epoch"), ["3", "5", "9"]);
    assert_eq!(run.column("t_s"), ["0.1", "0.2", "0.9"]);
    let few = "too-few-anchors";
    assert_eq!(run.column("reason"), ["", few, few]);
    assert_eq!(run.column("x_m")[1..], [""; 2]);
    assert_eq!(run.column("error_m")[1..], [""; 2]);
    assert!(run.stderr.contains("2 too-few-anchors"), "{}", run.stderr);
}

#[test]
fn a_height_flattens_the_ranges() {
    // Anchors above and below the tag's plane at 2 m: √(5² + 12²) = 13, √(4² + 3²) = 5, √(3² + 4²) = 5, 5.
    let anchors = "anchor,x_m,y_m,z_m\na,0,0,14\nb,3,0,5\nc,0,4,-2\nd,6,8,2\n";
    let ranges = "epoch,t_s,anchor,range_m\n7,0.5,a,13\n7,0.5,b,5\n7,0.5,c,5\n7,0.5,d,5\n";
    let truth = "epoch,t_s,x_m,y_m,z_m\n7,0.5,3,4,2\n";
    let files = [("anchors.csv", anchors), ("ranges.csv", ranges), ("truth.csv", truth)];
    for height in ["--height-m 2", "--truth truth.csv --height-from-truth"] {
        let run = solve(&files, &format!("--dims 2 --method nls {height}"));
        near(run.numbers("x_m")[0], 3.0, 0.001);
        near(run.numbers("y_m")[0], 4.0, 0.001);
        // The height that was given, which has no deviation.
        assert_eq!((run.column("z_m"), run.column("sigma_z_m")), (vec!["2.0000"], vec![""]));
    }
    let run = solve(&files, "--dims 2 --method nls");
    assert!(
        (run.numbers("x_m")[0] - 3.0).hypot(run.numbers("y_m")[0] - 4.0) > 1.0,
        "without a height they are taken as they are"
    );
}

#[test]
fn an_epoch_whose_height_is_not_known_says_so() {
    let truth = "epoch,t_s,x_m,y_m,z_m\n7,0.5,3,4,\n";
    let files = [("anchors.csv", ANCHORS), ("ranges.csv", RANGES), ("truth.csv", truth)];
    let run = solve_nothing(&files, "--dims 2 --truth truth.csv --height-from-truth");
    assert_eq!(run.column("reason"), ["height-unknown"]);
}

#[test]
fn errors_are_horizontal_in_the_plane_and_whole_in_space() {
    // Ranges from (1, 1, 1): √3, √11 to (4, 0, 0), √11 to (0, 4, 0), √27 to (4, 4, 4). The truth is off by (3, 4, 12).
    let anchors = "anchor,x_m,y_m,z_m\na,0,0,0\nb,4,0,0\nc,0,4,0\nd,4,4,4\n";
    let ranges = "epoch,t_s,anchor,range_m\n0,0,a,1.7320508\n0,0,b,3.3166248\n0,0,c,3.3166248\n0,0,d,5.1961524\n";
    let truth = ("truth.csv", "epoch,t_s,x_m,y_m,z_m\n0,0,4,5,13\n");
    let run = solve(&[("anchors.csv", anchors), ("ranges.csv", ranges), truth], "--method lls --truth truth.csv");
    near(run.numbers("z_m")[0], 1.0, 0.001);
    near(run.numbers("error_m")[0], 13.0, 0.002);
    let flat = ("truth.csv", "epoch,t_s,x_m,y_m\n0,0,4,5\n");
    let run = solve(&[("anchors.csv", anchors), ("ranges.csv", ranges), flat], "--method lls --truth truth.csv");
    near(run.numbers("error_m")[0], 5.0, 0.002);
    let truth = ("truth.csv", "epoch,t_s,x_m,y_m,z_m\n7,0,6,8,99\n");
    let files = [("anchors.csv", ANCHORS), ("ranges.csv", RANGES), truth];
    let run = solve(&files, "--method lls --dims 2 --truth truth.csv");
    near(run.numbers("error_m")[0], 5.0, 0.002);
}

#[test]
fn coplanar_anchors_leave_two_images_and_the_flag_chooses() {
    // Anchors on a ceiling at 3 m, above the tag at (1, 1, 1): √(1 + 1 + 4), √(9 + 1 + 4), √(1 + 9 + 4), √(9 + 9 + 4).
    let anchors = "anchor,x_m,y_m,z_m\na,0,0,3\nb,4,0,3\nc,0,4,3\nd,4,4,3\n";
    let ranges = "epoch,t_s,anchor,range_m\n0,0,a,2.4494897\n0,0,b,3.7416574\n0,0,c,3.7416574\n0,0,d,4.6904158\n";
    let files = [("anchors.csv", anchors), ("ranges.csv", ranges)];
    let run = |side: &str| solve(&files, &format!("--method nls {side}"));
    let (unknown, below, above) = (run(""), run("--side below"), run("--side above"));
    near(unknown.numbers("z_m")[0], 1.0, 0.01);
    near(below.numbers("z_m")[0], 1.0, 0.01);
    near(above.numbers("z_m")[0], 5.0, 0.01);
    assert!(unknown.numbers("sigma_z_m")[0] > 2.0, "the other image, 4 m away, is as likely: {}", unknown.stdout);
    assert!(below.numbers("sigma_z_m")[0] < 1.0, "{}", below.stdout);
}

#[test]
fn the_sixteen_shortest_of_many_ranges_are_taken() {
    // Sixteen exact ranges to anchors on a circle of 5 m around (0, 0), and four ranges of 40 m, which are too long.
    let mut anchors = String::from("anchor,x_m,y_m,z_m\n");
    let mut ranges = String::from("epoch,t_s,anchor,range_m\n");
    for i in 0..20 {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / 20.0).sin_cos();
        anchors += &format!("{i},{},{},0\n", 5.0 * cos, 5.0 * sin);
        ranges += &format!("0,0,{i},{}\n", if i % 5 == 0 { 40 } else { 5 });
    }
    let run = solve(&[("anchors.csv", &anchors), ("ranges.csv", &ranges)], "--dims 2 --method nls");
    assert_eq!(run.column("used"), ["16"]);
    near(run.numbers("x_m")[0], 0.0, 0.001);
    near(run.numbers("y_m")[0], 0.0, 0.001);
}

#[test]
fn the_oracle_needs_to_know_what_is_blocked() {
    // The range to d is 2 m too long. The first file says that it is blocked, the second does not.
    let ranges = "epoch,t_s,anchor,range_m,los\n7,0.5,a,5,1\n7,0.5,b,4,1\n7,0.5,c,3,1.0\n7,0.5,d,7,0.0\n";
    let run = solve(&[("anchors.csv", ANCHORS), ("ranges.csv", ranges)], "--dims 2 --method nls-ccv");
    // Four ranges, of which the blocked one has less weight: the error is less than the 2 m of the wrong range.
    assert!((run.numbers("x_m")[0] - 3.0).hypot(run.numbers("y_m")[0] - 4.0) < 0.2, "{}", run.stdout);
    let run = solve_nothing(&[("anchors.csv", ANCHORS), ("ranges.csv", RANGES)], "--dims 2 --method nls-ccv");
    assert_eq!(run.column("reason"), ["sight-unknown"]);
}

#[test]
fn the_iterated_methods_stay_in_the_area() {
    let files = [("anchors.csv", ANCHORS), ("ranges.csv", RANGES)];
    let run = solve(&files, "--dims 2 --method nls --area -1,-1,2.5,10");
    near(run.numbers("x_m")[0], 2.5, 0.001);
}

#[test]
fn a_site_grid_with_its_origin_far_away_costs_no_digits() {
    // The same room on a UTM grid, where an f32 has steps of half a metre.
    let anchors =
        "anchor,x_m,y_m,z_m\na,500000,4649000,0\nb,500003,4649000,0\nc,500000,4649004,0\nd,500006,4649008,0\n";
    let run = solve(&[("anchors.csv", anchors), ("ranges.csv", RANGES)], "--dims 2 --method nls");
    near(run.numbers("x_m")[0], 500_003.0, 0.001);
    near(run.numbers("y_m")[0], 4_649_004.0, 0.001);
}

#[test]
fn a_reader_that_goes_away_is_no_failure() {
    use std::io::{BufRead, BufReader};
    use std::process::Stdio;
    // More output than a pipe holds.
    let mut ranges = String::from("epoch,t_s,anchor,range_m\n");
    for epoch in 0..3000 {
        for (anchor, range) in [("a", 5), ("b", 4), ("c", 3), ("d", 5)] {
            ranges += &format!("{epoch},0,{anchor},{range}\n");
        }
    }
    let folder = Folder::with(&[("anchors.csv", ANCHORS), ("ranges.csv", &ranges)]);
    let mut command = folder.command("solve --anchors anchors.csv --ranges ranges.csv --dims 2");
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("baliza runs");
    let mut line = String::new();
    let mut stdout = BufReader::new(child.stdout.take().expect("piped"));
    stdout.read_line(&mut line).expect("a line");
    drop(stdout);
    let output = child.wait_with_output().expect("it ends");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && !stderr.contains("panic"), "{stderr}");
}

#[test]
fn help_names_every_command_and_method() {
    let folder = Folder::with(&[]);
    let help = folder.run("--help").ok().stdout;
    for command in ["solve", "bench", "plot", "example"] {
        assert!(help.contains(command), "{help}");
    }
    let help = folder.run("solve --help").ok().stdout;
    assert!(help.contains("bb-nls-r, robust") && help.contains("Examples:"), "{help}");
}

#[test]
fn every_document_says_its_schema_and_its_command_and_so_does_an_error() {
    let folder =
        Folder::with(&[("anchors.csv", ANCHORS), ("ranges.csv", RANGES), ("bad.csv", "epoch,anchor,range_m\n1,a,x\n")]);
    let document = folder.run("solve . --dims 2 --json").ok().document();
    assert_eq!((&document["schema"], &document["command"]), (&1.into(), &"solve".into()));
    assert_eq!(document["results"].as_array().map(Vec::len), Some(1));
    let document = folder.run("simulate --seconds 0.5 --json").ok().document();
    assert_eq!((&document["command"], document["results"].as_array().map(Vec::len)), (&"simulate".into(), Some(1)));
    let of = |arguments: &str| {
        let run = folder.run(arguments);
        let document = run.document();
        assert!(document["results"].is_null(), "{document}");
        (run.code, document["command"].clone(), document["error"].clone(), run.stderr)
    };
    let (code, command, error, stderr) = of("solve --anchors anchors.csv --ranges bad.csv --json");
    assert_eq!((code, command), (Some(2), "solve".into()));
    assert_eq!(error, serde_json::json!({ "file": "bad.csv", "line": 2, "message": "range_m \"x\" is not a number" }));
    assert_eq!(stderr, "bad.csv:2: range_m \"x\" is not a number\n");
    let (code, command, error, _) = of("ble solve . --json");
    assert_eq!((code, command), (Some(2), "ble solve".into()));
    assert_eq!(error, serde_json::json!({ "file": ".", "line": null, "message": "the folder has no beacons.csv" }));
    let (code, command, error, _) = of("solve --json --methods nls");
    assert_eq!((code, command), (Some(2), "solve".into()));
    assert!(error["message"].as_str().is_some_and(|said| said.contains("--methods")), "{error}");
}
