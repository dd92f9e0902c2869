//! Our figures beside those of the paper's tables, in Markdown.

use baliza_report::MarkdownTable;

use super::{Configuration, HallAlgorithm, Row};

impl HallAlgorithm {
    /// The name in the table.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Iekf => "IEKF",
            Self::Nls => "NLS",
            Self::Engine => "engine",
        }
    }
}

impl Configuration {
    /// The name in the table.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::NoIgnore => "no ignore",
            Self::Ignore => "ignore NLOS",
            Self::IgnoreMin4 => "ignore NLOS, min. 4",
            Self::IgnoreMitigate => "ignore NLOS, mitigate",
            Self::IgnoreMin4Mitigate => "ignore NLOS, min. 4, mitigate",
            Self::Mitigate => "no ignore, mitigate",
            Self::Weigh => "weigh",
        }
    }
}

/// One row an algorithm and configuration.
pub fn to_markdown(rows: &[Row]) -> String {
    let mut table = MarkdownTable::new([
        "algorithm",
        "blocked ranges",
        "MAE, m:",
        "P90, m:",
        "as printed, measured:",
        "as printed, simulated:",
    ]);
    for (score, _) in rows {
        let printed = |figure: Option<f64>| figure.map_or_else(String::new, |metres| format!("{metres:.3}"));
        table.row(format_args!(
            "{} | {} | {:.3} | {:.3} | {} | {}",
            score.algorithm.as_str(),
            score.configuration.as_str(),
            score.mae_m,
            score.p90_m,
            printed(score.printed_measured_m),
            printed(score.printed_simulated_m)
        ));
    }
    table.into_text()
}
