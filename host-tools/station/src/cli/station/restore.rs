//! `baliza station restore`: a store of a back-up.

use std::path::PathBuf;

use anyhow::{Context, Result};
use recording::UserError;
use station_core::Store;
use station_core::store::StoreError;

/// Make a store of a back-up
///
/// The store is a new SQLite file or an empty PostgreSQL database: nothing that is there is replaced. To go back to a
/// back-up, stop the station and move its store away. A back-up of an earlier version is brought to this one; its file
/// stays as it is.
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  baliza station restore monday.db --store baliza.db\n  \
                        baliza station restore monday.db --store postgres://baliza@db/baliza")]
pub struct Arguments {
    /// What `baliza station backup` has made
    #[arg(value_name = "FILE")]
    backup: PathBuf,
    /// The new store: a SQLite file, or postgres://USER:PASSWORD@HOST/DATABASE
    #[arg(long, value_name = "FILE|URL")]
    store: String,
}

/// Runs `baliza station restore`.
///
/// # Errors
/// The file is no back-up, or the place of the store is not empty or cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let scratch = tempfile::tempdir().context("cannot make a temporary folder")?;
    let Arguments { backup, store } = arguments;
    let done = super::run_to_end(async { Ok(Store::restore(backup, store, scratch.path()).await) })?;
    done.map_err(|error| match error {
        StoreError::Exists(_) => {
            UserError::flag("--store", format!("{store} is there already; name another, or move it away")).into()
        }
        StoreError::Occupied(_) => UserError::flag("--store", error.to_string()).into(),
        StoreError::Missing(_) => UserError::file(backup, "there is no such file").into(),
        StoreError::Foreign(_) => UserError::file(backup, "it is a database of another program").into(),
        StoreError::Newer(_) => UserError::file(backup, "it is of a newer version of baliza; use that version").into(),
        other => anyhow::Error::from(other),
    })?;
    host_tools::cli::note("the store is complete\n");
    Ok(())
}
