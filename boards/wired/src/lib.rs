//! A board in QEMU with a DW1000 that is simulated outside. For every transaction on the bus, every interrupt and every
//! wait, the board sends a request to a simulated world over a pipe (`qemu_link`). The world advances its time by the
//! instructions that were executed in between.
//!
//! As on a DWM1001 there are two executors: ranging in the upper one; engine, telemetry and the rest in the lower one.
//! A step of the lower executor is executed at once. Its time passes while the upper one waits, and there is no other
//! step before its time has passed.
#![no_std]
#![cfg(target_os = "none")]

mod clock;
mod executor;
mod lines;
mod pipe;
mod timers;

use baliza_board_rtt::TelemetryChannel;
use baliza_dw1000::driver::Dw1000;
use embassy_executor::Spawner;
use firmware_common::HostChannel;
use firmware_common::node::{self, Node};
use firmware_common::settings::Cipher;
use qemu_link::{NodeStart, Request};
use wire::config::Record;
use wire::telemetry::ResetCause;
use wire::uwb::native::software_code;

use executor::Executors;
use pipe::PIPE;

pub use clock::uptime_us;
pub use lines::{Bus, Interrupt, Reset};
pub use timers::Delay;

/// The board's name in telemetry.
pub const BOARD: wire::config::Board = wire::config::Board::Simulated;

/// The DW1000's driver.
pub type Radio = Dw1000<Bus, Interrupt, Reset, Delay>;

defmt::timestamp!("{=u64:us}", uptime_us());

/// The DW1000's parts.
pub type Uwb = baliza_dw1000::Parts<Bus, Interrupt, Reset, Delay>;

/// The board after its start.
pub struct Board {
    /// The DW1000's parts.
    pub uwb: Uwb,
    /// The delay for the exchange's waits.
    pub delay: Delay,
    /// The inputs of the node's start.
    pub start: node::Start,
    /// The executors of the node's tasks.
    pub care: Care,
}

/// The executors, and the channel of telemetry.
pub struct Care {
    executors: Executors,
    telemetry: TelemetryChannel,
}

impl Board {
    /// Takes the board. May be called once in a program's run.
    pub fn take() -> Self {
        clock::start();
        let telemetry = baliza_board_rtt::start();
        let record = PIPE.open(|pipe| {
            pipe.ask(Request::Start, |answer| {
                let NodeStart { instruction_ps, record } =
                    NodeStart::decode(answer.body).expect("the world says how to start");
                clock::set_instruction_ps(instruction_ps);
                wire::config::decode(record).map(|(record, _): (Record, u32)| record)
            })
        });
        let seed = record.as_ref().ok().and_then(|record| record.identity.address).unwrap_or_default().into();
        let [delay, driver_delay] = Delay::take();
        Self {
            uwb: Uwb { bus: Bus, interrupt: Interrupt, reset: Reset, delay: driver_delay },
            delay,
            // The record contains the node's address.
            start: node::Start {
                board: BOARD,
                clock: uptime_us,
                record,
                eui: 0xDECA_0000_0000_0000,
                reset: ResetCause::PowerOn,
                crash: None,
                // Nobody attacks a simulated world: the start of a node may be foreseen.
                cipher: Cipher { seed, make_code: software_code },
            },
            care: Care { executors: Executors::take(), telemetry },
        }
    }
}

impl Care {
    /// The spawner of ranging's tasks.
    pub fn ranging(&self) -> Spawner {
        self.executors.ranging()
    }

    /// The spawner of all other tasks.
    pub fn background(&self) -> Spawner {
        self.executors.background()
    }

    /// Runs the spawned tasks until the simulated world ends. Then it ends the program and QEMU.
    pub fn run(mut self, node: Node) -> ! {
        let reporter = node.reporter;
        // The world reads all telemetry.
        reporter.host.set(true);
        self.background().spawn(keep_telling(node).unwrap());
        self.executors.run(|| {
            reporter.event_log.drain(|frame| {
                // The channel has no reader. It is full soon, as on a board without a probe.
                self.telemetry.write(frame);
                PIPE.ask(Request::Telemetry(frame), |_| ());
                true
            });
        });
        reporter.event_log.log(reporter.counts.told(reporter.now_us(), reporter.event_log.dropped()));
        reporter.event_log.drain(|frame| {
            PIPE.ask(Request::Telemetry(frame), |_| ());
            true
        });
        semihosting::process::exit(0)
    }
}

/// Repeats the hello and the counters.
#[embassy_executor::task]
async fn keep_telling(node: Node) {
    node.keep_telling(embassy_time::Delay).await;
}
