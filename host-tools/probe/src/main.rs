//! `baliza-probe`: the commands of `baliza`, with a driver of debug probes. `baliza flash`, and whatever else needs a
//! probe, starts it.
#![forbid(unsafe_code)]

mod session;

use std::process::ExitCode;

use host_tools::cli::Arguments;

fn main() -> ExitCode {
    node_link::probe::install(&session::ProbeRs);
    host_tools::cli::program::<Arguments>()
}
