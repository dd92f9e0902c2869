//! Differences of arrivals: `differences.csv`, of a tag that only listens.
//!
//! A row is an anchor whose poll arrived, and how much farther it is than the reference anchor of its epoch. The row
//! whose anchor is the reference has that anchor's own reception.

use std::path::Path;

use crate::files::recording::{AnchorIndex, Epochs, anchor_of};
use crate::files::{DiagnosticColumns, Diagnostics};
use crate::{Anchor, Recording, Table, UserError};

/// The difference of the distances to two anchors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasuredDifference {
    /// Index of the reference anchor in [`Recording::anchors`].
    pub reference: usize,
    /// Index of the anchor; for the reference's own reception, that of the reference.
    pub anchor: usize,
    /// The distance to the anchor minus that to the reference, metres.
    pub difference_m: f64,
    /// The receiver's diagnostics of the anchor's frame.
    pub diagnostics: Diagnostics,
}

/// The recordings of a file of differences, one a tag.
///
/// # Errors
/// The first line that is wrong.
pub(crate) fn read_differences(file: &Path, anchors: &[Anchor]) -> Result<Vec<Recording>, UserError> {
    let places = AnchorIndex::of(anchors);
    let mut table = Table::open(file)?;
    let [reference, anchor] = [table.column("reference")?, table.column("anchor")?];
    let difference = table.column("difference_m")?;
    let columns = DiagnosticColumns::of_ranges(&table);
    let mut epochs = Epochs::of(&table, anchors)?;
    while let Some(row) = table.next_row()? {
        let (epoch, _) = epochs.of_row(&row)?;
        let [reference, anchor] = [anchor_of(&row, reference, &places)?, anchor_of(&row, anchor, &places)?];
        if let Some(difference_m) = row.number(difference)? {
            let diagnostics = columns.read(&row)?;
            epoch.differences.push(MeasuredDifference { reference, anchor, difference_m, diagnostics });
        }
    }
    epochs.recordings().ok_or_else(|| UserError::line(file, 1, "no differences below the header"))
}
