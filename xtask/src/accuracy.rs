//! How accurate the methods are: runs `baliza` on the thesis' simulation, on recordings and on recorded impulse responses, and takes
//! its tables and its figure into `docs/performance.md`.

use std::env;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result, bail};
use serde::Deserialize;

use crate::{document, root};

/// One method on one recording, as `baliza solve --json` prints it.
#[derive(Clone, Debug, Deserialize)]
struct Score {
    method: String,
    epochs: u64,
    fixed: u64,
    rmse_m: Option<f64>,
    p90_m: Option<f64>,
}

/// Remakes the tables of accuracy; the one of recordings only where there are recordings.
pub fn bench() -> Result<()> {
    let file = root().join("docs/performance.md");
    let table = baliza(["bench", "thesis", "--points", "3000", "--seed", "1", "--plot", "docs/thesis.svg"])?;
    println!("{table}");
    document::remake(&file, "thesis", &table)?;

    match sight()? {
        Some(table) => {
            println!("{table}");
            document::remake(&file, "nlos", &table)?;
        }
        None => println!("no impulse responses: the table of line of sight stays as it is"),
    }

    let floor = data().join("linde_floor/fingerprints.csv");
    if floor.is_file() {
        let arguments = ["ble", "rooms", "--leave-one-out", "--fingerprints"].map(OsStr::new);
        let table = baliza(arguments.into_iter().chain([floor.as_os_str()]))?;
        println!("{table}");
        document::remake(&file, "rooms", &table)?;
    } else {
        println!("no recorded floor: the table of rooms stays as it is");
    }

    let folders = recordings();
    if folders.is_empty() {
        println!("no recordings: BALIZA_DATA names no folder with some, and their table stays as it is");
        return Ok(());
    }
    let scores = folders.iter().map(|folder| Ok((name(folder), solve(folder)?))).collect::<Result<Vec<_>>>()?;
    let table = side_by_side(&scores);
    println!("{table}");
    document::remake(&file, "recordings", &table)
}

/// What tells blocked ranges from direct ones in a recorded flat, and how far corrections learnt there carry; `None` without it.
fn sight() -> Result<Option<String>> {
    let responses = data().join("apartment_cir/cir.csv");
    if !responses.is_file() {
        return Ok(None);
    }
    let folder = root().join("target");
    std::fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    let model = folder.join("nlos.model");
    let responses = [OsStr::new("--cir"), responses.as_os_str()];
    let begin = |command| [OsStr::new("nlos"), OsStr::new(command)].into_iter().chain(responses);
    let train = [OsStr::new("--folds"), OsStr::new("file"), OsStr::new("--out"), model.as_os_str()];
    let mut tables = baliza(begin("train").chain(train))?;
    // The other building, where it is there.
    let other = data().join("leiria_128_los_pos1");
    let [anchors, ranges, truth] = ["anchors.csv", "ranges.csv", "truth.csv"].map(|name| other.join(name));
    let files = [("--anchors", &anchors), ("--ranges", &ranges), ("--truth", &truth)];
    let files = files.iter().filter(|_| other.is_dir());
    let files = files.flat_map(|(option, file)| [OsStr::new(option), file.as_os_str()]);
    tables.push('\n');
    tables += &baliza(begin("mitigation").chain(files))?;
    Ok(Some(tables))
}

/// Where recordings lie: in `BALIZA_DATA`, or beside the repository.
pub fn data() -> PathBuf {
    env::var_os("BALIZA_DATA").map_or_else(|| root().join("../shared/data"), PathBuf::from)
}

/// The folders that hold a recording.
pub fn recordings() -> Vec<PathBuf> {
    let data = data();
    let files = ["anchors.csv", "ranges.csv", "truth.csv"];
    let entries = data.read_dir().into_iter().flatten().flatten().map(|entry| entry.path());
    let mut folders: Vec<_> = entries.filter(|folder| files.iter().all(|file| folder.join(file).is_file())).collect();
    folders.sort();
    folders
}

pub fn name(folder: &Path) -> String {
    folder.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Every method on one recording, in the plane.
fn solve(folder: &Path) -> Result<Vec<Score>> {
    let [anchors, ranges, truth] = ["anchors.csv", "ranges.csv", "truth.csv"].map(|name| folder.join(name));
    let files = [("--anchors", &anchors), ("--ranges", &ranges), ("--truth", &truth)];
    let files = files.iter().flat_map(|(option, file)| [OsStr::new(option), file.as_os_str()]);
    let rest = ["--dims", "2", "--height-from-truth", "--method", "all", "--json"].map(OsStr::new);
    let printed = baliza([OsStr::new("solve")].into_iter().chain(files).chain(rest))?;
    serde_json::from_str(&printed).context("baliza prints something else")
}

/// A row a method, a column a recording.
fn side_by_side(recordings: &[(String, Vec<Score>)]) -> String {
    let mut table = String::from("| RMSE (P90), m |");
    for (name, scores) in recordings {
        table += &format!(" {name}, {} epochs |", scores.first().map_or(0, |score| score.epochs));
    }
    table += &format!("\n|---|{}\n", "---:|".repeat(recordings.len()));
    let methods = recordings.first().into_iter().flat_map(|(_, scores)| scores).map(|score| &score.method);
    for method in methods {
        table += &format!("| `{method}` |");
        for (_, scores) in recordings {
            let cell = scores.iter().find(|score| score.method == *method).map_or_else(String::new, cell);
            table += &format!(" {cell} |");
        }
        table.push('\n');
    }
    table
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

/// What `baliza` prints with these arguments.
pub fn baliza(arguments: impl IntoIterator<Item: AsRef<OsStr>>) -> Result<String> {
    let mut command = Command::new("cargo");
    command.args(["run", "--quiet", "--release", "--package", "host-tools", "--bin", "baliza", "--"]);
    let output = command.args(arguments).current_dir(root()).stderr(Stdio::inherit()).output()?;
    if !output.status.success() {
        bail!("{command:?}: {}", output.status);
    }
    Ok(String::from_utf8(output.stdout)?)
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
