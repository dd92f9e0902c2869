//! The benchmark on the simulated ranges of P. M. de Rojas Malpartida's thesis (Universidad de Sevilla, 2021).

use crate::support::Folder;

/// Root mean square errors of an independent implementation over at least 3,000 points, metres.
const INDEPENDENT_M: [(&str, f64); 8] = [
    ("lls", 0.71),
    ("nls", 0.54),
    ("bounding-box", 0.46),
    ("b-wls", 0.285),
    ("bb-nls", 0.30),
    ("b-wls-r", 0.26),
    ("bb-nls-r", 0.26),
    ("nls-ccv", 0.147),
];
/// An independent search for the maximum of the likelihood had an error of 0.19 m.
const ROBUST_M: f64 = 0.20;

#[test]
fn every_method_is_as_accurate_as_an_independent_implementation() {
    let run = Folder::with(&[]).run("bench thesis --points 3000 --seed 1 --json").ok();
    let list = run.json();
    let list = list.as_array().expect("a list");
    let rmse = |method: &str| {
        let all = list.iter().find(|score| score["method"] == method && score["ddp_anchors"].is_null());
        all.and_then(|score| score["rmse_m"].as_f64()).unwrap_or_else(|| panic!("no figure of {method}"))
    };
    for (method, independent) in INDEPENDENT_M {
        let ratio = rmse(method) / independent;
        assert!((0.95..=1.05).contains(&ratio), "{method}: {} m is not {independent} m ± 5 %", rmse(method));
    }
    assert!(rmse("robust") <= ROBUST_M, "{}", rmse("robust"));
}

#[test]
fn every_point_counts_once_overall_and_once_by_its_detected_paths() {
    let run = Folder::with(&[]).run("bench thesis --points 500 --seed 3 --json").ok();
    let list = run.json();
    for method in ["lls", "nls-ccv", "robust"] {
        let scores = list.as_array().expect("a list").iter().filter(|score| score["method"] == method);
        let (all, by_ddp): (Vec<_>, Vec<_>) = scores.partition(|score| score["ddp_anchors"].is_null());
        let points = |scores: &[&serde_json::Value]| scores.iter().filter_map(|s| s["points"].as_u64()).sum::<u64>();
        assert_eq!((all.len(), points(&all), points(&by_ddp)), (1, 500, 500), "{method}");
        // Mean squares are means over disjoint sets: Σ n · rmse² over the sets is N · rmse².
        let squares = |scores: &[&serde_json::Value]| -> f64 {
            let number = |score: &serde_json::Value, key: &str| score[key].as_f64().expect("a number");
            scores.iter().map(|score| number(score, "points") * number(score, "rmse_m").powi(2)).sum()
        };
        assert!((squares(&all) / squares(&by_ddp) - 1.0).abs() < 1e-4, "{method}");
    }
}

#[test]
fn equal_seeds_give_equal_bytes_and_others_do_not() {
    let folder = Folder::with(&[]);
    let run = |seed: u32| folder.run(&format!("bench thesis --points 100 --seed {seed} --json")).ok().stdout;
    assert_eq!(run(5), run(5));
    assert_ne!(run(5), run(6));
}

#[test]
fn the_table_stands_beside_the_printed_figures() {
    let table = Folder::with(&[]).run("bench thesis --points 200").ok().stdout;
    let row = |name: &str| table.lines().skip_while(|line| !line.contains(name)).nth(1).unwrap_or("").to_owned();
    // Table 8-1: LLS with 3 to 9 detected paths. Over all points: table 8-2.
    let figures = "0.741 | 0.898 | 0.912 | 0.794 | 0.710 | 0.673 | 0.606 | 0.560";
    assert!(row("`lls`").contains("as printed") && row("`lls`").contains(figures), "{table}");
}
