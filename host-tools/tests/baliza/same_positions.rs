//! `track` of what `simulate --out` wrote gives the positions that the simulated tags computed themselves.

use std::collections::HashMap;

use crate::support::{Folder, root};

/// A corridor of 30 m by 3 m with anchors on alternating walls. One tag walks along it, another behind its wall, where
/// the ranges fit a place and its mirror image.
const CORRIDOR: &str = "
[[node]]
role = 'anchor'
position_m = [0.1, 2.9, 2.4]
[[node]]
role = 'anchor'
position_m = [10, 0.1, 2.4]
[[node]]
role = 'anchor'
position_m = [20, 2.9, 2.4]
[[node]]
role = 'anchor'
position_m = [29.9, 0.1, 2.4]
[[node]]
role = 'tag'
height_m = 1.2
rate_hz = 10
simulation = { path_m = [[1, 1.5, 1.2], [29, 1.5, 1.2]] }
[[node]]
role = 'tag'
height_m = 1.2
rate_hz = 10
simulation = { path_m = [[5, 5, 1.2], [25, 5, 1.2]] }
[simulation]
seconds = 8
fidelity = 'air'
[[simulation.wall]]
from_m = [0, 3]
to_m = [30, 3]
material = 'concrete'
[[simulation.wall]]
from_m = [0, 0]
to_m = [30, 0]
material = 'concrete'
";

/// Two rooms and three tags. Receptions are lost, and an anchor is off for a while.
const ROOMS: &str = "
[[node]]
role = 'anchor'
position_m = [0, 0, 2.5]
[[node]]
role = 'anchor'
position_m = [12, 0, 2.5]
[[node]]
role = 'anchor'
position_m = [12, 8, 2.5]
[[node]]
role = 'anchor'
position_m = [0, 8, 2.5]
[[node]]
role = 'anchor'
position_m = [6, 8, 1.5]
[[node]]
role = 'tag'
height_m = 1.2
rate_hz = 20
simulation = { path_m = [[1, 1, 1.2], [5, 7, 1.2], [5, 1, 1.2]] }
[[node]]
role = 'tag'
height_m = 1.2
rate_hz = 20
simulation = { path_m = [[7, 1, 1.2], [11, 7, 1.2]] }
[[node]]
role = 'tag'
height_m = 1.2
rate_hz = 20
simulation = { path_m = [[3, 3, 1.2]] }
[simulation]
seconds = 10
loss = 0.1
fidelity = 'air'
[[simulation.wall]]
from_m = [6, 0]
to_m = [6, 5]
material = 'brick'
[[simulation.fault]]
at_s = 4
node = 3
what = 'off'
[[simulation.fault]]
at_s = 7
node = 3
what = 'on'
";

/// A position; of a tag at a known height, without its z. Its flag, empty without one, and the other place.
type Found = ([f64; 3], String, [f64; 3]);

/// The positions in a table by tag and epoch.
fn positions(text: &str) -> HashMap<(String, String), Found> {
    let mut rows = text.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let header = rows.next().expect("a header");
    let place = |name: &str| header.iter().position(|column| *column == name);
    let [epoch, x, y, z, sigma_z] =
        ["epoch", "x_m", "y_m", "z_m", "sigma_z_m"].map(|name| place(name).expect("a column"));
    let number = |field: &str| field.parse().unwrap_or(f64::NAN);
    let row = |row: Vec<&str>| {
        let tag = place("tag").map_or("", |tag| row[tag]).to_owned();
        let z_m = if row[sigma_z].is_empty() { 0.0 } else { number(row[z]) };
        // A table without any flag has no such columns.
        let field = |name: &str| place(name).map_or("", |column| row[column]);
        let other = ["alt_x_m", "alt_y_m", "alt_z_m"].map(|name| field(name).parse().unwrap_or(0.0));
        let found = ([number(row[x]), number(row[y]), z_m], field("flag").to_owned(), other);
        ((tag, row[epoch].to_owned()), found)
    };
    rows.map(row).filter(|(_, (position, ..))| position[0].is_finite()).collect()
}

/// Simulates, tracks the recording, and compares every position of the nodes. Returns how many have a flag.
fn compare(folder: &Folder, simulated: &str) -> usize {
    let _ = std::fs::remove_dir_all(folder.path("run"));
    folder.run(&format!("simulate {simulated} --out run")).ok();
    let nodes = positions(&String::from_utf8(folder.read("run/positions.csv")).expect("text"));
    let tracked = positions(&folder.run("track run").ok().stdout);
    assert!(nodes.len() > 8, "{simulated}: {}", nodes.len());
    let of_single_tag = tracked.keys().all(|(tag, _)| tag.is_empty());
    let flagged = nodes.values().filter(|(_, flag, _)| !flag.is_empty()).count();
    for ((tag, epoch), of_node) in nodes {
        let tag = if of_single_tag { String::new() } else { tag };
        let found = tracked.get(&(tag.clone(), epoch.clone()));
        let found = found.unwrap_or_else(|| panic!("{simulated}: no epoch {epoch} of {tag}"));
        let apart_m = |a: [f64; 3], b: [f64; 3]| (a[0] - b[0]).hypot(a[1] - b[1]).hypot(a[2] - b[2]);
        // Both tables have tenths of millimetres.
        let is_same = apart_m(found.0, of_node.0) <= 0.001 && apart_m(found.2, of_node.2) <= 0.001;
        assert!(is_same && found.1 == of_node.1, "{simulated}: tag {tag}, epoch {epoch}: {found:?} of {of_node:?}");
    }
    flagged
}

#[test]
fn the_track_of_a_simulated_recording_is_that_of_its_tags() {
    let folder = Folder::with(&[("corridor.toml", CORRIDOR), ("rooms.toml", ROOMS)]);
    let example = |name: &str| format!("--site {}", root().join("examples").join(name).display());
    let scenarios = [
        example("anchors.toml") + " --seconds 10",
        example("walls.toml") + " --seconds 2",
        example("battery.toml") + " --seconds 30",
        example("battery-still.toml") + " --seconds 100",
        example("picked-up.toml") + " --seconds 6",
        "--site corridor.toml".into(),
        "--site corridor.toml --seed 2".into(),
        "--site corridor.toml --seed 3".into(),
        "--site rooms.toml".into(),
        "--site rooms.toml --seed 2".into(),
        "--site rooms.toml --fidelity spi --seconds 3".into(),
        "--seconds 2".into(),
        "--anchors 3 --dims 2 --seconds 8 --fidelity air --rate 10".into(),
        "--anchors 12 --tags 3 --seconds 6 --fidelity air --rate 10".into(),
        "--dims 3 --anchors 6 --seconds 8 --fidelity air --rate 10".into(),
        "--dims 3 --loss 0.3 --seconds 10 --fidelity air --rate 10".into(),
        "--loss 0.6 --seconds 10 --fidelity air --rate 10".into(),
        "--scheme double-sided --tags 2 --seconds 8 --fidelity air --rate 10".into(),
        "--no-power-weighting --seconds 8 --fidelity air --rate 10".into(),
        "--mode tdoa --anchors 6 --seconds 4 --fidelity air".into(),
    ];
    let flagged: usize = scenarios.iter().map(|simulated| compare(&folder, simulated)).sum();
    assert!(flagged > 0, "behind the wall of the corridor ranges fit two places");
}
