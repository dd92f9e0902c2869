//! The figures of the benchmarks: their documents and their pictures.

use papers::fusion::bench::Swept;
use serde_json::json;

use crate::schema_check::check;
use crate::support::Folder;

#[test]
fn the_benchmark_draws_its_figure() {
    let folder = Folder::with(&[]);
    let run = folder.run("bench thesis --points 50 --plot figure.svg").ok();
    assert_eq!(run.stderr, "picture: figure.svg\n");
    let svg = String::from_utf8(folder.read("figure.svg")).expect("text");
    assert!(svg.contains("bb-nls-r") && svg.contains("as printed"));
}

#[test]
fn the_benchmark_of_fusion_agrees_with_its_schema() {
    let scores = Folder::with(&[]).run("bench fusion --walks 1 --json").ok().json();
    assert_eq!(scores.as_array().map(Vec::len), Some(9), "three algorithms with anchors, beacons and both");
    // A row of --sweep, which takes long.
    let row = Swept {
        anchors: 2,
        blocked: 1,
        range_sigma_m: 0.1,
        excess_m: 0.5,
        beacons: 3,
        rmse_m: [None, Some(2.5), Some(1.5)],
        ratio: Some(0.6),
        nees: Some(2.0),
        inside_1_sigma: Some(0.39),
    };
    check(&json!({ "schema": 1, "command": "bench fusion", "results": [row] }));
}
