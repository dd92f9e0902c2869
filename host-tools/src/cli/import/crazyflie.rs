//! `baliza import crazyflie`: logs of the Crazyflie client.

use std::path::PathBuf;

use anyhow::Result;
use recording::import::crazyflie;
use recording::read_anchors;

/// Import a log of a Crazyflie in two-way ranging: CSV of the client with ranging.distance0 to ranging.distance7
///
/// stateEstimate.x, .y and .z, or kalman.stateX, …, become positions.csv.
#[derive(clap::Args)]
pub struct Arguments {
    /// The log
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// The anchors' positions, with their numbers, 0 to 7, as names: CSV with anchor,x_m,y_m,z_m
    #[arg(long, value_name = "FILE")]
    anchors: PathBuf,
    /// The folder for the recording; it is made where it does not exist
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// Replace the recording that is there
    #[arg(long)]
    force: bool,
}

/// Runs `baliza import crazyflie`.
///
/// # Errors
/// The log has no range, an anchor has no position, or the folder cannot be written.
pub fn run(arguments: &Arguments) -> Result<()> {
    let Arguments { file, anchors, out, force } = arguments;
    super::write(&crazyflie::read(file, &read_anchors(anchors)?)?, "crazyflie", file, out, *force)
}
