//! A site's TOML text: its tables as types, its line numbers, and errors with line numbers.

use std::collections::BTreeMap;
use std::fmt;

use baliza_report::{explain, line_of};
use serde::de::{Deserialize, DeserializeOwned, Deserializer, Error as _, Unexpected};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// What is wrong with a site, and where.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SiteError {
    /// The line, from 1; `None`: something is missing in the whole file.
    pub line: Option<u64>,
    /// What is wrong, in one line.
    pub message: String,
}

impl SiteError {
    /// An error in a line.
    pub fn at(line: u64, message: impl Into<String>) -> Self {
        Self { line: Some(line), message: message.into() }
    }

    /// An error of the whole file.
    pub fn whole(message: impl Into<String>) -> Self {
        Self { line: None, message: message.into() }
    }
}

impl fmt::Display for SiteError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.line {
            Some(line) => write!(f, "line {line}: {}", self.message),
            None => f.write_str(&self.message),
        }
    }
}

impl std::error::Error for SiteError {}

/// The text.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Document<'t> {
    pub(crate) text: &'t str,
}

impl Document<'_> {
    /// Parses the text to a type.
    pub(crate) fn read<T: DeserializeOwned>(self) -> Result<T, SiteError> {
        toml::from_str(self.text).map_err(|error| {
            let explained = explain(self.text, error.span(), error.message());
            let error = SiteError::at(explained.line as u64, explained.message);
            if error.message.starts_with("duplicate key") { self.single_brackets().unwrap_or(error) } else { error }
        })
    }

    /// A table in single brackets among others of its name in double ones.
    fn single_brackets(self) -> Option<SiteError> {
        let is_double = |name: &str| self.text.lines().any(|line| header(line) == format!("[[{name}]]"));
        let single = |line| header(line).strip_prefix('[')?.strip_suffix(']').filter(|name| is_double(name));
        let (line, name) = (1..).zip(self.text.lines()).find_map(|(at, line)| Some((at, single(line)?)))?;
        Some(SiteError::at(line, format!("there may be several of [{name}]: put it in two brackets")))
    }

    /// The line number of an offset.
    pub(crate) fn line(self, offset: usize) -> u64 {
        line_of(self.text, offset) as u64
    }

    /// A value and the line number of its beginning.
    pub(crate) fn with_line<T>(self, value: Spanned<T>) -> (T, u64) {
        let line = self.line(value.span().start);
        (value.into_inner(), line)
    }

    /// The line numbers of the outermost table, and those of the tables in it, by their keys and in their order.
    pub(crate) fn lines(self) -> (KeyLines, BTreeMap<String, Vec<KeyLines>>) {
        let Ok(root) = DeTable::parse(self.text) else { return Default::default() };
        let tables = root.get_ref().iter().map(|(key, value)| {
            let tables = tables_of(value).into_iter().map(|(start, table)| self.lines_of(start, table)).collect();
            (key.get_ref().to_string(), tables)
        });
        (self.lines_of(0, root.get_ref()), tables.collect())
    }

    fn lines_of(self, start: usize, table: &DeTable<'_>) -> KeyLines {
        let mut lines = KeyLines { line: self.line(start), keys: BTreeMap::new() };
        for (key, value) in table {
            lines.keys.insert(key.get_ref().to_string(), self.line(key.span().start));
            for (inner, _) in value.get_ref().as_table().into_iter().flatten() {
                let name = format!("{}.{}", key.get_ref(), inner.get_ref());
                lines.keys.insert(name, self.line(inner.span().start));
            }
        }
        lines
    }
}

/// A line without comment and spaces.
fn header(line: &str) -> &str {
    line.split('#').next().unwrap_or_default().trim()
}

/// The table of a value, or the tables of its list, with the offsets of their beginnings.
pub(crate) fn tables_of<'v, 'i>(value: &'v Spanned<DeValue<'i>>) -> Vec<(usize, &'v DeTable<'i>)> {
    let one = |value: &'v Spanned<DeValue<'i>>| Some((value.span().start, value.get_ref().as_table()?));
    match value.get_ref().as_array() {
        Some(list) => list.iter().filter_map(one).collect(),
        None => one(value).into_iter().collect(),
    }
}

/// The line numbers of a table and of its keys. A key of a table within it has a dot: `simulation.path_m`.
#[derive(Clone, Debug, Default)]
pub struct KeyLines {
    /// The line of the table itself.
    pub line: u64,
    pub(crate) keys: BTreeMap<String, u64>,
}

impl KeyLines {
    /// The line number of a key, or of the table where the table does not have the key.
    pub fn of(&self, key: &str) -> u64 {
        self.keys.get(key).copied().unwrap_or(self.line)
    }
}

/// N bytes as hexadecimal digits. `-` and `:` may separate the digits.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hex<const N: usize>(pub(crate) [u8; N]);

impl<const N: usize> Hex<N> {
    /// The bytes of a text. The error is the text itself, where it is not valid.
    pub(crate) fn from_text(text: &str) -> Result<Self, String> {
        let digits = text.chars().filter(|c| !matches!(c, '-' | ':')).map(|c| c.to_digit(16).map(|digit| digit as u8));
        let digits: Option<Vec<u8>> = digits.collect();
        let digits = digits.filter(|digits| digits.len() == 2 * N).ok_or(text)?;
        let bytes: Vec<u8> =
            digits.chunks(2).map(|pair| pair.iter().fold(0, |byte, digit| byte << 4 | digit)).collect();
        bytes.try_into().map(Self).map_err(|_| text.to_owned())
    }

    /// The error of an invalid text.
    pub(crate) fn refuse<E: serde::de::Error>(text: &str) -> E {
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
pub(crate) fn choice<'de, D: Deserializer<'de>, T: Copy>(
    from: D,
    all: &[T],
    name: impl Fn(T) -> &'static str,
) -> Result<T, D::Error> {
    let text = String::deserialize(from)?;
    all.iter().copied().find(|one| name(*one) == text).ok_or_else(|| {
        let names: Vec<_> = all.iter().map(|one| format!("`{}`", name(*one))).collect();
        D::Error::custom(format!("unknown variant `{text}`, expected one of {}", names.join(", ")))
    })
}
