//! A TOML file with its lines: tables whose keys are all known, fields of the right kind, or what is wrong in which
//! line.

use std::path::{Path, PathBuf};

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::UserError;

/// The file, for its lines.
#[derive(Clone, Copy, Debug)]
pub(super) struct Document<'d> {
    pub(super) file: &'d Path,
    pub(super) text: &'d str,
}

impl<'d> Document<'d> {
    /// The file's outermost table.
    pub(super) fn parse(self) -> Result<Spanned<DeTable<'d>>, UserError> {
        DeTable::parse(self.text).map_err(|error| {
            let at = error.span().map_or(0, |span| span.start);
            self.wrong(self.line(at), error.message())
        })
    }

    /// The line, from 1, of an offset into the text.
    fn line(self, at: usize) -> u64 {
        let before = self.text.as_bytes().get(..at).unwrap_or(self.text.as_bytes());
        before.iter().filter(|byte| **byte == b'\n').count() as u64 + 1
    }

    pub(super) fn wrong(self, line: u64, what: impl Into<String>) -> UserError {
        UserError::line(self.file, line, what)
    }
}

/// A table.
#[derive(Clone, Copy, Debug)]
pub(super) struct Section<'d> {
    document: Document<'d>,
    table: &'d DeTable<'d>,
    /// Its first line.
    pub(super) line: u64,
}

impl<'d> Section<'d> {
    /// The outermost table.
    pub(super) fn root(document: Document<'d>, table: &'d Spanned<DeTable<'d>>) -> Self {
        Self { document, table: table.get_ref(), line: 1 }
    }

    /// The table with no other keys than these; `foreign` says of a key that is known elsewhere why it is wrong here.
    pub(super) fn with_keys(self, known: &[&str], foreign: impl Fn(&str) -> Option<String>) -> Result<Self, UserError> {
        let mut keys: Vec<_> = self.table.iter().map(|(key, _)| (key.span().start, key.get_ref().as_ref())).collect();
        keys.sort_unstable();
        let Some((at, unknown)) = keys.into_iter().find(|(_, key)| !known.contains(key)) else {
            return Ok(self);
        };
        let what = foreign(unknown).unwrap_or_else(|| match nearest(unknown, known) {
            Some(near) => format!("unknown key {unknown}; {near} is near it"),
            None => format!("unknown key {unknown}; there are {}", known.join(", ")),
        });
        Err(self.document.wrong(self.document.line(at), what))
    }

    pub(super) fn optional(&self, key: &'static str) -> Option<Field<'d>> {
        let (name, value) = self.table.get_key_value(key)?;
        Some(Field {
            document: self.document,
            key,
            line: self.document.line(name.span().start),
            value: value.get_ref(),
        })
    }

    pub(super) fn required(&self, key: &'static str) -> Result<Field<'d>, UserError> {
        self.optional(key).ok_or_else(|| self.wrong(format!("{key} is missing")))
    }

    /// The tables of a list `[[key]]`, or the one table `[key]`.
    pub(super) fn tables(&self, key: &'static str) -> Result<Vec<Section<'d>>, UserError> {
        let Some((name, value)) = self.table.get_key_value(key) else { return Ok(Vec::new()) };
        let table_at = |value: &'d Spanned<DeValue<'d>>| match value.get_ref() {
            DeValue::Table(table) => {
                let (document, line) = (self.document, self.document.line(value.span().start));
                Ok(Section { document, table, line })
            }
            other => {
                let line = self.document.line(value.span().start);
                Err(self.document.wrong(line, format!("{key} is {}: it must be a table", kind(other))))
            }
        };
        match value.get_ref() {
            DeValue::Array(list) => list.iter().map(table_at).collect(),
            DeValue::Table(table) => {
                let at = if value.span().is_empty() { name.span().start } else { value.span().start };
                Ok(vec![Section { document: self.document, table, line: self.document.line(at) }])
            }
            _ => table_at(value).map(|section| vec![section]),
        }
    }

    pub(super) fn wrong(&self, what: impl Into<String>) -> UserError {
        self.document.wrong(self.line, what)
    }
}

/// A key with its value.
#[derive(Clone, Copy, Debug)]
pub(super) struct Field<'d> {
    document: Document<'d>,
    pub(super) key: &'static str,
    pub(super) line: u64,
    value: &'d DeValue<'d>,
}

impl<'d> Field<'d> {
    /// A whole number that fits; `must` says which those are.
    pub(super) fn integer<T: TryFrom<i128>>(&self, must: &str) -> Result<T, UserError> {
        whole(self.value).ok_or_else(|| self.refuse(must))
    }

    /// A number.
    pub(super) fn real(&self) -> Result<f32, UserError> {
        number(self.value).ok_or_else(|| self.refuse("a number"))
    }

    /// Where something is, metres.
    pub(super) fn place(&self) -> Result<[f32; 3], UserError> {
        let must = "three numbers, [x, y, z]";
        let DeValue::Array(list) = self.value else { return Err(self.refuse(must)) };
        let numbers: Option<Vec<f32>> = list.iter().map(|value| number(value.get_ref())).collect();
        numbers.and_then(|numbers| numbers.try_into().ok()).ok_or_else(|| self.refuse(must))
    }

    /// Whole numbers that fit.
    pub(super) fn integers<T: TryFrom<i128>>(&self, must: &str) -> Result<Vec<T>, UserError> {
        let DeValue::Array(list) = self.value else { return Err(self.refuse(must)) };
        let numbers: Option<Vec<T>> = list.iter().map(|value| whole(value.get_ref())).collect();
        numbers.ok_or_else(|| self.refuse(must))
    }

    pub(super) fn boolean(&self) -> Result<bool, UserError> {
        match self.value {
            DeValue::Boolean(value) => Ok(*value),
            _ => Err(self.refuse("true or false")),
        }
    }

    pub(super) fn text(&self, must: &str) -> Result<&'d str, UserError> {
        match self.value {
            DeValue::String(text) => Ok(text),
            _ => Err(self.refuse(must)),
        }
    }

    /// One of these, by its name.
    pub(super) fn choice<T: Copy>(&self, all: &[T], name: impl Fn(T) -> &'static str) -> Result<T, UserError> {
        let names: Vec<&str> = all.iter().map(|one| name(*one)).collect();
        let must = format!("one of \"{}\"", names.join("\", \""));
        let text = self.text(&must)?;
        let same = all.iter().copied().find(|one| name(*one) == text);
        same.ok_or_else(|| match nearest(text, &names) {
            Some(near) => self.refuse(&format!("{must}; {near} is near it")),
            None => self.refuse(&must),
        })
    }

    /// A file; its path counts from the folder of the document.
    pub(super) fn path(&self, must: &str) -> Result<PathBuf, UserError> {
        let text = self.text(must)?;
        Ok(self.document.file.parent().map_or_else(|| PathBuf::from(text), |folder| folder.join(text)))
    }

    /// So many bytes as hexadecimal digits; `-` and `:` may stand between them.
    pub(super) fn bytes<const N: usize>(&self) -> Result<[u8; N], UserError> {
        let must = format!("{} hexadecimal digits in quotation marks", 2 * N);
        let text = self.text(&must)?;
        let digits: Option<Vec<u8>> =
            text.chars().filter(|c| !matches!(c, '-' | ':')).map(|c| c.to_digit(16).map(|digit| digit as u8)).collect();
        let bytes = digits.filter(|digits| digits.len() == 2 * N);
        let bytes =
            bytes.map(|digits| digits.chunks(2).map(|pair| pair.iter().fold(0, |byte, d| byte << 4 | d)).collect());
        bytes.and_then(|bytes: Vec<u8>| bytes.try_into().ok()).ok_or_else(|| self.refuse(&must))
    }

    /// The table that the value is.
    pub(super) fn table(&self) -> Result<Section<'d>, UserError> {
        match self.value {
            DeValue::Table(table) => Ok(Section { document: self.document, table, line: self.line }),
            _ => Err(self.refuse("a table, { … }")),
        }
    }

    /// The value is not what it must be.
    pub(super) fn refuse(&self, must: &str) -> UserError {
        self.wrong(format!("{} is {}: it must be {must}", self.key, kind(self.value)))
    }

    pub(super) fn wrong(&self, what: impl Into<String>) -> UserError {
        self.document.wrong(self.line, what)
    }
}

fn whole<T: TryFrom<i128>>(value: &DeValue<'_>) -> Option<T> {
    let DeValue::Integer(integer) = value else { return None };
    i128::from_str_radix(integer.as_str(), integer.radix()).ok()?.try_into().ok()
}

/// The nearest f32 of the digits themselves, not of an f64 between.
fn number(value: &DeValue<'_>) -> Option<f32> {
    match value {
        DeValue::Float(float) => float.as_str().parse().ok(),
        DeValue::Integer(integer) if integer.radix() == 10 => integer.as_str().parse().ok(),
        DeValue::Integer(_)
        | DeValue::String(_)
        | DeValue::Boolean(_)
        | DeValue::Datetime(_)
        | DeValue::Array(_)
        | DeValue::Table(_) => None,
    }
}

/// A value in an error: short ones as they are.
fn kind(value: &DeValue<'_>) -> String {
    match value {
        DeValue::String(text) => format!("\"{text}\""),
        DeValue::Integer(integer) => integer.to_string(),
        DeValue::Float(float) => float.to_string(),
        DeValue::Boolean(value) => value.to_string(),
        DeValue::Datetime(value) => value.to_string(),
        DeValue::Array(list) => format!("a list of {}", list.len()),
        DeValue::Table(_) => "a table".to_owned(),
    }
}

/// The known word that an unknown one is nearest to, where it is near.
pub(super) fn nearest<'w>(unknown: &str, known: &[&'w str]) -> Option<&'w str> {
    let score = |word: &str| strsim::jaro_winkler(&unknown.to_lowercase(), word);
    let near = known.iter().copied().max_by(|a, b| score(a).total_cmp(&score(b)))?;
    (score(near) > 0.75).then_some(near)
}
