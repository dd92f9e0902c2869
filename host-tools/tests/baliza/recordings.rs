//! Replays of recordings that are not part of the project: where they lie, `BALIZA_DATA` says, else they are looked for beside
//! the repository. Each reach was measured by an independent implementation before this project began.

use std::path::PathBuf;

use crate::support::{Folder, root};

/// Root mean square errors to reach with the default method and the tag's height known, metres.
const REACH_M: [(&str, f64); 4] = [
    ("leiria_128_los_pos1", 0.095),
    ("leiria_128_nlos_pos1", 0.095),
    ("leiria_128_move_slow", 0.087),
    ("cuhk_dynamic_mid", 0.125),
];

#[test]
fn the_default_method_reaches_its_accuracy_on_recorded_ranges() {
    let data = std::env::var_os("BALIZA_DATA").map_or_else(|| root().join("../shared/data"), PathBuf::from);
    for (name, reach) in REACH_M {
        let recording = data.join(name);
        if !recording.is_dir() {
            eprintln!("{name} is not in {}: not replayed", data.display());
            continue;
        }
        let file = |name: &str| recording.join(name).display().to_string();
        let run = Folder::with(&[]).run(&format!(
            "solve --anchors {} --ranges {} --truth {} --dims 2 --height-from-truth --json",
            file("anchors.csv"),
            file("ranges.csv"),
            file("truth.csv"),
        ));
        let summary = &run.ok().json()[0];
        assert_eq!(summary["epochs"], summary["fixed"], "{name}: {summary}");
        let rmse = summary["rmse_m"].as_f64().expect("a number");
        assert!(rmse <= reach, "{name}: {rmse} m is more than {reach} m");
    }
}
