//! The accuracy protocol: runs `baliza bench accuracy` on the recordings, where they exist, and on the simulated set.

use std::env;
use std::ffi::OsString;
use std::path::PathBuf;
use std::process::Command;

use anyhow::Result;

use crate::baliza::{binary, data};
use crate::succeed;

/// The arguments of `cargo xtask accuracy`.
#[derive(clap::Args)]
pub struct Arguments {
    /// Arguments of `baliza bench accuracy`: --out FILE, --against FILE, --quick, --json …
    #[arg(trailing_var_arg = true, allow_hyphen_values = true)]
    arguments: Vec<OsString>,
}

/// Runs the protocol.
///
/// # Errors
/// The program cannot be built, or its run fails.
pub fn run(arguments: &Arguments) -> Result<()> {
    if data().is_none() {
        eprintln!("no folder of recordings (BALIZA_DATA, ../shared/data): the simulated set alone");
    }
    // Files are named relative to the folder of the caller.
    succeed(Command::new(binary()?).args(command()).args(&arguments.arguments).current_dir(env::current_dir()?))
}

fn command() -> Vec<PathBuf> {
    let data = data().map(|folder| [PathBuf::from("--data"), folder]);
    ["bench", "accuracy"].map(PathBuf::from).into_iter().chain(data.into_iter().flatten()).collect()
}
