//! What every node's program does beside its role: says why it started and who it is, reads its record, and watches over its tasks.

use core::convert::Infallible;

use embassy_futures::join::join;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embedded_hal_async::delay::DelayNs;
use embedded_hal_async::digital::Wait;
use ranging::dw1000::{self, ClockedSpi, Dw1000, ResetLine};
use static_cell::StaticCell;
use wire::config::{Board, Invalid, LoadError, Record};
use wire::telemetry::{Condition, Crash, CrashReason, Hello, RecordError, ResetCause, Role};

use crate::supervision::Lit;
use crate::{Settings, introduce};

/// Guards what tasks of two priorities share.
pub type Guard = CriticalSectionRawMutex;

/// Bytes of telemetry that wait while the channel is full.
pub const TELEMETRY_BYTES: usize = 1536;

/// A node's reporter. Made at the start, in a `StaticCell`: as an initialised `static` it would lie in flash as well.
pub type Reporter = crate::Reporter<Guard, TELEMETRY_BYTES>;

/// From one look at telemetry, lights and tasks to the next, milliseconds: the channel holds 10 ms of the busiest tag …
const LOOK_MS: u32 = 10;
/// … and from the first on that found nothing to send.
const QUIET_LOOK_MS: u32 = 100;

/// What a board gives the DW1000's driver.
pub struct Uwb<S, I, R, D> {
    /// SPI with the chip's select line.
    pub bus: S,
    /// High while the chip has something to say.
    pub interrupt: I,
    /// RSTn.
    pub reset: R,
    /// For the driver's waits.
    pub delay: D,
}

impl<S: ClockedSpi, I: Wait, R: ResetLine, D: DelayNs> Uwb<S, I, R, D> {
    /// The driver.
    pub fn radio(self, config: dw1000::Config) -> Dw1000<S, I, R, D> {
        Dw1000::new(self.bus, self.interrupt, self.reset, self.delay, config)
    }
}

/// What a board knows at its start.
pub struct Start {
    /// The board.
    pub board: Board,
    /// Microseconds since the start.
    pub clock: fn() -> u64,
    /// From flash.
    pub record: Result<Record, LoadError>,
    /// The chip's own EUI-64.
    pub eui: u64,
    /// Why the node started.
    pub reset: ResetCause,
    /// What a crash before the start left.
    pub crash: Option<Crash>,
}

/// A record that the node follows, and what it means.
pub struct Configured {
    /// The record.
    pub record: Record,
    /// Made of it.
    pub settings: Settings,
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

/// A node that has started.
pub struct Node {
    /// Its board.
    pub board: Board,
    /// What its tasks report to.
    pub reporter: &'static Reporter,
    /// The tasks that were spawned.
    pub tasks: Tasks,
    hello: Hello,
}

impl Node {
    /// Reports why the node started, who it is and, if so, why its record cannot be followed. The node greets in any case.
    #[inline(never)]
    pub fn start(memory: &'static StaticCell<Reporter>, role: Role, start: Start) -> (Self, Option<Configured>) {
        let Start { board, clock, record, eui, reset, crash } = start;
        let reporter: &_ = memory.init_with(|| Reporter::new(clock));
        let found = crate::Start { record, eui, reset, crash };
        let (hello, followed) = introduce(reporter, board, role, found);
        let configured = followed.map(|(record, settings)| Configured { record, settings });
        (Self { board, reporter, tasks: Tasks::None, hello }, configured)
    }

    /// Reports a change of the node's state.
    pub fn report(&self, condition: Condition) {
        self.reporter.event_log.state(self.reporter.now_us(), condition);
    }

    /// Reports that the record cannot be followed. Telemetry has the kind, the log what is wrong.
    pub fn refuse(&self, what: &Invalid) {
        #[cfg(feature = "defmt")]
        defmt::error!("{}", what);
        let _ = what;
        self.report(Condition::NoRecord(RecordError::Invalid));
    }

    /// Repeats who is speaking, and what was counted, for ever.
    pub async fn keep_telling(&self, delay: impl DelayNs) -> Infallible {
        self.reporter.keep_telling(self.hello, delay).await
    }

    /// The supervisor, for ever: lets telemetry out, shows the lights, and feeds the watchdog while all tasks are alive; the node greets
    /// again now and then. The first task that misses its heartbeat is written to the crash record, and the watchdog resets the node.
    pub async fn supervise<D: DelayNs + Clone>(
        self,
        delay: D,
        write: impl FnMut(&[u8]) -> bool,
        show: impl FnMut(Lit),
        feed: impl FnMut(),
        leave: impl Fn(Crash),
    ) -> Infallible {
        join(self.watch(delay.clone(), write, show, feed, leave), self.keep_telling(delay)).await.0
    }

    async fn watch(
        &self,
        mut delay: impl DelayNs,
        mut write: impl FnMut(&[u8]) -> bool,
        mut show: impl FnMut(Lit),
        mut feed: impl FnMut(),
        leave: impl Fn(Crash),
    ) -> Infallible {
        let reporter = self.reporter;
        loop {
            let mut is_quiet = true;
            reporter.event_log.drain(|frame| {
                is_quiet = false;
                write(frame)
            });
            show(reporter.event_log.lit(reporter.now_us()));
            match self.tasks.alive(reporter) {
                Ok(()) => feed(),
                Err(task) => {
                    // The task's number stands for a line.
                    let line = u32::try_from(task).unwrap_or(u32::MAX);
                    leave(Crash { reason: CrashReason::Stalled, program_counter: 0, line, file: 0 });
                }
            }
            delay.delay_ms(if is_quiet { QUIET_LOOK_MS } else { LOOK_MS }).await;
        }
    }
}

impl Tasks {
    /// Whether they are alive, or which is not.
    fn alive(self, reporter: &Reporter) -> Result<(), usize> {
        match self {
            Self::None => Ok(()),
            Self::Ranging => reporter.all_alive(false),
            Self::RangingAndEngine => reporter.all_alive(true),
        }
    }
}
