//! The Bluetooth scan of a tag: when it runs, and what happens when the scanner falls silent.
//!
//! UWB ranging needs the processor within microseconds, but a Bluetooth controller uses it at any time. So a scan's
//! window begins when the radio has reported that it is quiet for that long. The radio of a tag that owns every slot is
//! never quiet. Such a tag scans anyway, an interval late. This costs rounds, which are counted as late.
//!
//! [`Supervisor`] decides, sans-I/O, and [`supervise`] carries out its decisions: for a tag ([`run`]), and for the
//! scanner of `firmware-scanner`, which has no other radio to wait for.

use core::convert::Infallible;

use embassy_futures::select::{Either, select};
use embassy_sync::blocking_mutex::raw::RawMutex;
use embedded_hal_async::delay::DelayNs;
use wire::ble::Advertised;

use crate::channels::{ReceivedAdvertisement, TaskChannels};
use crate::{Quiet, Sink};

/// After this time of scanning without an advertisement, a scanner that has received some before is assumed to hang,
/// microseconds.
const SILENT_US: u64 = 10_000_000;
/// The same for a scanner that has never received any: there may be no sender.
const EVER_SILENT_US: u64 = 30_000_000;

/// A Bluetooth scanner: passive, with duplicates. Each advertisement that it receives goes to `receive`.
#[allow(async_fn_in_trait, reason = "nodes run on one core; no future crosses a thread")]
pub trait Scanner {
    /// Starts to scan, without end.
    async fn start(&mut self);

    /// Stops scanning.
    async fn stop(&mut self);
}

/// When a tag scans, microseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    /// From the start of one window to the start of the next.
    pub interval_us: u64,
    /// The length of a window. If it is not shorter than the interval, the tag scans all the time.
    pub window_us: u64,
}

impl From<wire::config::Scan> for Plan {
    fn from(scan: wire::config::Scan) -> Self {
        let micros = |ms: u16| 1000 * u64::from(ms.max(1));
        Self { interval_us: micros(scan.interval_ms), window_us: micros(scan.window_ms.min(scan.interval_ms)) }
    }
}

/// What is to be done with the scanner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Command {
    /// A window begins.
    Start,
    /// A window ends.
    Stop,
    /// The scanner hangs: stop it and start it again.
    Restart,
}

/// Decides when to scan.
#[derive(Clone, Debug)]
pub struct Supervisor {
    plan: Plan,
    /// Since when the scanner is on; `None` while it is off.
    on_since_us: Option<u64>,
    /// When the next window is due.
    due_us: u64,
    quiet_until_us: u64,
    /// The scanning time since the last advertisement or restart.
    silent_us: u64,
    /// The time up to which `silent_us` is counted.
    judged_us: u64,
    has_heard: bool,
}

impl Supervisor {
    /// A supervisor of a scanner that is off.
    pub const fn new(plan: Plan) -> Self {
        Self { plan, on_since_us: None, due_us: 0, quiet_until_us: 0, silent_us: 0, judged_us: 0, has_heard: false }
    }

    /// Ranging pauses until this time.
    pub fn quiet(&mut self, until_us: u64) {
        self.quiet_until_us = until_us;
    }

    /// An advertisement was received.
    pub fn heard(&mut self, now_us: u64) {
        (self.has_heard, self.silent_us, self.judged_us) = (true, 0, now_us);
    }

    /// The command for now, if any, and the time of the next call at the latest.
    pub fn step(&mut self, now_us: u64) -> (Option<Command>, u64) {
        let Plan { interval_us, window_us } = self.plan;
        let Some(since_us) = self.on_since_us else {
            return self.begin(now_us);
        };
        self.silent_us += now_us.saturating_sub(self.judged_us);
        self.judged_us = now_us;
        let endless = window_us >= interval_us;
        if self.silent_us >= if self.has_heard { SILENT_US } else { EVER_SILENT_US } {
            self.silent_us = 0;
            return (Some(Command::Restart), now_us);
        }
        if endless {
            return (None, now_us + interval_us);
        }
        let end_us = since_us + window_us;
        if now_us < end_us {
            return (None, end_us);
        }
        self.on_since_us = None;
        self.due_us = since_us + interval_us;
        (Some(Command::Stop), self.due_us.max(now_us))
    }

    /// The step while the scanner is off.
    fn begin(&mut self, now_us: u64) -> (Option<Command>, u64) {
        let Plan { interval_us, window_us } = self.plan;
        let latest_us = self.due_us + interval_us;
        let fits = self.quiet_until_us >= now_us + window_us;
        let endless = window_us >= interval_us;
        if now_us < self.due_us {
            return (None, self.due_us);
        }
        if !endless && !fits && now_us < latest_us {
            return (None, latest_us);
        }
        (self.on_since_us, self.judged_us) = (Some(now_us), now_us);
        (Some(Command::Start), now_us + window_us)
    }
}

/// Takes the data of an advertisement that a scanner has just received.
pub fn receive<M: RawMutex>(channels: &TaskChannels<M>, sink: &impl Sink, data: &[u8], rssi_dbm: i8) {
    channels.heard.add();
    // Most advertisements do not come from beacons.
    if let Ok(beacon) = Advertised::parse(data) {
        let dropped = channels.put_sighting(ReceivedAdvertisement { t_us: sink.now_us(), beacon, rssi_dbm });
        sink.heard(dropped);
    }
}

/// What a scanner is supervised by.
#[allow(async_fn_in_trait, reason = "nodes run on one core; no future crosses a thread")]
pub trait Ears {
    /// Microseconds since the node started.
    fn now_us(&self) -> u64;

    /// Advertisements received so far, of whomever. It wraps.
    fn received(&self) -> u32;

    /// Waits until the radio will be quiet, and returns until when, microseconds since the node started.
    async fn next_quiet(&self) -> u64;

    /// The scanner was silent and has been restarted, `times` times so far.
    fn restarted(&self, times: u32);
}

/// A tag's ears.
struct TagEars<'a, M: RawMutex, S> {
    channels: &'a TaskChannels<M>,
    sink: &'a S,
}

impl<M: RawMutex, S: Sink> Ears for TagEars<'_, M, S> {
    fn now_us(&self) -> u64 {
        self.sink.now_us()
    }

    fn received(&self) -> u32 {
        self.channels.heard.get()
    }

    async fn next_quiet(&self) -> u64 {
        let Quiet { until_us } = self.channels.next_quiet().await;
        until_us
    }

    fn restarted(&self, times: u32) {
        self.sink.scanner_restarted(times);
    }
}

/// Runs a tag's scanner for ever.
pub async fn run<M: RawMutex>(
    channels: &TaskChannels<M>,
    plan: Plan,
    scanner: impl Scanner,
    delay: impl DelayNs,
    sink: &impl Sink,
) -> Infallible {
    supervise(plan, scanner, delay, &TagEars { channels, sink }).await
}

/// Runs a scanner for ever, as a [`Supervisor`] decides.
pub async fn supervise(plan: Plan, mut scanner: impl Scanner, mut delay: impl DelayNs, ears: &impl Ears) -> Infallible {
    let mut supervisor = Supervisor::new(plan);
    let (mut received, mut restarts) = (ears.received(), 0_u32);
    loop {
        let now = ears.now_us();
        let count = ears.received();
        if core::mem::replace(&mut received, count) != count {
            supervisor.heard(now);
        }
        let (command, next_us) = supervisor.step(now);
        match command {
            Some(Command::Start) => scanner.start().await,
            Some(Command::Stop) => scanner.stop().await,
            Some(Command::Restart) => {
                scanner.stop().await;
                scanner.start().await;
                restarts = restarts.wrapping_add(1);
                ears.restarted(restarts);
            }
            None => {}
        }
        let wait_us = u32::try_from(next_us.saturating_sub(ears.now_us())).unwrap_or(u32::MAX);
        if let Either::Second(until_us) = select(delay.delay_us(wait_us), ears.next_quiet()).await {
            supervisor.quiet(until_us);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAN: Plan = Plan { interval_us: 1_000_000, window_us: 100_000 };

    /// Steps at the times that the supervisor asks for, up to `end_us`. Returns the commands and their times.
    fn commands(supervisor: &mut Supervisor, from_us: u64, end_us: u64) -> std::vec::Vec<(u64, Command)> {
        let (mut now, mut done) = (from_us, std::vec::Vec::new());
        while now < end_us {
            let (command, next) = supervisor.step(now);
            done.extend(command.map(|command| (now, command)));
            assert!(command.is_some() || next > now, "stands still at {now}");
            now = next;
        }
        done
    }

    #[test]
    fn a_window_begins_where_the_radio_is_quiet_long_enough() {
        let mut supervisor = Supervisor::new(PLAN);
        supervisor.quiet(50_000);
        assert_eq!(supervisor.step(0), (None, 1_000_000));
        supervisor.quiet(390_000);
        assert_eq!(supervisor.step(300_000), (None, 1_000_000));
        supervisor.quiet(500_000);
        assert_eq!(supervisor.step(400_000), (Some(Command::Start), 500_000));
        assert_eq!(supervisor.step(500_000), (Some(Command::Stop), 1_400_000));
    }

    #[test]
    fn a_tag_that_is_never_quiet_is_scanned_an_interval_late() {
        let mut supervisor = Supervisor::new(PLAN);
        let done = commands(&mut supervisor, 0, 5_000_000);
        // Due at 0, 2 s, 4 s: each begins a second later.
        let expected = [1_000_000, 1_100_000, 3_000_000, 3_100_000];
        assert_eq!(done.iter().map(|(at, _)| *at).collect::<std::vec::Vec<_>>(), expected);
        assert_eq!((done[0].1, done[1].1), (Command::Start, Command::Stop));
    }

    #[test]
    fn a_scanner_that_falls_silent_is_restarted_after_ten_seconds_of_scanning() {
        let mut supervisor = Supervisor::new(Plan { interval_us: 1_000_000, window_us: 1_000_000 });
        assert_eq!(supervisor.step(0).0, Some(Command::Start));
        supervisor.heard(4_000_000);
        let done = commands(&mut supervisor, 4_000_000, 40_000_000);
        assert_eq!(
            done,
            [(14_000_000, Command::Restart), (24_000_000, Command::Restart), (34_000_000, Command::Restart)]
        );
    }

    #[test]
    fn one_that_never_heard_anybody_is_given_thirty() {
        let mut supervisor = Supervisor::new(Plan { interval_us: 1_000_000, window_us: 1_000_000 });
        let done = commands(&mut supervisor, 0, 65_000_000);
        assert_eq!(done, [(0, Command::Start), (30_000_000, Command::Restart), (60_000_000, Command::Restart)]);
    }

    #[test]
    fn pauses_are_no_silence() {
        let mut supervisor = Supervisor::new(PLAN);
        supervisor.quiet(u64::MAX);
        supervisor.heard(0);
        // A tenth of the time: ten seconds of scanning take a hundred seconds.
        let done = commands(&mut supervisor, 0, 110_000_000);
        let restarts = done.iter().filter(|(_, command)| *command == Command::Restart).map(|(at, _)| *at);
        assert_eq!(restarts.collect::<std::vec::Vec<_>>(), [99_100_000]);
    }
}
