//! The residuals of ranges by anchor, for reading and as JSON.

use std::fmt::Write as _;

use analysis::locate::residuals::AnchorResiduals;
use node_link::provision::SiteNames;

/// An anchor's figures for `--json`.
#[derive(Debug, serde::Serialize)]
pub struct Row<'a> {
    anchor: &'a str,
    ranges: usize,
    mean_m: Option<f64>,
    std_m: Option<f64>,
    median_m: Option<f64>,
    white_m: Option<f64>,
    blocked_share: Option<f64>,
    remark: Option<&'static str>,
}

impl<'a> Row<'a> {
    /// The figures of an anchor.
    pub fn of(anchor: &'a AnchorResiduals) -> Self {
        let AnchorResiduals { anchor, ranges, mean_m, std_m, median_m, white_m, blocked_share, remark } = anchor;
        Self {
            anchor,
            ranges: *ranges,
            mean_m: *mean_m,
            std_m: *std_m,
            median_m: *median_m,
            white_m: *white_m,
            blocked_share: *blocked_share,
            remark: remark.map(|remark| remark.as_str()),
        }
    }
}

/// The figures of all anchors as a table.
pub fn table(anchors: &[AnchorResiduals], names: &SiteNames) -> String {
    let mut text = format!(
        "{:<16} {:>7} {:>8} {:>8} {:>8} {:>8} {:>8}\n",
        "anchor", "ranges", "mean_m", "std_m", "median_m", "white_m", "blocked"
    );
    for anchor in anchors {
        let Row { anchor, ranges, mean_m, std_m, median_m, white_m, blocked_share, remark } = Row::of(anchor);
        let _ = write!(text, "{:<16} {ranges:>7}", names.node(anchor));
        for figure in [mean_m, std_m, median_m, white_m] {
            let _ = write!(text, " {:>8}", figure.map_or_else(|| "-".to_owned(), |metres| format!("{metres:.3}")));
        }
        let share = blocked_share.map_or_else(|| "-".to_owned(), |share| format!("{:.1} %", 100.0 * share));
        let _ = writeln!(text, " {share:>8}{}", remark.map_or_else(String::new, |remark| format!("  {remark}")));
    }
    text
}
