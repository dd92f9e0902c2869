//! `baliza station …`: the station's store.

mod backup;
mod export;
mod restore;

use anyhow::{Context, Result};
use recording::{Interrupted, UserError};
use station_core::store::StoreError;

use host_tools::cli::stream::catch_signals;

use super::serve::stopped;

host_tools::commands! {
    /// Back up, restore and export what the station has stored
    ///
    /// All of them work while a station runs on the store.
    pub enum Arguments {
        Backup(backup),
        Restore(restore),
        Export(export),
    }
}

/// A store that cannot be read from: where it is not there, or another program's, the person named a wrong one.
fn unusable(error: StoreError) -> anyhow::Error {
    match error {
        StoreError::Missing(_) | StoreError::Foreign(_) => UserError::flag("--store", error.to_string()).into(),
        other => other.into(),
    }
}

/// Runs work on a store. A signal ends it, and what is half done is removed.
fn run_to_end<T>(work: impl Future<Output = Result<T>>) -> Result<T> {
    catch_signals()?;
    let runtime =
        tokio::runtime::Builder::new_multi_thread().enable_all().build().context("cannot start the runtime")?;
    runtime.block_on(async {
        tokio::select! {
            done = work => done,
            () = stopped() => Err(Interrupted.into()),
        }
    })
}
