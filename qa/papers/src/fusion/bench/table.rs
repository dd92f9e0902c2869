//! The figures in Markdown.

use baliza_report::MarkdownTable;

use super::{FusionAlgorithm, Inputs, Scored, Swept};

impl FusionAlgorithm {
    /// The name in the table.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Fusion => "fusion, 64 hypotheses",
            Self::FusionOnNode => "fusion, 24 hypotheses",
            Self::Engine => "engine",
        }
    }
}

impl Inputs {
    /// The name in the table.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Uwb => "UWB",
            Self::Ble => "BLE",
            Self::Both => "both",
        }
    }
}

fn metres(figure: Option<f64>) -> String {
    figure.map_or_else(|| "–".to_owned(), |metres| format!("{metres:.3}"))
}

/// How the errors agree with the covariance, in two cells.
fn consistency(inside_1_sigma: Option<f64>, nees: Option<f64>) -> String {
    let inside = inside_1_sigma.map_or_else(|| "–".to_owned(), |inside| format!("{:.0} %", 100.0 * inside));
    let nees = nees.map_or_else(|| "–".to_owned(), |nees| format!("{nees:.1}"));
    format!("{inside} | {nees}")
}

/// One row an algorithm and choice of nodes.
pub fn to_markdown(scores: &[Scored]) -> String {
    let mut table = MarkdownTable::new([
        "algorithm",
        "heard",
        "RMSE, m:",
        "MAE, m:",
        "P90, m:",
        "rounds with a position:",
        "inside 1σ:",
        "NEES:",
        "both against the better one:",
    ]);
    for (score, _) in scores {
        let of = |heard| {
            let one = scores.iter().find(|(other, _)| other.algorithm == score.algorithm && other.heard == heard);
            one.and_then(|(other, _)| other.rmse_m).unwrap_or(f64::INFINITY)
        };
        let against = match (score.heard, score.rmse_m) {
            (Inputs::Both, Some(both)) => {
                format!("{:+.0} %", 100.0 * (both / of(Inputs::Uwb).min(of(Inputs::Ble)) - 1.0))
            }
            (Inputs::Both, None) | (Inputs::Uwb | Inputs::Ble, _) => String::new(),
        };
        table.row(format_args!(
            "{} | {} | {} | {} | {} | {:.0} % | {} | {against}",
            score.algorithm.as_str(),
            score.heard.as_str(),
            metres(score.rmse_m),
            metres(score.mae_m),
            metres(score.p90_m),
            100.0 * score.answered,
            consistency(score.inside_1_sigma, score.nees),
        ));
    }
    table.into_text()
}

/// One row a set of conditions.
pub fn sweep_to_markdown(rows: &[Swept]) -> String {
    let mut table = MarkdownTable::new([
        "anchors:",
        "blocked, mean excess",
        "σ of a range, m:",
        "beacons:",
        "UWB, m:",
        "BLE, m:",
        "both, m:",
        "inside 1σ:",
        "NEES:",
        "both against the better one:",
    ]);
    for row in rows {
        let blocked = if row.blocked == 0 { "none".to_owned() } else { format!("{}, {} m", row.blocked, row.excess_m) };
        let [uwb, ble, both] = row.rmse_m.map(metres);
        let against = row.ratio.map_or_else(String::new, |ratio| format!("{:+.0} %", 100.0 * (ratio - 1.0)));
        table.row(format_args!(
            "{} | {blocked} | {} | {} | {uwb} | {ble} | {both} | {} | {against}",
            row.anchors,
            row.range_sigma_m,
            row.beacons,
            consistency(row.inside_1_sigma, row.nees)
        ));
    }
    table.into_text()
}

#[cfg(test)]
mod tests {
    use super::super::FusionScore;
    use super::*;

    #[test]
    fn both_are_compared_with_the_better_one() {
        let score = |heard, rmse_m| {
            let (mae_m, p90_m, nees, inside_1_sigma) = (rmse_m, rmse_m, Some(2.04), Some(0.394));
            let algorithm = FusionAlgorithm::Fusion;
            let score = FusionScore { algorithm, heard, rmse_m, mae_m, p90_m, answered: 1.0, nees, inside_1_sigma };
            (score, Vec::new())
        };
        let text = to_markdown(&[
            score(Inputs::Uwb, Some(0.4)),
            score(Inputs::Ble, Some(1.6)),
            score(Inputs::Both, Some(0.3)),
        ]);
        assert!(
            text.ends_with("| fusion, 64 hypotheses | both | 0.300 | 0.300 | 0.300 | 100 % | 39 % | 2.0 | -25 % |\n"),
            "{text}"
        );
    }

    #[test]
    fn conditions_without_positions_are_told() {
        let row = Swept {
            anchors: 2,
            blocked: 1,
            range_sigma_m: 0.3,
            excess_m: 3.0,
            beacons: 8,
            rmse_m: [None, Some(1.25), Some(1.0)],
            ratio: Some(0.8),
            nees: Some(5.25),
            inside_1_sigma: None,
        };
        let text = sweep_to_markdown(&[row]);
        assert!(text.ends_with("| 2 | 1, 3 m | 0.3 | 8 | – | 1.250 | 1.000 | – | 5.2 | -20 % |\n"), "{text}");
    }
}
