//! Runs of `baliza`, and its recordings.

use std::env::{self, consts::EXE_EXTENSION};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use anyhow::{Context, Result, ensure};
use serde::de::DeserializeOwned;

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

/// A recording, or a file of one, in the folder that `BALIZA_DATA` names, or beside the repository.
///
/// # Errors
/// It does not exist.
pub fn recording(name: &str) -> Result<PathBuf> {
    let folder = data().context("no folder of recordings (BALIZA_DATA, ../shared/data)")?.join(name);
    ensure!(folder.exists(), "no recording {}", folder.display());
    Ok(folder)
}

/// The names of the recordings with ranges, anchors and true positions.
pub fn ranges() -> Vec<String> {
    let entries =
        data().and_then(|folder| folder.read_dir().ok()).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut folders: Vec<_> =
        entries.filter(|folder| FILES.iter().all(|(_, file)| folder.join(file).is_file())).collect();
    folders.sort();
    folders.iter().filter_map(|folder| Some(folder.file_name()?.to_string_lossy().into_owned())).collect()
}

/// The files of a recording of ranges, and the options that name them.
const FILES: [(&str, &str); 3] = [("--anchors", "anchors.csv"), ("--ranges", "ranges.csv"), ("--truth", "truth.csv")];

/// The arguments in a text. `DATA` is the folder of recordings and `DATA/FILE` a file there, `RANGES/NAME` the options
/// with the files of a recording, and `OUT/FILE` a [`scratch`] file.
///
/// # Errors
/// There is no such recording, or the folder of build outputs cannot be made.
pub fn words(text: &str) -> Result<Vec<PathBuf>> {
    let mut words = Vec::new();
    for word in text.split_whitespace() {
        match word.split_once('/').unwrap_or((word, "")) {
            ("DATA", file) => words.push(recording(file)?),
            ("OUT", file) => words.push(scratch(file)?),
            ("RANGES", name) => {
                let folder = recording(name)?;
                words.extend(FILES.iter().flat_map(|(option, file)| [PathBuf::from(option), folder.join(file)]));
            }
            _ => words.push(word.into()),
        }
    }
    Ok(words)
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
