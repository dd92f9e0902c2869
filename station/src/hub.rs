//! The hub: one task that takes reports, and everything that must see them.

use std::sync::{Arc, RwLock};
use std::time::Duration;

use tokio::sync::{broadcast, mpsc};

use crate::{Live, Report, Store, Update};

/// Reports that wait for the hub. A source that is faster waits.
const REPORTS: usize = 4096;
/// Updates that a listener may be behind. A slower one misses some, and is told how many.
const UPDATES: usize = 4096;

/// How long rows wait for others before they are written together.
pub const WRITE_EVERY: Duration = Duration::from_millis(500);

/// The way into the station, for sources, and the way out, for listeners.
#[derive(Clone, Debug)]
pub struct Hub {
    reports: mpsc::Sender<Report>,
    updates: broadcast::Sender<Update>,
    live: Arc<RwLock<Live>>,
}

impl Hub {
    /// Starts the hub's task on the current runtime. The task ends, with everything written, when all senders of
    /// reports are dropped or `stop` is called.
    pub fn start(live: Live, store: Store) -> (Self, tokio::task::JoinHandle<()>) {
        let _ = (live, store, REPORTS, UPDATES);
        todo!()
    }

    /// Where sources send their reports.
    pub fn reports(&self) -> mpsc::Sender<Report> {
        self.reports.clone()
    }

    /// Updates from now on.
    pub fn listen(&self) -> broadcast::Receiver<Update> {
        self.updates.subscribe()
    }

    /// Reads the current state.
    pub fn read<T>(&self, read: impl FnOnce(&Live) -> T) -> T {
        read(&self.live.read().unwrap_or_else(std::sync::PoisonError::into_inner))
    }

    /// Changes the current state, where a person has configured something.
    pub fn change<T>(&self, change: impl FnOnce(&mut Live) -> T) -> T {
        change(&mut self.live.write().unwrap_or_else(std::sync::PoisonError::into_inner))
    }
}
