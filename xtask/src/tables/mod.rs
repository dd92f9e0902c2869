//! Tables of accuracy: runs of `baliza` on recordings and simulations, and what of their results documents show.

pub mod beacons;
pub mod fingerprints;
pub mod recordings;
pub mod scenarios;

use anyhow::Result;
use serde::Deserialize;

use crate::promises::Made;
use crate::{cargo, printed};

/// One method on one recording, as `--json` of a command prints it. Each command has some of the keys.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
struct Score {
    method: String,
    epochs: u64,
    fixed: u64,
    mae_m: Option<f64>,
    rmse_m: Option<f64>,
    p90_m: Option<f64>,
    inside_1_sigma: Option<f64>,
    nees: Option<f64>,
}

/// A number with this many digits after the point, or a dash.
fn number(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "–".to_owned(), |value| format!("{value:.digits$}"))
}

/// Costs and accuracy of schemes of two-way ranging: the table that an example of `ranging` prints.
///
/// # Errors
/// The example cannot be built, or fails.
pub fn schemes() -> Result<Made> {
    let example = ["run", "--quiet", "--release", "--package", "baliza-ranging", "--example", "schemes"];
    Ok(Made::one("schemes", printed(cargo().args(example))?))
}
