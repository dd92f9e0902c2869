//! The Python package: its wheel, its tests and its example, in a virtual environment of its own.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result};

use crate::{root, succeed, target_directory};

/// What the environment needs besides the wheel and what that asks for.
const TOOLS: [&str; 1] = ["maturin>=1.8,<2"];

/// Builds the wheel, and runs its tests and its example.
///
/// # Errors
/// There is no Python with `venv`, a package cannot be fetched, or a check fails.
pub fn run() -> Result<()> {
    let package = root().join("python");
    let (venv, wheels) = (target_directory().join("python/venv"), target_directory().join("python/wheels"));
    let python = environment(&venv)?;
    let run = |arguments: &[&OsStr]| succeed(Command::new(&python).args(arguments).current_dir(&package));
    install(&python, TOOLS)?;
    if wheels.exists() {
        fs::remove_dir_all(&wheels).with_context(|| format!("cannot remove {}", wheels.display()))?;
    }
    // The profile of the other tests, so that their dependencies are not built again.
    let build = ["-m", "maturin", "build", "--locked", "--profile", "dev", "--out"].map(OsStr::new);
    run(&[&build[..], &[wheels.as_os_str()]].concat())?;
    let wheel = only_file(&wheels)?;
    // First what it asks for, then the wheel itself even where its version has not changed.
    install(&python, [format!("{}[test]", wheel.display())])?;
    install(&python, ["--no-deps", "--force-reinstall"].map(OsStr::new).into_iter().chain([wheel.as_os_str()]))?;
    run(&["-m", "pytest", "--quiet"].map(OsStr::new))?;
    run(&["examples/room.py"].map(OsStr::new))
}

/// The Python of the virtual environment, which is made where there is none.
///
/// # Errors
/// There is no Python with `venv`.
pub fn environment(venv: &Path) -> Result<PathBuf> {
    let python = venv.join(if cfg!(windows) { "Scripts/python.exe" } else { "bin/python" });
    if !python.exists() {
        let mut make = Command::new(std::env::var_os("PYTHON").unwrap_or_else(|| "python3".into()));
        succeed(make.args(["-m", "venv"]).arg(venv))
            .context("Python 3.10 or newer with venv is needed (python3-venv)")?;
    }
    Ok(python)
}

/// Installs packages with pip.
///
/// # Errors
/// A package cannot be fetched.
pub fn install(python: &Path, packages: impl IntoIterator<Item = impl AsRef<OsStr>>) -> Result<()> {
    let pip = ["-m", "pip", "install", "--quiet", "--disable-pip-version-check"];
    succeed(Command::new(python).args(pip).args(packages))
}

fn only_file(folder: &Path) -> Result<PathBuf> {
    let mut entries = fs::read_dir(folder).with_context(|| format!("cannot read {}", folder.display()))?;
    Ok(entries.next().context("maturin has built no wheel")??.path())
}
