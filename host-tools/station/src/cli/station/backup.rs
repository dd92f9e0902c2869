//! `baliza station backup`: the store in one file.

use std::path::PathBuf;

use anyhow::Result;
use recording::UserError;
use recording::output;
use station_core::Store;
use station_core::store::StoreError;

/// Copy the store to a new file, while the station runs
///
/// The file is a SQLite store, also where the station's own is a PostgreSQL: `baliza serve --store FILE` shows it, and
/// `baliza station restore` makes a SQLite or a PostgreSQL store of it. It has what was written before the command
/// began. An existing file is not replaced.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  baliza station backup --out monday.db\n  \
                        baliza station backup --store postgres://baliza@db/baliza --out monday.db")]
pub struct Arguments {
    /// The station's store: a SQLite file, or postgres://USER:PASSWORD@HOST/DATABASE
    #[arg(long, value_name = "FILE|URL", default_value = "baliza.db")]
    store: String,
    /// The new file
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

/// Runs `baliza station backup`.
///
/// # Errors
/// The store cannot be read, or the file is there or cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let wrong = |what: &str| UserError::flag("--out", format!("{}: {what}", arguments.out.display()));
    if arguments.out.as_os_str() == output::STANDARD {
        return Err(wrong("a file is needed, not standard output").into());
    }
    output::check("--out", &arguments.out)?;
    let done = super::run_to_end(async { Ok(Store::back_up(&arguments.store, &arguments.out).await) })?;
    done.map_err(|error| match error {
        StoreError::Exists(_) => wrong("it is there already; name another file").into(),
        other => super::unusable(other),
    })?;
    host_tools::cli::note(&format!("back-up: {}\n", arguments.out.display()));
    Ok(())
}
