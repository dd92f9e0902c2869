//! `cargo xtask deny`: cargo-deny's checks of licences, sources and duplicates; those of advisories where their
//! database can be fetched.

use std::process::Command;

use anyhow::{Result, bail};

use crate::toolchain::is_installed;
use crate::{cargo, succeed};

/// Runs the checks.
///
/// # Errors
/// A crate is not allowed, or has an advisory.
pub fn run() -> Result<()> {
    if !is_installed("cargo-deny") {
        println!(
            "cargo-deny is not here: licences, sources and advisories are not checked; `cargo install --locked cargo-deny` installs it"
        );
        return Ok(());
    }
    let deny = |words: &[&str]| -> Command {
        let mut command = cargo();
        command.args(["deny", "--workspace"]).args(words);
        command
    };
    succeed(&mut deny(&["check", "licenses", "bans", "sources"]))?;
    let fetched = deny(&["fetch", "db"]).output()?.status.success();
    if !fetched {
        println!("the database of advisories cannot be fetched: advisories are not checked");
        return Ok(());
    }
    if !deny(&["check", "--disable-fetch", "advisories"]).status()?.success() {
        bail!("a crate has an advisory");
    }
    Ok(())
}
