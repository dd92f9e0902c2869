//! A board without hardware, in QEMU: Cortex-M4F (mps2-an386) or RISC-V without FPU (virt). Its radio is the small air's; its
//! flash is memory; its debug probe is itself: what RTT holds goes to two files of the host by semihosting.
#![no_std]
#![cfg(target_os = "none")]

mod critical;
mod flash;
mod probe;

use baliza_board_rtt::TelemetryChannel;
use embassy_sync::blocking_mutex::raw::RawMutex;
use firmware_common::EventLog;
use small_air::uptime_us;
use wire::config::{LoadError, Record};

use flash::Flash;
use probe::Probe;

// Microseconds of virtual time, as in telemetry.
defmt::timestamp!("{=u64:us}", uptime_us());

/// As telemetry calls it.
pub const BOARD: wire::config::Board = wire::config::Board::Simulated;

/// Where the record is.
const PAGES: [u32; 2] = BOARD.pages().offsets;

/// The board, once a program.
pub struct Board {
    /// What its flash holds.
    pub record: Result<Record, LoadError>,
    probe: Probe,
    telemetry: TelemetryChannel,
}

impl Board {
    /// Takes the board, after somebody has written this record into its flash; none where the host takes no files.
    pub fn take(provisioned: &Record) -> Option<Self> {
        let telemetry = baliza_board_rtt::start();
        let mut flash = Flash::erased();
        // What cannot be stored is missed when it is loaded.
        let _ = wire::config::store(&mut flash, PAGES, provisioned);
        let record = wire::config::load(&mut flash, PAGES);
        Probe::attach().map(|probe| Self { record, probe, telemetry })
    }

    /// Puts telemetry into its channel, and what both channels hold into the host's files; false where the host does not take it.
    pub fn take_out<M: RawMutex, const BYTES: usize>(&mut self, event_log: &EventLog<M, BYTES>) -> bool {
        let mut taken = true;
        let mut full = true;
        while taken && full {
            full = false;
            event_log.drain(|frame| {
                full = !self.telemetry.write(frame);
                !full
            });
            taken = self.probe.drain();
        }
        taken
    }
}

/// Ends the program, and QEMU with it.
pub fn exit(success: bool) -> ! {
    semihosting::process::exit(if success { 0 } else { 1 })
}
