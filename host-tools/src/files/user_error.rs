//! What a user did wrong, in one line: the binary prints it as it is and exits with 2.

use std::path::{Path, PathBuf};

/// The input or the arguments are wrong.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub enum UserError {
    /// A line of a file.
    #[error("{}:{line}: {what}", file.display())]
    Line {
        /// The file, as the user named it.
        file: PathBuf,
        /// The line, from 1.
        line: u64,
        /// What is wrong with it.
        what: String,
    },
    /// A file as a whole.
    #[error("{}: {what}", file.display())]
    File {
        /// The file, as the user named it.
        file: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// An argument.
    #[error("{flag}: {what}")]
    Flag {
        /// The flag, with its dashes.
        flag: &'static str,
        /// What is wrong with it.
        what: String,
    },
}

impl UserError {
    /// A line of a file is wrong.
    pub fn line(file: &Path, line: u64, what: impl Into<String>) -> Self {
        Self::Line { file: file.to_owned(), line, what: what.into() }
    }

    /// A file is wrong.
    pub fn file(file: &Path, what: impl Into<String>) -> Self {
        Self::File { file: file.to_owned(), what: what.into() }
    }

    /// An argument is wrong.
    pub fn flag(flag: &'static str, what: impl Into<String>) -> Self {
        Self::Flag { flag, what: what.into() }
    }
}
