//! A user's mistake, in one line. The binary prints the line as it is and exits with code 2.

use std::path::{Path, PathBuf};

use baliza_report::line_of;

/// The input or the arguments are wrong.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub enum UserError {
    /// An error in a line of a file.
    #[error("{}:{line}: {what}", file.display())]
    Line {
        /// The file, as the user named it.
        file: PathBuf,
        /// The line number, from 1.
        line: u64,
        /// What is wrong with the line.
        what: String,
    },
    /// An error of a whole file.
    #[error("{}: {what}", file.display())]
    File {
        /// The file, as the user named it.
        file: PathBuf,
        /// What is wrong with the file.
        what: String,
    },
    /// An error of an argument.
    #[error("{flag}: {what}")]
    Flag {
        /// The flag, with its dashes.
        flag: &'static str,
        /// What is wrong with the argument.
        what: String,
    },
}

impl UserError {
    /// The error of a TOML file with secrets: the line and what is wrong, without the text. `needs` says what belongs
    /// into such a file.
    pub fn secret_toml(file: &Path, text: &str, error: &toml::de::Error, needs: &str) -> Self {
        let line = line_of(text, error.span().map_or(0, |span| span.start));
        Self::line(file, line as u64, format!("{}; {needs}", error.message()))
    }

    /// The error of a wrong line in a file.
    pub fn line(file: &Path, line: u64, what: impl Into<String>) -> Self {
        Self::Line { file: file.to_owned(), line, what: what.into() }
    }

    /// The error of a wrong file.
    pub fn file(file: &Path, what: impl Into<String>) -> Self {
        Self::File { file: file.to_owned(), what: what.into() }
    }

    /// The error of a wrong argument.
    pub fn flag(flag: &'static str, what: impl Into<String>) -> Self {
        Self::Flag { flag, what: what.into() }
    }
}
