//! `baliza calibrate`: what is to be known of a site before positions are good.

mod path_loss;

use anyhow::Result;

/// Parameters of a site, from measurements at known points
#[derive(clap::Subcommand)]
pub enum Command {
    PathLoss(path_loss::Arguments),
}

pub fn run(command: &Command) -> Result<()> {
    match command {
        Command::PathLoss(arguments) => path_loss::run(arguments),
    }
}
