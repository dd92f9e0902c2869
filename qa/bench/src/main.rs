//! `baliza-bench`: published benchmarks on simulated data, and the accuracy protocol. `baliza bench` starts it.
#![forbid(unsafe_code)]

mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    host_tools::cli::program::<cli::BenchProgram>()
}
