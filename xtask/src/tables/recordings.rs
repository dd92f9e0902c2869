//! Recorded ranges, solved and tracked.

use anyhow::{Context, Result};
use baliza_report::MarkdownTable;

use super::{Score, number};
use crate::baliza::{json, ranges, words};
use crate::promises::Made;

/// One row each of the table of tracks: a title, and the arguments before and behind those of the recording.
const TRACKS: [(&str, &str, &str); 6] = [
    ("`baliza solve`", "solve", PLANE),
    ("`baliza track`", "track", PLANE),
    ("`baliza track --nlos alike`", "track --nlos alike", PLANE),
    ("`baliza track --nlos ignore`", "track --nlos ignore", PLANE),
    ("`baliza solve --dims 3`", "solve", "--dims 3"),
    ("`baliza track --dims 3`", "track", "--dims 3"),
];
/// In the plane, at the height of the true position.
const PLANE: &str = "--dims 2 --height-from-truth";

/// Every method on every recording, in the plane.
///
/// # Errors
/// A run of `baliza` fails.
pub fn solved() -> Result<Made> {
    let solve = |name: String| {
        let scores = json(words(&format!("solve {PLANE} --method all --json RANGES/{name}"))?)?;
        Ok((name, scores))
    };
    Ok(Made::one("recordings", side_by_side(&ranges().into_iter().map(solve).collect::<Result<Vec<_>>>()?)))
}

/// One row a method, one column a recording.
fn side_by_side(recordings: &[(String, Vec<Score>)]) -> String {
    let epochs = |scores: &[Score]| scores.first().map_or(0, |score| score.epochs);
    let titles = recordings.iter().map(|(name, scores)| format!("{name}, {} epochs:", epochs(scores)));
    let mut table = MarkdownTable::new(std::iter::once("RMSE (P90), m".to_owned()).chain(titles));
    let methods = recordings.first().into_iter().flat_map(|(_, scores)| scores).map(|score| &score.method);
    for method in methods {
        let of = |scores: &[Score]| scores.iter().find(|score| score.method == *method).map_or_else(String::new, solve);
        let cells: Vec<_> = recordings.iter().map(|(_, scores)| of(scores)).collect();
        table.row(format_args!("`{method}` | {}", cells.join(" | ")));
    }
    table.into_text()
}

/// The cell of a method.
fn solve(score: &Score) -> String {
    if score.fixed == 0 {
        return "no fix".to_owned();
    }
    let missing = match score.epochs.saturating_sub(score.fixed) {
        0 => String::new(),
        missing => format!(", {missing} without a fix"),
    };
    format!("{} ({}{missing})", number(score.rmse_m, 3), number(score.p90_m, 3))
}

/// The engine on every recording.
///
/// # Errors
/// A run of `baliza` fails.
pub fn tracked() -> Result<Made> {
    let names = ranges();
    let titles = names.iter().map(|name| format!("{name}:"));
    let mut table = MarkdownTable::new(std::iter::once("RMSE (P90), m; inside 1σ; NEES".to_owned()).chain(titles));
    for (title, command, options) in TRACKS {
        let cell = |name: &String| {
            let scores: Vec<Score> = json(words(&format!("{command} {options} --json RANGES/{name}"))?)?;
            Ok(track(scores.first().context("baliza prints no score")?))
        };
        table.row(format_args!("{title} | {}", names.iter().map(cell).collect::<Result<Vec<_>>>()?.join(" | ")));
    }
    Ok(Made::one("tracks", table.into_text()))
}

/// The cell of a track.
fn track(score: &Score) -> String {
    if score.epochs == 0 {
        return "none".to_owned();
    }
    let consistency = score.inside_1_sigma.zip(score.nees);
    let consistency =
        consistency.map_or_else(String::new, |(inside, nees)| format!("; {:.0} %; {nees:.1}", 100.0 * inside));
    format!("{} ({}){consistency}", number(score.rmse_m, 3), number(score.p90_m, 3))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn methods_are_rows_and_recordings_columns() {
        let score = |method: &str, fixed, rmse_m| {
            let method = method.to_owned();
            Score { method, epochs: 10, fixed, rmse_m, p90_m: rmse_m, ..Score::default() }
        };
        let here = vec![score("lls", 10, Some(0.5)), score("robust", 8, Some(0.25))];
        let there = vec![score("robust", 0, None), score("lls", 10, Some(1.0))];
        let table = side_by_side(&[("here".to_owned(), here), ("there".to_owned(), there)]);
        let expected = "| RMSE (P90), m | here, 10 epochs | there, 10 epochs |\n\
                        |---|---:|---:|\n\
                        | `lls` | 0.500 (0.500) | 1.000 (1.000) |\n\
                        | `robust` | 0.250 (0.250, 2 without a fix) | no fix |\n";
        assert_eq!(table, expected);
    }

    #[test]
    fn a_track_tells_its_consistency_where_there_is_some() {
        let mut score = Score { epochs: 9, rmse_m: Some(0.0749), p90_m: Some(0.1), ..Score::default() };
        (score.inside_1_sigma, score.nees) = (Some(0.394), Some(2.04));
        assert_eq!(track(&score), "0.075 (0.100); 39 %; 2.0");
        score.nees = None;
        assert_eq!(track(&score), "0.075 (0.100)");
    }
}
