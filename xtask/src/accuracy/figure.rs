//! The figure beside the table: RMSE over the number of direct anchors, ours as lines, the thesis' as circles.

use std::path::Path;

use anyhow::Result;
use plotters::prelude::*;

use super::thesis::{DIRECT, Score, methods, printed, rmse};

const SIZE: (u32, u32) = (900, 560);

/// Draws the figure as SVG.
pub fn draw(scores: &[Score], file: &Path) -> Result<()> {
    let area = SVGBackend::new(file, SIZE).into_drawing_area();
    area.fill(&WHITE)?;
    let top = scores.iter().filter_map(|score| score.rmse_m).fold(0.0, f64::max);
    let mut chart = ChartBuilder::on(&area)
        .margin(16)
        .x_label_area_size(40)
        .y_label_area_size(56)
        .build_cartesian_2d(f64::from(*DIRECT.start())..f64::from(*DIRECT.end()) + 2.5, 0.0..top)?;
    chart
        .configure_mesh()
        .disable_x_mesh()
        .x_desc("direct anchors of 12 (lines: this project; circles: the thesis)")
        .y_desc("RMSE, m")
        .x_label_formatter(&|x| if *x <= f64::from(*DIRECT.end()) { format!("{x:.0}") } else { String::new() })
        .draw()?;
    for (place, method) in methods(scores).into_iter().enumerate() {
        let colour = Palette99::pick(place).to_rgba();
        let ours: Vec<_> =
            DIRECT.filter_map(|direct| Some((f64::from(direct), rmse(scores, method, Some(direct))?))).collect();
        chart
            .draw_series(LineSeries::new(ours, colour.stroke_width(2)))?
            .label(method)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
        if let Some(theirs) = printed(method) {
            let points = DIRECT.zip(theirs).map(|(direct, rmse)| (f64::from(direct), rmse));
            chart.draw_series(points.map(|point| Circle::new(point, 4, colour.stroke_width(1))))?;
        }
    }
    chart.configure_series_labels().position(SeriesLabelPosition::UpperRight).border_style(BLACK.mix(0.3)).draw()?;
    area.present()?;
    Ok(())
}
