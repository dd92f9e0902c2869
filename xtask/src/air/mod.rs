//! The simulated air beside recorded ones: statistics of residuals, and of the tracks made from the same ranges.

mod residuals;

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use baliza_report::MarkdownTable;
use serde::Deserialize;

use self::residuals::{Residuals, Statistics, Truth};
use crate::baliza::{json, recording, result, scratch};
use crate::promises::Made;

/// A recording in line of sight.
struct Recorded {
    folder: &'static str,
    /// By how much its truth is late, seconds: the offset with the smallest residuals.
    late_s: f64,
    /// Whether the tag moves continuously. Correlation lengths need many distances.
    moves: bool,
}

const RECORDED: [Recorded; 4] = [
    Recorded { folder: "leiria_128_los_pos1", late_s: 0.0, moves: false },
    Recorded { folder: "leiria_128_move_slow", late_s: 0.4, moves: true },
    Recorded { folder: "cuhk_static", late_s: 0.0, moves: false },
    Recorded { folder: "cuhk_dynamic_mid", late_s: 0.28, moves: true },
];
/// The tags of the default room, and its simulated seeds.
const TAGS: [&str; 2] = ["0x1001", "0x1002"];
const SEEDS: [&str; 8] = ["1", "2", "3", "4", "5", "6", "7", "8"];
/// How far the simulation may be from the recordings' mean.
const TOLERANCE: f64 = 0.3;
/// The figures of a column, and their names.
const FIGURES: [&str; 5] = ["link error, rms", "its correlation length", "its white part", "track, P50", "track, P90"];

/// Errors of a track, as `baliza track --json` and `baliza simulate --json` print them.
#[derive(Clone, Copy, Debug, Deserialize)]
struct Track {
    p50_m: Option<f64>,
    p90_m: Option<f64>,
}

/// The figures of a recording or a simulation, in the order of [`FIGURES`]. It may lack some.
type Column = [Option<f64>; FIGURES.len()];

fn column(statistics: Statistics, track: Track) -> Column {
    let Statistics { rms_m, length_m, white_m } = statistics;
    [Some(rms_m), length_m, Some(white_m), track.p50_m, track.p90_m]
}

/// The default room of `baliza simulate` beside recordings in line of sight.
///
/// # Errors
/// A run of `baliza` fails, or a file cannot be read or written.
pub fn compared() -> Result<Made> {
    let folders = RECORDED.iter().map(|of| recording(of.folder)).collect::<Result<Vec<_>>>()?;
    let recorded =
        RECORDED.iter().zip(&folders).map(|(of, folder)| recorded(of, folder)).collect::<Result<Vec<_>>>()?;
    let mut simulated = Vec::new();
    for seed in SEEDS {
        simulated.extend(simulation(seed)?);
    }
    let (table, is_like) = side_by_side(&mean(&simulated), &recorded);
    let complaint = (!is_like).then_some("the simulated air is not within 30 % of the recorded one");
    Ok(Made::of(vec![("air", table)], complaint))
}

fn recorded(of: &Recorded, folder: &Path) -> Result<Column> {
    let statistics = Residuals::read(folder, None, of.late_s)?.statistics();
    let statistics = Statistics { length_m: statistics.length_m.filter(|_| of.moves), ..statistics };
    let truth = scratch("air-truth.csv")?;
    fs::write(&truth, Truth::read(folder, None)?.to_csv(of.late_s)).context("cannot write the shifted truth")?;
    let files =
        [("--anchors", folder.join("anchors.csv")), ("--ranges", folder.join("ranges.csv")), ("--truth", truth)];
    let words = ["track", "--dims", "2", "--height-from-truth", "--json"].map(PathBuf::from);
    let files = files.into_iter().flat_map(|(option, file)| [PathBuf::from(option), file]);
    let tracks: Vec<Track> = json(words.into_iter().chain(files))?;
    let track = tracks.first().copied().context("no track")?;
    Ok(column(statistics, track))
}

/// The figures of each tag; the track's are those of all tags.
fn simulation(seed: &str) -> Result<Vec<Column>> {
    let folder = scratch("air-simulated")?;
    let words = ["simulate", "--seconds", "20", "--json", "--seed", seed, "--force", "--out"].map(PathBuf::from);
    let track: Track = result(words.into_iter().chain([folder.clone()]))?;
    TAGS.into_iter().map(|tag| Ok(column(Residuals::read(&folder, Some(tag), 0.0)?.statistics(), track))).collect()
}

/// The mean of each figure over the columns that have it.
fn mean(columns: &[Column]) -> Column {
    std::array::from_fn(|row| {
        let values: Vec<f64> = columns.iter().filter_map(|column| column[row]).collect();
        (!values.is_empty()).then(|| baliza_report::mean(values))
    })
}

/// The table, and whether all simulated figures are within the tolerance.
fn side_by_side(simulated: &Column, recorded: &[Column]) -> (String, bool) {
    let titles = ["metres", "`baliza simulate`:", "recordings, mean:"].map(str::to_owned);
    let mut table = MarkdownTable::new(titles.into_iter().chain(RECORDED.iter().map(|of| format!("`{}`:", of.folder))));
    let means = mean(recorded);
    let mut is_like = true;
    for (row, what) in FIGURES.iter().enumerate() {
        let ratio = simulated[row].zip(means[row]).map(|(simulated, recorded)| simulated / recorded - 1.0);
        is_like &= ratio.is_some_and(|ratio| ratio.abs() <= TOLERANCE);
        let metres = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |value| format!("{value:.3}"));
        let percent = ratio.map_or_else(String::new, |ratio| format!(" ({:+.0} %)", 100.0 * ratio));
        let cells: Vec<_> = recorded.iter().map(|column| metres(column[row])).collect();
        table.row(format_args!(
            "{what} | {}{percent} | {} | {}",
            metres(simulated[row]),
            metres(means[row]),
            cells.join(" | ")
        ));
    }
    (table.into_text(), is_like)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_compared_with_the_mean_of_those_that_have_them() {
        let recorded =
            [[Some(0.1), None, Some(0.03), Some(0.1), Some(0.2)], [Some(0.2), Some(0.4), Some(0.03), None, None]];
        let simulated = [Some(0.18), Some(0.4), Some(0.03), Some(0.1), Some(0.2)];
        let (table, is_like) = side_by_side(&simulated, &recorded);
        assert!(table.contains("| link error, rms | 0.180 (+20 %) | 0.150 | 0.100 | 0.200 |"), "{table}");
        assert!(table.contains("| its correlation length | 0.400 (+0 %) | 0.400 | – | 0.400 |"), "{table}");
        assert!(is_like);
        assert!(!side_by_side(&[Some(0.008); 5], &recorded).1);
    }
}
