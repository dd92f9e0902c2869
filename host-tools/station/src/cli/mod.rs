//! The commands of the station.

mod forward;
mod live;
mod serve;
mod station;

use anyhow::Result;
use clap::CommandFactory as _;
use host_tools::cli::verbosity::Verbosity;
use host_tools::cli::{EXIT_CODES, Program, VERSION, help};

host_tools::commands! {
    /// What the station can do.
    enum Command {
        Serve(serve),
        Live(live),
        Forward(forward),
        #[command(subcommand)]
        Station(station),
    }
}

/// The commands of the station, and those of `baliza`: one program does where only this one is installed.
#[derive(clap::Subcommand)]
enum All {
    #[command(flatten)]
    Station(Command),
    #[command(flatten)]
    Baliza(host_tools::cli::Command),
}

/// Serves positions of tags: a live map, a store and an API. `baliza serve`, `baliza live` and `baliza station` start
/// this program.
#[derive(clap::Parser)]
#[command(name = "baliza", version = VERSION, max_term_width = 120, after_help = EXIT_CODES)]
pub struct Arguments {
    #[command(subcommand)]
    command: All,
    #[command(flatten)]
    verbosity: Verbosity,
}

impl Program for Arguments {
    fn grouped() -> clap::Command {
        help::grouped(Self::command())
    }

    fn verbosity(&self) -> Verbosity {
        self.verbosity
    }

    fn run(&self) -> Result<()> {
        match &self.command {
            All::Station(command) => run(command),
            All::Baliza(command) => host_tools::cli::run(command),
        }
    }
}
