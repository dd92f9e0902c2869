//! The distribution of errors alone, with a legend.

use super::style::{pen, pixels};
use super::{Drawing, Series, cdf, legend};

/// Draws the errors of the series; their positions are not shown.
pub fn distribution(series: &[Series]) -> Drawing {
    Drawing::new([920, 460], |area| {
        let [left, right] = area.split_at_x(pixels(640));
        let curves: Vec<_> = series.iter().map(|series| (pen(&series.method), series.errors_m.as_slice())).collect();
        cdf::draw(left, &curves, "error");
        legend::methods_beside(right, series.iter().map(|series| series.method.as_str()));
    })
}
