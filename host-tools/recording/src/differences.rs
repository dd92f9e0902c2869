//! Differences of arrivals: `differences.csv`, of a tag that only listens.
//!
//! A row is an anchor whose poll arrived, and how much farther it is than the reference anchor of its epoch. The row
//! whose anchor is the reference has that anchor's own reception.

use std::path::Path;

use crate::DiagnosticColumns;
use crate::epochs::MeasuredDifference;
use crate::recording::{AnchorIndex, EpochsByTag, anchor_of};
use crate::{Anchor, Recording, Table, UserError};

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
    let mut epochs = EpochsByTag::of(&table, anchors)?;
    while let Some(row) = table.next_row()? {
        let (epochs, _) = epochs.of_row(&row)?;
        let [reference, anchor] = [anchor_of(&row, reference, &places)?, anchor_of(&row, anchor, &places)?];
        if let Some(difference_m) = row.number(difference)? {
            let diagnostics = columns.read(&row)?;
            epochs.push_difference(&MeasuredDifference { reference, anchor, difference_m, diagnostics });
        }
    }
    epochs.recordings().ok_or_else(|| UserError::line(file, 1, "no differences below the header"))
}
