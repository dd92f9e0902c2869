//! True positions by time: interpolated, with the offset between the clocks of ranges and truth.
//!
//! This is the one place where the protocol joins ranges and truth.

use std::path::Path;

use anyhow::Result;
use host_tools::{Coordinates, Epoch, Solved, Table};

/// The longest gap over which positions are interpolated, seconds.
const BRIDGED_S: f64 = 1.0;
/// Offsets that are tried: up to this, in steps, seconds.
const OFFSETS_S: (f64, f64) = (1.5, 0.02);
/// An error beyond this counts as this, so that wild ranges do not choose the offset, metres.
const CLIPPED_M: f64 = 1.0;
/// Where the tag moves less than this in all, there is no offset to be seen, metres.
const MOVED_M: f64 = 2.0;
/// An offset must reduce the mean squared error to this share: lasting errors of a slow tag look like small offsets.
const WORTH: f64 = 0.98;

/// The true positions of a recording, by time.
pub struct Truth(Vec<(f64, Coordinates)>);

impl Truth {
    /// Reads `truth.csv`. `None` where a row has no time: then epochs are joined by their names.
    ///
    /// # Errors
    /// The first line that is wrong.
    pub fn read(file: &Path) -> Result<Option<Self>> {
        let mut table = Table::open(file)?;
        let (time, x, y) = (table.optional("t_s"), table.column("x_m")?, table.column("y_m")?);
        let z = table.optional("z_m");
        let mut rows = Vec::new();
        while let Some(row) = table.next_row()? {
            let Some(t_s) = row.number(time)? else { return Ok(None) };
            let place = Coordinates { x_m: row.some_number(x)?, y_m: row.some_number(y)?, z_m: row.number(z)? };
            rows.push((t_s, place));
        }
        rows.sort_by(|a, b| a.0.total_cmp(&b.0));
        Ok(Some(Self(rows)))
    }

    /// The position at a time, seconds; `None` outside the recording and in its gaps.
    fn at(&self, t_s: f64) -> Option<Coordinates> {
        let next = self.0.partition_point(|(row_s, _)| *row_s < t_s);
        let (after_s, after) = self.0.get(next)?;
        if *after_s == t_s {
            return Some(*after);
        }
        let (before_s, before) = self.0.get(next.checked_sub(1)?)?;
        let share = (t_s - before_s) / (after_s - before_s);
        let mix = |a: f64, b: f64| a + share * (b - a);
        (after_s - before_s <= BRIDGED_S).then(|| Coordinates {
            x_m: mix(before.x_m, after.x_m),
            y_m: mix(before.y_m, after.y_m),
            z_m: before.z_m.zip(after.z_m).map(|(a, b)| mix(a, b)),
        })
    }

    /// Gives epochs their true positions, with the truth's clock this much ahead, seconds. Epochs without a time keep
    /// theirs.
    pub fn join(&self, epochs: &mut [Epoch], offset_s: f64) {
        for epoch in epochs {
            if let Some(t_s) = epoch.t_s {
                epoch.truth = self.at(t_s + offset_s);
            }
        }
    }

    /// By how much the truth's clock is ahead, seconds: the offset with which solved positions err least, or 0.
    pub fn offset_s(&self, epochs: &[Epoch], solved: &[Solved]) -> f64 {
        let way: f64 = self.0.windows(2).map(|pair| horizontal_m(&pair[0].1, &pair[1].1)).sum();
        if way < MOVED_M {
            return 0.0;
        }
        let placed = epochs.iter().zip(solved);
        let placed: Vec<(f64, Coordinates)> =
            placed.filter_map(|(epoch, solved)| Some((epoch.t_s?, solved.outcome.ok()?.place))).collect();
        let cost = |offset_s: f64| {
            let truths = placed.iter().filter_map(|(t_s, place)| Some((place, self.at(t_s + offset_s)?)));
            let squares = truths.map(|(place, truth)| horizontal_m(place, &truth).min(CLIPPED_M).powi(2));
            baliza_report::mean(squares)
        };
        let (most_s, step_s) = OFFSETS_S;
        let count = (most_s / step_s) as i32;
        let offsets = (-count..=count).map(|step| f64::from(step) * step_s);
        let costs = offsets.map(|offset_s| (offset_s, cost(offset_s))).filter(|(_, cost)| cost.is_finite());
        let best = costs.min_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, least)| *least < WORTH * cost(0.0));
        best.map_or(0.0, |(offset_s, _)| offset_s)
    }
}

/// The horizontal distance, metres.
pub fn horizontal_m(a: &Coordinates, b: &Coordinates) -> f64 {
    (a.x_m - b.x_m).hypot(a.y_m - b.y_m)
}

#[cfg(test)]
mod tests {
    use host_tools::{Coordinates, Epoch, NoPosition, Position, Solved};
    use positioning_core::SolveError;

    use super::Truth;

    fn at(x_m: f64, y_m: f64) -> Coordinates {
        Coordinates { x_m, y_m, z_m: None }
    }

    /// A tag on a circle of 2 m, 3 s a turn.
    fn on_circle(t_s: f64) -> Coordinates {
        let angle = t_s * std::f64::consts::TAU / 3.0;
        at(2.0 * angle.cos(), 2.0 * angle.sin())
    }

    #[test]
    fn positions_are_interpolated_but_not_over_long_gaps_or_ends() {
        let truth = Truth(vec![(0.0, at(0.0, 0.0)), (1.0, at(2.0, 4.0)), (5.0, at(3.0, 3.0))]);
        assert_eq!(truth.at(0.25), Some(at(0.5, 1.0)));
        assert_eq!(truth.at(5.0), Some(at(3.0, 3.0)));
        assert_eq!([-0.1, 1.1, 5.1].map(|t_s| truth.at(t_s)), [None; 3]);
    }

    #[test]
    fn the_offset_of_a_moving_tag_is_found_beside_wild_positions() {
        let truth = Truth((0..200).map(|row| (f64::from(row) * 0.1, on_circle(f64::from(row) * 0.1))).collect());
        let epoch = |t_s| Epoch { name: String::new(), t_s: Some(t_s), ranges: Vec::new(), truth: None };
        let solved = |place| Solved {
            outcome: Ok(Position { place, sigma: at(0.1, 0.1), covariance_xy: 0.0, used: 4 }),
            error_m: None,
        };
        let times = (0..150).map(|row| 2.0 + f64::from(row) * 0.1);
        let (epochs, mut found): (Vec<_>, Vec<_>) =
            times.map(|t_s| (epoch(t_s), solved(on_circle(t_s + 0.44)))).unzip();
        found[7] = solved(at(50.0, 50.0));
        found[9] = Solved { outcome: Err(NoPosition::SolveError(SolveError::TooFewAnchors)), error_m: None };
        let offset_s = truth.offset_s(&epochs, &found);
        assert!((offset_s - 0.44).abs() < 0.03, "{offset_s}");
        let still = Truth(vec![(0.0, at(0.0, 0.0)), (20.0, at(0.0, 0.0))]);
        assert_eq!(still.offset_s(&epochs, &found), 0.0);
    }
}
