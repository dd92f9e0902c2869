//! A recording: surveyed anchors, ranges by epoch, and the tag's true positions.
//!
//! The input is `anchors.csv`, `ranges.csv` or `differences.csv` and, where there is one, `truth.csv`. The output is a
//! [`Recording`] a tag, with its [`Epochs`] in the order of their first range. A file without a column `tag` is of one
//! tag.

use std::borrow::Cow;
use std::collections::HashMap;
use std::path::Path;

use crate::differences::read_differences;
use crate::epochs::{Epochs, Gathering, Measured};
use crate::grouping::{ByName, tag_of};
use crate::table::quoted;
use crate::{Column, Row, Table, Truths, UserError};
use crate::{DiagnosticColumns, MeasurementMode, spelled};

/// A position, metres. Its height may be unknown.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coordinates {
    /// East, or along the room.
    pub x_m: f64,
    /// North, or across the room.
    pub y_m: f64,
    /// Up.
    pub z_m: Option<f64>,
}

/// An anchor.
#[derive(Clone, Debug, PartialEq)]
pub struct Anchor {
    /// The anchor's name in `ranges.csv`.
    pub name: String,
    /// The anchor's position.
    pub place: Coordinates,
}

/// The anchors, and the epochs of one tag.
#[derive(Clone, Debug, Default)]
pub struct Recording {
    /// The tag's name; `None` where the file of ranges has no column `tag`.
    pub tag: Option<String>,
    /// The anchors, in the order of the file.
    pub anchors: Vec<Anchor>,
    /// The epochs, in the order of their first range.
    pub epochs: Epochs,
}

/// Which files to read, and which heights they must have.
#[derive(Clone, Copy, Debug)]
pub struct Files<'a> {
    /// `anchors.csv`.
    pub anchors: &'a Path,
    /// `ranges.csv` or `differences.csv`.
    pub measured: &'a Path,
    /// Which of the two it is.
    pub mode: MeasurementMode,
    /// `truth.csv`.
    pub truth: Option<&'a Path>,
    /// Whether an anchor without a height is an error.
    pub anchor_heights: bool,
    /// Whether a truth file without a column of heights is an error.
    pub truth_heights: bool,
}

impl Recording {
    /// Reads the recordings of all tags, in the order of their first rows: at least one.
    ///
    /// # Errors
    /// The first line of a file that is wrong.
    pub fn read(files: &Files) -> Result<Vec<Self>, UserError> {
        let anchors = anchor_rows(files.anchors, files.anchor_heights)?;
        let mut recordings = match files.mode {
            MeasurementMode::Ranges => read_ranges(files.measured, &anchors)?,
            MeasurementMode::Differences => read_differences(files.measured, &anchors)?,
        };
        if let Some(truth) = files.truth {
            let truths = Truths::read(truth, files.truth_heights)?;
            for Self { tag, epochs, .. } in &mut recordings {
                if let Some(truth) = truths.of(tag.as_deref())? {
                    truth.join(epochs, 0.0);
                }
            }
        }
        Ok(recordings)
    }
}

/// The epochs of a file with the columns `epoch` and, where known, `t_s` and `tag`: those of each tag, in the order of
/// their first rows.
pub(crate) struct EpochsByTag<'a> {
    epoch: Column,
    time: Column,
    tag: Column,
    anchors: &'a [Anchor],
    /// By tag: its name, and its epochs.
    tags: ByName<(Option<String>, Gathering)>,
}

impl<'a> EpochsByTag<'a> {
    /// No epochs yet, of a recording with these anchors.
    pub(crate) fn of(table: &Table, anchors: &'a [Anchor]) -> Result<Self, UserError> {
        let (epoch, time, tag) = (table.column("epoch")?, table.optional("t_s"), table.optional("tag"));
        Ok(Self { epoch, time, tag, anchors, tags: ByName::default() })
    }

    /// The epochs of the row's tag, which take the measurement of the row, and the time of the row itself, seconds.
    pub(crate) fn of_row(&mut self, row: &Row) -> Result<(&mut Gathering, Option<f64>), UserError> {
        let (name, t_s) = (row.some_text(self.epoch)?, row.number(self.time)?);
        let tag = tag_of(row, self.tag);
        let (_, epochs) = self.tags.of(tag.unwrap_or(""), || (tag.map(str::to_owned), Gathering::default()));
        epochs.begin_row(name, t_s);
        Ok((epochs, t_s))
    }

    /// The recordings; `None` without any row.
    pub(crate) fn recordings(self) -> Option<Vec<Recording>> {
        let recording =
            |(tag, epochs): (_, Gathering)| Recording { tag, anchors: self.anchors.to_vec(), epochs: epochs.finish() };
        let recordings: Vec<_> = self.tags.in_order().into_iter().map(recording).collect();
        Some(recordings).filter(|recordings| !recordings.is_empty())
    }
}

/// The indices of anchors by their names.
pub(crate) struct AnchorIndex<'a> {
    exact: HashMap<&'a str, usize>,
    /// By the spelling that is the same for all spellings of an address.
    alike: HashMap<Cow<'a, str>, usize>,
}

impl<'a> AnchorIndex<'a> {
    pub(crate) fn of(anchors: &'a [Anchor]) -> Self {
        let names = || anchors.iter().enumerate().map(|(at, anchor)| (anchor.name.as_str(), at));
        Self { exact: names().collect(), alike: names().map(|(name, at)| (spelled(name), at)).collect() }
    }

    fn find(&self, name: &str) -> Option<usize> {
        self.exact.get(name).or_else(|| self.alike.get(&spelled(name))).copied()
    }
}

/// The index of the anchor that a row names.
pub(crate) fn anchor_of(row: &Row, column: Column, places: &AnchorIndex) -> Result<usize, UserError> {
    let name = row.some_text(column)?;
    places.find(name).ok_or_else(|| row.wrong(column, &format!("{} is not in the file of anchors", quoted(name))))
}

/// The columns of a file of ranges that belong to a range.
pub(crate) struct RangeColumns<'a> {
    anchor: Column,
    range: Column,
    sight: Column,
    diagnostics: DiagnosticColumns,
    places: AnchorIndex<'a>,
}

impl<'a> RangeColumns<'a> {
    pub(crate) fn of(table: &Table, anchors: &'a [Anchor]) -> Result<Self, UserError> {
        Ok(Self {
            anchor: table.column("anchor")?,
            range: table.column("range_m")?,
            sight: table.optional("los"),
            diagnostics: DiagnosticColumns::of_ranges(table),
            places: AnchorIndex::of(anchors),
        })
    }

    /// The range of a row at this time, seconds; `None` where the row has none.
    pub(crate) fn read(&self, row: &Row, t_s: Option<f64>) -> Result<Option<Measured>, UserError> {
        let anchor = anchor_of(row, self.anchor, &self.places)?;
        let line_of_sight = row.truth_value(self.sight)?;
        let Some(range_m) = row.number(self.range)? else { return Ok(None) };
        Ok(Some(Measured { anchor, range_m, t_s, line_of_sight, diagnostics: self.diagnostics.read(row)? }))
    }
}

/// The recordings of a file of ranges, one a tag.
fn read_ranges(file: &Path, anchors: &[Anchor]) -> Result<Vec<Recording>, UserError> {
    let mut table = Table::open(file)?;
    let mut epochs = EpochsByTag::of(&table, anchors)?;
    let columns = RangeColumns::of(&table, anchors)?;
    while let Some(row) = table.next_row()? {
        let (epochs, t_s) = epochs.of_row(&row)?;
        if let Some(range) = columns.read(&row, t_s)? {
            epochs.push_range(&range);
        }
    }
    epochs.recordings().ok_or_else(|| UserError::line(file, 1, "no ranges below the header"))
}

/// The indices of epochs, sorted by their times, since a file may have them in any order. An epoch without a time stays
/// behind the epoch before it.
pub fn by_time(times_s: impl IntoIterator<Item = Option<f64>>) -> Vec<usize> {
    let mut last_s = f64::NEG_INFINITY;
    let known = times_s.into_iter().map(|t_s| {
        last_s = t_s.unwrap_or(last_s);
        last_s
    });
    let mut places: Vec<(usize, f64)> = known.enumerate().collect();
    places.sort_by(|(_, a), (_, b)| a.total_cmp(b));
    places.into_iter().map(|(place, _)| place).collect()
}

/// Reads `anchors.csv`. An anchor may lack its height.
///
/// # Errors
/// The first line that is wrong.
pub fn read_anchors(file: &Path) -> Result<Vec<Anchor>, UserError> {
    anchor_rows(file, false)
}

/// Reads `anchors.csv`; with `heights`, each anchor must have its height.
///
/// # Errors
/// The first line that is wrong.
pub fn anchor_rows(file: &Path, heights: bool) -> Result<Vec<Anchor>, UserError> {
    let mut table = Table::open(file)?;
    let (anchor, x, y) = (table.column("anchor")?, table.column("x_m")?, table.column("y_m")?);
    let z = match table.column("z_m") {
        Err(UserError::Line { file, line, what }) if heights => {
            let what = what + "; only --dims 2 without a height needs no z_m";
            return Err(UserError::Line { file, line, what });
        }
        Ok(_) | Err(_) => table.optional("z_m"),
    };
    let mut anchors: Vec<Anchor> = Vec::new();
    let mut lines: HashMap<String, u64> = HashMap::new();
    while let Some(row) = table.next_row()? {
        let name = row.some_text(anchor)?;
        if let Some(line) = lines.insert(name.to_owned(), row.line()) {
            return Err(row.wrong(anchor, &format!("{} stands in line {line} already", quoted(name))));
        }
        let z_m = if heights { Some(row.some_number(z)?) } else { row.number(z)? };
        let place = Coordinates { x_m: row.some_number(x)?, y_m: row.some_number(y)?, z_m };
        anchors.push(Anchor { name: name.to_owned(), place });
    }
    if anchors.is_empty() { Err(UserError::line(file, 1, "no anchors below the header")) } else { Ok(anchors) }
}

#[cfg(test)]
mod tests {
    use super::by_time;

    #[test]
    fn epochs_are_sorted_by_time_and_those_without_one_stay_where_they_are() {
        assert_eq!(by_time([Some(2.0), None, Some(1.0), Some(1.0), Some(-3.0)]), [4, 2, 3, 0, 1]);
        assert_eq!(by_time([None, None, Some(5.0)]), [0, 1, 2]);
    }
}
