//! Accuracy of tracks: runs `baliza track`, `bench garcia`, `bench barral` and `bench fusion`, and makes tables of
//! the results.

use baliza_report::MarkdownTable;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use serde::Deserialize;

use crate::baliza::{baliza, drawn, files, json, name, ranges};
use crate::promises::Made;

/// One recording, as `baliza track --json` prints it.
#[derive(Clone, Debug, Deserialize)]
struct Score {
    epochs: u64,
    rmse_m: Option<f64>,
    p90_m: Option<f64>,
    inside_1_sigma: Option<f64>,
    nees: Option<f64>,
}

/// In the plane, at the height of the true position.
const PLANE: [&str; 3] = ["--dims", "2", "--height-from-truth"];
/// In space.
const SPACE: [&str; 2] = ["--dims", "3"];
/// One row each: a title, the arguments before the recording's, and those behind.
const ROWS: [(&str, &[&str], &[&str]); 6] = [
    ("`baliza solve`", &["solve"], &PLANE),
    ("`baliza track`", &["track"], &PLANE),
    ("`baliza track --nlos alike`", &["track", "--nlos", "alike"], &PLANE),
    ("`baliza track --nlos ignore`", &["track", "--nlos", "ignore"], &PLANE),
    ("`baliza solve --dims 3`", &["solve"], &SPACE),
    ("`baliza track --dims 3`", &["track"], &SPACE),
];

/// Differences of arrival, and their figure.
///
/// # Errors
/// A run of `baliza` fails.
pub fn garcia() -> Result<Made> {
    drawn("garcia", "qa/papers/garcia.svg")
}

/// Ranges, some of them blocked, and their figure.
///
/// # Errors
/// A run of `baliza` fails.
pub fn barral() -> Result<Made> {
    drawn("barral", "qa/papers/barral.svg")
}

/// Anchors and beacons.
///
/// # Errors
/// A run of `baliza` fails.
pub fn fusion() -> Result<Made> {
    Ok(Made::one("fusion", baliza(["bench", "fusion", "--seed", "1"])?))
}

/// The same under other conditions.
///
/// # Errors
/// A run of `baliza` fails.
pub fn sweep() -> Result<Made> {
    Ok(Made::one("fusion sweep", baliza(["bench", "fusion", "--seed", "1", "--sweep", "--walks", "8"])?))
}

/// The engine on every recording.
///
/// # Errors
/// A run of `baliza` fails.
pub fn recorded() -> Result<Made> {
    let folders = ranges();
    let titles = folders.iter().map(|folder| format!("{}:", name(folder)));
    let mut table = MarkdownTable::new(std::iter::once("RMSE (P90), m; inside 1σ; NEES".to_owned()).chain(titles));
    for (title, arguments, space) in ROWS {
        let cells = folders.iter().map(|folder| Ok(cell(&score(folder, arguments, space)?)));
        table.row(format_args!("{title} | {}", cells.collect::<Result<Vec<_>>>()?.join(" | ")));
    }
    Ok(Made::one("tracks", table.into_text()))
}

/// One command on one recording.
fn score(folder: &Path, arguments: &[&str], space: &[&str]) -> Result<Score> {
    let words = arguments.iter().chain(space).chain(&["--json"]).map(PathBuf::from);
    let scores: Vec<Score> = json(words.chain(files(folder)))?;
    scores.into_iter().next().context("baliza prints no score")
}

fn cell(score: &Score) -> String {
    if score.epochs == 0 {
        return "none".to_owned();
    }
    let number = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |value| format!("{value:.3}"));
    let consistency = score.inside_1_sigma.zip(score.nees);
    let consistency =
        consistency.map_or_else(String::new, |(inside, nees)| format!("; {:.0} %; {nees:.1}", 100.0 * inside));
    format!("{} ({}){consistency}", number(score.rmse_m), number(score.p90_m))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_tells_consistency_where_there_is_some() {
        let mut score =
            Score { epochs: 9, rmse_m: Some(0.0749), p90_m: Some(0.1), inside_1_sigma: Some(0.394), nees: Some(2.04) };
        assert_eq!(cell(&score), "0.075 (0.100); 39 %; 2.0");
        score.nees = None;
        assert_eq!(cell(&score), "0.075 (0.100)");
    }
}
