//! The file of positions: what `solve` writes as CSV, JSON lines or Parquet, and `plot` reads from CSV.

mod columns;
#[cfg(feature = "parquet")]
mod parquet;
mod read;

use std::io::Write;
use std::path::Path;

use serde_json::Map;

use self::columns::{Column, Entry, columns};
use crate::Epochs;
use crate::Solved;

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

    /// Writes the file: row after row in the order given. With `with_errors` it has the errors.
    ///
    /// # Errors
    /// The file cannot be written, the format's writer returns an error, or the format is not available.
    pub fn write<'a>(
        self,
        rows: impl Iterator<Item = Rows<'a>> + Clone,
        with_errors: bool,
        file: impl Write,
    ) -> anyhow::Result<()> {
        let columns = columns(rows.clone(), with_errors);
        let entries = rows.flat_map(|Rows { tag, method, epochs, solved }| {
            epochs.iter().zip(solved).map(move |(epoch, solved)| Entry { tag, method, epoch, solved })
        });
        match self {
            Self::Csv => csv(&columns, entries, file),
            Self::Jsonl => jsonl(&columns, entries, file),
            #[cfg(feature = "parquet")]
            Self::Parquet => {
                let mut file = file;
                Ok(file.write_all(&parquet::encode(&columns, &entries)?)?)
            }
            #[cfg(not(feature = "parquet"))]
            Self::Parquet => anyhow::bail!("this program cannot write Parquet"),
        }
    }
}

fn csv<'a>(columns: &[&Column], entries: impl Iterator<Item = Entry<'a>>, file: impl Write) -> anyhow::Result<()> {
    let mut writer = csv::Writer::from_writer(file);
    writer.write_record(columns.iter().map(|column| column.name))?;
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
