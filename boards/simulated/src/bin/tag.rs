//! The tag on a board without hardware. It runs for some seconds in the small air's room, and reports through RTT. The
//! program's argument is its solver.
#![no_std]
#![no_main]
// The entry macros make a public function without documentation.
#![allow(missing_docs)]

use baliza_board_simulated::{Board, exit};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use firmware_common::Reporter;
use firmware_tag::TaskChannels;
use firmware_tag::simulated::live;
use semihosting::experimental::env::args;
use small_air::{room, uptime_us};
use wire::config::Solver;

static REPORTER: Reporter<CriticalSectionRawMutex, 4096> = Reporter::new(uptime_us);
/// The longest command line: the path of the image, and one argument.
const COMMAND_LINE_BYTES: usize = 1024;

static CHANNELS: TaskChannels<CriticalSectionRawMutex> = TaskChannels::new();

#[cfg_attr(target_arch = "arm", cortex_m_rt::entry)]
#[cfg_attr(target_arch = "riscv32", riscv_rt::entry)]
fn main() -> ! {
    let Some(mut board) = solver().and_then(|solver| Board::take(&room::record(solver))) else { exit(false) };
    let record = board.record.clone();
    let life = live(record, room::LIFE_US, room::tag, (&CHANNELS, &REPORTER), || {
        board.take_out(&REPORTER.event_log);
    });
    if let Some(life) = life {
        defmt::info!("digest {=u64:016x}", life.digest.value());
    }
    let told = board.take_out(&REPORTER.event_log);
    exit(life.is_some() && told && REPORTER.all_alive(true).is_ok())
}

/// The solver in the last argument of the command line. Without an argument the tag follows a track. `None` if the
/// argument is no solver.
fn solver() -> Option<Solver> {
    let arguments = args::<COMMAND_LINE_BYTES>().ok()?;
    (&arguments).skip(1).last().map_or(Some(Solver::Track), |name| Solver::from_name(name.ok()?))
}
