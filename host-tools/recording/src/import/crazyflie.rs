//! A log of a Crazyflie with the Loco Positioning System in two-way ranging, as the Crazyflie client writes it: CSV
//! with `Timestamp` (milliseconds) and the logged variables.
//!
//! `ranging.distance0` to `ranging.distance7` are the ranges to the anchors 0 to 7, metres; zero means none.
//! `stateEstimate.x`, `.y`, `.z` (or `kalman.stateX`, …) are the Crazyflie's own position, metres. A log does not have
//! the anchors' positions.

use std::path::Path;

use super::{Imported, Round};
use crate::{Anchor, Column, Table, UserError};

/// The variables of the ranges, by the anchor's number.
const RANGES: [&str; 8] = [
    "ranging.distance0",
    "ranging.distance1",
    "ranging.distance2",
    "ranging.distance3",
    "ranging.distance4",
    "ranging.distance5",
    "ranging.distance6",
    "ranging.distance7",
];
/// The variables of the position.
const POSITIONS: [[&str; 3]; 2] =
    [["stateEstimate.x", "stateEstimate.y", "stateEstimate.z"], ["kalman.stateX", "kalman.stateY", "kalman.stateZ"]];

/// Reads a log. `anchors` have the anchors' numbers as names.
///
/// # Errors
/// The file is no such log, no line has a range, or an anchor that is ranged has no position.
pub fn read(file: &Path, anchors: &[Anchor]) -> Result<Imported, UserError> {
    let mut table = Table::open(file)?;
    let time = table.column("Timestamp")?;
    let ranges = RANGES.map(|name| table.optional(name));
    if !ranges.iter().any(Column::is_present) {
        return Err(UserError::line(file, 1, "no column ranging.distance0 to ranging.distance7"));
    }
    let of_position = POSITIONS.map(|names| names.map(|name| table.optional(name)));
    let of_position = of_position.into_iter().find(|columns| columns.iter().all(Column::is_present));
    let mut imported = Imported::default();
    while let Some(row) = table.next_row()? {
        let round = || -> Result<Round, UserError> {
            let mut round = Round { t_s: row.some_number(time)? / 1000.0, ..Round::default() };
            for (anchor, column) in ranges.iter().enumerate() {
                let range_m = row.number(*column)?.filter(|range_m| *range_m > 0.0);
                round.ranges_m.extend(range_m.map(|range_m| (anchor.to_string(), range_m)));
            }
            if let Some([x, y, z]) = of_position {
                round.position_m = match (row.number(x)?, row.number(y)?, row.number(z)?) {
                    (Some(x_m), Some(y_m), Some(z_m)) => Some([x_m, y_m, z_m]),
                    (_, _, _) => None,
                };
            }
            Ok(round)
        };
        match round() {
            Ok(round) => imported.rounds.push(round),
            Err(UserError::Line { line, what, .. }) => imported.left_out.count(line, what),
            Err(other @ (UserError::File { .. } | UserError::Flag { .. })) => return Err(other),
        }
    }
    let imported = imported.with_ranges(file)?;
    let mut places = std::collections::BTreeMap::new();
    for (name, _) in imported.rounds.iter().flat_map(|round| &round.ranges_m) {
        let known = anchors.iter().find(|anchor| anchor.name == *name);
        let place = known.and_then(|anchor| Some([anchor.place.x_m, anchor.place.y_m, anchor.place.z_m?]));
        let place = place.ok_or_else(|| {
            UserError::flag("--anchors", format!("no position with z_m for anchor {name}, which the log has ranges to"))
        })?;
        places.insert(name.clone(), place);
    }
    Ok(Imported { anchors: places, ..imported })
}
