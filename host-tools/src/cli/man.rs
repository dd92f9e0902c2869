//! `baliza man`: writes manual pages.

use std::path::PathBuf;

use anyhow::{Context, Result};
use recording::UserError;

use super::companion;

/// Write manual pages: one for `baliza` and one a command
#[derive(clap::Args)]
#[command(after_help = EXAMPLES)]
pub struct Arguments {
    /// The folder for the pages; it is made where it does not exist
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
}

const EXAMPLES: &str = "\
Examples:
  baliza man --out ~/.local/share/man/man1
  man baliza-solve";

/// Runs `baliza man`.
///
/// # Errors
/// A page cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let folder = &arguments.out;
    if folder.exists() && !folder.is_dir() {
        return Err(UserError::flag("--out", format!("{} is no folder", folder.display())).into());
    }
    let write = || {
        std::fs::create_dir_all(folder)?;
        clap_mangen::generate_to(companion::whole(), folder)
    };
    write().with_context(|| format!("cannot write pages into {}", folder.display()))
}
