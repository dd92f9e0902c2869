//! Our figures beside the paper's, as a Markdown table.

use std::fmt::Write as _;

use baliza_report::MarkdownTable;

use super::Experiment;

/// One row a way.
pub fn to_markdown(outcome: &Experiment) -> String {
    let mut table =
        MarkdownTable::new(["way", "RMSE x, m:", "as printed:", "RMSE y, m:", "as printed:", "less than without:"]);
    for score in &outcome.scores {
        let printed = |figure: Option<f64>| figure.map_or_else(String::new, |metres| format!("{metres:.2}"));
        table.row(format_args!(
            "{} | {:.2} | {} | {:.2} | {} | {:.0} %",
            score.way.as_str(),
            score.rmse_x_m,
            printed(score.printed_x_m),
            score.rmse_y_m,
            printed(score.printed_y_m),
            100.0 * score.reduction
        ));
    }
    let mut text = table.into_text();
    let _ = writeln!(
        text,
        "\nλ = {:.2} (as printed 1.99), {:.0} % of the receptions told rightly.",
        outcome.threshold,
        100.0 * outcome.detected
    );
    text
}
