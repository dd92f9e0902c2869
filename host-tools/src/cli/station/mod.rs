//! `baliza station …`: the station's store.

mod backup;
mod export;
mod restore;

use anyhow::{Context, Result};
use host_tools::Interrupted;

use super::serve::stopped;
use super::stream::catch_signals;

super::commands! {
    /// Back up, restore and export what the station has stored
    ///
    /// All of them work while a station runs on the store.
    enum Arguments {
        Backup(backup),
        Restore(restore),
        Export(export),
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
