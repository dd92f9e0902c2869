//! What the station sends to maps, read by programs of others (`station/tests/maps/`).

use std::net::TcpListener;
use std::process::Command;

use anyhow::{Context, Result};

use super::server::Server;
use crate::python::{environment, install};
use crate::{root, succeed, target_directory};

/// What reads NMEA and GPX.
const TOOLS: [&str; 2] = ["pynmea2==1.19.0", "gpxpy==1.6.2"];
/// A tag of the simulation.
const TAG: &str = "0x1001";

/// Reads the NMEA and the GPX of a simulated tag.
///
/// # Errors
/// There is no Python with `venv`, the tools cannot be fetched, or what they read is wrong.
pub fn run() -> Result<()> {
    let python = environment(&target_directory().join("station/venv"))?;
    install(&python, TOOLS)?;
    let free = TcpListener::bind("127.0.0.1:0").and_then(|free| free.local_addr()).context("no free port")?;
    let station = Server::start(&["--simulate", "--nmea", &format!("{TAG}@{free}")], ("empty", ""))?;
    let check = root().join("station/tests/maps/check.py");
    let url = format!("http://{}", station.address);
    succeed(Command::new(&python).arg(check).args([&url, &free.to_string(), TAG]))?;
    station.stop()
}
