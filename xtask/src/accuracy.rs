//! Accuracy of the methods: runs `baliza` on the simulation of P. M. de Rojas Malpartida's thesis, on recordings, on
//! recorded impulse responses and on the rooms of a recorded floor, and makes tables of the results.

use baliza_report::MarkdownTable;
use std::path::{Path, PathBuf};

use anyhow::Result;
use serde::Deserialize;

use crate::baliza::{baliza, files, json, name, ranges, recording, scratch};
use crate::promises::Made;

/// One method on one recording, as `baliza solve --json` prints it.
#[derive(Clone, Debug, Deserialize)]
struct Score {
    method: String,
    epochs: u64,
    fixed: u64,
    rmse_m: Option<f64>,
    p90_m: Option<f64>,
}

/// The figure of the thesis' simulation.
const THESIS: &str = "qa/accuracy/thesis.svg";

/// The thesis' simulation, and its figure.
///
/// # Errors
/// A run of `baliza` fails.
pub fn thesis() -> Result<Made> {
    let picture = scratch("thesis.svg")?;
    let words = ["bench", "thesis", "--points", "3000", "--seed", "1", "--plot"].map(PathBuf::from);
    let table = baliza(words.into_iter().chain([picture.clone()]))?;
    Made::drawn("thesis", table, THESIS, &picture)
}

/// The rooms of a recorded floor.
///
/// # Errors
/// A run of `baliza` fails.
pub fn rooms() -> Result<Made> {
    let floor = recording("linde_floor")?;
    let words = ["ble", "rooms", "--leave-one-out", "--fingerprints"].map(PathBuf::from);
    let table = baliza(words.into_iter().chain([floor.join("fingerprints.csv")]))?;
    Ok(Made::one("rooms", markdown(&table)))
}

/// The first table of a text in which columns are aligned by two spaces or more, in Markdown. The first column is
/// words, the others are numbers.
fn markdown(text: &str) -> String {
    let mut lines = text.lines().take_while(|line| !line.trim().is_empty());
    let cells = |line: &str| {
        line.split("  ").map(str::trim).filter(|cell| !cell.is_empty()).map(str::to_owned).collect::<Vec<_>>()
    };
    let titles = lines.next().map(cells).unwrap_or_default();
    let titles = titles.into_iter().enumerate().map(|(at, title)| if at == 0 { title } else { format!("{title}:") });
    let mut table = MarkdownTable::new(titles);
    lines.for_each(|line| table.row(format_args!("{}", cells(line).join(" | "))));
    table.into_text()
}

/// Classifiers of blocked ranges in a recorded flat, and the effect of corrections learnt there in other places.
///
/// # Errors
/// A run of `baliza` fails.
pub fn sight() -> Result<Made> {
    let flat = recording("apartment_cir")?;
    let begin = |command: &str| ["nlos", command, "--cir"].map(PathBuf::from).into_iter().chain([flat.join("cir.csv")]);
    let train = ["--folds", "file", "--out"].map(PathBuf::from).into_iter().chain([scratch("nlos.model")?]);
    let mut tables = baliza(begin("train").chain(train))?;
    // The other building.
    let other = files(&recording("leiria_128_los_pos1")?);
    tables.push('\n');
    tables += &baliza(begin("mitigation").chain(other))?;
    Ok(Made::one("nlos", tables))
}

/// Every method on every recording, in the plane.
///
/// # Errors
/// A run of `baliza` fails.
pub fn recorded() -> Result<Made> {
    let folders = ranges();
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
    fn aligned_columns_are_a_table_in_markdown() {
        let text = "method  points  right windows\nsvm         37         94.4 %\n\nby svm, in  a  b\n";
        let expected = "| method | points | right windows |\n|---|---:|---:|\n| svm | 37 | 94.4 % |\n";
        let made = markdown(text);
        assert_eq!(made.replace(['-', ':', ' '], ""), expected.replace(['-', ':', ' '], ""), "{made}");
    }

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
