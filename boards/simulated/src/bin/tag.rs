//! The tag on a board without hardware: some seconds in the small air's room, told through RTT. Its solver is the program's argument.
#![no_std]
#![no_main]
// The entry macros make a public function without documentation.
#![allow(missing_docs)]

use core::pin::pin;

use baliza_board_simulated::{BOARD, Board, exit};
use embassy_futures::join::join;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use firmware_common::{Reporter, Settings, settings};
use firmware_tag::{Digest, LocatorConfig, TaskChannels, anchor_positions, run_as_told};
use semihosting::experimental::env::args;
use small_air::{room, uptime_us};
use wire::config::{LoadError, Record, Role, Solver};
use wire::telemetry::{Condition, Reset, ResetCause};

static REPORTER: Reporter<CriticalSectionRawMutex, 4096> = Reporter::new(uptime_us);
/// The path of the image, and a word.
const COMMAND_LINE_BYTES: usize = 1024;

static CHANNELS: TaskChannels<CriticalSectionRawMutex> = TaskChannels::new();

#[cfg_attr(target_arch = "arm", cortex_m_rt::entry)]
#[cfg_attr(target_arch = "riscv32", riscv_rt::entry)]
fn main() -> ! {
    let Some(mut board) = solver().and_then(|solver| Board::take(&room::record(solver))) else { exit(false) };
    REPORTER.event_log.reset(Reset { t_us: uptime_us(), cause: ResetCause::PowerOn, crash: None });
    let lived = match &board.record.clone() {
        Ok(record) => live(&mut board, record),
        Err(fault) => Err(Condition::NoRecord(settings::told(fault))),
    };
    if let Err(condition) = lived {
        REPORTER.event_log.state(uptime_us(), condition);
    }
    let told = board.take_out(&REPORTER.event_log);
    exit(lived.is_ok() && told && REPORTER.all_alive(true).is_ok())
}

/// The tag's life by its record; an error where that says something else.
fn live(board: &mut Board, record: &Record) -> Result<(), Condition> {
    let settings = Settings::of(record, room::TAG_EUI);
    let settings = settings.map_err(|invalid| Condition::NoRecord(settings::told(&LoadError::Invalid(invalid))))?;
    let Role::Tag(tag) = settings.role else { return Err(Condition::WrongRecord) };
    let anchors = anchor_positions(record);
    let world = room::world(&settings.network);
    let radio = room::tag(&world).ok_or(Condition::RadioFailed(1))?;
    let told = (&CHANNELS, &REPORTER);
    let mut digest = Digest::new();
    let app = run_as_told(
        radio,
        world.delay(),
        (&settings, &tag),
        LocatorConfig::of(&tag, record, &anchors),
        told,
        BOARD,
        |epoch| digest.take(epoch),
    );
    {
        let everything = pin!(join(app, room::anchors(&world, settings.network)));
        world.run(room::LIFE_US, everything, || {
            board.take_out(&REPORTER.event_log);
        });
    }
    defmt::info!("digest {=u64:016x}", digest.value());
    Ok(())
}

/// What the host asks for, the last word of the command line; a track where it asks for nothing, and none where that is no solver.
fn solver() -> Option<Solver> {
    let arguments = args::<COMMAND_LINE_BYTES>().ok()?;
    (&arguments).skip(1).last().map_or(Some(Solver::Track), |name| Solver::from_name(name.ok()?))
}
