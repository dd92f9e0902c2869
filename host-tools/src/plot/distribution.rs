//! The distribution of errors alone, with a legend.

use anyhow::Result;

use super::style::{pen, pixels};
use super::{Series, cdf, drawing, legend};

/// Draws the errors of the series; their positions are not shown.
///
/// # Errors
/// The drawing library fails.
pub fn distribution(series: &[Series]) -> Result<String> {
    drawing((920, 460), |area| {
        let (left, right) = area.split_horizontally(pixels(640));
        let curves: Vec<_> = series.iter().map(|series| (pen(&series.method), series.errors_m.as_slice())).collect();
        cdf::draw(&left, &curves, "error")?;
        legend::methods_beside(&right, series.iter().map(|series| series.method.as_str()))?;
        Ok(())
    })
}
