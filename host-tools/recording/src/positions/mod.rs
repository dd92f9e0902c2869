//! The file of positions: what `solve` writes as CSV, JSON lines or Parquet, and `plot` reads from CSV.

mod columns;
#[cfg(feature = "parquet")]
mod parquet;
mod read;

use std::io::Write;
use std::path::Path;

use serde_json::Map;

use self::columns::{Column, Entry};
use crate::{Epochs, Height, Solved};

pub use columns::TableParts;
pub use read::{PositionRow, Positions, read, read_track};

/// The positions of one tag by one method.
#[derive(Clone, Copy, Debug)]
pub struct Rows<'a> {
    /// The tag's name, where it is known.
    pub tag: Option<&'a str>,
    /// The method's name.
    pub method: &'a str,
    /// The epochs.
    pub epochs: &'a Epochs,
    /// What was found for each of them.
    pub solved: &'a [Solved],
    /// The tag's height, where it is given: it is written beside positions in the plane, without a deviation.
    pub height: Height,
}

/// The format of a file of positions. All have the same columns and values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Format {
    /// A header, and a row a position
    Csv,
    /// One object of JSON a line; its keys are the columns
    Jsonl,
    /// Apache Parquet; only with --out
    Parquet,
}

impl Format {
    /// The format that belongs to the ending of the file's name, if one does.
    pub fn of(file: &Path) -> Option<Self> {
        let extension = file.extension()?.to_str()?.to_ascii_lowercase();
        match extension.as_str() {
            "csv" => Some(Self::Csv),
            "jsonl" => Some(Self::Jsonl),
            "parquet" => Some(Self::Parquet),
            _ => None,
        }
    }

    /// Whether this program can write it: Parquet is a feature.
    pub const fn is_available(self) -> bool {
        match self {
            Self::Csv | Self::Jsonl => true,
            Self::Parquet => cfg!(feature = "parquet"),
        }
    }

    /// Writes the file: row after row in the order given. With `with_errors` it has the errors. `maker`: the version and
    /// the command that make it, which Parquet keeps.
    ///
    /// # Errors
    /// The file cannot be written, the format's writer returns an error, or the format is not available.
    pub fn write<'a>(
        self,
        rows: impl Iterator<Item = Rows<'a>> + Clone,
        with_errors: bool,
        maker: [&str; 2],
        file: impl Write,
    ) -> anyhow::Result<()> {
        let columns = TableParts::of(rows.clone(), with_errors).columns();
        let entries = rows.flat_map(Rows::entries);
        match self {
            Self::Csv => csv(&columns, true, entries, file),
            Self::Jsonl => jsonl(&columns, entries, file),
            #[cfg(feature = "parquet")]
            Self::Parquet => {
                let mut file = file;
                Ok(file.write_all(&parquet::encode(&columns, &entries, maker)?)?)
            }
            #[cfg(not(feature = "parquet"))]
            Self::Parquet => {
                let [version, _] = maker;
                anyhow::bail!("baliza {version} was built without Parquet")
            }
        }
    }
}

impl<'a> Rows<'a> {
    fn entries(self) -> impl Iterator<Item = Entry<'a>> + Clone {
        let Self { tag, method, epochs, solved, height } = self;
        epochs.iter().zip(solved).map(move |(epoch, solved)| Entry { tag, method, epoch, solved, height })
    }
}

/// A table of positions that is written row by row, while what it will have is not known yet.
pub struct LiveTable {
    columns: Vec<&'static Column>,
    is_csv: bool,
    is_begun: bool,
}

impl LiveTable {
    /// A table with the columns of these parts, as CSV or as JSON lines.
    pub fn new(parts: TableParts, is_csv: bool) -> Self {
        Self { columns: parts.columns(), is_csv, is_begun: false }
    }

    /// The text of these rows; before the first ones, the header.
    ///
    /// # Errors
    /// The format's writer returns an error.
    pub fn text(&mut self, rows: Rows) -> anyhow::Result<Vec<u8>> {
        let mut text = Vec::new();
        if self.is_csv {
            csv(&self.columns, !std::mem::replace(&mut self.is_begun, true), rows.entries(), &mut text)?;
        } else {
            jsonl(&self.columns, rows.entries(), &mut text)?;
        }
        Ok(text)
    }
}

fn csv<'a>(
    columns: &[&Column],
    has_header: bool,
    entries: impl Iterator<Item = Entry<'a>>,
    file: impl Write,
) -> anyhow::Result<()> {
    let mut writer = csv::Writer::from_writer(file);
    if has_header {
        writer.write_record(columns.iter().map(|column| column.name))?;
    }
    let mut field = String::new();
    for entry in entries {
        for column in columns {
            field.clear();
            column.values.write(&entry, &mut field);
            writer.write_field(&field)?;
        }
        writer.write_record(None::<&[u8]>)?;
    }
    Ok(writer.flush()?)
}

fn jsonl<'a>(
    columns: &[&Column],
    entries: impl Iterator<Item = Entry<'a>>,
    mut file: impl Write,
) -> anyhow::Result<()> {
    for entry in entries {
        let object: Map<_, _> =
            columns.iter().map(|column| (column.name.to_owned(), column.values.json(&entry))).collect();
        serde_json::to_writer(&mut file, &object)?;
        file.write_all(b"\n")?;
    }
    Ok(())
}
