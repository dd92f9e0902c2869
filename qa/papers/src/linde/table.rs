//! Our figures beside those of the annex, in Markdown.

use std::fmt::Write as _;

use baliza_report::MarkdownTable;

use super::{PRINTED_MOST_M, Parameter, ROWS, RoomAlgorithm, Scored, blocked, unmeasured};

impl RoomAlgorithm {
    /// The name in the table.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Fingerprinting => "fingerprinting",
            Self::Multilateration => "multilateration",
            Self::Nonlinear => "nonlinear in the room",
        }
    }
}

impl Parameter {
    /// The name and the noise in the table.
    pub fn words(self) -> [String; 2] {
        match self {
            Self::Rssi(db) => ["RSSI".to_owned(), format!("{db} dB")],
            Self::Tof(us) => ["ToF".to_owned(), format!("{us} µs")],
        }
    }
}

/// A row's name in a picture.
pub fn name(parameter: Parameter, algorithm: RoomAlgorithm) -> String {
    let [measured, noise] = parameter.words();
    format!("{measured} {noise}, {}", algorithm.as_str())
}

/// One row a parameter, noise and algorithm.
pub fn to_markdown(rows: &[Scored]) -> String {
    let mut table = MarkdownTable::new([
        "parameter",
        "noise",
        "algorithm",
        "RMSE, m:",
        "as printed:",
        "MAE, m:",
        "as printed:",
        "with a position:",
    ]);
    for ((score, _), (parameter, ..)) in rows.iter().zip(ROWS) {
        let [measured, noise] = parameter.words();
        table.row(format_args!(
            "{measured} | {noise} | {} | {} | {} | {} | {} | {:.0} %",
            score.algorithm.as_str(),
            metres(score.rmse_m),
            printed(score.printed_rmse_m),
            metres(score.mae_m),
            printed(score.printed_mae_m),
            100.0 * score.answered,
        ));
    }
    let [rmse, mae] = unmeasured();
    let mut text = table.into_text();
    let _ = writeln!(
        text,
        "\n{:.1} % of the links are blocked. Who measures nothing and always answers the receivers' middle errs by {rmse:.2} m (RMSE) and \
         {mae:.2} m (MAE).",
        100.0 * blocked()
    );
    text
}

fn metres(figure: Option<f64>) -> String {
    figure.map_or_else(|| "–".to_owned(), |metres| format!("{metres:.2}"))
}

fn printed(figure: Option<f64>) -> String {
    figure.map_or_else(
        String::new,
        |metres| if metres < PRINTED_MOST_M { format!("{metres:.2}") } else { "> 5".to_owned() },
    )
}
