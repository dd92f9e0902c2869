//! Recordings of several tags, and recordings as folders.

use std::fmt::Write as _;

use crate::support::{Folder, Run};

const ANCHORS: &str = "anchor,x_m,y_m,z_m\na,0,0,0\nb,9,0,0\nc,9,9,0\nd,0,9,0\n";

/// The distance of a tag from the anchors, whose order is that of [`ANCHORS`].
fn ranges_m([x, y]: [f64; 2]) -> [(&'static str, f64); 4] {
    [("a", [0.0, 0.0]), ("b", [9.0, 0.0]), ("c", [9.0, 9.0]), ("d", [0.0, 9.0])]
        .map(|(anchor, [ax, ay])| (anchor, (x - ax).hypot(y - ay)))
}

/// Two tags that walk in parallel, 6 m apart, with the same numbers of epochs, and their truth.
fn two_tags() -> (String, String) {
    let (mut ranges, mut truth) =
        ("epoch,t_s,anchor,range_m,tag\n".to_owned(), "epoch,t_s,x_m,y_m,z_m,tag\n".to_owned());
    for k in 0..40 {
        let t = 0.1 * f64::from(k);
        for (tag, y) in [("car", 1.5), ("dog", 7.5)] {
            let at = [1.0 + 0.5 * t, y];
            let _ = writeln!(truth, "{k},{t},{},{},0,{tag}", at[0], at[1]);
            for (anchor, range) in ranges_m(at) {
                let _ = writeln!(ranges, "{k},{t},{anchor},{range:.4},{tag}");
            }
        }
    }
    (ranges, truth)
}

#[test]
fn each_tag_is_solved_and_tracked_by_itself_and_keeps_its_name() {
    let (ranges, truth) = two_tags();
    let folder = Folder::with(&[("anchors.csv", ANCHORS), ("ranges.csv", &ranges), ("truth.csv", &truth)]);
    for command in ["solve", "track"] {
        let run = folder.run(&format!("{command} . --dims 2 --height-m 0")).ok();
        assert_eq!(run.column("epoch").len(), 80, "{command}");
        assert!(run.numbers("error_m").iter().all(|error| *error < 0.05), "{command}: {:?}", run.numbers("error_m"));
        for (tag, y) in run.column("tag").into_iter().zip(run.numbers("y_m")) {
            let expected = if tag == "car" { 1.5 } else { 7.5 };
            assert!((y - expected).abs() < 0.05, "{command}: {tag} at {y}");
        }
        let rows = folder.run(&format!("{command} . --dims 2 --height-m 0 --json")).ok().json();
        let of = |at: usize| (rows[at]["tag"].clone(), rows[at]["epochs"].clone(), rows[at]["fixed"].clone());
        assert_eq!(of(0), ("car".into(), 40.into(), 40.into()), "{rows}");
        assert_eq!(of(1), ("dog".into(), 40.into(), 40.into()), "{rows}");
        assert_eq!(of(2), (serde_json::Value::Null, 80.into(), 80.into()), "{rows}");
    }
}

#[test]
fn the_velocity_of_a_track_is_that_of_the_walk() {
    let (ranges, truth) = two_tags();
    let folder = Folder::with(&[("anchors.csv", ANCHORS), ("ranges.csv", &ranges), ("truth.csv", &truth)]);
    let run = folder.run("track . --dims 2 --height-m 0").ok();
    // The tags walk at 0.5 m/s along x.
    let last = |column| run.numbers(column).last().copied().expect("a row");
    assert!((last("vx_m_s") - 0.5).abs() < 0.1 && last("vy_m_s").abs() < 0.1, "{}", run.stdout);
    assert!(!run.stdout.contains("vz_m_s"), "the plane has no vertical velocity");
}

#[test]
fn a_truth_of_several_tags_needs_to_know_which() {
    let (ranges, truth) = two_tags();
    let one: String = ranges.lines().filter(|line| !line.ends_with("dog")).fold(String::new(), |mut text, line| {
        let _ = writeln!(text, "{}", line.rsplit_once(',').expect("a last column").0);
        text
    });
    let folder = Folder::with(&[("anchors.csv", ANCHORS), ("ranges.csv", &one), ("truth.csv", &truth)]);
    let run = folder.run("solve . --dims 2");
    assert_eq!(run.code, Some(2));
    assert_eq!(run.stderr, "./truth.csv: it is of 2 tags, and the other file has no column tag\n");
}

#[test]
fn rooms_are_remembered_for_each_tag_alone() {
    let (ranges, truth) = two_tags();
    let outlines = "room,x_m,y_m\nhall,0,0\nhall,9,0\nhall,9,4\nhall,0,4\nattic,0,5\nattic,9,5\nattic,9,9\nattic,0,9\n";
    let folder = Folder::with(&[
        ("anchors.csv", ANCHORS),
        ("ranges.csv", &ranges),
        ("truth.csv", &truth),
        ("rooms.csv", outlines),
    ]);
    folder.run("track . --dims 2 --height-m 0 --out positions.csv").ok();
    let rows = folder.run("classify-rooms --positions positions.csv --outlines rooms.csv --truth truth.csv --json");
    let rows = rows.ok().json();
    for (at, tag) in ["car", "dog"].into_iter().enumerate() {
        assert_eq!(rows[at]["tag"], tag, "{rows}");
        assert_eq!((&rows[at]["changes"], &rows[at]["wrong"]), (&0.into(), &0.into()), "{rows}");
    }
}

#[test]
fn a_folder_says_in_which_space_its_tags_are() {
    let (ranges, truth) = two_tags();
    let files = [("anchors.csv", ANCHORS), ("ranges.csv", &ranges), ("truth.csv", &truth)];
    let flags = Folder::with(&files).run("solve . --dims 2 --height-m 0").ok();
    let folder = Folder::with(&files);
    folder.write("recording.toml", b"dims = 2\nheight_m = 0.0\n");
    assert_eq!(folder.run("solve .").ok().stdout, flags.stdout);
    let run = folder.run("solve nowhere");
    assert_eq!((run.code, run.stderr.contains("no folder")), (Some(2), true), "{}", run.stderr);
    std::fs::remove_file(folder.path("ranges.csv")).expect("removed");
    assert_eq!(folder.run("solve .").stderr, ".: the folder has no ranges.csv\n");
}

#[test]
fn a_simulated_folder_is_solved_as_it_is() {
    let folder = Folder::with(&[]);
    folder.run("simulate --seconds 2 --tags 2 --out ranges").ok();
    let run = folder.run("track ranges").ok();
    // The tags' height is known: it stands in the same way beside the positions that the simulation wrote.
    for text in [&run.stdout, &String::from_utf8(folder.read("ranges/positions.csv")).expect("text")] {
        let rows = Run { code: None, stdout: text.clone(), stderr: String::new() };
        for (x, z) in rows.numbers("x_m").into_iter().zip(rows.numbers("z_m")) {
            assert!(if x.is_nan() { z.is_nan() } else { z == 1.2 }, "{text}");
        }
        assert!(rows.column("sigma_z_m").iter().all(|sigma| sigma.is_empty()), "{text}");
    }
    assert!(run.stderr.lines().any(|line| line.starts_with("track") && line.contains(" all ")), "{}", run.stderr);
    folder.run("simulate --seconds 2 --mode tdoa --out differences").ok();
    let run = folder.run("track differences").ok();
    let known: Vec<f64> = run.numbers("error_m").into_iter().filter(|error| error.is_finite()).collect();
    assert!(known.len() > 50 && known.iter().all(|error| *error < 1.0), "{known:?}");
}

/// Exact differences of a tag at (3, 4) to anchor a: 5 m away; the others by Pythagoras.
fn differences() -> String {
    let mut text = "epoch,t_s,reference,anchor,difference_m\n".to_owned();
    for k in 0..20 {
        for (anchor, range) in ranges_m([3.0, 4.0]) {
            let _ = writeln!(text, "{k},{},a,{anchor},{:.4}", 0.1 * f64::from(k), range - 5.0);
        }
    }
    text
}

#[test]
fn differences_of_arrivals_are_solved_and_tracked() {
    let folder = Folder::with(&[("anchors.csv", ANCHORS), ("differences.csv", &differences())]);
    folder.write("recording.toml", b"mode = \"differences\"\ndims = 2\nheight_m = 0.0\n");
    for (command, method) in [("solve", "hyperbolic"), ("track", "track")] {
        let run = folder.run(&format!("{command} .")).ok();
        assert_eq!(run.column("method"), [method; 20]);
        for (x, y) in run.numbers("x_m").into_iter().zip(run.numbers("y_m")).skip(5) {
            assert!((x - 3.0).abs() < 0.02 && (y - 4.0).abs() < 0.02, "{command}: {x}, {y}");
        }
    }
    let run = folder.run("solve . --method nls");
    assert_eq!((run.code, run.stderr.starts_with("--method: only for ranges")), (Some(2), true), "{}", run.stderr);
    let by_flag = folder.run("solve --anchors anchors.csv --differences differences.csv --dims 2 --height-m 0").ok();
    assert_eq!(by_flag.stdout, folder.run("solve .").ok().stdout);
}
