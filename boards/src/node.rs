//! What every node's program does beside its role: says why it started and who it is, reads its record, and watches over its tasks.

use core::convert::Infallible;

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_time::Timer;
use firmware_common::supervision::Lit;
use firmware_common::{Settings, build, settings};
use wire::config::{LoadError, Record};
use wire::telemetry::{Condition, Crash, CrashReason, Hello, Reset, ResetCause, Role};

/// Guards what tasks of two priorities share.
pub type Guard = CriticalSectionRawMutex;

/// Bytes of telemetry that wait while the channel is full.
pub const TELEMETRY_BYTES: usize = 1536;

/// A node's reporter. Made at the start, in a `StaticCell`: as an initialised `static` it would lie in flash as well.
pub type Reporter = firmware_common::Reporter<Guard, TELEMETRY_BYTES>;

/// From one look at telemetry, lights and tasks to the next, milliseconds: the channel holds 10 ms of the busiest tag …
const LOOK_MS: u64 = 10;
/// … and from the first on that found nothing to tell.
const QUIET_LOOK_MS: u64 = 100;

/// What a node is told at its start.
pub struct Start {
    /// From flash.
    pub record: Result<Record, LoadError>,
    /// The chip's own EUI-64.
    pub eui: u64,
    /// Why the node started.
    pub reset: ResetCause,
    /// What the life before left.
    pub crash: Option<Crash>,
}

/// Tells why the node started, who it is and, if so, why its record cannot be followed. The node greets in any case.
pub fn introduce(
    reporter: &Reporter,
    board: wire::telemetry::Board,
    role: Role,
    start: Start,
) -> (Hello, Option<(Record, Settings)>) {
    let Start { record, eui, reset, crash } = start;
    let t_us = reporter.now_us();
    reporter.event_log.reset(Reset { t_us, cause: reset, crash });
    let followed = record.and_then(|record| Ok((Settings::of(&record, eui).map_err(LoadError::Invalid)?, record)));
    let (eui, address) = followed.as_ref().map_or((eui, 0xFFFF), |(settings, _)| (settings.eui, settings.address));
    let hello = Hello { t_us, eui, address, role, board, build: *build::BUILD };
    reporter.event_log.greet(hello);
    match followed {
        Ok((settings, record)) => (hello, Some((record, settings))),
        Err(fault) => {
            // Telemetry has the kind, the log what is wrong.
            if let LoadError::Invalid(what) = &fault {
                defmt::error!("{}", what);
            }
            reporter.event_log.state(t_us, Condition::NoRecord(settings::told(&fault)));
            (hello, None)
        }
    }
}

/// The tasks of a node that have to show that they are alive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tasks {
    /// None: the node is quiet.
    None,
    /// An anchor's.
    Ranging,
    /// A tag's.
    RangingAndEngine,
}

impl Tasks {
    /// Whether they are, or which is not.
    pub fn alive(self, reporter: &Reporter) -> Result<(), usize> {
        match self {
            Self::None => Ok(()),
            Self::Ranging => reporter.all_alive(false),
            Self::RangingAndEngine => reporter.all_alive(true),
        }
    }
}

/// Repeats who is speaking, and what was counted.
#[embassy_executor::task]
pub async fn keep_telling(reporter: &'static Reporter, hello: Hello) {
    reporter.keep_telling(hello, embassy_time::Delay).await;
}

/// The supervisor, for ever: lets telemetry out, shows the lights, and feeds the watchdog while `alive` says that all tasks are. Of
/// the first task that misses its heartbeat is written to the crash report, and the watchdog resets the node.
pub async fn supervise(
    reporter: &Reporter,
    mut write: impl FnMut(&[u8]) -> bool,
    mut show: impl FnMut(Lit),
    mut feed: impl FnMut(),
    alive: impl Fn(&Reporter) -> Result<(), usize>,
    leave: impl Fn(Crash),
) -> Infallible {
    loop {
        let mut is_quiet = true;
        reporter.event_log.drain(|frame| {
            is_quiet = false;
            write(frame)
        });
        show(reporter.event_log.lit(reporter.now_us()));
        match alive(reporter) {
            Ok(()) => feed(),
            Err(task) => {
                // The task's place stands for a line.
                let line = u32::try_from(task).unwrap_or(u32::MAX);
                leave(Crash { reason: CrashReason::Stalled, program_counter: 0, line, file: 0 });
            }
        }
        Timer::after_millis(if is_quiet { QUIET_LOOK_MS } else { LOOK_MS }).await;
    }
}
