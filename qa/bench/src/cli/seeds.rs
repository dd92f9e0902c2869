//! `baliza bench seeds`: whether the positions of simulated sites are as good as they say, over many seeds.

use std::path::{Path, PathBuf};

use anyhow::Result;
use baliza_report::{MarkdownTable, Statistics};
use host_tools::cli::progress::Progress;
use host_tools::simulate::read_scenario;
use recording::UserError;
use serde::Serialize;
use sim::scenario::{Scenario, SimulatedEpoch, Simulation};
use wire::telemetry::Doubt;

use super::{MOST_DEVIATIONS, Output, on_all_processors};

/// A position is misleading if it is farther off than the first number while its deviation is below the second one,
/// metres.
const MISLEADING_M: [f64; 2] = [1.0, 0.3];

/// Errors of simulated sites beside the deviations that tags report, over many seeds
///
/// Each site is simulated with the seeds 1, 2, 3 …, as `baliza simulate` does it. A position is misleading if it is more
/// than 1 m off, its deviation is below 0.3 m and it has no flag. Errors and deviations are horizontal; a NEES of 1 is
/// right.
///
/// As JSON: an object a site with site, seeds, positions, flagged, misleading, beyond_4_sigma (without a flag, too),
/// rmse_m, nees (of all positions) and nees_worst (of the worst seed).
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  baliza bench seeds qa/accuracy/sites/*.toml\n  \
                        baliza bench seeds site.toml --seeds 100 --json")]
pub struct Arguments {
    /// Sites, as `baliza simulate --site` reads them
    #[arg(required = true, value_name = "FILE")]
    sites: Vec<PathBuf>,
    /// How many seeds of each
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    seeds: u64,
    /// Print JSON: results has an object a site
    #[arg(long)]
    json: bool,
}

/// What the seeds of a site show.
#[derive(Debug, Serialize)]
struct Row {
    site: String,
    seeds: u64,
    positions: usize,
    flagged: usize,
    misleading: usize,
    beyond_4_sigma: usize,
    rmse_m: Option<f64>,
    nees: Option<f64>,
    nees_worst: Option<f64>,
}

/// What one seed shows.
#[derive(Default)]
struct Seed {
    errors_m: Vec<f64>,
    /// Squared errors in units of their covariance; 1 is right.
    squares: Vec<f64>,
    flagged: usize,
    misleading: usize,
    beyond: usize,
}

/// Runs `baliza bench seeds`.
///
/// # Errors
/// A site cannot be read or simulated, or the output cannot be printed.
pub fn run(arguments: &Arguments) -> Result<()> {
    // A file that is wrong is refused before the work begins.
    arguments.sites.iter().try_for_each(|file| scenario(file, 1).map(drop))?;
    let progress = Progress::new(arguments.sites.len() * arguments.seeds as usize);
    let rows: Vec<_> =
        arguments.sites.iter().map(|file| row(file, arguments.seeds, &progress)).collect::<Result<_>>()?;
    drop(progress);
    Output { json: arguments.json, picture: None }.print(&rows, || table(&rows))
}

/// A site with a seed.
fn scenario(file: &Path, seed: u64) -> Result<Scenario, UserError> {
    Ok(Scenario { seed, ..read_scenario(file, true)? })
}

fn row(file: &Path, seeds: u64, progress: &Progress) -> Result<Row> {
    let all = on_all_processors(1..seeds + 1, |seed| Ok(simulate(scenario(file, seed)?, progress)));
    let all: Vec<Seed> = all.into_iter().collect::<Result<_, UserError>>()?;
    let count = |of: fn(&Seed) -> usize| all.iter().map(of).sum::<usize>();
    let errors_m: Vec<f64> = all.iter().flat_map(|seed| seed.errors_m.iter().copied()).collect();
    let squares: Vec<f64> = all.iter().flat_map(|seed| seed.squares.iter().copied()).collect();
    let nees = |squares: &[f64]| Statistics::of(squares).map(|of| of.mae);
    Ok(Row {
        site: file.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
        seeds,
        positions: errors_m.len(),
        flagged: count(|seed| seed.flagged),
        misleading: count(|seed| seed.misleading),
        beyond_4_sigma: count(|seed| seed.beyond),
        rmse_m: Statistics::of(&errors_m).map(|of| of.rmse),
        nees: nees(&squares),
        nees_worst: all.iter().filter_map(|seed| nees(&seed.squares)).reduce(f64::max),
    })
}

fn simulate(scenario: Scenario, progress: &Progress) -> Seed {
    let mut simulation = Simulation::new(scenario);
    let mut seed = Seed::default();
    for record in simulation.run_until(simulation.scenario().seconds) {
        record.epoch().into_iter().for_each(|epoch| seed.take(epoch));
    }
    progress.step();
    seed
}

impl Seed {
    fn take(&mut self, epoch: &SimulatedEpoch) {
        let (Some([x_m, y_m, _]), Some([x_sigma_m, y_sigma_m, _])) = (epoch.fix.position_m(), epoch.fix.deviation_m())
        else {
            return;
        };
        let error_m = (x_m - epoch.truth_m[0]).hypot(y_m - epoch.truth_m[1]);
        let sigma_m = x_sigma_m.hypot(y_sigma_m);
        let is_flagged = epoch.fix.doubt != Doubt::None;
        self.errors_m.push(error_m);
        self.squares.extend(epoch.normalised_square().map(|square| 0.5 * square));
        self.flagged += usize::from(is_flagged);
        self.misleading += usize::from(!is_flagged && error_m > MISLEADING_M[0] && sigma_m < MISLEADING_M[1]);
        self.beyond += usize::from(!is_flagged && error_m > MOST_DEVIATIONS * sigma_m);
    }
}

fn table(rows: &[Row]) -> String {
    let titles =
        ["site", "positions:", "flagged:", "misleading:", "beyond 4 σ:", "RMSE, m:", "NEES:", "of the worst seed:"];
    let mut table = MarkdownTable::new(titles);
    for row in rows {
        let [rmse_m, nees, worst] = [row.rmse_m, row.nees, row.nees_worst].map(|figure| figure.unwrap_or(f64::NAN));
        table.row(format_args!(
            "{} | {} | {} | {} | {} | {rmse_m:.3} | {nees:.1} | {worst:.1}",
            row.site, row.positions, row.flagged, row.misleading, row.beyond_4_sigma
        ));
    }
    table.into_text()
}

#[cfg(test)]
mod tests {
    use wire::telemetry::{Fix, Outcome, Solver};

    use super::*;

    /// A position that is off by this, with a deviation of 0.1 m in each direction.
    fn epoch(off_m: f32, doubt: Doubt) -> SimulatedEpoch {
        let covariance_m2 = [[0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.0]];
        let outcome = Outcome::position([2.0 + off_m, 3.0, 1.2], covariance_m2, 0b1111, 1.0);
        let fix = Fix { t_us: 0, round: 0, age_us: 0, asked: 4, outcome, solver: Solver::Track, doubt };
        SimulatedEpoch {
            number: 0,
            truth_m: [2.0, 3.0, 1.2],
            fix,
            is_of_station: false,
            ranges: Vec::new(),
            differences: Vec::new(),
        }
    }

    #[test]
    fn far_positions_with_small_deviations_and_without_a_flag_are_misleading() {
        let mut seed = Seed::default();
        // The deviation is 0.1 √2 m, and four of them are 0.566 m.
        let drawn = [(0.1, Doubt::None), (0.6, Doubt::None), (1.1, Doubt::None), (1.1, Doubt::Suspect)];
        drawn.iter().for_each(|(off_m, doubt)| seed.take(&epoch(*off_m, *doubt)));
        assert_eq!((seed.errors_m.len(), seed.flagged, seed.misleading, seed.beyond), (4, 1, 1, 2));
        // Half of (1.1 ⁄ 0.1)².
        assert!((seed.squares[2] - 60.5).abs() < 1e-3, "{:?}", seed.squares);
    }
}
