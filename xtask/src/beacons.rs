//! Accuracy of positions by the RSSI of Bluetooth beacons: runs `baliza bench linde`, and `baliza calibrate
//! path-loss` and `baliza ble solve` on the room of A. Linde Cerezo's thesis, and makes tables of the results.

use baliza_report::MarkdownTable;
use std::path::PathBuf;

use anyhow::{Context, Result};
use serde::Deserialize;

use crate::baliza::{baliza, drawn, json, recording, scratch};
use crate::promises::Made;

/// Positions of the room's beacons: tables 4.1 and 4.2, with beacons 6 and 8 exchanged, as their path losses of table
/// 4.3 show.
const ROOM: &str = "beacon,x_m,y_m\n1,0.45,3.22\n2,5.25,1.63\n6,3.70,6.55\n7,6.88,3.73\n8,2.30,0.12\n";

/// One method, as `baliza ble solve --json` prints it.
#[derive(Clone, Debug, Deserialize)]
struct Score {
    method: String,
    mae_m: f64,
    rmse_m: f64,
    p90_m: f64,
    nees: Option<f64>,
}

/// The simulation of the thesis' annex, and its figure.
///
/// # Errors
/// A run of `baliza` fails.
pub fn linde() -> Result<Made> {
    drawn("linde", "qa/papers/linde.svg")
}

/// The recorded room: its path losses, and the positions of its targets by them.
///
/// # Errors
/// A run of `baliza` fails.
pub fn by_path_loss() -> Result<Made> {
    let room = recording("linde_room")?;
    let (beacons, calibrated) = (scratch("room-beacons.csv")?, scratch("room-calibrated.csv")?);
    std::fs::write(&beacons, ROOM).with_context(|| format!("cannot write {}", beacons.display()))?;
    let words = |words: &str| words.split(' ').map(PathBuf::from).collect::<Vec<_>>();
    let file = |option: &str, file: PathBuf| [PathBuf::from(option), file];
    let losses = baliza(words("calibrate path-loss").into_iter().chain(file("--beacons", beacons)).chain(
        file("--fingerprints", room.join("fingerprints.csv")).into_iter().chain(file("--out", calibrated.clone())),
    ))?;
    let scores: Vec<Score> = json(
        words("ble solve --json")
            .into_iter()
            .chain(file("--beacons", calibrated))
            .chain(file("--rssi", room.join("targets.csv"))),
    )?;
    Ok(Made::one("beacons by path loss", format!("{losses}\n{}", table(&scores))))
}

fn table(scores: &[Score]) -> String {
    let mut table = MarkdownTable::new(["method", "MAE, m:", "RMSE, m:", "P90, m:", "NEES:"]);
    for Score { method, mae_m, rmse_m, p90_m, nees } in scores {
        let nees = nees.map_or_else(|| "–".to_owned(), |nees| format!("{nees:.2}"));
        table.row(format_args!("`{method}` | {mae_m:.2} | {rmse_m:.2} | {p90_m:.2} | {nees}"));
    }
    table.row(format_args!("thesis, multilateration | 1.20 | 1.33 | |"));
    table.row(format_args!("thesis, with its particle filter | 1.15 | 1.31 | |"));
    table.into_text()
}

#[cfg(test)]
mod tests {
    use super::{Score, table};

    #[test]
    fn methods_are_rows_above_the_thesis() {
        let score = Score { method: "posterior".to_owned(), mae_m: 1.064, rmse_m: 1.156, p90_m: 1.6, nees: Some(0.95) };
        let text = table(&[score]);
        assert_eq!(text.lines().nth(2), Some("| `posterior` | 1.06 | 1.16 | 1.60 | 0.95 |"));
        assert!(text.ends_with("| 1.15 | 1.31 | | |\n"));
    }
}
