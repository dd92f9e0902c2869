//! The files of a command: those that its flags name, or else those of a recording's folder.

use std::path::{Path, PathBuf};

use recording::UserError;
use recording::folder::{Folder, MeasurementMode, RecordingSettings};

/// Where files come from that no flag names.
pub struct FolderFiles(Option<Folder>);

impl FolderFiles {
    /// The files of a folder; of none, where no folder is given.
    ///
    /// # Errors
    /// The path is no folder, or its recording.toml is wrong.
    pub fn open(folder: Option<&Path>) -> Result<Self, UserError> {
        folder.map(Folder::open).transpose().map(Self)
    }

    /// The file of a flag, or else the folder's file of this name.
    ///
    /// # Errors
    /// There is neither.
    pub fn file(&self, of_flag: &Option<PathBuf>, name: &str) -> Result<PathBuf, UserError> {
        match (of_flag, &self.0) {
            (Some(file), _) => Ok(file.clone()),
            (None, Some(folder)) => folder.file(name),
            (None, None) => Err(needed(name)),
        }
    }

    /// How the folder's tags measured, and the file of it.
    ///
    /// # Errors
    /// There is no folder, or it has no such file.
    pub fn measured(&self) -> Result<(MeasurementMode, PathBuf), UserError> {
        self.0.as_ref().ok_or_else(|| needed("ranges.csv"))?.measured()
    }

    /// The same, for a file that may be absent.
    pub fn find(&self, of_flag: &Option<PathBuf>, name: &str) -> Option<PathBuf> {
        of_flag.clone().or_else(|| self.0.as_ref()?.find(name))
    }

    /// The file of a flag, or else the folder's table of this name, where it has a row.
    ///
    /// # Errors
    /// The table is wrong before its first row.
    pub fn find_rows(&self, of_flag: &Option<PathBuf>, name: &str) -> Result<Option<PathBuf>, UserError> {
        match (of_flag, &self.0) {
            (Some(file), _) => Ok(Some(file.clone())),
            (None, Some(folder)) => folder.find_rows(name),
            (None, None) => Ok(None),
        }
    }

    /// What the folder says of the recording.
    pub fn settings(&self) -> RecordingSettings {
        self.0.as_ref().map(|folder| folder.settings.clone()).unwrap_or_default()
    }
}

fn needed(name: &str) -> UserError {
    UserError::flag("FOLDER", format!("a folder with {name}, or the flag of this file is needed"))
}
