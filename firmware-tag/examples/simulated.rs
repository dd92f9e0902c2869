//! The tag's program in the small air's room, on a desktop. It does the same as the image for QEMU, and writes the same
//! telemetry.
//!
//! `cargo run -p firmware-tag --example simulated -- FILE [SOLVER]`; it prints the positions' digest.

use std::error::Error;

use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use firmware_common::Reporter;
use firmware_tag::TaskChannels;
use firmware_tag::simulated::live;
use small_air::{room, uptime_us};
use wire::config::Solver;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (file, solver) = match arguments.as_slice() {
        [file] => (file, Solver::Track),
        [file, name] => (file, Solver::from_name(name).ok_or("there is no such solver")?),
        _ => return Err("usage: simulated FILE [SOLVER]".into()),
    };
    let (channels, reporter) = (TaskChannels::new(), Reporter::<NoopRawMutex, 4096>::new(uptime_us));
    let mut telemetry = Vec::new();
    let life = live(Ok(room::record(solver)), room::LIFE_US, room::tag, (&channels, &reporter), || {
        reporter.event_log.drain(|frame| {
            telemetry.extend_from_slice(frame);
            true
        });
    });
    std::fs::write(file, telemetry)?;
    println!("digest {:016x}", life.ok_or("the room's record cannot be followed")?.digest.value());
    Ok(())
}
