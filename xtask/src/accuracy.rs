//! Accuracy of the methods: runs `baliza` on the simulation of P. M. de Rojas Malpartida's thesis, on recordings, on
//! recorded impulse responses and on the rooms of a recorded floor, and makes tables of the results.

use baliza_report::MarkdownTable;
use std::path::{Path, PathBuf};

use anyhow::Result;
use serde::Deserialize;

use crate::baliza::{baliza, files, json, name, ranges, recording, scratch};
use crate::bench::Made;

/// One method on one recording, as `baliza solve --json` prints it.
#[derive(Clone, Debug, Deserialize)]
struct Score {
    method: String,
    epochs: u64,
    fixed: u64,
    rmse_m: Option<f64>,
    p90_m: Option<f64>,
}

/// The thesis' simulation, and its figure.
///
/// # Errors
/// A run of `baliza` fails.
pub fn thesis() -> Result<Option<Made>> {
    let table = baliza(["bench", "thesis", "--points", "3000", "--seed", "1", "--plot", "docs/thesis.svg"])?;
    Ok(Made::one("thesis", table))
}

/// The rooms of a recorded floor.
///
/// # Errors
/// A run of `baliza` fails.
pub fn rooms() -> Result<Option<Made>> {
    let Some(floor) = recording("linde_floor") else { return Ok(None) };
    let words = ["ble", "rooms", "--leave-one-out", "--fingerprints"].map(PathBuf::from);
    let table = baliza(words.into_iter().chain([floor.join("fingerprints.csv")]))?;
    Ok(Made::one("rooms", table))
}

/// Classifiers of blocked ranges in a recorded flat, and the effect of corrections learnt there in other places.
///
/// # Errors
/// A run of `baliza` fails.
pub fn sight() -> Result<Option<Made>> {
    let Some(flat) = recording("apartment_cir") else { return Ok(None) };
    let begin = |command: &str| ["nlos", command, "--cir"].map(PathBuf::from).into_iter().chain([flat.join("cir.csv")]);
    let train = ["--folds", "file", "--out"].map(PathBuf::from).into_iter().chain([scratch("nlos.model")?]);
    let mut tables = baliza(begin("train").chain(train))?;
    // The other building, if it is recorded.
    let other = recording("leiria_128_los_pos1").map(|folder| files(&folder)).unwrap_or_default();
    tables.push('\n');
    tables += &baliza(begin("mitigation").chain(other))?;
    Ok(Made::one("nlos", tables))
}

/// Every method on every recording, in the plane.
///
/// # Errors
/// A run of `baliza` fails.
pub fn recorded() -> Result<Option<Made>> {
    let folders = ranges();
    if folders.is_empty() {
        return Ok(None);
    }
    let scores = folders.iter().map(|folder| Ok((name(folder), solve(folder)?))).collect::<Result<Vec<_>>>()?;
    Ok(Made::one("recordings", side_by_side(&scores)))
}

fn solve(folder: &Path) -> Result<Vec<Score>> {
    let words = ["solve", "--dims", "2", "--height-from-truth", "--method", "all", "--json"].map(PathBuf::from);
    json(words.into_iter().chain(files(folder)))
}

/// One row a method, one column a recording.
fn side_by_side(recordings: &[(String, Vec<Score>)]) -> String {
    let epochs = |scores: &[Score]| scores.first().map_or(0, |score| score.epochs);
    let titles = recordings.iter().map(|(name, scores)| format!("{name}, {} epochs:", epochs(scores)));
    let mut table = MarkdownTable::new(std::iter::once("RMSE (P90), m".to_owned()).chain(titles));
    let methods = recordings.first().into_iter().flat_map(|(_, scores)| scores).map(|score| &score.method);
    for method in methods {
        let of = |scores: &[Score]| scores.iter().find(|score| score.method == *method).map_or_else(String::new, cell);
        let cells: Vec<_> = recordings.iter().map(|(_, scores)| of(scores)).collect();
        table.row(format_args!("`{method}` | {}", cells.join(" | ")));
    }
    table.into_text()
}

fn cell(score: &Score) -> String {
    if score.fixed == 0 {
        return "no fix".to_owned();
    }
    let metres = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |value| format!("{value:.3}"));
    let missing = match score.epochs.saturating_sub(score.fixed) {
        0 => String::new(),
        missing => format!(", {missing} without a fix"),
    };
    format!("{} ({}{missing})", metres(score.rmse_m), metres(score.p90_m))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn methods_are_rows_and_recordings_columns() {
        let score =
            |method: &str, fixed, rmse_m| Score { method: method.into(), epochs: 10, fixed, rmse_m, p90_m: rmse_m };
        let here = vec![score("lls", 10, Some(0.5)), score("robust", 8, Some(0.25))];
        let there = vec![score("robust", 0, None), score("lls", 10, Some(1.0))];
        let table = side_by_side(&[("here".to_owned(), here), ("there".to_owned(), there)]);
        let expected = "| RMSE (P90), m | here, 10 epochs | there, 10 epochs |\n\
                        |---|---:|---:|\n\
                        | `lls` | 0.500 (0.500) | 1.000 (1.000) |\n\
                        | `robust` | 0.250 (0.250, 2 without a fix) | no fix |\n";
        assert_eq!(table, expected);
    }
}
