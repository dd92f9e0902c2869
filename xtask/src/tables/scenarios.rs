//! Tags among anchors and beacons: `baliza simulate` with several seeds.

use anyhow::Result;
use baliza_report::MarkdownTable;
use serde::Deserialize;

use crate::baliza::result;
use crate::promises::Made;

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
pub fn made() -> Result<Made> {
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

#[cfg(test)]
mod tests {
    use super::*;

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
