//! The cumulative distribution of errors: the share of positions with a smaller error.

use anyhow::Result;

use super::axes::{Axes, LEFT};
use super::style::pen;
use super::{Area, Track};

/// The axis ends at this quantile of the worst method's errors, so that a few outliers do not flatten the rest.
const SHOWN: f64 = 0.97;
/// Number of points of a curve; more would not be visible.
const POINTS: usize = 400;

/// Draws the curves over the whole area.
///
/// # Errors
/// The drawing library fails.
pub fn draw(area: &Area, tracks: &[Track]) -> Result<()> {
    let sorted: Vec<Vec<f64>> = tracks
        .iter()
        .map(|track| {
            let mut errors = track.errors_m.clone();
            errors.sort_by(f64::total_cmp);
            errors
        })
        .collect();
    let ends = sorted.iter().filter_map(|errors| errors.get((SHOWN * errors.len() as f64) as usize));
    let end = 1.05 * ends.copied().fold(0.01, f64::max);
    let axes = Axes {
        title: "Distance from the truth",
        names: ["error, metres", "positions that err less"],
        left: LEFT,
        ticks: [7, 6],
        unit: " %",
    };
    let mut chart = axes.draw(area, 0.0..end, 0.0..100.0)?;
    for (track, errors) in tracks.iter().zip(&sorted).filter(|(_, errors)| !errors.is_empty()) {
        chart.draw_series([pen(&track.method).line::<(f64, f64)>(curve(errors, end))])?;
    }
    Ok(())
}

/// The share of the sorted errors that is below a value, for values from zero to the end of the axis.
fn curve(sorted: &[f64], end: f64) -> Vec<(f64, f64)> {
    let share = |error: f64| 100.0 * sorted.partition_point(|e| *e <= error) as f64 / sorted.len() as f64;
    (0..=POINTS).map(|i| end * i as f64 / POINTS as f64).map(|error| (error, share(error))).collect()
}

#[cfg(test)]
mod tests {
    use super::{POINTS, curve};

    #[test]
    fn half_of_two_errors_is_below_their_middle() {
        let curve = curve(&[0.1, 0.3], 0.4);
        let at = |i: usize| curve[i].1;
        assert_eq!((at(0), at(POINTS / 2), at(POINTS)), (0.0, 50.0, 100.0));
    }
}
