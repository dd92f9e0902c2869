//! Fuzz targets: bytes go in as they would from the air, a wire, flash or a file; a panic, an overflow, a number that
//! is not finite or a value that does not survive writing and reading is a finding.
//!
//! `nodes` has what nodes run, `host` what the program `baliza` reads. A target whose format has a checksum also gets
//! the bytes with the right checksum, because no mutation finds it.

#[cfg(feature = "host")]
pub mod host;
pub mod nodes;
mod seal;

use std::path::Path;
use std::sync::OnceLock;

/// A fuzz target.
#[derive(Clone, Copy, Debug)]
pub struct Target {
    /// Its name on the command line.
    pub name: &'static str,
    /// Takes an input.
    pub run: fn(&[u8]),
    /// Inputs to begin with.
    pub seeds: fn() -> Vec<Vec<u8>>,
}

static CHOSEN: OnceLock<Target> = OnceLock::new();

/// Chooses the target that the environment's `FUZZ_TARGET` names. Without it, prints the names of all, and ends. With
/// `FUZZ_SEEDS`, writes the target's seeds to this folder, and ends.
///
/// # Panics
/// There is no such target, or the seeds cannot be written.
pub fn choose(targets: &[Target]) {
    let Ok(name) = std::env::var("FUZZ_TARGET") else {
        targets.iter().for_each(|target| println!("{}", target.name));
        std::process::exit(0);
    };
    let target = targets.iter().find(|target| target.name == name).unwrap_or_else(|| panic!("no target {name}"));
    if let Some(folder) = std::env::var_os("FUZZ_SEEDS") {
        for (number, seed) in (target.seeds)().into_iter().enumerate() {
            std::fs::write(Path::new(&folder).join(format!("seed-{number:02}")), seed).expect("the folder is writable");
        }
        std::process::exit(0);
    }
    CHOSEN.get_or_init(|| *target);
}

/// Gives an input to the chosen target.
pub fn run(input: &[u8]) {
    if let Some(target) = CHOSEN.get() {
        (target.run)(input);
    }
}

/// Asserts that all numbers are finite.
fn finite(numbers: impl IntoIterator<Item = f64>) {
    numbers.into_iter().for_each(|number| assert!(number.is_finite(), "{number}"));
}
