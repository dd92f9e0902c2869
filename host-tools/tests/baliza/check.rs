//! `baliza check`: each of the prepared recordings with a mistake is named with the right word, and sound ones are not.

use std::path::Path;

use crate::support::{Folder, REPLAYED, recording, root};

/// The folders of `examples/mistakes`, the code of what is wrong there, and the word that says it.
const MISTAKES: [(&str, &str, &str); 12] = [
    ("all-long", "all-ranges-long", "all ranges are about 1."),
    ("clock-back", "time-backwards", "t_s goes backwards 1 times"),
    ("equal-times", "time-equal", "t_s stands still"),
    ("exchanged", "anchors-exchanged", "the anchors 1 and 5 look exchanged"),
    ("feet", "unit-feet", "the ranges look like feet"),
    ("height", "height-wrong", "the tag is at a height of about"),
    ("kiloseconds", "time-unit", "kiloseconds"),
    ("millimetres", "unit-millimetres", "millimetres"),
    ("moved", "anchor-moved", "anchor 3 is about 1."),
    ("nanoseconds", "unit-nanoseconds", "nanoseconds"),
    ("one-long", "link-blocked", "the ranges of anchor 5 are about"),
    ("zeros", "zero-for-none", "does 0 stand for none?"),
];

#[test]
fn each_prepared_mistake_is_named_by_check_and_by_solve_and_strict_refuses_it() {
    let folder = Folder::with(&[]);
    for (name, code, words) in MISTAKES {
        let path = root().join("examples/mistakes").join(name);
        let path = path.display();
        let run = folder.run(&format!("check {path} --json --strict"));
        assert_eq!(run.code, Some(1), "{name}: {run:?}");
        assert!(
            run.stderr.lines().any(|line| line.starts_with("warning: ") && line.contains(words)),
            "{name}: {run:?}"
        );
        for command in ["check", "solve"] {
            // Without any position, `solve` ends with 1.
            let document = folder.run(&format!("{command} {path} --json")).document();
            let findings = document["results"][0]["findings"].as_array().expect("a list");
            let found = findings
                .iter()
                .any(|of| of["code"] == code && of["message"].as_str().is_some_and(|m| m.contains(words)));
            assert!(found, "{command} {name}: {findings:?}");
        }
    }
}

#[test]
fn exchanged_anchors_are_the_subjects_and_the_residuals_are_evidence() {
    let path = root().join("examples/mistakes/exchanged");
    let folder = Folder::with(&[]);
    let result = folder.run(&format!("check {} --plot exchanged.svg --json", path.display())).ok().object();
    let finding = &result["findings"][0];
    assert_eq!(finding["subjects"], serde_json::json!(["1", "5"]), "{finding}");
    let [before, after] =
        ["residual_m", "residual_explained_m"].map(|key| finding["evidence"][key].as_f64().expect("a number"));
    assert!(after < 0.1 && before > 5.0 * after, "{finding}");
    let picture = String::from_utf8(folder.read("exchanged.svg")).expect("text");
    assert!(picture.contains("where the ranges prefer an anchor") && picture.contains("residual of a range"));
}

#[test]
fn the_recordings_contradict_nothing() {
    for name in REPLAYED {
        let Some(path) = recording(name) else { return };
        let result = Folder::with(&[]).run(&format!("check {} --json", path.display())).ok().object();
        let findings = result["findings"].as_array().expect("a list");
        // Anchors on one ceiling say nothing against a recording.
        assert!(findings.iter().all(|finding| finding["code"] == "ambiguous-geometry"), "{name}: {findings:?}");
    }
}

#[test]
fn one_epoch_one_anchor_and_blocked_ranges_are_told_without_a_crash() {
    let anchors = "anchor,x_m,y_m,z_m\na,0,0,2\nb,10,0,2.5\nc,10,8,2\nd,0,8,3\n";
    let one = "epoch,t_s,anchor,range_m\n0,0,a,5.5\n0,0,b,8.1\n0,0,c,8.2\n0,0,d,5.6\n";
    let one_anchor = "epoch,t_s,anchor,range_m\n0,0,a,5.5\n1,1,a,5.4\n2,2,a,5.3\n";
    let folder = Folder::with(&[("anchors.csv", anchors), ("ranges.csv", one)]);
    assert!(Path::new(&folder.path("ranges.csv")).exists());
    assert!(folder.run("check .").ok().stdout.starts_with("1 epochs, too few ranges for their residuals, 0 findings"));
    folder.write("ranges.csv", one_anchor.as_bytes());
    assert!(folder.run("check .").ok().stdout.starts_with("3 epochs, too few ranges"));
    folder.write("ranges.csv", b"epoch,t_s,anchor,range_m\n");
    folder.run("check .").refused("./ranges.csv:1: no ranges below the header");
    folder.run("check . --height-m 1").refused("--height-m: only with --dims 2");
}

/// The positions by themselves and with the anchors 1 and 5 in each other's place, which is right.
#[test]
fn deviations_grow_to_what_exchanged_anchors_make_wrong() {
    let path = root().join("examples/mistakes/exchanged");
    let read = |name: &str| std::fs::read_to_string(path.join(name)).expect("a file");
    let swapped: String = read("anchors.csv")
        .lines()
        .map(|line| match line.split_once(',') {
            Some(("1", place)) => format!("5,{place}\n"),
            Some(("5", place)) => format!("1,{place}\n"),
            Some(_) | None => format!("{line}\n"),
        })
        .collect();
    let folder = Folder::with(&[("ranges.csv", &read("ranges.csv")), ("recording.toml", &read("recording.toml"))]);
    for command in ["solve", "track"] {
        folder.write("anchors.csv", read("anchors.csv").as_bytes());
        let wrong = folder.run(&format!("{command} .")).ok();
        folder.write("anchors.csv", swapped.as_bytes());
        let right = folder.run(&format!("{command} .")).ok();
        assert!(!right.stderr.contains("warning"), "{right:?}");
        let squares = |axis: &str| {
            let (wrong_m, right_m) = (wrong.numbers(&format!("{axis}_m")), right.numbers(&format!("{axis}_m")));
            let sigmas_m = wrong.numbers(&format!("sigma_{axis}_m"));
            let both = wrong_m.iter().zip(right_m).zip(sigmas_m);
            both.map(|((wrong, right), sigma)| ((wrong - right) / sigma).powi(2)).sum::<f64>() / wrong_m.len() as f64
        };
        let nees = squares("x") + squares("y");
        assert!((0.5..4.0).contains(&nees), "{command}: {nees}");
    }
}
