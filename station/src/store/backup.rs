//! A back-up of a SQLite store.

use std::io;
use std::path::Path;

use super::{Engine, Result, Store, StoreError};

impl Store {
    /// Copies a SQLite store, while it is in use, to a new file. The file appears when it is complete.
    pub async fn back_up(&self, file: &Path) -> Result<()> {
        if self.engine != Engine::Sqlite {
            return Err(StoreError::NotSqlite);
        }
        let failed = |error| StoreError::File(file.display().to_string(), error);
        if file.symlink_metadata().is_ok() {
            return Err(StoreError::Exists(file.display().to_string()));
        }
        // Absolute: SQLite takes a name that begins with `file:` for a URL.
        let mut part = std::path::absolute(file).map_err(failed)?.into_os_string();
        part.push(format!(".{}.part", std::process::id()));
        let text = part.to_str().ok_or_else(|| failed(io::Error::other("the name is not UTF-8")))?;
        let copied = sqlx::query("VACUUM INTO $1").bind(text).execute(&self.pool).await;
        let done = match copied {
            Ok(_) => publish(Path::new(&part), file).map_err(failed),
            Err(error) => Err(error.into()),
        };
        if done.is_err() {
            let _ = std::fs::remove_file(&part);
        }
        done
    }
}

/// Gives a complete file its name, unless there is one of that name by now.
fn publish(part: &Path, file: &Path) -> io::Result<()> {
    std::fs::File::open(part)?.sync_all()?;
    if file.symlink_metadata().is_ok() {
        return Err(io::ErrorKind::AlreadyExists.into());
    }
    std::fs::rename(part, file)?;
    // The name, too, is to survive a power cut. Only Unix opens a folder like a file.
    match part.parent() {
        Some(folder) if cfg!(unix) => std::fs::File::open(folder)?.sync_all(),
        _ => Ok(()),
    }
}
