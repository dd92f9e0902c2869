//! `baliza`: positions from recorded ranges, and the commands around them.
#![forbid(unsafe_code)]

use std::process::ExitCode;

use host_tools::cli::Arguments;

fn main() -> ExitCode {
    host_tools::cli::program::<Arguments>()
}
