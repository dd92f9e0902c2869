//! Opens a store: its URL, its connections, its tables.

use std::fmt::Write;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use sqlx::Connection;
use sqlx::any::AnyPoolOptions;
use sqlx::migrate::{MigrateError, Migrator};

use super::migrations::migrations;
use super::{Engine, Result, Store, StoreError};

/// What every connection to a SQLite file begins with. The first waits for other processes; `cache_size` is in KiB.
const PRAGMAS: &str = "PRAGMA busy_timeout = 10000; PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; \
     PRAGMA foreign_keys = ON; PRAGMA cache_size = -16384; PRAGMA journal_size_limit = 67108864";

/// How long an operation waits for a connection.
const ACQUIRE_WITHIN: Duration = Duration::from_secs(5);

/// Where a store is.
pub(super) struct Place {
    pub engine: Engine,
    /// What of the URL may be shown; of SQLite the file.
    pub name: String,
}

impl Place {
    pub fn of(url: &str) -> Self {
        if url.starts_with("postgres://") || url.starts_with("postgresql://") {
            Self { engine: Engine::Postgres, name: without_password(url) }
        } else {
            Self { engine: Engine::Sqlite, name: url.strip_prefix("sqlite://").unwrap_or(url).to_owned() }
        }
    }
}

impl Store {
    /// Opens `sqlite://FILE`, a plain path of a file, or `postgres://…`; makes or upgrades the tables.
    pub async fn open(url: &str) -> Result<Self> {
        sqlx::any::install_default_drivers();
        let Place { engine, name } = Place::of(url);
        let cannot_open = |error| StoreError::Open(name.clone(), error);
        // SQLite ends a transaction by itself where the disk is full. What sqlx rolls back then is no transaction, which
        // fails, and the connection can begin no other one: another connection is made in its place.
        let options = AnyPoolOptions::new()
            .acquire_timeout(ACQUIRE_WITHIN)
            .before_acquire(|connection, _| Box::pin(async move { Ok(!connection.is_in_transaction()) }));
        let pool = match engine {
            Engine::Sqlite => {
                let options = options.max_connections(4).after_connect(|connection, _| {
                    Box::pin(async move { sqlx::raw_sql(PRAGMAS).execute(connection).await.map(|_| ()) })
                });
                let file = Path::new(&name);
                let url = url_of_file(file).map_err(cannot_open)?;
                if file.exists() && !is_ours(&url).await.map_err(cannot_open)? {
                    return Err(StoreError::Foreign(name));
                }
                options.connect(&format!("{url}?mode=rwc")).await.map_err(cannot_open)?
            }
            Engine::Postgres => {
                // A pool tries until its time is over, and then does not tell why it has no connection.
                let first = sqlx::AnyConnection::connect(url).await.map_err(cannot_open)?;
                first.close().await.map_err(cannot_open)?;
                options.max_connections(8).connect(url).await.map_err(cannot_open)?
            }
        };
        match Migrator::with_migrations(migrations(engine)).run(&pool).await {
            Ok(()) => Ok(Self { pool, engine, writer: Arc::default() }),
            Err(MigrateError::VersionMissing(_)) => Err(StoreError::Newer(name)),
            Err(error) => Err(StoreError::Open(name, error.into())),
        }
    }
}

impl Store {
    /// Opens a store that is there: no file is made.
    ///
    /// # Errors
    /// As [`Store::open`], and there is no such file.
    pub async fn open_existing(url: &str) -> Result<Self> {
        if let Place { engine: Engine::Sqlite, name } = Place::of(url) {
            require_file(&name)?;
        }
        Self::open(url).await
    }
}

/// Refuses a SQLite store that is not there.
pub(super) fn require_file(name: &str) -> Result<()> {
    if Path::new(name).is_file() { Ok(()) } else { Err(StoreError::Missing(format!("file {name}"))) }
}

/// Whether a SQLite file has no tables, or those of migrations. It is not changed here, as it may be another program's.
pub(super) async fn is_ours(url: &str) -> std::result::Result<bool, sqlx::Error> {
    let mut connection = sqlx::AnyConnection::connect(url).await?;
    let foreign = sqlx::query(
        "SELECT 1 FROM sqlite_master WHERE NOT EXISTS (SELECT 1 FROM sqlite_master WHERE name = '_sqlx_migrations')",
    );
    let foreign = foreign.fetch_optional(&mut connection).await?.is_some();
    connection.close().await?;
    Ok(!foreign)
}

/// A file's path as a URL; every byte that could mean something else there is encoded.
pub(super) fn url_of_file(path: &Path) -> std::result::Result<String, sqlx::Error> {
    let path = std::path::absolute(path)?;
    let mut url = "sqlite://".to_owned();
    for &byte in path.as_os_str().as_encoded_bytes() {
        if byte.is_ascii_alphanumeric() || b"/-_.".contains(&byte) {
            url.push(char::from(byte));
        } else {
            let _ = write!(url, "%{byte:02X}");
        }
    }
    Ok(url)
}

/// What of a URL may be shown.
fn without_password(url: &str) -> String {
    let shown = url.split('?').next().unwrap_or(url);
    match shown.rsplit_once('@') {
        Some((_, place)) => format!("postgres://{place}"),
        None => shown.to_owned(),
    }
}
