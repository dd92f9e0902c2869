//! Sites over many seeds.

use crate::support::Folder;

/// Four anchors in the corners and a tag that walks among them, each second for four seconds.
const ROOM: &str = r#"
node = [
    { role = "anchor", position_m = [0.2, 0.2, 2.6] },
    { role = "anchor", position_m = [7.8, 0.2, 2.2] },
    { role = "anchor", position_m = [7.8, 5.8, 2.6] },
    { role = "anchor", position_m = [0.2, 5.8, 2.2] },
    { role = "tag", height_m = 1.2, rate_hz = 1 },
]
simulation = { seconds = 4, fidelity = "air" }
"#;

#[test]
fn a_good_site_has_no_misleading_position_with_any_seed() {
    let results = Folder::with(&[("room.toml", ROOM)]).run("bench seeds room.toml --seeds 3 --json").ok().object();
    assert_eq!((&results["site"], &results["seeds"]), (&"room".into(), &3.into()));
    // Three times four rounds, of which a round at either end may be cut off.
    let positions = results["positions"].as_u64().expect("a number");
    assert!((6..=15).contains(&positions), "{results}");
    assert_eq!([&results["misleading"], &results["beyond_4_sigma"]].map(|of| of.as_u64()), [Some(0); 2], "{results}");
    let [nees, worst] = ["nees", "nees_worst"].map(|key| results[key].as_f64().expect("a number"));
    assert!(0.0 < nees && nees <= worst, "{results}");
}

#[test]
fn a_tag_behind_concrete_is_farther_off_than_one_in_the_room() {
    let wall = |from, to| format!("{{ from_m = {from}, to_m = {to}, material = \"concrete\" }}");
    let walls = [wall("[-1, 5.5]", "[9, 5.5]"), wall("[-1, 0.5]", "[9, 0.5]")].join(", ");
    let walled = ROOM.replace("fidelity = \"air\"", &format!("fidelity = \"air\", wall = [{walls}]"));
    let folder = Folder::with(&[("room.toml", ROOM), ("walled.toml", &walled)]);
    let results = folder.run("bench seeds room.toml walled.toml --seeds 2 --json").ok().json();
    assert_eq!((&results[0]["site"], &results[1]["site"]), (&"room".into(), &"walled".into()));
    let [room, walled] = [0, 1].map(|row: usize| results[row]["rmse_m"].as_f64().expect("a number"));
    assert!(room < walled, "{results}");
}

#[test]
fn a_file_that_is_no_site_is_refused_before_the_work() {
    let folder = Folder::with(&[("room.toml", ROOM), ("none.toml", "node = 3\n")]);
    folder.run("bench seeds room.toml none.toml").refused("none.toml");
}
