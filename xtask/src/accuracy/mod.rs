//! How accurate the methods are: runs `baliza` on the thesis' simulation and on recordings, and makes the tables and the figure
//! of `docs/performance.md`.

mod figure;
mod thesis;

use std::env;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail};
use serde::Deserialize;
use serde::de::DeserializeOwned;

use crate::{document, root};

/// One method on one recording, as `baliza solve --json` prints it.
#[derive(Deserialize)]
struct Score {
    method: String,
    epochs: u64,
    fixed: u64,
    rmse_m: Option<f64>,
    p90_m: Option<f64>,
}

/// Remakes the tables of accuracy; those of recordings only where there are recordings.
pub fn bench() -> Result<()> {
    let file = root().join("docs/performance.md");
    let scores = baliza::<thesis::Score>(["bench", "thesis", "--points", "3000", "--seed", "1", "--json"])?;
    let table = thesis::table(&scores);
    println!("{table}");
    document::remake(&file, "thesis", &table)?;
    figure::draw(&scores, &root().join("docs/thesis.svg"))?;

    let folders = recordings();
    if folders.is_empty() {
        println!("no recordings: BALIZA_DATA names no folder with some; their table stays as it is");
        return Ok(());
    }
    let table = on_recordings(&folders)?;
    println!("{table}");
    document::remake(&file, "recordings", &table)
}

/// The folders that hold a recording: in `BALIZA_DATA`, or beside the repository.
fn recordings() -> Vec<PathBuf> {
    let data = env::var_os("BALIZA_DATA").map_or_else(|| root().join("../shared/data"), PathBuf::from);
    let is_recording =
        |folder: &PathBuf| ["anchors.csv", "ranges.csv", "truth.csv"].iter().all(|f| folder.join(f).is_file());
    let entries = data.read_dir().into_iter().flatten().flatten().map(|entry| entry.path());
    let mut folders: Vec<_> = entries.filter(is_recording).collect();
    folders.sort();
    folders
}

/// Every method on every recording, in the plane.
fn on_recordings(folders: &[PathBuf]) -> Result<String> {
    let columns = folders.iter().map(|folder| solve(folder)).collect::<Result<Vec<_>>>()?;
    let mut table = String::from("| method |");
    for (folder, scores) in folders.iter().zip(&columns) {
        let name = folder.file_name().unwrap_or_default().to_string_lossy();
        let epochs = scores.first().map_or(0, |score| score.epochs);
        table += &format!(" {name}, {epochs} epochs |");
    }
    table += &format!("\n|---|{}\n", "---:|".repeat(folders.len()));
    for (place, score) in columns.first().into_iter().flatten().enumerate() {
        table += &format!("| `{}` |", score.method);
        for score in columns.iter().filter_map(|column| column.get(place)) {
            let (rmse, p90) = (metres(score.rmse_m), metres(score.p90_m));
            let missing = score.epochs - score.fixed;
            let missing = if missing > 0 { format!(", {missing} without a fix") } else { String::new() };
            table += &format!(" {rmse} ({p90}{missing}) |");
        }
        table.push('\n');
    }
    Ok(table)
}

fn solve(folder: &Path) -> Result<Vec<Score>> {
    let [anchors, ranges, truth] = ["anchors.csv", "ranges.csv", "truth.csv"].map(|name| folder.join(name));
    let mut arguments: Vec<&OsStr> = Vec::new();
    for (option, file) in [("--anchors", &anchors), ("--ranges", &ranges), ("--truth", &truth)] {
        arguments.extend([OsStr::new(option), file.as_os_str()]);
    }
    let rest = ["--dims", "2", "--height-from-truth", "--method", "all", "--json"].map(OsStr::new);
    baliza([OsStr::new("solve")].into_iter().chain(arguments).chain(rest))
}

/// What `baliza` prints with these arguments.
fn baliza<T: DeserializeOwned>(arguments: impl IntoIterator<Item: AsRef<OsStr>>) -> Result<Vec<T>> {
    let mut command = Command::new("cargo");
    command.args(["run", "--quiet", "--release", "--package", "host-tools", "--bin", "baliza", "--"]);
    let output = command.args(arguments).current_dir(root()).stderr(std::process::Stdio::inherit()).output()?;
    if !output.status.success() {
        bail!("{command:?}: {}", output.status);
    }
    serde_json::from_slice(&output.stdout).with_context(|| format!("{command:?} prints something else"))
}

/// Metres with millimetres; a dash where there is no number.
fn metres(value: Option<f64>) -> String {
    value.map_or_else(|| "–".to_owned(), |value| format!("{value:.3}"))
}
