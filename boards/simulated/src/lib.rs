//! A board without hardware, in QEMU: Cortex-M4F (mps2-an386) or RISC-V without FPU (virt). Its radio is that of the
//! small air, and its flash is memory. The program is its own debug probe: it copies RTT's channels to two files of the
//! host by semihosting.
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

/// The board's name in telemetry.
pub const BOARD: wire::config::Board = wire::config::Board::Simulated;

/// The offsets of the record's pages.
const PAGES: [u32; 2] = BOARD.pages().offsets;

/// The board. There is one in a program.
pub struct Board {
    /// The record in its flash.
    pub record: Result<Record, LoadError>,
    probe: Probe,
    telemetry: TelemetryChannel,
}

impl Board {
    /// Takes the board, after this record was written into its flash. `None` if the host refuses the files.
    pub fn take(provisioned: &Record) -> Option<Self> {
        let telemetry = baliza_board_rtt::start();
        let mut flash = Flash::erased();
        // A record that cannot be stored is missing when it is loaded.
        let _ = wire::config::store(&mut flash, PAGES, provisioned);
        let record = wire::config::load(&mut flash, PAGES);
        Probe::attach().map(|probe| Self { record, probe, telemetry })
    }

    /// Writes telemetry into its channel, and the content of both channels into the host's files. Returns false if the
    /// host refuses it.
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

/// Ends the program and QEMU.
pub fn exit(success: bool) -> ! {
    semihosting::process::exit(if success { 0 } else { 1 })
}
