//! Supervision: whether all tasks are alive, so that the watchdog may be fed, and what the lights show of the node's
//! state.

use core::sync::atomic::{AtomicU32, Ordering};

use wire::serial_number::SerialNumber;
use wire::telemetry::Condition;

/// The heartbeat of one task, for a `static`. The task beats, and the supervisor checks.
#[derive(Debug)]
pub struct Heartbeat {
    /// The last beat, milliseconds since the start. It wraps.
    last_ms: AtomicU32,
    patience_ms: u32,
}

impl Heartbeat {
    /// The heartbeat of a task that has `patience_ms` milliseconds from one beat to the next. The first period begins
    /// at the start.
    pub const fn new(patience_ms: u32) -> Self {
        Self { last_ms: AtomicU32::new(0), patience_ms }
    }

    /// Notes that the task is alive at `t_us`. The time may lie less than 24 days ahead: so a task announces a rest.
    pub fn beat(&self, t_us: u64) {
        self.last_ms.store(millis(t_us), Ordering::Relaxed);
    }

    /// Whether the last beat is recent enough.
    pub fn is_alive(&self, t_us: u64) -> bool {
        // A beat may come during this check, so that it is later than `t_us`.
        let since = SerialNumber(millis(t_us)).minus(self.last_ms.load(Ordering::Relaxed));
        since <= i32::try_from(self.patience_ms).unwrap_or(i32::MAX)
    }
}

/// Milliseconds; wraps after 49 days.
fn millis(t_us: u64) -> u32 {
    (t_us / 1000) as u32
}

/// Whether the watchdog may be fed, because every task is alive.
///
/// # Errors
/// A task is silent: the index of the first such task.
pub fn all_alive(t_us: u64, heartbeats: &[&Heartbeat]) -> Result<(), usize> {
    heartbeats.iter().position(|heartbeat| !heartbeat.is_alive(t_us)).map_or(Ok(()), Err)
}

/// Which lights are on. A board with one light shows it if either is on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Lit {
    /// The light that shows the node's progress in joining its network.
    pub state: bool,
    /// The light that shows a fault.
    pub fault: bool,
}

/// What the lights show. It depends on the state and the time only.
///
/// | state | light | pattern |
/// |---|---|---|
/// | no record, or a wrong one | fault | on and off, each half a second |
/// | radio failed | fault | on and off, each a tenth of a second |
/// | searching | state | a flash of 50 ms a second |
/// | synchronised, network-full | state | two flashes a second |
/// | paired, joined, coordinating, following, advertising | state | on |
///
/// A restart of the scanner does not change the lights. A map that is not used does not change them either. A tag that a
/// person looks for shows its state's light a quarter of a second on and off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lights {
    shown: Condition,
    /// A person looks for this node until then, microseconds since the start.
    wanted_until_us: u64,
}

impl Default for Lights {
    fn default() -> Self {
        Self::new()
    }
}

impl Lights {
    /// The lights of a node that has reported no state yet.
    pub const fn new() -> Self {
        Self { shown: Condition::Searching, wanted_until_us: 0 }
    }

    /// A person looks for this node until `until_us`.
    pub fn identify(&mut self, until_us: u64) {
        self.wanted_until_us = until_us;
    }

    /// Shows this state from now on.
    pub fn show(&mut self, condition: Condition) {
        match condition {
            Condition::ScannerRestarted(_)
            | Condition::Unused(..)
            | Condition::BeaconMoved(_)
            | Condition::BeaconDuplicated(_)
            | Condition::BeaconRestored(_)
            | Condition::MotionSensor(_) => {}
            Condition::NoRecord(_)
            | Condition::WrongRecord
            | Condition::Searching
            | Condition::Paired(_)
            | Condition::Synchronised(_)
            | Condition::NetworkFull
            | Condition::Unlisted
            | Condition::Joined(_)
            | Condition::Coordinating
            | Condition::Following(_)
            | Condition::RadioFailed(_)
            | Condition::Advertising => self.shown = condition,
        }
    }

    /// Which lights are on at this time. 20 calls a second are enough to show every pattern.
    pub fn at(&self, t_us: u64) -> Lit {
        let ms = (t_us / 1000 % 1000) as u32;
        if t_us < self.wanted_until_us {
            return Lit { state: ms % 500 < 250, fault: false };
        }
        let (state, fault) = match self.shown {
            Condition::NoRecord(_) | Condition::WrongRecord => (false, ms < 500),
            Condition::RadioFailed(_) => (false, ms % 200 < 100),
            Condition::Searching
            | Condition::ScannerRestarted(_)
            | Condition::Unused(..)
            | Condition::BeaconMoved(_)
            | Condition::BeaconDuplicated(_)
            | Condition::BeaconRestored(_)
            | Condition::MotionSensor(_) => (ms < 50, false),
            Condition::Synchronised(_) | Condition::NetworkFull | Condition::Unlisted => {
                (ms < 50 || (200..250).contains(&ms), false)
            }
            Condition::Paired(_)
            | Condition::Joined(_)
            | Condition::Coordinating
            | Condition::Following(_)
            | Condition::Advertising => (true, false),
        };
        Lit { state, fault }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wire::telemetry::RecordError;

    #[test]
    fn who_said_that_it_rests_is_silent_until_then() {
        let task = Heartbeat::new(1000);
        task.beat(64_000_000);
        assert!(task.is_alive(2_000_000) && task.is_alive(64_999_000));
        assert!(!task.is_alive(65_002_000));
    }

    #[test]
    fn one_silent_task_is_enough_and_is_named() {
        let tasks = [Heartbeat::new(100), Heartbeat::new(1000)];
        let all = [&tasks[0], &tasks[1]];
        assert_eq!(all_alive(100_999, &all), Ok(()));
        assert_eq!(all_alive(101_000, &all), Err(0));
        tasks[0].beat(1_050_000);
        assert_eq!(all_alive(1_100_000, &all), Err(1));
        tasks[1].beat(1_050_000);
        assert_eq!(all_alive(1_100_000, &all), Ok(()));
    }

    #[test]
    fn heartbeats_go_on_across_the_wrap() {
        // 2³² ms.
        let wrap_us = 4_294_967_296_000_u64;
        let task = Heartbeat::new(100);
        task.beat(wrap_us - 50_000);
        assert!(task.is_alive(wrap_us + 40_000));
        assert!(!task.is_alive(wrap_us + 60_000));
        task.beat(wrap_us + 60_000);
        assert!(task.is_alive(wrap_us + 59_000));
    }

    #[test]
    fn each_state_has_its_pattern() {
        // Twenty checks a second: in how many of them each light is on.
        let lit = |condition| {
            let mut lights = Lights::default();
            lights.show(condition);
            let looks = || (0..20).map(|look| lights.at(50_000 * look));
            (looks().filter(|lit| lit.state).count(), looks().filter(|lit| lit.fault).count())
        };
        assert_eq!(lit(Condition::NoRecord(RecordError::Missing)), (0, 10));
        assert_eq!(lit(Condition::RadioFailed(3)), (0, 10));
        assert_eq!(lit(Condition::Searching), (1, 0));
        assert_eq!(lit(Condition::Synchronised(1)), (2, 0));
        assert_eq!(lit(Condition::NetworkFull), (2, 0));
        assert_eq!(lit(Condition::Unlisted), (2, 0));
        assert_eq!(lit(Condition::Joined(1)), (20, 0));
    }

    #[test]
    fn who_is_looked_for_flashes_until_then_and_shows_its_state_again() {
        let mut lights = Lights::default();
        lights.show(Condition::RadioFailed(1));
        lights.identify(10_000_000);
        let on = |from_us: u64| (0..20).map(|look| lights.at(from_us + 50_000 * look)).filter(|lit| lit.state).count();
        assert_eq!((on(9_000_000), on(10_000_000)), (10, 0));
        assert!((0..20).all(|look| !lights.at(9_000_000 + 50_000 * look).fault));
        assert!(lights.at(10_000_000).fault);
    }

    #[test]
    fn a_restarted_scanner_changes_nothing() {
        let mut lights = Lights::default();
        lights.show(Condition::Joined(2));
        let before = lights;
        lights.show(Condition::ScannerRestarted(1));
        assert_eq!(lights, before);
    }
}
