//! `baliza survey`: what is measured on the spot, with a person.

mod fingerprints;

use anyhow::Result;

/// Surveys: a person is led from point to point
#[derive(clap::Subcommand)]
pub enum Command {
    Fingerprints(fingerprints::Arguments),
}

pub fn run(command: &Command) -> Result<()> {
    match command {
        Command::Fingerprints(arguments) => fingerprints::run(arguments),
    }
}
