//! A site's TOML file: its tables as types, its line numbers, and errors with line numbers.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use baliza_report::{explain, line_of};
use serde::de::{Deserialize, DeserializeOwned, Deserializer, Error as _, Unexpected};
use toml::de::DeTable;

use recording::UserError;

/// The file.
#[derive(Clone, Copy, Debug)]
pub(super) struct Document<'d> {
    pub(super) file: &'d Path,
    pub(super) text: &'d str,
}

impl Document<'_> {
    /// Parses the file to a type.
    pub(super) fn read<T: DeserializeOwned>(self) -> Result<T, UserError> {
        toml::from_str(self.text).map_err(|error| {
            let explained = explain(self.text, error.span(), error.message());
            self.wrong(explained.line as u64, explained.message)
        })
    }

    /// The line numbers of the outermost table, and those of the tables in it, by their keys and in their order.
    pub(super) fn lines(self) -> (Lines, BTreeMap<String, Vec<Lines>>) {
        let Ok(root) = DeTable::parse(self.text) else { return Default::default() };
        let line = |offset: usize| line_of(self.text, offset) as u64;
        let lines = |line_of_table: u64, table: &DeTable<'_>| Lines {
            line: line_of_table,
            keys: table.iter().map(|(key, _)| (key.get_ref().to_string(), line(key.span().start))).collect(),
        };
        let tables = root.get_ref().iter().filter_map(|(key, value)| {
            let tables = match (value.get_ref().as_array(), value.get_ref().as_table()) {
                (Some(list), _) => {
                    list.iter().filter_map(|of| Some(lines(line(of.span().start), of.get_ref().as_table()?))).collect()
                }
                (None, Some(table)) => vec![lines(line(key.span().start), table)],
                (None, None) => return None,
            };
            Some((key.get_ref().to_string(), tables))
        });
        (lines(1, root.get_ref()), tables.collect())
    }

    pub(super) fn wrong(self, line: u64, what: impl Into<String>) -> UserError {
        UserError::line(self.file, line, what)
    }

    /// The path of a file that the document names. It is relative to the document's folder.
    pub(super) fn beside(self, name: &Path) -> PathBuf {
        self.file.parent().map_or_else(|| name.to_owned(), |folder| folder.join(name))
    }
}

/// The line numbers of a table and of its keys.
#[derive(Clone, Debug, Default)]
pub(super) struct Lines {
    pub(super) line: u64,
    pub(super) keys: BTreeMap<String, u64>,
}

impl Lines {
    /// The line number of a key, or of the table where the table does not have the key.
    pub(super) fn of(&self, key: &str) -> u64 {
        self.keys.get(key).copied().unwrap_or(self.line)
    }
}

/// N bytes as hexadecimal digits. `-` and `:` may separate the digits.
#[derive(Clone, Copy, Debug)]
pub(super) struct Hex<const N: usize>(pub(super) [u8; N]);

impl<const N: usize> Hex<N> {
    /// The bytes of a text. The error is the text itself, where it is not valid.
    pub(super) fn from_text(text: &str) -> Result<Self, String> {
        let digits = text.chars().filter(|c| !matches!(c, '-' | ':')).map(|c| c.to_digit(16).map(|digit| digit as u8));
        let digits: Option<Vec<u8>> = digits.collect();
        let digits = digits.filter(|digits| digits.len() == 2 * N).ok_or(text)?;
        let bytes: Vec<u8> =
            digits.chunks(2).map(|pair| pair.iter().fold(0, |byte, digit| byte << 4 | digit)).collect();
        bytes.try_into().map(Self).map_err(|_| text.to_owned())
    }

    /// The error of an invalid text.
    pub(super) fn refuse<E: serde::de::Error>(text: &str) -> E {
        let must = format!("{} hexadecimal digits in quotation marks", 2 * N);
        E::invalid_value(Unexpected::Str(text), &must.as_str())
    }
}

impl<'de, const N: usize> Deserialize<'de> for Hex<N> {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        Self::from_text(&String::deserialize(from)?).map_err(|text| Self::refuse(&text))
    }
}

/// One of several values, by its name.
pub(super) fn choice<'de, D: Deserializer<'de>, T: Copy>(
    from: D,
    all: &[T],
    name: impl Fn(T) -> &'static str,
) -> Result<Option<T>, D::Error> {
    let text = String::deserialize(from)?;
    let found = all.iter().copied().find(|one| name(*one) == text);
    found.map(Some).ok_or_else(|| {
        let names: Vec<_> = all.iter().map(|one| format!("`{}`", name(*one))).collect();
        D::Error::custom(format!("unknown variant `{text}`, expected one of {}", names.join(", ")))
    })
}
