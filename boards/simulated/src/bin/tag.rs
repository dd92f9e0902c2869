//! The tag on a board without hardware: some seconds in the small air's room, told through RTT. Its solver is the program's argument.
#![no_std]
#![no_main]
// The entry macros make a public function without documentation.
#![allow(missing_docs)]

use core::cell::RefCell;
use core::pin::pin;

use baliza_board_simulated::{BOARD, Board, exit};
use embassy_futures::join::join;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use firmware_common::{Reporter, Start, introduce};
use firmware_tag::{Digest, LocatorConfig, TaskChannels, anchor_positions, run_from_config};
use semihosting::experimental::env::args;
use small_air::{room, uptime_us};
use wire::config::{Role, Solver};
use wire::telemetry::{Condition, ResetCause};

static REPORTER: Reporter<CriticalSectionRawMutex, 4096> = Reporter::new(uptime_us);
/// The path of the image, and a word.
const COMMAND_LINE_BYTES: usize = 1024;

static CHANNELS: TaskChannels<CriticalSectionRawMutex> = TaskChannels::new();

#[cfg_attr(target_arch = "arm", cortex_m_rt::entry)]
#[cfg_attr(target_arch = "riscv32", riscv_rt::entry)]
fn main() -> ! {
    let Some(mut board) = solver().and_then(|solver| Board::take(&room::record(solver))) else { exit(false) };
    let lived = live(&mut board);
    if let Err(Some(condition)) = lived {
        REPORTER.event_log.state(uptime_us(), condition);
    }
    let told = board.take_out(&REPORTER.event_log);
    exit(lived.is_ok() && told && REPORTER.all_alive(true).is_ok())
}

/// The tag's life by its record; else what is left to say of the reason why it has none.
fn live(board: &mut Board) -> Result<(), Option<Condition>> {
    let start = Start { record: board.record.clone(), eui: room::TAG_EUI, reset: ResetCause::PowerOn, crash: None };
    let (hello, followed) = introduce(&REPORTER, wire::telemetry::Board::Simulated, wire::telemetry::Role::Tag, start);
    let (record, settings) = followed.ok_or(None)?;
    let Role::Tag(tag) = settings.role else { return Err(Some(Condition::WrongRecord)) };
    let anchors = anchor_positions(&record);
    let world = room::world(&settings.network);
    let radio = room::tag(&world).ok_or(Some(Condition::RadioFailed(1)))?;
    let digest = RefCell::new(Digest::new());
    let app = run_from_config(
        radio,
        world.delay(),
        (&settings, &tag),
        LocatorConfig::of(&tag, &record, &anchors),
        (&CHANNELS, &REPORTER),
        hello,
        &digest,
    );
    {
        let everything = pin!(join(app, room::anchors(&world, settings.network)));
        world.run(room::LIFE_US, everything, || {
            board.take_out(&REPORTER.event_log);
        });
    }
    defmt::info!("digest {=u64:016x}", digest.into_inner().value());
    Ok(())
}

/// What the host asks for, the last word of the command line; a track where it asks for nothing, and none where that is no solver.
fn solver() -> Option<Solver> {
    let arguments = args::<COMMAND_LINE_BYTES>().ok()?;
    (&arguments).skip(1).last().map_or(Some(Solver::Track), |name| Solver::from_name(name.ok()?))
}
