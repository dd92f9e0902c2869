//! How fast and how accurate whole nodes are: runs `baliza simulate` and takes its figures into `docs/performance.md`.

use std::env::consts::EXE_EXTENSION;
use std::process::Command;
use std::time::Instant;

use anyhow::{Context, Result};
use serde::Deserialize;

use crate::accuracy::baliza;
use crate::{document, root, target_directory};

/// What `baliza simulate --json` prints, as far as the table has it.
#[derive(Clone, Debug, Deserialize)]
struct Summary {
    seconds: f64,
    fixes_per_s: f64,
    p50_m: Option<f64>,
    p90_m: Option<f64>,
    airtime_share: f64,
}

/// What is simulated, with which arguments, and what other systems do.
const ROWS: [[&str; 3]; 7] = [
    ["1 tag, 4 anchors", "--tags 1 --anchors 4", "PANS 10, best field report 100 to 300"],
    ["1 tag, 8 anchors", "--tags 1 --anchors 8", "Loco Positioning, two-way: below 100"],
    ["15 tags, 16 anchors", "--tags 15 --anchors 16 --seconds 30", "PANS 150 together"],
    ["1 tag, 4 anchors, 30 % of receptions lost", "--tags 1 --anchors 4 --loss 0.3", ""],
    ["1 tag, 8 anchors, 30 % of receptions lost", "--tags 1 --anchors 8 --loss 0.3", ""],
    ["1 tag, 8 anchors, a minute", "--tags 1 --anchors 8 --seconds 60", ""],
    ["1,000 tags at 10 Hz, 200 anchors", "--tags 1000 --anchors 200 --rate 10 --level air --seconds 10", ""],
];

/// Remakes the table of simulations.
pub fn bench() -> Result<()> {
    // Built before any time is taken, and run without cargo, which takes some of its own.
    baliza(["--version"])?;
    let binary = target_directory().join("release").join("baliza").with_extension(EXE_EXTENSION);
    let mut table = String::from(
        "| what | `baliza simulate …` | positions a second | error P50, P90, m | on the air | times real time | others \
         |\n|---|---|---:|---:|---:|---:|---|\n",
    );
    for [what, arguments, others] in ROWS {
        let begun = Instant::now();
        let output = Command::new(&binary).args(["simulate", "--json"]).args(arguments.split(' ')).output()?;
        let took_s = begun.elapsed().as_secs_f64();
        let summary: Summary = serde_json::from_slice(&output.stdout).context("baliza prints something else")?;
        table += &row(what, arguments, others, &summary, took_s);
    }
    println!("{table}");
    document::remake(&root().join("docs/performance.md"), "simulation", &table)
}

fn row(what: &str, arguments: &str, others: &str, summary: &Summary, took_s: f64) -> String {
    let metres = |figure: Option<f64>| figure.map_or_else(|| "–".to_owned(), |metres| format!("{metres:.3}"));
    format!(
        "| {what} | `{arguments}` | {:.0} | {}, {} | {:.0} % | {:.1} | {others} |\n",
        summary.fixes_per_s,
        metres(summary.p50_m),
        metres(summary.p90_m),
        100.0 * summary.airtime_share,
        summary.seconds / took_s
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_has_the_figures_of_its_simulation() {
        let summary =
            Summary { seconds: 10.0, fixes_per_s: 123.4, p50_m: Some(0.0312), p90_m: None, airtime_share: 0.456 };
        let expected = "| one | `--tags 1` | 123 | 0.031, – | 46 % | 20.0 | none |\n";
        assert_eq!(row("one", "--tags 1", "none", &summary, 0.5), expected);
    }
}
