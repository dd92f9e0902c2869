//! What every node's program does, whatever its role: it reports why it started and its identity, reads its record, and
//! supervises its tasks.

use core::convert::Infallible;

use embassy_futures::join::join;
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embedded_hal_async::delay::DelayNs;
use static_cell::StaticCell;
use wire::config::{Board, Invalid, LoadError, Record};
use wire::telemetry::{Condition, Crash, CrashReason, Hello, RecordError, ResetCause, Role};
use wire::to_node::FrameReader;

use crate::host::HostWatch;
use crate::settings::Cipher;
use crate::supervision::Lit;
use crate::{HostChannel, Settings, introduce};

/// The mutex for data that tasks of two priorities share.
pub type Guard = CriticalSectionRawMutex;

/// Bytes of telemetry that can wait while the channel is full.
pub const TELEMETRY_BYTES: usize = 1536;

/// A node's reporter. It is created at the start, in a `StaticCell`: an initialised `static` would take space in flash
/// as well.
pub type Reporter = crate::Reporter<Guard, TELEMETRY_BYTES>;

/// From one check of telemetry, lights and tasks to the next, milliseconds. The channel holds 10 ms of the busiest tag.
const LOOK_MS: u32 = 10;
/// The same after a check that found no telemetry to send.
const QUIET_LOOK_MS: u32 = 100;

/// What a board knows when it starts.
pub struct Start {
    /// The board.
    pub board: Board,
    /// The clock: microseconds since the start.
    pub clock: fn() -> u64,
    /// The config record from flash.
    pub record: Result<Record, LoadError>,
    /// The chip's own EUI-64.
    pub eui: u64,
    /// Why the node started.
    pub reset: ResetCause,
    /// The crash report of the run before, if there is one.
    pub crash: Option<Crash>,
    /// What the board has for frames with a key.
    pub cipher: Cipher,
}

/// A record that the node can use, and the settings derived from it.
pub struct Configured {
    /// The record.
    pub record: Record,
    /// The settings derived from the record.
    pub settings: Settings,
}

/// The tasks of a node that the supervisor checks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tasks {
    /// None: the node does not transmit.
    None,
    /// The task of an anchor.
    Ranging,
    /// The tasks of a tag.
    RangingAndEngine,
}

/// Fills a `static` with what `make` makes. That is made on the stack first, which is free again when this returns: if
/// this became a part of its caller, it would not be.
#[inline(never)]
pub fn fill<T>(place: &'static StaticCell<T>, make: impl FnOnce() -> T) -> &'static mut T {
    place.init_with(make)
}

/// A node that has started.
pub struct Node {
    /// The board.
    pub board: Board,
    /// The reporter of its tasks.
    pub reporter: &'static Reporter,
    /// The tasks that were spawned.
    pub tasks: Tasks,
    hello: Hello,
}

impl Node {
    /// Reports why the node started, its identity and, if so, why its record cannot be used. The node sends a hello in
    /// any case.
    #[inline(never)]
    #[cold]
    pub fn start(memory: &'static StaticCell<Reporter>, role: Role, start: Start) -> (Self, Option<Configured>) {
        let Start { board, clock, record, eui, reset, crash, cipher } = start;
        let reporter: &_ = fill(memory, || Reporter::new(clock));
        let found = crate::Start { record, eui, reset, crash, cipher };
        let (hello, followed) = introduce(reporter, board, role, found);
        let configured = followed.map(|(record, settings)| Configured { record, settings });
        (Self { board, reporter, tasks: Tasks::None, hello }, configured)
    }

    /// Reports a change of the node's state.
    pub fn report(&self, condition: Condition) {
        self.reporter.event_log.state(self.reporter.now_us(), condition);
    }

    /// Reports that the record cannot be used. Telemetry has the kind of the fault, the log has the details.
    pub fn refuse(&self, what: &Invalid) {
        #[cfg(feature = "defmt")]
        defmt::error!("{}", what);
        let _ = what;
        self.report(Condition::NoRecord(RecordError::Invalid));
    }

    /// Repeats the hello and the counters, for ever.
    pub async fn keep_telling(&self, delay: impl DelayNs) -> Infallible {
        self.reporter.keep_telling(self.hello, delay).await
    }

    /// The supervisor, for ever. It sends telemetry, shows the lights, and feeds the watchdog while all tasks are
    /// alive. It also repeats the hello. When a task misses its heartbeat, the first such task is written to the crash
    /// record, and the watchdog resets the node.
    pub async fn supervise<D: DelayNs + Clone>(
        self,
        delay: D,
        channel: impl HostChannel,
        show: impl FnMut(Lit),
        feed: impl FnMut(),
        leave: impl Fn(Crash),
    ) -> Infallible {
        join(self.watch(delay.clone(), channel, show, feed, leave), self.keep_telling(delay)).await.0
    }

    async fn watch(
        &self,
        mut delay: impl DelayNs,
        mut channel: impl HostChannel,
        mut show: impl FnMut(Lit),
        mut feed: impl FnMut(),
        leave: impl Fn(Crash),
    ) -> Infallible {
        let reporter = self.reporter;
        let mut host = HostWatch::default();
        let mut messages = FrameReader::new();
        loop {
            let mut is_quiet = true;
            take_messages(reporter, &mut channel, &mut messages);
            reporter.host.set(host.look(reporter.now_us(), channel.is_read()));
            reporter.event_log.drain(|frame| {
                is_quiet = false;
                let written = channel.write(frame);
                if written {
                    host.note_write();
                }
                written
            });
            show(reporter.event_log.lit(reporter.now_us()));
            match self.tasks.alive(reporter) {
                Ok(()) => feed(),
                Err(task) => {
                    // The crash record has the task's number in the field of the line.
                    let line = u32::try_from(task).unwrap_or(u32::MAX);
                    leave(Crash { reason: CrashReason::Stalled, program_counter: 0, line, file: 0 });
                }
            }
            delay.delay_ms(if is_quiet { QUIET_LOOK_MS } else { LOOK_MS }).await;
        }
    }
}

/// Passes the host's messages to tags on to the exchange. What it has no room for stays in the channel.
#[inline(never)]
fn take_messages(reporter: &Reporter, channel: &mut impl HostChannel, messages: &mut FrameReader) {
    let mut byte = [0];
    while !reporter.host.has_message() && channel.read(&mut byte) > 0 {
        if let Some(message) = messages.feed(byte[0]) {
            reporter.host.put(message);
        }
    }
}

impl Tasks {
    /// Whether all tasks are alive, or else the number of the first that is not.
    fn alive(self, reporter: &Reporter) -> Result<(), usize> {
        match self {
            Self::None => Ok(()),
            Self::Ranging => reporter.all_alive(false),
            Self::RangingAndEngine => reporter.all_alive(true),
        }
    }
}
