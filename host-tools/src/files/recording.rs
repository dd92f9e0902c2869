//! A recording: surveyed anchors, ranges by epoch, and the tag's true positions.
//!
//! The input is `anchors.csv`, `ranges.csv` and, where there is one, `truth.csv`. The output is a list of [`Epoch`]s in
//! the order of their first range. Epochs of which only the true position is known are placed between them.

use std::collections::HashMap;
use std::path::Path;

use crate::files::table::quoted;
use crate::files::{DiagnosticColumns, Diagnostics};
use crate::{Table, UserError};

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
    /// Its time, seconds.
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
        let by_name = recording.read_ranges(files.ranges)?;
        if let Some(truth) = files.truth {
            recording.read_truth(truth, files.truth_heights, &by_name)?;
        }
        Ok(recording)
    }

    /// Adds the epochs with their ranges. Returns the epochs' indices by name.
    fn read_ranges(&mut self, file: &Path) -> Result<HashMap<String, usize>, UserError> {
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
            let name = row.some_text(anchor)?;
            let Some(&anchor) = places.get(name) else {
                return Err(row.wrong(anchor, &format!("{} is not in the file of anchors", quoted(name))));
            };
            let line_of_sight = row.truth_value(sight)?;
            if let Some(range_m) = row.number(range)? {
                let measured = Measured { anchor, range_m, line_of_sight, diagnostics: columns.read(&row)? };
                self.epochs[at].ranges.push(measured);
            }
        }
        if self.epochs.is_empty() { Err(UserError::line(file, 1, "no ranges below the header")) } else { Ok(by_name) }
    }

    /// Epochs without a range are inserted after the epoch before them in the truth file.
    fn read_truth(&mut self, file: &Path, heights: bool, by_name: &HashMap<String, usize>) -> Result<(), UserError> {
        let mut unheard: Vec<Vec<Epoch>> = vec![Vec::new(); self.epochs.len() + 1];
        let mut next = 0;
        for row in truth_rows(file, heights)? {
            match by_name.get(&row.epoch) {
                Some(&at) => {
                    self.epochs[at].truth = Some(row.place);
                    next = at + 1;
                }
                None => unheard[next].push(Epoch {
                    name: row.epoch,
                    t_s: row.t_s,
                    ranges: Vec::new(),
                    truth: Some(row.place),
                }),
            }
        }
        let heard = std::mem::take(&mut self.epochs).into_iter().map(Some).chain([None]);
        self.epochs =
            unheard.into_iter().zip(heard).flat_map(|(before, epoch)| before.into_iter().chain(epoch)).collect();
        Ok(())
    }
}

/// The tag's true position at one time.
struct TruthRow {
    epoch: String,
    t_s: Option<f64>,
    place: Coordinates,
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

/// Reads `truth.csv` as epochs and positions, in the order of the file.
///
/// # Errors
/// The first line that is wrong.
pub fn read_truth(file: &Path) -> Result<Vec<(String, Coordinates)>, UserError> {
    Ok(truth_rows(file, false)?.into_iter().map(|row| (row.epoch, row.place)).collect())
}

fn truth_rows(file: &Path, heights: bool) -> Result<Vec<TruthRow>, UserError> {
    let mut table = Table::open(file)?;
    let (epoch, x, y) = (table.column("epoch")?, table.column("x_m")?, table.column("y_m")?);
    let z = if heights { table.column("z_m")? } else { table.optional("z_m") };
    let time = table.optional("t_s");
    let mut rows = Vec::new();
    let mut lines: HashMap<String, u64> = HashMap::new();
    while let Some(row) = table.next_row()? {
        let name = row.some_text(epoch)?;
        if let Some(line) = lines.insert(name.to_owned(), row.line()) {
            return Err(row.wrong(epoch, &format!("{} stands in line {line} already", quoted(name))));
        }
        let place = Coordinates { x_m: row.some_number(x)?, y_m: row.some_number(y)?, z_m: row.number(z)? };
        rows.push(TruthRow { epoch: name.to_owned(), t_s: row.number(time)?, place });
    }
    if rows.is_empty() { Err(UserError::line(file, 1, "no positions below the header")) } else { Ok(rows) }
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
