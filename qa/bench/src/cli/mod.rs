//! `baliza bench …`: benchmarks on simulated data, beside published figures.

mod accuracy;
mod barral;
mod fusion;
mod garcia;
mod honesty;
mod linde;
mod mistakes;
mod seeds;
mod thesis;

use std::ops::Range;
use std::panic::resume_unwind;
use std::path::PathBuf;
use std::thread;

use anyhow::Result;

use clap::CommandFactory as _;
use host_tools::cli::verbosity::Verbosity;
use host_tools::cli::{EXIT_CODES, PictureFile, VERSION, help};
use pictures::Series;

host_tools::commands! {
    /// Benchmarks on simulated ranges and RSSI values
    pub enum Arguments {
        Thesis(thesis),
        Garcia(garcia),
        Barral(barral),
        Fusion(fusion),
        Linde(linde),
        Accuracy(accuracy),
        Honesty(honesty),
        Mistakes(mistakes),
        Seeds(seeds),
    }
}

/// Re-enacts published benchmarks and scores accuracy. `baliza bench` starts this program.
#[derive(clap::Parser)]
#[command(name = "baliza", version = VERSION, max_term_width = 120, after_help = EXIT_CODES)]
pub struct BenchProgram {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    verbosity: Verbosity,
}

/// The benchmarks, and the commands of `baliza`: drawn recordings can be solved.
#[derive(clap::Subcommand)]
enum Command {
    #[command(subcommand)]
    Bench(Arguments),
    #[command(flatten)]
    Baliza(host_tools::cli::Command),
}

impl host_tools::cli::Program for BenchProgram {
    fn grouped() -> clap::Command {
        help::grouped(Self::command())
    }

    fn verbosity(&self) -> Verbosity {
        self.verbosity
    }

    fn run(&self) -> Result<()> {
        match &self.command {
            Command::Bench(arguments) => run(arguments),
            Command::Baliza(command) => host_tools::cli::run(command),
        }
    }
}

/// What is simulated and drawn, and how the figures are printed.
#[derive(clap::Args)]
struct Drawing {
    /// Seed of the random numbers: equal seeds give equal figures
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print JSON: results has an object a row of the table (of garcia: one object)
    #[arg(long)]
    json: bool,
    /// Draw the errors, as .svg or .png
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
}

impl Drawing {
    /// Checks the picture's file before the work begins.
    fn check(&self) -> Result<Output<'_>> {
        Ok(Output { json: self.json, picture: PictureFile::plot(self.plot.as_deref())? })
    }
}

/// The destinations of the figures. The files can be written.
struct Output<'a> {
    json: bool,
    picture: Option<PictureFile<'a>>,
}

impl Output<'_> {
    /// Prints the figures, as a JSON document or as a table.
    fn print(&self, document: &impl serde::Serialize, table: impl FnOnce() -> String) -> Result<()> {
        if self.json { host_tools::cli::print_json(document) } else { host_tools::cli::print(table().as_bytes()) }
    }

    /// Prints and draws the figures.
    fn show(
        self,
        document: &impl serde::Serialize,
        table: impl FnOnce() -> String,
        picture: impl FnOnce() -> pictures::Drawing,
    ) -> Result<()> {
        self.print(document, table)?;
        if let Some(file) = self.picture {
            file.write_and_note(&picture())?;
        }
        Ok(())
    }
}

/// An error of more than this number of deviations is beyond what a deviation allows.
const MOST_DEVIATIONS: f64 = 4.0;

/// What `make` makes of each of these numbers, on all processors: those of one processor after those of another.
fn on_all_processors<T: Send>(numbers: Range<u64>, make: impl Fn(u64) -> T + Sync) -> Vec<T> {
    let threads = thread::available_parallelism().map_or(1, usize::from);
    let part = |first: usize| numbers.clone().skip(first).step_by(threads).map(&make).collect::<Vec<_>>();
    thread::scope(|scope| {
        let part = &part;
        let running: Vec<_> = (0..threads).map(|first| scope.spawn(move || part(first))).collect();
        running.into_iter().flat_map(|thread| thread.join().unwrap_or_else(|panic| resume_unwind(panic))).collect()
    })
}

/// The distribution of the errors, metres, by what they are of.
fn distribution(errors: impl Iterator<Item = (String, Vec<f64>)>) -> pictures::Drawing {
    let series = errors.map(|(method, errors_m)| Series { method, errors_m, ..Series::default() });
    pictures::distribution(&series.collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use papers::fusion::bench as fusion;
    use papers::linde;
    use pictures::{Pen, pen};

    #[test]
    fn the_curves_of_a_benchmark_are_distinct() {
        let fused = fusion::FusionAlgorithm::ALL.into_iter().flat_map(|algorithm| {
            fusion::Inputs::ALL.map(|heard| format!("{}, {}", algorithm.as_str(), heard.as_str()))
        });
        let found = linde::ROWS.into_iter().map(|(parameter, algorithm, _)| linde::name(parameter, algorithm));
        for names in [fused.collect::<Vec<_>>(), found.collect()] {
            let pens: Vec<Pen> = names.iter().map(|name| pen(name)).collect();
            for (index, pen) in pens.iter().enumerate() {
                assert!(!pens[..index].contains(pen), "{}", names[index]);
            }
        }
    }
}
