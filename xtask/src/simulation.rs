//! Speed and accuracy of whole nodes: runs `baliza simulate` and makes tables of the results.

use std::time::Instant;

use anyhow::Result;
use baliza_report::MarkdownTable;
use serde::Deserialize;

use crate::baliza::{binary, result};
use crate::bench::Made;

/// The part of the output of `baliza simulate --json` that the table needs.
#[derive(Clone, Debug, Deserialize)]
struct Summary {
    seconds: f64,
    fixes_per_s: f64,
    p50_m: Option<f64>,
    p90_m: Option<f64>,
    airtime_share: f64,
}

/// The simulated case, its arguments, and the figure of other systems.
const ROWS: [[&str; 3]; 12] = [
    ["1 tag, 4 anchors", "--tags 1 --anchors 4", "PANS 10, best field report 100 to 300"],
    ["1 tag, 8 anchors", "--tags 1 --anchors 8", "Loco Positioning, two-way: below 100"],
    ["1 tag, 4 anchors, all code takes twice as long", "--tags 1 --anchors 4 --cpu-slowdown 2", ""],
    ["1 tag, 4 anchors, four times as long", "--tags 1 --anchors 4 --cpu-slowdown 4", ""],
    ["1 tag, 4 anchors, double-sided", "--tags 1 --anchors 4 --scheme double-sided", ""],
    ["1 tag, 4 anchors, ESP32-C3", "--tags 1 --anchors 4 --board esp32c3", ""],
    ["1 tag, 4 anchors, EVK1000", "--tags 1 --anchors 4 --board evk1000", ""],
    ["15 tags, 16 anchors", "--tags 15 --anchors 16 --seconds 30", "PANS 150 together"],
    ["1 tag, 4 anchors, 30 % of receptions lost", "--tags 1 --anchors 4 --loss 0.3", ""],
    ["1 tag, 8 anchors, 30 % of receptions lost", "--tags 1 --anchors 8 --loss 0.3", ""],
    ["1 tag, 8 anchors, a minute", "--tags 1 --anchors 8 --seconds 60", ""],
    ["1,000 tags at 10 Hz, 200 anchors", "--tags 1000 --anchors 200 --rate 10 --fidelity air --seconds 10", ""],
];

/// The part of the output of `baliza simulate --json` for a scenario with beacons that the table needs.
#[derive(Clone, Debug, Deserialize)]
struct Scenario {
    fixes_per_s: f64,
    rmse_m: Option<f64>,
    bluetooth: Option<Bluetooth>,
}

/// Positions by anchors, and by beacons alone.
#[derive(Clone, Debug, Deserialize)]
struct Bluetooth {
    by_anchors: Errors,
    by_beacons: Errors,
}

#[derive(Clone, Copy, Debug, Deserialize)]
struct Errors {
    rmse_m: Option<f64>,
}

/// Scenarios with anchors and beacons, and their descriptions.
const SCENARIOS: [[&str; 2]; 4] = [
    ["beacons.toml", "six beacons around 12 m × 8 m"],
    ["anchors.toml", "four anchors in the same room"],
    ["both.toml", "both in one room"],
    ["leaving.toml", "from four anchors behind steel and concrete to eight beacons"],
];
/// Each scenario is simulated with these seeds.
const SEEDS: [&str; 3] = ["1", "2", "3"];

/// Tags among anchors and beacons.
///
/// # Errors
/// A run of `baliza` fails.
pub fn scenarios() -> Result<Option<Made>> {
    let mut table = MarkdownTable::new(["scenario", "positions a second:", "by anchors:", "by beacons:"]);
    for [file, what] in SCENARIOS {
        let path = format!("examples/{file}");
        let run = |seed| result(["simulate", "--json", "--scenario", path.as_str(), "--seed", seed]);
        let runs = SEEDS.into_iter().map(run).collect::<Result<Vec<Scenario>>>()?;
        table.row(format_args!("{}", scenario(file, what, &runs)));
    }
    Ok(Made::one("scenarios", table.into_text()))
}

/// The cells of a row: the errors for each seed side by side; empty where no seed gives a position.
fn scenario(file: &str, what: &str, runs: &[Scenario]) -> String {
    let errors = |of: fn(&Scenario) -> Option<f64>| {
        let metres = |metres: f64| if metres < 0.1 { format!("{metres:.3}") } else { format!("{metres:.2}") };
        let errors = runs.iter().map(|run| of(run).map_or_else(|| "–".to_owned(), metres)).collect::<Vec<_>>();
        if errors.iter().all(|error| error == "–") { String::new() } else { errors.join(", ") }
    };
    let anchors = errors(|run| run.bluetooth.as_ref().map_or(run.rmse_m, |bluetooth| bluetooth.by_anchors.rmse_m));
    let beacons = errors(|run| run.bluetooth.as_ref().and_then(|bluetooth| bluetooth.by_beacons.rmse_m));
    let rate = runs.iter().map(|run| run.fixes_per_s).sum::<f64>() / runs.len() as f64;
    format!("`{file}`: {what} | {rate:.1} | {anchors} | {beacons}")
}

/// Rooms with tags and anchors.
///
/// # Errors
/// A run of `baliza` fails.
pub fn rooms() -> Result<Option<Made>> {
    let figures = ["positions a second:", "error P50, P90, m:", "on the air:", "times real time:"];
    let titles = ["what", "`baliza simulate …`"].into_iter().chain(figures).chain(["others"]);
    let mut table = MarkdownTable::new(titles);
    // Built before any time is measured.
    binary()?;
    for [what, arguments, others] in ROWS {
        let begun = Instant::now();
        let summary: Summary = result(["simulate", "--json"].into_iter().chain(arguments.split(' ')))?;
        let took_s = begun.elapsed().as_secs_f64();
        table.row(format_args!("{}", row(what, arguments, others, &summary, took_s)));
    }
    Ok(Made::one("simulation", table.into_text()))
}

fn row(what: &str, arguments: &str, others: &str, summary: &Summary, took_s: f64) -> String {
    let metres = |figure: Option<f64>| figure.map_or_else(|| "–".to_owned(), |metres| format!("{metres:.3}"));
    format!(
        "{what} | `{arguments}` | {:.0} | {}, {} | {:.0} % | {:.1} | {others}",
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
        let expected = "one | `--tags 1` | 123 | 0.031, – | 46 % | 20.0 | none";
        assert_eq!(row("one", "--tags 1", "none", &summary, 0.5), expected);
    }

    #[test]
    fn a_scenario_has_the_errors_of_all_seeds() {
        let run = |by_anchors, by_beacons| Scenario {
            fixes_per_s: 2.04,
            rmse_m: Some(9.0),
            bluetooth: Some(Bluetooth {
                by_anchors: Errors { rmse_m: by_anchors },
                by_beacons: Errors { rmse_m: by_beacons },
            }),
        };
        let row = scenario("a.toml", "a room", &[run(None, Some(2.017)), run(None, None)]);
        assert_eq!(row, "`a.toml`: a room | 2.0 |  | 2.02, –");
        let alone = Scenario { bluetooth: None, rmse_m: Some(0.0303), ..run(None, None) };
        assert_eq!(scenario("a.toml", "a room", &[alone]), "`a.toml`: a room | 2.0 | 0.030 | ");
    }
}
