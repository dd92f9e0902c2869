//! A recording: surveyed anchors, ranges by epoch, and the tag's true positions.
//!
//! The input is `anchors.csv`, `ranges.csv` and, where there is one, `truth.csv`. The output is a list of [`Epoch`]s in
//! the order of their first range. Epochs of which only the true position is known are placed between them: see
//! [`Truth`].

use std::collections::HashMap;
use std::path::Path;

use crate::files::table::quoted;
use crate::files::{DiagnosticColumns, Diagnostics};
use crate::{Table, Truth, UserError};

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

/// A measured range.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// Index of the anchor in [`Recording::anchors`].
    pub anchor: usize,
    /// The range, metres.
    pub range_m: f64,
    /// The time of the range itself, seconds, where its row has one: asynchronous ranges of one epoch have several.
    pub t_s: Option<f64>,
    /// Ground truth of the line of sight, where known.
    pub line_of_sight: Option<bool>,
    /// The receiver's diagnostics of this range.
    pub diagnostics: Diagnostics,
}

/// The ranges that make one fix.
#[derive(Clone, Debug, PartialEq)]
pub struct Epoch {
    /// The epoch's name in the files.
    pub name: String,
    /// Its time, seconds: the latest of its rows.
    pub t_s: Option<f64>,
    /// The ranges, in the order of the file.
    pub ranges: Vec<Measured>,
    /// The tag's true position.
    pub truth: Option<Coordinates>,
}

/// Anchors and epochs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    /// The anchors, in the order of the file.
    pub anchors: Vec<Anchor>,
    /// The epochs, in the order of their first range.
    pub epochs: Vec<Epoch>,
}

/// Which files to read, and which heights they must have.
#[derive(Clone, Copy, Debug)]
pub struct Files<'a> {
    /// `anchors.csv`.
    pub anchors: &'a Path,
    /// `ranges.csv`.
    pub ranges: &'a Path,
    /// `truth.csv`.
    pub truth: Option<&'a Path>,
    /// Whether an anchor without a height is an error.
    pub anchor_heights: bool,
    /// Whether a truth file without a column of heights is an error.
    pub truth_heights: bool,
}

impl Recording {
    /// Reads a recording.
    ///
    /// # Errors
    /// The first line of a file that is wrong.
    pub fn read(files: &Files) -> Result<Self, UserError> {
        let anchors = anchor_rows(files.anchors, files.anchor_heights)?;
        let mut recording = Self { anchors, epochs: Vec::new() };
        recording.read_ranges(files.ranges)?;
        if let Some(truth) = files.truth {
            Truth::read(truth, files.truth_heights)?.join(&mut recording.epochs, 0.0);
        }
        Ok(recording)
    }

    /// Adds the epochs with their ranges.
    fn read_ranges(&mut self, file: &Path) -> Result<(), UserError> {
        let mut by_name = HashMap::new();
        let places: HashMap<&str, usize> = self.anchors.iter().enumerate().map(|(i, a)| (a.name.as_str(), i)).collect();
        let mut table = Table::open(file)?;
        let (epoch, anchor, range) = (table.column("epoch")?, table.column("anchor")?, table.column("range_m")?);
        let (time, sight) = (table.optional("t_s"), table.optional("los"));
        let columns = DiagnosticColumns::of_ranges(&table);
        while let Some(row) = table.next_row()? {
            let (name, t_s) = (row.some_text(epoch)?, row.number(time)?);
            let at = *by_name.entry(name.to_owned()).or_insert_with(|| {
                self.epochs.push(Epoch { name: name.to_owned(), t_s, ranges: Vec::new(), truth: None });
                self.epochs.len() - 1
            });
            self.epochs[at].t_s = [self.epochs[at].t_s, t_s].into_iter().flatten().reduce(f64::max);
            let name = row.some_text(anchor)?;
            let Some(&anchor) = places.get(name) else {
                return Err(row.wrong(anchor, &format!("{} is not in the file of anchors", quoted(name))));
            };
            let line_of_sight = row.truth_value(sight)?;
            if let Some(range_m) = row.number(range)? {
                let measured = Measured { anchor, range_m, t_s, line_of_sight, diagnostics: columns.read(&row)? };
                self.epochs[at].ranges.push(measured);
            }
        }
        if self.epochs.is_empty() { Err(UserError::line(file, 1, "no ranges below the header")) } else { Ok(()) }
    }
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

fn anchor_rows(file: &Path, heights: bool) -> Result<Vec<Anchor>, UserError> {
    let mut table = Table::open(file)?;
    let (anchor, x, y) = (table.column("anchor")?, table.column("x_m")?, table.column("y_m")?);
    let z = if heights { table.column("z_m")? } else { table.optional("z_m") };
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
