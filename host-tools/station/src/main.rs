//! `baliza-station`: the station. `baliza serve`, `baliza live` and `baliza station` start it.
#![forbid(unsafe_code)]

use std::process::ExitCode;

fn main() -> ExitCode {
    host_tools::cli::program::<baliza_station::cli::Arguments>()
}
