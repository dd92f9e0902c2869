//! `cargo xtask dist --verify`: the images of the last commit, built here and in a clone elsewhere, have equal bytes.

use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, ensure};

use super::sums::sum;
use crate::{firmware, printed, root, succeed, target_directory};

/// Builds twice and compares.
///
/// # Errors
/// There are changes that are not committed, a build fails, or two files differ.
pub fn run(filter: Option<&str>) -> Result<()> {
    let changes = printed(Command::new("git").current_dir(root()).args(["status", "--porcelain"]))?;
    ensure!(changes.is_empty(), "commit first: the second build is of the last commit\n{changes}");
    let elsewhere = target_directory().join("built-elsewhere");
    if elsewhere.exists() {
        fs::remove_dir_all(&elsewhere).with_context(|| format!("cannot empty {}", elsewhere.display()))?;
    }
    succeed(Command::new("git").args(["clone", "--quiet"]).arg(root()).arg(&elsewhere))?;
    let images = firmware::release(filter)?;
    let mut again = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    again.current_dir(&elsewhere).env_remove("CARGO_TARGET_DIR").args(["run", "--quiet", "--package", "xtask", "--"]);
    succeed(again.arg("firmware").args(filter))?;
    let mut differing = Vec::new();
    for image in &images {
        let name = image.elf.file_name().map(Path::new).context("an image has a name")?;
        let (ours, theirs) = (fs::read(&image.elf)?, fs::read(elsewhere.join("target/firmware").join(name))?);
        println!("{}  {}  {}", sum(&ours), if ours == theirs { "same" } else { "DIFFERS" }, name.display());
        if ours != theirs {
            differing.push(name.display().to_string());
        }
    }
    ensure!(differing.is_empty(), "built twice, these differ: {}", differing.join(", "));
    println!("{} images have equal bytes in {} and {}", images.len(), root().display(), elsewhere.display());
    Ok(())
}
