//! The accuracy protocol.

use crate::support::Folder;

#[test]
fn a_version_is_neither_better_nor_worse_than_itself() {
    let folder = Folder::with(&[]);
    let before = folder.run("bench accuracy --quick --out before.csv").ok().stdout;
    assert!(before.starts_with("| recording | epochs | `solve`: RMSE (P90), m |"), "{before}");
    let run = folder.run("bench accuracy --quick --against before.csv --json").ok().object();
    let compared = run["comparison"].as_array().expect("a list");
    // Seven groups, each with solver and track.
    assert_eq!(compared.len(), 14);
    assert!(compared.iter().all(|site| site["outcome"] == "undecided"), "{compared:?}");
    for verdict in run["verdicts"].as_array().expect("a list") {
        assert_eq!((&verdict["sites"], &verdict["better"], &verdict["counts"]), (&7.into(), &0.into(), &false.into()));
    }
}

#[test]
fn errors_that_were_larger_before_make_the_change_count() {
    let folder = Folder::with(&[]);
    folder.run("bench accuracy --quick --out before.csv").ok();
    // Twice the errors in every block: four times the squares.
    let text = String::from_utf8(folder.read("before.csv")).expect("UTF-8");
    let doubled = text.lines().enumerate().map(|(number, line)| {
        let (rest, square) = line.rsplit_once(',').expect("columns");
        let square = square.parse::<f64>().ok().filter(|_| number > 0).map(|square| (4.0 * square).to_string());
        square.map_or_else(|| format!("{line}\n"), |square| format!("{rest},{square}\n"))
    });
    folder.write("before.csv", doubled.collect::<String>().as_bytes());
    let run = folder.run("bench accuracy --quick --against before.csv").ok();
    assert!(run.stdout.ends_with("the change counts.\n"), "{}", run.stdout);
    assert!(run.stdout.contains(" | 0.500 | 0.0 % | better |"), "{}", run.stdout);
}

#[test]
fn the_simulated_set_is_written_as_recordings() {
    let folder = Folder::with(&[]);
    folder.run("bench accuracy --write-prior cases --cases 2").ok();
    let table = String::from_utf8(folder.read("cases/cases.csv")).expect("UTF-8");
    assert_eq!(table.lines().count(), 3);
    let files = "--anchors cases/00-walk/anchors.csv --ranges cases/00-walk/ranges.csv --truth cases/00-walk/truth.csv";
    let run = folder.run(&format!("track {files} --dims 2 --height-from-truth --json")).ok().json();
    // The bench itself reads no files: the same case, the same figures.
    let bench = folder.run("bench accuracy --cases 1 --quick --json").ok().object();
    let recordings = bench["recordings"].as_array().expect("a list");
    let track = recordings.iter().find(|of| of["recording"] == "00-walk of seed 1" && of["method"] == "track");
    let of = |score: &serde_json::Value| score["rmse_m"].as_f64().expect("a number");
    assert!((of(&run[0]) - of(track.expect("a score"))).abs() < 1e-4);
}

#[test]
fn a_folder_that_is_not_there_is_refused() {
    let run = Folder::with(&[]).run("bench accuracy --data nowhere");
    assert_eq!((run.code, run.stderr.trim_end()), (Some(2), "--data: the folder nowhere does not exist"));
    let run = Folder::with(&[("old.csv", "site,recording\n")]).run("bench accuracy --against old.csv");
    assert_eq!(run.code, Some(2), "{run:?}");
}
