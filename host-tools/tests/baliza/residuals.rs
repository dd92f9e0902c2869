//! Residuals of ranges by anchor, and errors in the plane and in height.

use std::fmt::Write as _;

use crate::support::Folder;

/// Five anchors; the tag is at (3, 4, 0), at distances 5, 4, 3, 5 and 4.
const ANCHORS: &str = "anchor,x_m,y_m,z_m\na,0,0,0\nb,3,0,0\nc,0,4,0\nd,6,8,0\ne,7,4,0\n";
const TRUTH: &str = "epoch,t_s,x_m,y_m,z_m\n0,0,3,4,0\n1,60,3,4,0\n";

/// Twenty rounds: ten of them 0.1 s apart, then a minute, then ten more. `errors_m` gives the errors of a round.
fn ranges(errors_m: impl Fn(u32) -> [f64; 5]) -> String {
    let mut text = "epoch,t_s,anchor,range_m\n".to_owned();
    for k in 0..20 {
        let t_s = 0.1 * f64::from(k) + if k < 10 { 0.0 } else { 50.0 };
        for ((anchor, distance_m), error_m) in
            [("a", 5.0), ("b", 4.0), ("c", 3.0), ("d", 5.0), ("e", 4.0)].into_iter().zip(errors_m(k))
        {
            let _ = writeln!(text, "{k},{t_s:.1},{anchor},{:.3}", distance_m + error_m);
        }
    }
    text
}

fn near(value: &serde_json::Value, expected: f64, tolerance: f64) {
    let found = value.as_f64().expect("a number");
    assert!((found - expected).abs() <= tolerance, "{found} is not {expected} ± {tolerance}");
}

#[test]
fn figures_of_each_anchor_are_those_of_a_hand_calculation() {
    // a: 0.1 and 0.2 in turn; d is always 0.4 m too short, e 1 m too long in six rounds of twenty.
    let errors_m = |k: u32| [0.1 + 0.1 * f64::from(k % 2), 0.0, 0.0, -0.4, if k >= 14 { 1.0 } else { 0.0 }];
    let folder = Folder::with(&[("a.csv", ANCHORS), ("r.csv", &ranges(errors_m)), ("t.csv", TRUTH)]);
    let arguments = "--anchors a.csv --ranges r.csv --truth t.csv --dims 2 --residuals";
    let json = folder.run(&format!("solve {arguments} --method nls,robust --json")).ok().json();
    assert_eq!(json[0]["anchors"], json[1]["anchors"], "they are against the truth");
    let anchors = json[0]["anchors"].as_array().expect("a list");
    let names: Vec<_> = anchors.iter().map(|anchor| anchor["anchor"].as_str()).collect();
    assert_eq!(names, [Some("a"), Some("b"), Some("c"), Some("d"), Some("e")]);
    let [a, b, d, e] = [&anchors[0], &anchors[1], &anchors[3], &anchors[4]];
    assert_eq!(a["ranges"], 20);
    for (key, expected) in [("mean_m", 0.15), ("median_m", 0.15), ("std_m", 0.05), ("blocked_share", 0.0)] {
        near(&a[key], expected, 1e-6);
    }
    // The differences in a row are 0.1 m: 1.4826 · 0.1 ⁄ √2.
    near(&a["white_m"], 0.104_836, 1e-5);
    // The mean of e is 6 ⁄ 20, and its standard deviation √(0.3 · 0.7); 17 of its 18 differences are 0.
    for (key, expected) in [("mean_m", 0.3), ("std_m", 0.458_258), ("white_m", 0.0), ("blocked_share", 0.3)] {
        near(&e[key], expected, 1e-5);
    }
    assert!(a["remark"].is_null() && b["remark"].is_null(), "{json}");
    assert_eq!(d["remark"], "this anchor's position or antenna delay is wrong");
    assert_eq!(e["remark"], "often blocked");
    // As a table, once for all methods.
    let run = folder.run(&format!("solve {arguments} --method nls,robust")).ok();
    assert_eq!(run.stderr.matches("residuals of the ranges").count(), 1, "{}", run.stderr);
    let line = run.stderr.lines().find(|line| line.starts_with("e ")).expect("a line");
    let words: Vec<_> = line.split_whitespace().collect();
    assert_eq!(words, ["e", "20", "0.300", "0.458", "0.000", "0.000", "30.0", "%", "often", "blocked"]);
    assert!(run.stderr.contains("anchor            ranges   mean_m"), "{}", run.stderr);
}

#[test]
fn a_tag_at_rest_does_not_distinguish_a_blocked_anchor_from_a_wrong_one() {
    let files = [("a.csv", ANCHORS), ("r.csv", &*ranges(|_| [0.0, 0.0, 0.0, 1.0, 0.0])), ("t.csv", TRUTH)];
    let folder = Folder::with(&files);
    let json = folder.run("track --anchors a.csv --ranges r.csv --truth t.csv --dims 2 --residuals --json").ok().json();
    let remark = json[0]["anchors"][3]["remark"].as_str().expect("a remark");
    assert!(remark.starts_with("always blocked, or"), "{remark}");
    // Without truth they are against the solved positions, which are a few centimetres off.
    let json = folder.run("solve --anchors a.csv --ranges r.csv --dims 2 --residuals --json").ok().json();
    near(&json[0]["anchors"][3]["median_m"], 1.0, 0.2);
    near(&json[0]["anchors"][0]["median_m"], 0.0, 0.15);
    let json = folder.run("solve --anchors a.csv --ranges r.csv --dims 2 --json").ok().json();
    assert!(json[0].get("anchors").is_none(), "only where it is asked for");
}

#[test]
fn errors_in_the_plane_and_in_height_are_apart() {
    // Ranges from (1, 1, 1): √3, √11 to (4, 0, 0), √11 to (0, 4, 0), √27 to (4, 4, 4). The truth is off by (3, 4, 12).
    let anchors = "anchor,x_m,y_m,z_m\na,0,0,0\nb,4,0,0\nc,0,4,0\nd,4,4,4\n";
    let ranges = "epoch,t_s,anchor,range_m\n0,0,a,1.7320508\n0,0,b,3.3166248\n0,0,c,3.3166248\n0,0,d,5.1961524\n";
    let folder =
        Folder::with(&[("a.csv", anchors), ("r.csv", ranges), ("t.csv", "epoch,t_s,x_m,y_m,z_m\n0,0,4,5,13\n")]);
    let arguments = "solve --anchors a.csv --ranges r.csv --truth t.csv --method nls";
    let run = folder.run(arguments).ok();
    let json = folder.run(&format!("{arguments} --json")).ok().json();
    for (key, expected) in
        [("rmse_m", 13.0), ("rmse_xy_m", 5.0), ("p90_xy_m", 5.0), ("rmse_z_m", 12.0), ("mae_z_m", 12.0)]
    {
        near(&json[0][key], expected, 0.002);
    }
    assert_eq!(json[0]["inside_1_sigma"], 0.0);
    // (12 ⁄ σ)², with the σ of the file, which has four digits.
    let nees_z = (12.0 / run.numbers("sigma_z_m")[0]).powi(2);
    near(&json[0]["nees_z"], nees_z, 0.01 * nees_z);
    assert!(run.stderr.contains("rmse_xy_m rmse_z_m") && run.stderr.contains("of z"), "{}", run.stderr);
    // In the plane there are no heights. A flag of former versions changes nothing.
    let plane = folder.run(&format!("{arguments} --dims 2 --height-m 1 --consistency --json")).ok().json();
    assert!(plane[0]["nees"].is_number() && plane[0]["rmse_xy_m"] == plane[0]["rmse_m"], "{plane}");
    assert!(plane[0].get("rmse_z_m").is_none(), "{plane}");
}
