//! How good positions by the levels of Bluetooth beacons are: runs `baliza bench linde`, and `baliza calibrate path-loss` and `baliza ble solve` on
//! the room of A. Linde Cerezo's thesis, and takes the tables into `docs/performance.md`.

use std::ffi::OsStr;
use std::fmt::Write;

use anyhow::{Context, Result};
use serde::Deserialize;

use crate::accuracy::{baliza, data};
use crate::{document, root};

/// Where the room's beacons are: tables 4.1 and 4.2, with beacons 6 and 8 exchanged, as their path losses of table 4.3 show.
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

/// Remakes the tables of beacons; the one of the recorded room only where there is the recording.
pub fn bench() -> Result<()> {
    let file = root().join("docs/performance.md");
    let simulated = baliza(["bench", "linde", "--seed", "1", "--plot", "docs/linde.svg"])?;
    println!("{simulated}");
    document::remake(&file, "linde", &simulated)?;
    let room = data().join("linde_room");
    if !room.is_dir() {
        println!("no recording linde_room: its table stays as it is");
        return Ok(());
    }
    let folder = root().join("target");
    let [beacons, calibrated] = ["room-beacons.csv", "room-calibrated.csv"].map(|name| folder.join(name));
    std::fs::create_dir_all(&folder).with_context(|| format!("cannot make {}", folder.display()))?;
    std::fs::write(&beacons, ROOM).with_context(|| format!("cannot write {}", beacons.display()))?;
    let [fingerprints, targets] = ["fingerprints.csv", "targets.csv"].map(|name| room.join(name));
    let word = OsStr::new;
    let losses = baliza(
        [word("calibrate"), word("path-loss"), word("--beacons"), beacons.as_os_str(), word("--fingerprints")]
            .into_iter()
            .chain([fingerprints.as_os_str(), word("--out"), calibrated.as_os_str()]),
    )?;
    let solved = baliza(
        [word("ble"), word("solve"), word("--beacons"), calibrated.as_os_str(), word("--rssi"), targets.as_os_str()]
            .into_iter()
            .chain([word("--json")]),
    )?;
    let scores: Vec<Score> = serde_json::from_str(&solved).context("baliza prints something else")?;
    let table = format!("{losses}\n{}", table(&scores)?);
    println!("{table}");
    document::remake(&file, "beacons by path loss", &table)
}

fn table(scores: &[Score]) -> Result<String> {
    let mut table = String::from("| method | MAE, m | RMSE, m | P90, m | NEES |\n|---|---:|---:|---:|---:|\n");
    for Score { method, mae_m, rmse_m, p90_m, nees } in scores {
        let nees = nees.map_or_else(|| "–".to_owned(), |nees| format!("{nees:.2}"));
        writeln!(table, "| `{method}` | {mae_m:.2} | {rmse_m:.2} | {p90_m:.2} | {nees} |")?;
    }
    table += "| thesis, multilateration | 1.20 | 1.33 | | |\n| thesis, with its particle filter | 1.15 | 1.31 | | |\n";
    Ok(table)
}

#[cfg(test)]
mod tests {
    use super::{Score, table};

    #[test]
    fn methods_are_rows_above_the_thesis() {
        let score = Score { method: "posterior".to_owned(), mae_m: 1.064, rmse_m: 1.156, p90_m: 1.6, nees: Some(0.95) };
        let text = table(&[score]).expect("a table");
        assert_eq!(text.lines().nth(2), Some("| `posterior` | 1.06 | 1.16 | 1.60 | 0.95 |"));
        assert!(text.ends_with("| 1.15 | 1.31 | | |\n"));
    }
}
