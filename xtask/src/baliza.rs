//! Runs of `baliza`, and its recordings.

use std::env::{self, consts::EXE_EXTENSION};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use anyhow::{Context, Result, ensure};
use serde::de::DeserializeOwned;

use crate::promises::Made;
use crate::{cargo, printed, root, succeed, target_directory};

/// The output of `baliza` with these arguments. The program is built before the first run, and each run is printed on
/// standard error.
///
/// # Errors
/// The program cannot be built, or its run fails.
pub fn baliza(arguments: impl IntoIterator<Item: AsRef<OsStr>>) -> Result<String> {
    let mut command = Command::new(binary()?);
    command.args(arguments).current_dir(root());
    let words: Vec<_> = command.get_args().map(|word| word.to_string_lossy().into_owned()).collect();
    eprintln!("baliza {}", words.join(" "));
    printed(&mut command)
}

/// What `--json` prints.
#[derive(serde::Deserialize)]
struct Envelope<T> {
    results: Vec<T>,
}

/// The results that `baliza --json` prints.
///
/// # Errors
/// The run fails, or its output is not the expected JSON.
pub fn json<T: DeserializeOwned>(arguments: impl IntoIterator<Item: AsRef<OsStr>>) -> Result<Vec<T>> {
    let printed: Envelope<T> = serde_json::from_str(&baliza(arguments)?).context("baliza prints something else")?;
    Ok(printed.results)
}

/// The only result of a run.
///
/// # Errors
/// The run fails, or its output is not one result.
pub fn result<T: DeserializeOwned>(arguments: impl IntoIterator<Item: AsRef<OsStr>>) -> Result<T> {
    json(arguments)?.pop().context("baliza prints no result")
}

/// The program that is run.
static PROGRAM: OnceLock<PathBuf> = OnceLock::new();

/// Runs this program from now on, instead of one that is built. Only the first call counts.
///
/// # Errors
/// There is no such file.
pub fn run_this(program: &Path) -> Result<()> {
    let program = program.canonicalize().with_context(|| program.display().to_string())?;
    PROGRAM.get_or_init(|| program);
    Ok(())
}

/// The program, built once: cargo would check all sources again for each of a hundred runs, and take time that some
/// tables measure.
///
/// # Errors
/// The program cannot be built.
pub fn binary() -> Result<PathBuf> {
    if let Some(program) = PROGRAM.get() {
        return Ok(program.clone());
    }
    succeed(cargo().args([
        "build",
        "--release",
        "--package",
        "host-tools",
        "--package",
        "baliza-bench",
        "--features",
        "host-tools/training",
    ]))?;
    let built = target_directory().join("release").join("baliza").with_extension(EXE_EXTENSION);
    Ok(PROGRAM.get_or_init(|| built).clone())
}

/// A recording: a folder in the one that `BALIZA_DATA` names, or beside the repository.
///
/// # Errors
/// It does not exist.
pub fn recording(name: &str) -> Result<PathBuf> {
    let folder = data().context("no folder of recordings (BALIZA_DATA, ../shared/data)")?.join(name);
    ensure!(folder.is_dir(), "no recording {}", folder.display());
    Ok(folder)
}

/// The folders with recorded ranges, anchors and true positions.
pub fn ranges() -> Vec<PathBuf> {
    let files = ["anchors.csv", "ranges.csv", "truth.csv"];
    let entries =
        data().and_then(|folder| folder.read_dir().ok()).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut folders: Vec<_> = entries.filter(|folder| files.iter().all(|file| folder.join(file).is_file())).collect();
    folders.sort();
    folders
}

/// The arguments that name a folder's recorded ranges, anchors and true positions.
pub fn files(folder: &Path) -> Vec<PathBuf> {
    let options = [("--anchors", "anchors.csv"), ("--ranges", "ranges.csv"), ("--truth", "truth.csv")];
    options.into_iter().flat_map(|(option, file)| [PathBuf::from(option), folder.join(file)]).collect()
}

/// The name of a folder.
pub fn name(folder: &Path) -> String {
    folder.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// The table of `baliza bench NAME --seed 1`, and its picture, which is kept at this path.
///
/// # Errors
/// The run fails.
pub fn drawn(name: &str, picture: &str) -> Result<Made> {
    let file = scratch("promised.svg")?;
    let words = ["bench", name, "--seed", "1", "--plot"].map(PathBuf::from);
    let table = baliza(words.into_iter().chain([file.clone()]))?;
    Made::drawn(name, table, picture, &file)
}

/// A file in the folder of build outputs, which one run writes and another reads.
///
/// # Errors
/// The folder cannot be made.
pub fn scratch(name: &str) -> Result<PathBuf> {
    let folder = target_directory();
    std::fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    Ok(folder.join(name))
}

/// The folder of recordings, where it exists.
pub fn data() -> Option<PathBuf> {
    let folder = env::var_os("BALIZA_DATA").map_or_else(|| root().join("../shared/data"), PathBuf::from);
    folder.is_dir().then_some(folder)
}
