//! The test programs of all packages, built as `cargo test` builds them. Built for one package alone, their dependencies
//! would have other features, and would all be built again.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result};
use serde_json::Value;

use crate::{cargo, printed, root};

/// A test program.
pub struct TestProgram {
    /// The folder of its package from the root, and its target, which a program and its tests may both have the name of:
    /// `station test api`.
    pub name: String,
    file: PathBuf,
    /// The folder of its package, where cargo runs it.
    folder: PathBuf,
}

impl TestProgram {
    /// Whether it is of the package in this folder.
    pub fn is_of(&self, folder: &str) -> bool {
        self.folder == root().join(folder)
    }

    /// A run of it, as by cargo.
    pub fn command(&self) -> Command {
        let mut command = Command::new(&self.file);
        command.current_dir(&self.folder).env("CARGO_MANIFEST_DIR", &self.folder);
        command
    }
}

/// Builds all test programs.
///
/// # Errors
/// They do not build.
pub fn all() -> Result<Vec<TestProgram>> {
    let messages = printed(cargo().args(["test", "--no-run", "--message-format=json-render-diagnostics"]))?;
    let mut programs = Vec::new();
    for line in messages.lines() {
        let message: Value = serde_json::from_str(line).with_context(|| format!("cargo says {line}"))?;
        let (Some(file), Some(true)) = (message["executable"].as_str(), message["profile"]["test"].as_bool()) else {
            continue;
        };
        let manifest = Path::new(message["manifest_path"].as_str().context("no path of a manifest")?);
        let folder = manifest.parent().context("no folder of a manifest")?.to_owned();
        let package = folder.strip_prefix(root()).unwrap_or(&folder).display().to_string();
        let target = message["target"]["name"].as_str().context("no name of a target")?;
        let kind = message["target"]["kind"][0].as_str().context("no kind of a target")?;
        programs.push(TestProgram { name: format!("{package} {kind} {target}"), file: file.into(), folder });
    }
    Ok(programs)
}
