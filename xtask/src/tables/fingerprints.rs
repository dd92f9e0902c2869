//! Accuracy of comparisons with fingerprints: runs `baliza ble fingerprint` and `baliza ble map` on recorded surveys,
//! and makes tables of the results.

use std::collections::BTreeMap;

use anyhow::{Context, Result};
use baliza_report::MarkdownTable;

use super::{Score, number};
use crate::baliza::{json, words};
use crate::promises::Made;

/// One column each: a title, the recording, and the arguments; `{` is replaced by the recording's folder.
const COLUMNS: [(&str, &str, &str); 6] = [
    ("linde_room, as in the thesis", "linde_room", "--targets {targets.csv --average trimmed --receiver-offset-db 0"),
    ("linde_room, targets", "linde_room", "--targets {targets.csv"),
    ("the same, particle filter", "linde_room", "--targets {targets.csv --particle-filter"),
    ("linde_room, left out", "linde_room", "--leave-one-out"),
    ("linde_floor, left out", "linde_floor", "--leave-one-out"),
    ("kolakowski, held out", "kolakowski", "--hold-out 5 --block 100"),
];

/// The figures printed in A. Linde Cerezo's thesis for its first terminal without the particle filter (table 4.4):
/// MAE and RMSE, metres.
const THESIS: [(&str, f64, f64); 6] = [
    ("w3nn", 1.32, 1.48),
    ("w4nn", 1.23, 1.39),
    ("w5nn", 1.18, 1.34),
    ("3nn", 1.38, 1.51),
    ("4nn", 1.26, 1.41),
    ("5nn", 1.21, 1.37),
];

/// Maps of few points: the recording, the known plan, and the numbers of points.
const MAPS: [(&str, &str, [u32; 4]); 5] = [
    ("linde_floor", "", [8, 12, 18, 24]),
    ("linde_floor", "--beacons {beacons.csv", [8, 12, 18, 24]),
    ("kolakowski", "", [8, 15, 30, 60]),
    ("kolakowski", "--beacons {beacons.csv", [8, 15, 30, 60]),
    ("kolakowski", "--beacons {beacons.csv --walls {walls.csv", [8, 15, 30, 60]),
];

/// Every comparison on every survey.
///
/// # Errors
/// A run of `baliza` fails.
pub fn comparisons() -> Result<Made> {
    let titles = COLUMNS.map(|(title, ..)| format!("{title}:"));
    let mut table = MarkdownTable::new(["MAE (RMSE), m", "the thesis:"].into_iter().map(String::from).chain(titles));
    let mut scores: Vec<BTreeMap<String, String>> = Vec::new();
    for (_, folder, arguments) in COLUMNS {
        let rows = run("fingerprint --kernel all --json", folder, arguments)?;
        // The name of a method with the particle filter shows that.
        let named = rows.iter().map(|row| (row.method.trim_start_matches("fp_").to_owned(), cell(row)));
        scores.push(named.collect());
    }
    for method in THESIS.iter().map(|(method, ..)| *method).chain(["gp", "gp-walk"]) {
        let thesis = THESIS.iter().find(|(name, ..)| *name == method);
        let thesis = thesis.map_or_else(|| "–".to_owned(), |(_, mae, rmse)| format!("{mae:.2} ({rmse:.2})"));
        let cell =
            |score: &BTreeMap<String, String>| score.get(method).cloned().with_context(|| format!("no {method}"));
        let cells = scores.iter().map(cell).collect::<Result<Vec<_>>>()?;
        table.row(format_args!("`{method}` | {thesis} | {}", cells.join(" | ")));
    }
    Ok(Made::one("fingerprints", table.into_text()))
}

/// A recorded walk with its floor plan and without.
///
/// # Errors
/// A run of `baliza` fails.
pub fn barriers() -> Result<Made> {
    let walk = "kolakowski";
    let mut table = MarkdownTable::new(["MAE (RMSE), m", "walls unknown:", "walls are barriers:"]);
    for kernel in ["gp-walk", "gp --particle-filter", "knn --weighted --particle-filter"] {
        let command = format!("fingerprint --json --hold-out 5 --block 100 --kernel {kernel}");
        let score = |walls| -> Result<String> {
            let rows = run(&command, walk, walls)?;
            Ok(cell(rows.first().context("no score")?))
        };
        let (open, walled) = (score("")?, score("--walls {walls.csv")?);
        table.row(format_args!("`--kernel {kernel}` | {open} | {walled}"));
    }
    Ok(Made::one("walls as barriers", table.into_text()))
}

/// Maps of few points.
///
/// # Errors
/// A run of `baliza` fails.
pub fn maps() -> Result<Made> {
    let mut table = MarkdownTable::new(["recording", "known beside", "MAE of the others (RMSE), m"]);
    for (folder, known, points) in MAPS {
        let beside = match known.matches("--").count() {
            0 => "nothing",
            1 => "the beacons' places",
            _ => "the beacons' places, walls",
        };
        let cells = points.map(|count| {
            let map = format!("map --survey-points {count} --json --out OUT/few.map");
            let scores = run(&map, folder, known)?;
            Ok(format!("{count} points: {}", cell(scores.first().context("no score")?)))
        });
        let cells = cells.into_iter().collect::<Result<Vec<_>>>()?;
        table.row(format_args!("{folder} | {beside} | {}", cells.join("; ")));
    }
    Ok(Made::one("predicted maps", table.into_text()))
}

/// The output of `baliza ble` for a recording's survey.
fn run(command: &str, folder: &str, arguments: &str) -> Result<Vec<Score>> {
    let run = format!("ble {command} --fingerprints {{fingerprints.csv {arguments}");
    json(words(&run.replace('{', &format!("DATA/{folder}/")))?)
}

fn cell(score: &Score) -> String {
    format!("{} ({})", number(score.mae_m, 2), number(score.rmse_m, 2))
}

#[cfg(test)]
mod tests {
    use super::{Score, cell};

    #[test]
    fn a_cell_has_both_errors_or_says_that_there_is_none() {
        let score: Score =
            serde_json::from_str(r#"{"method":"gp","k":null,"mae_m":1.018,"rmse_m":1.128}"#).expect("a score");
        assert_eq!(cell(&score), "1.02 (1.13)");
        assert_eq!(cell(&Score { mae_m: None, rmse_m: None, ..score }), "– (–)");
    }
}
