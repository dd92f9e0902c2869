//! `track --smooth`: the way back through a recording.

use crate::support::{Folder, Run, recording, root};

/// Track and smoother of a run: the keys of its JSON.
fn figures(run: &Run) -> [serde_json::Value; 2] {
    let results = run.json();
    let of = |method: &str| results.as_array().and_then(|all| all.iter().find(|of| of["method"] == method).cloned());
    ["track", "track-smooth"].map(|method| of(method).unwrap_or_else(|| panic!("no {method}: {results}")))
}

/// The smoother's RMSE as a share of the track's.
fn share(run: &Run) -> f64 {
    let [track, smooth] = figures(run).map(|of| of["rmse_m"].as_f64().expect("a number"));
    smooth / track
}

#[test]
fn positions_by_the_whole_recording_stand_beside_those_of_the_track() {
    let folder = Folder::with(&[]);
    let room = root().join("examples/room").display().to_string();
    let alone = folder.run(&format!("track {room}")).ok();
    let run = folder.run(&format!("track {room} --smooth --plot both.svg")).ok();
    // The track's rows are what they are without the smoother, and as many rows follow.
    let rows = |run: &Run, method: &str| -> Vec<String> {
        let of_method = |row: &&str| row.split(',').nth(2) == Some(method);
        run.stdout.lines().filter(of_method).map(str::to_owned).collect()
    };
    assert_eq!(rows(&run, "track"), rows(&alone, "track"));
    assert_eq!(rows(&run, "track-smooth").len(), rows(&alone, "track").len());
    let picture = String::from_utf8(folder.read("both.svg")).expect("text");
    assert!(picture.contains("track-smooth"), "both are in the picture");
    let run = folder.run(&format!("track {room} --smooth --json")).ok();
    let [track, smooth] = figures(&run);
    assert_eq!((&track["epochs"], &track["fixed"]), (&smooth["epochs"], &smooth["fixed"]));
    assert!(share(&run) < 0.9, "{track} {smooth}");
    let nees = smooth["nees"].as_f64().expect("a number");
    // The room has no lasting errors, which engine and smoother expect.
    assert!((0.3..4.0).contains(&nees), "{smooth}");
}

/// The positions y of track and smoother where a tag walks 4 m on one side of anchors on a line. The first ranges fit its
/// mirror image better; an anchor off the line answers from the fourth second on.
fn beside_a_line(side: f64) -> [Vec<f64>; 2] {
    let mut ranges = "epoch,t_s,anchor,range_m\n".to_owned();
    let anchors = [(0.0, 0.0), (4.0, 0.1), (8.0, 0.0), (12.0, 0.1), (6.0, 9.0)];
    for epoch in 0..100 {
        let t_s = 0.1 * f64::from(epoch);
        // Until then, errors of up to 0.1 m make the ranges those of the mirror image.
        let (x, y) = (2.0 + 0.8 * t_s, if epoch < 40 { 0.1 - 4.0 * side } else { 4.0 * side });
        for (anchor, (ax, ay)) in anchors.iter().enumerate().take(if epoch < 40 { 4 } else { 5 }) {
            // A few centimetres of noise that is the same in each run.
            let noise = 0.03 * (f64::from(epoch) * 7.7 + anchor as f64 * 1.9).sin();
            ranges += &format!("{epoch},{t_s:.1},{anchor},{:.4}\n", f64::hypot(x - ax, y - ay) + noise);
        }
    }
    let places = anchors.iter().enumerate().map(|(anchor, (x, y))| format!("{anchor},{x},{y},0\n"));
    let places = "anchor,x_m,y_m,z_m\n".to_owned() + &places.collect::<String>();
    let folder = Folder::with(&[("anchors.csv", &places), ("ranges.csv", &ranges)]);
    let run = folder.run("track . --dims 2 --height-m 0 --smooth").ok();
    let (methods, y_m) = (run.column("method"), run.numbers("y_m"));
    let rows = || methods.iter().zip(&y_m);
    ["track", "track-smooth"].map(|method| rows().filter(|(of, _)| **of == method).map(|(_, y)| *y).collect())
}

#[test]
fn the_hypothesis_that_wins_has_the_positions_before() {
    let mut wrong = 0;
    for side in [-1.0, 1.0] {
        let [track, smooth] = beside_a_line(side);
        wrong += track.iter().filter(|y| **y * side < 2.0).count();
        assert!(smooth.iter().all(|y| (3.5..4.5).contains(&(y * side))), "{side}: {smooth:?}");
    }
    assert!(wrong > 20, "the track begins on the wrong side of one of the walks: {wrong}");
}

#[test]
fn a_recording_without_a_track_has_the_reasons_of_its_filter() {
    let folder = Folder::with(&[
        ("anchors.csv", "anchor,x_m,y_m,z_m\na,0,0,2\nb,5,0,2\n"),
        ("ranges.csv", "epoch,t_s,anchor,range_m\n0,0,a,3\n0,0,b,4\n1,0.1,a,3\n1,0.1,b,4\n"),
    ]);
    let run = folder.run("track . --smooth");
    assert_eq!(run.code, Some(1), "{run:?}");
    assert_eq!(run.column("reason"), ["too-few-anchors"; 4]);
}

#[test]
fn one_recording_of_each_site_is_better_by_a_tenth_and_knows_it() {
    let (mut product, mut count) = (1.0, 0);
    let folder = Folder::with(&[]);
    for name in ["leiria_128_los_pos1", "cuhk_dynamic_mid", "hanyang_los_b_3"] {
        let Some(recording) = recording(name) else { continue };
        let run = folder.run(&format!("track {} --smooth --time-offset-s auto --json", recording.display())).ok();
        let [track, smooth] = figures(&run).map(|of| of["rmse_xy_m"].as_f64().expect("a number"));
        product *= smooth / track;
        count += 1;
        let nees = figures(&run)[1]["nees"].as_f64().expect("a number");
        assert!((0.5..4.0).contains(&nees), "{name}: {nees}");
    }
    assert!(count == 0 || product.powf(1.0 / f64::from(count)) <= 0.9, "{product} of {count}");
}
