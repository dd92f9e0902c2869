//! `baliza bench accuracy`: the comparison by which a change of solver, track or settings is accepted
//! (`docs/design/accuracy.md`).

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use baliza_research::prior::{self, Case};

/// The accuracy of solver, track and fingerprints over all recordings and a simulated set
#[derive(clap::Args)]
#[command(after_help = "Examples:\n  baliza bench accuracy --write-prior cases")]
pub struct Arguments {
    /// Only write the cases of the simulated set into this folder, a recording each, and cases.csv, a list of their
    /// conditions
    #[arg(long, value_name = "DIR")]
    write_prior: Option<PathBuf>,
    /// Cases of the simulated set; groups take turns
    #[arg(long, default_value_t = prior::CASES as u32, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    cases: u32,
    /// Seed of the simulated set
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// Runs `baliza bench accuracy`.
///
/// # Errors
/// A file cannot be read or written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let cases: Vec<Case> = (0..arguments.cases as usize).map(|number| prior::draw(number, arguments.seed)).collect();
    if let Some(folder) = &arguments.write_prior {
        write_prior(folder, &cases)?;
    }
    Ok(())
}

fn write_prior(folder: &Path, cases: &[Case]) -> Result<()> {
    let make =
        |folder: &Path| std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()));
    for case in cases {
        let folder = folder.join(case.name());
        make(&folder)?;
        for (name, text) in prior::texts(case) {
            crate::cli::write(&folder.join(name), text.as_bytes())?;
        }
    }
    crate::cli::write(&folder.join("cases.csv"), prior::index(cases).as_bytes())
}
