//! The store: SQLite or PostgreSQL, by URL. One station writes to a store; others may read.
//!
//! | table | a row is |
//! |---|---|
//! | `recent` | a position that has just been written; only grows at its end |
//! | `history` | a position of a minute that is over, by its key |
//! | `minutes` | a minute that has rows in `history`, and whether they are thinned |
//! | `measurements` | a range or a sighting, by the key of the position for which it was made; only where asked for |
//! | `peers` | a node that was measured to, the number that stands for it in measurements, and its place |
//! | `tags`, `rooms` | a name, and the number that stands for it in positions; of a tag also its first and last time |
//! | `health` | how a node was in a minute, as whole numbers |
//! | `events`, `sites`, `zones`, `nodes`, `campaigns`, `points`, `samples` | an object of [`crate::model`]; lists are JSON |
//!
//! The key of a position is `minute << 36 | tag << 16 | millisecond of the minute`. Once a minute, [`Store::compact`]
//! moves the minutes that are over from `recent` to `history` in the order of the key, so that pages are full and a
//! tag's minute lies in one place. A row that comes late goes to its minute too. Lengths of positions are whole
//! millimetres, times whole milliseconds, the covariance of x and y is a correlation in 1/127. A tag has one position
//! in a millisecond: the first that was written. With that and the ids of events, what is written twice is stored
//! once; a writer whose connection broke may write again.
//!
//! SQLite runs with a write-ahead log and `synchronous = FULL`: a commit waits until the log is on the disk, so that
//! what is acknowledged survives a power cut, not only a crash of the process. `NORMAL` would lose the last seconds
//! there. The hub commits twice a second, so the wait does not matter. The file does not shrink when rows are deleted;
//! new rows use the pages. A back-up is a SQLite store itself, of either engine.

mod backup;
mod campaigns;
mod copy;
mod events;
mod health;
mod history;
mod key;
mod measurements;
mod migrations;
mod open;
mod placed;
mod position_text;
mod retention;
mod rows;
mod sites;
#[cfg(test)]
mod tests;
mod write;

use std::sync::Arc;
use std::time::Duration;

use sqlx::{Any, Transaction};
use tokio::sync::{Mutex, MutexGuard};

use crate::Utc;
use rows::UnboundStatement;
use write::Numbers;

/// An error of the store.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// There is already one of this name.
    #[error("there is already {0}")]
    Exists(String),
    /// There is none of this name.
    #[error("there is no {0}")]
    Missing(String),
    /// The database was written by a newer version.
    #[error("{0} was written by a newer version of baliza; use that version, or another store")]
    Newer(String),
    /// The SQLite file belongs to another program.
    #[error("{0} is a database of another program; name another file")]
    Foreign(String),
    /// It cannot be opened.
    #[error("cannot open the store {0}: {1}")]
    Open(String, sqlx::Error),
    /// PostgreSQL stores no text with this character.
    #[error("a text contains the character U+0000")]
    Nul,
    /// A back-up is restored to an empty store only.
    #[error("the store has {0} already, and a back-up is restored to an empty one only: name another store")]
    Occupied(&'static str),
    /// The file of a back-up.
    #[error("cannot write {0}: {1}")]
    File(String, std::io::Error),
    /// A column holds what this version did not write.
    #[error("the store is damaged: {0}")]
    Damaged(String),
    /// The database.
    #[error(transparent)]
    Database(sqlx::Error),
}

impl From<sqlx::Error> for StoreError {
    fn from(error: sqlx::Error) -> Self {
        // character_not_in_repertoire: PostgreSQL's texts hold every character but this one.
        if error.as_database_error().and_then(|e| e.code()).is_some_and(|code| code == "22021") {
            Self::Nul
        } else {
            Self::Database(error)
        }
    }
}

/// The result of an operation.
pub type Result<T> = std::result::Result<T, StoreError>;

/// A part of history.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Span {
    /// Included.
    pub from: Utc,
    /// Excluded.
    pub to: Utc,
}

/// How long positions, events, the health of nodes and measurements are kept.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Retention {
    /// Positions older than this are thinned to one a second and tag.
    pub thin_after: Option<Duration>,
    /// Rows older than this are deleted, and tags that were not seen since.
    pub delete_after: Option<Duration>,
    /// Measurements are kept for this time, and not longer than positions. None: there are no new ones.
    pub measurements: Option<Duration>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Engine {
    Sqlite,
    Postgres,
}

/// The store.
#[derive(Clone, Debug)]
pub struct Store {
    pool: sqlx::AnyPool,
    engine: Engine,
    /// Who writes holds it: SQLite has one writer at a time, and numbers are given to names one after the other.
    writer: Arc<Mutex<Numbers>>,
}

/// A transaction that writes.
struct Writing<'a> {
    tx: Transaction<'static, Any>,
    numbers: MutexGuard<'a, Numbers>,
}

impl Store {
    /// How long [`Store::is_well`] waits for an answer.
    const ANSWERS_WITHIN: Duration = Duration::from_secs(2);

    /// Whether the database answers.
    pub async fn is_well(&self) -> bool {
        let answer = sqlx::query("SELECT 1").execute(&self.pool);
        matches!(tokio::time::timeout(Self::ANSWERS_WITHIN, answer).await, Ok(Ok(_)))
    }

    /// Closes all connections, after what runs on them.
    pub async fn close(&self) {
        self.pool.close().await;
    }

    /// A transaction whose statements all see the same state.
    async fn read(&self) -> Result<Transaction<'static, Any>> {
        let begin = match self.engine {
            Engine::Sqlite => "BEGIN",
            Engine::Postgres => "BEGIN ISOLATION LEVEL REPEATABLE READ READ ONLY",
        };
        Ok(self.pool.begin_with(begin).await?)
    }

    /// Runs a statement that writes. Returns the number of rows that it changed.
    async fn run(&self, statement: UnboundStatement<'_>) -> Result<u64> {
        let mut writing = self.begin().await?;
        let rows = statement.execute(&mut *writing.tx).await?.rows_affected();
        writing.tx.commit().await?;
        Ok(rows)
    }

    /// Runs a statement that changes a row. An error where there is no such row.
    async fn change(&self, statement: UnboundStatement<'_>, missing: impl FnOnce() -> String) -> Result<()> {
        if self.run(statement).await? == 0 { Err(StoreError::Missing(missing())) } else { Ok(()) }
    }

    async fn begin(&self) -> Result<Writing<'_>> {
        let numbers = self.writer.lock().await;
        let begin = match self.engine {
            // Waits for another process here, where it can, and not at its first INSERT, where it cannot.
            Engine::Sqlite => "BEGIN IMMEDIATE",
            Engine::Postgres => "BEGIN ISOLATION LEVEL REPEATABLE READ",
        };
        Ok(Writing { tx: self.pool.begin_with(begin).await?, numbers })
    }
}
