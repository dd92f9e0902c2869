//! What schemes of two-way ranging cost and give: the table that an example of `ranging` prints.

use std::process::{Command, Stdio};

use anyhow::{Context, Result, ensure};

use crate::bench::Made;
use crate::root;

/// The table.
pub fn compared() -> Result<Option<Made>> {
    let mut cargo = Command::new("cargo");
    cargo.args(["run", "--quiet", "--release", "--package", "ranging", "--example", "schemes"]).current_dir(root());
    let output = cargo.stderr(Stdio::inherit()).output().context("cannot run cargo")?;
    ensure!(output.status.success(), "{cargo:?}: {}", output.status);
    Ok(Made::one("schemes", String::from_utf8(output.stdout)?))
}
