//! Back-up and restoring. A back-up is a SQLite store in one file, whatever the engine of the store; so a store goes
//! from one engine to the other by its back-up. A file appears when it is complete, and a database is filled in one
//! transaction: what is interrupted leaves nothing half.

use std::ffi::OsString;
use std::io;
use std::path::{Path, PathBuf};

use sqlx::{AnyConnection, Connection};

use super::copy::copy;
use super::open::{Place, is_ours, require_file, url_of_file};
use super::{Engine, Result, Store, StoreError};

impl Store {
    /// Copies the store of a URL, while it is in use, to a new file.
    ///
    /// # Errors
    /// There is no such store, or the file is there already or cannot be written.
    pub async fn back_up(url: &str, file: &Path) -> Result<()> {
        let place = Place::of(url);
        refuse_existing(file)?;
        let part = Part::beside(file)?;
        match place.engine {
            Engine::Sqlite => vacuum(Path::new(&place.name), &part.path).await?,
            Engine::Postgres => {
                let store = Self::open(url).await?;
                let made = Self::open(&part.name()?).await?;
                let copied = copy(&store, &made).await;
                made.close().await;
                store.close().await;
                copied?;
            }
        }
        part.publish(file)
    }

    /// Makes a store of a back-up: a new SQLite file, or an empty PostgreSQL. A back-up of an earlier version gets the
    /// tables of this one; its file is not changed. `scratch` is a folder for a copy of the back-up.
    ///
    /// # Errors
    /// The file is no back-up, the place is not empty, or it cannot be written.
    pub async fn restore(file: &Path, url: &str, scratch: &Path) -> Result<()> {
        let place = Place::of(url);
        match place.engine {
            Engine::Sqlite => {
                let target = Path::new(&place.name);
                refuse_existing(target)?;
                let part = Part::beside(target)?;
                vacuum(file, &part.path).await?;
                Self::open(&part.name()?).await?.close().await;
                part.publish(target)
            }
            Engine::Postgres => {
                let part = Part::beside(&scratch.join("baliza.db"))?;
                vacuum(file, &part.path).await?;
                let store = Self::open(url).await?;
                let made = Self::open(&part.name()?).await?;
                let copied = copy(&made, &store).await;
                made.close().await;
                store.close().await;
                copied
            }
        }
    }
}

/// Copies a SQLite store to a new file. The store is only read: it may be in use, and of another version.
async fn vacuum(store: &Path, file: &Path) -> Result<()> {
    sqlx::any::install_default_drivers();
    let name = || store.display().to_string();
    let cannot_open = |error| StoreError::Open(name(), error);
    let url = url_of_file(store).map_err(cannot_open)?;
    require_file(&name())?;
    if !is_ours(&format!("{url}?mode=ro")).await.map_err(cannot_open)? {
        return Err(StoreError::Foreign(name()));
    }
    let mut connection = AnyConnection::connect(&format!("{url}?mode=ro")).await.map_err(cannot_open)?;
    let to = file.to_str().ok_or_else(|| not_utf8(file))?;
    sqlx::query("VACUUM INTO $1").bind(to).execute(&mut connection).await?;
    Ok(connection.close().await?)
}

fn refuse_existing(file: &Path) -> Result<()> {
    if file.symlink_metadata().is_ok() { Err(StoreError::Exists(file.display().to_string())) } else { Ok(()) }
}

fn not_utf8(file: &Path) -> StoreError {
    StoreError::File(file.display().to_string(), io::Error::other("the name is not UTF-8"))
}

/// A file that is being made. It is removed when it is dropped before it is published.
struct Part {
    path: PathBuf,
}

impl Part {
    /// A new file in the same folder.
    fn beside(file: &Path) -> Result<Self> {
        let failed = |error| StoreError::File(file.display().to_string(), error);
        // Absolute: SQLite takes a name that begins with `file:` for a URL.
        let mut path = std::path::absolute(file).map_err(failed)?.into_os_string();
        path.push(format!(".{}.part", std::process::id()));
        Ok(Self { path: path.into() })
    }

    fn name(&self) -> Result<String> {
        self.path.to_str().map(str::to_owned).ok_or_else(|| not_utf8(&self.path))
    }

    /// Gives the complete file its name, unless there is one of that name by now.
    fn publish(self, file: &Path) -> Result<()> {
        let publish = || {
            std::fs::File::open(&self.path)?.sync_all()?;
            if file.symlink_metadata().is_ok() {
                return Err(io::ErrorKind::AlreadyExists.into());
            }
            std::fs::rename(&self.path, file)?;
            // The name, too, is to survive a power cut. Only Unix opens a folder like a file.
            match self.path.parent() {
                Some(folder) if cfg!(unix) => std::fs::File::open(folder)?.sync_all(),
                _ => Ok(()),
            }
        };
        publish().map_err(|error| StoreError::File(file.display().to_string(), error))
    }
}

impl Drop for Part {
    fn drop(&mut self) {
        // With what SQLite writes beside it. Published, there is none of them.
        for end in ["", "-wal", "-shm", "-journal"] {
            let mut path = OsString::from(&self.path);
            path.push(end);
            let _ = std::fs::remove_file(path);
        }
    }
}
