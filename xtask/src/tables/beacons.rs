//! Positions by the RSSI values of Bluetooth beacons in the room of A. Linde Cerezo's thesis: its path losses by
//! `baliza calibrate path-loss`, the targets by `baliza ble solve`.

use anyhow::{Context, Result};
use baliza_report::MarkdownTable;

use super::{Score, number};
use crate::baliza::{baliza, json, scratch, words};
use crate::promises::Made;

/// Positions of the room's beacons: tables 4.1 and 4.2, with beacons 6 and 8 exchanged, as their path losses of table
/// 4.3 show.
const ROOM: &str = "beacon,x_m,y_m\n1,0.45,3.22\n2,5.25,1.63\n6,3.70,6.55\n7,6.88,3.73\n8,2.30,0.12\n";

/// The recorded room: its path losses, and the positions of its targets by them.
///
/// # Errors
/// A run of `baliza` fails.
pub fn by_path_loss() -> Result<Made> {
    let beacons = scratch("room-beacons.csv")?;
    std::fs::write(&beacons, ROOM).with_context(|| format!("cannot write {}", beacons.display()))?;
    let calibrate = "calibrate path-loss --beacons OUT/room-beacons.csv \
                     --fingerprints DATA/linde_room/fingerprints.csv --out OUT/room-calibrated.csv";
    let losses = baliza(words(calibrate)?)?;
    let solve = "ble solve --json --beacons OUT/room-calibrated.csv --rssi DATA/linde_room/targets.csv";
    let scores: Vec<Score> = json(words(solve)?)?;
    Ok(Made::one("beacons by path loss", format!("{losses}\n{}", table(&scores))))
}

fn table(scores: &[Score]) -> String {
    let mut table = MarkdownTable::new(["method", "MAE, m:", "RMSE, m:", "P90, m:", "NEES:"]);
    for Score { method, mae_m, rmse_m, p90_m, nees, .. } in scores {
        let [mae, rmse, p90, nees] = [mae_m, rmse_m, p90_m, nees].map(|value| number(*value, 2));
        table.row(format_args!("`{method}` | {mae} | {rmse} | {p90} | {nees}"));
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
        let (mae_m, rmse_m, p90_m, nees) = (Some(1.064), Some(1.156), Some(1.6), Some(0.95));
        let score = Score { method: "posterior".to_owned(), mae_m, rmse_m, p90_m, nees, ..Score::default() };
        let text = table(&[score]);
        assert_eq!(text.lines().nth(2), Some("| `posterior` | 1.06 | 1.16 | 1.60 | 0.95 |"));
        assert!(text.ends_with("| 1.15 | 1.31 | | |\n"));
    }
}
