//! Shared code of the system tests: runs a scenario to its end and queries its records.
#![forbid(unsafe_code)]

use sim::scenario::{RangeRecord, Record, Scenario, SimulatedEpoch, Simulation, Summary, What};
use wire::telemetry::{Condition, Message, MotionSensor};

/// A scenario that has been run.
pub struct Run {
    /// All records, in the order of time.
    pub records: Vec<Record>,
    /// The figures.
    pub summary: Summary,
}

impl Run {
    /// Runs a scenario.
    pub fn of(scenario: Scenario) -> Self {
        let seconds = scenario.seconds;
        let mut simulation = Simulation::new(scenario);
        let records = simulation.run_until(seconds);
        Self { records, summary: simulation.summary() }
    }

    /// Runs the text of a scenario file.
    ///
    /// # Panics
    /// Panics if the text is not a scenario.
    pub fn of_text(text: &str) -> Self {
        match Scenario::parse(text) {
            Ok(scenario) => Self::of(scenario),
            Err(error) => panic!("the test's scenario, {error}"),
        }
    }

    /// The epochs of a tag with their times.
    pub fn epochs(&self, tag: u16) -> impl Iterator<Item = (f64, &SimulatedEpoch)> {
        let of_tag = self.records.iter().filter(move |record| record.node == tag);
        of_tag.filter_map(|record| Some((record.t_s, record.epoch()?)))
    }

    /// The changes of a tag's state with their times.
    pub fn states(&self, tag: u16) -> impl Iterator<Item = (f64, Condition)> {
        let of_tag = self.records.iter().filter(move |record| record.node == tag);
        of_tag.filter_map(|record| match record.what {
            What::Message(Message::State(state)) => Some((record.t_s, state.is)),
            What::Message(_) | What::Epoch(_) | What::Fault(_) => None,
        })
    }

    /// A tag's reports on the condition of beacons, with the times.
    pub fn words(&self, tag: u16) -> Vec<(f64, Condition)> {
        let is_of_beacon = |is: &Condition| {
            matches!(
                is,
                Condition::BeaconMoved(_)
                    | Condition::BeaconDuplicated(_)
                    | Condition::BeaconRestored(_)
                    | Condition::Unused(..)
            )
        };
        self.states(tag).filter(|(_, is)| is_of_beacon(is)).collect()
    }

    /// The reported states of a tag's motion sensor, with the times.
    pub fn motion_sensor(&self, tag: u16) -> Vec<(f64, MotionSensor)> {
        let sensor = |is| if let Condition::MotionSensor(state) = is { Some(state) } else { None };
        self.states(tag).filter_map(|(t_s, is)| Some((t_s, sensor(is)?))).collect()
    }

    /// The times of a tag's positions within an interval.
    pub fn fix_times(&self, tag: u16, from_s: f64, to_s: f64) -> Vec<f64> {
        let within = |t_s: &f64| (from_s..=to_s).contains(t_s);
        self.epochs(tag).filter(|(_, epoch)| epoch.fix.reason().is_none()).map(|(t_s, _)| t_s).filter(within).collect()
    }

    /// The longest time without a position within an interval, seconds.
    pub fn longest_gap(&self, tag: u16, from_s: f64, to_s: f64) -> f64 {
        let times = self.fix_times(tag, from_s, to_s);
        let ends = times.iter().copied().chain([to_s]);
        let mut last = from_s;
        ends.map(|t_s| t_s - std::mem::replace(&mut last, t_s)).fold(0.0, f64::max)
    }

    /// A tag's ranges to an anchor within an interval.
    pub fn ranges(&self, tag: u16, anchor: u16, from_s: f64, to_s: f64) -> Vec<RangeRecord> {
        let epochs = self.epochs(tag).filter(|(t_s, _)| (from_s..=to_s).contains(t_s));
        epochs.flat_map(|(_, epoch)| &epoch.ranges).filter(|range| range.range.peer == anchor).copied().collect()
    }

    /// Mean and standard deviation of the measured minus the true distance, metres.
    pub fn range_error(&self, tag: u16, anchor: u16, from_s: f64, to_s: f64) -> (f64, f64) {
        let ranges = self.ranges(tag, anchor, from_s, to_s);
        moments(ranges.iter().map(|range| range.range.distance_m() - range.truth_m))
    }
}

/// Mean and standard deviation.
pub fn moments(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let values: Vec<f64> = values.collect();
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let variance = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / values.len() as f64;
    (mean, variance.sqrt())
}

/// The text of a site with a hall of 20 m × 12 m with `anchors` anchors around, without walls, on the ideal air, with
/// more keys of its simulation, and tags that walk along these paths in the plane. More text may follow.
pub fn hall(simulation: &str, anchors: usize, paths: &[&str]) -> String {
    let mut text = format!("[simulation]\nair = \"ideal\"\n{simulation}\n");
    for i in 0..anchors {
        let angle = std::f64::consts::TAU * i as f64 / anchors as f64;
        let (x, y) = (10.0 + 9.0 * angle.cos(), 6.0 + 5.0 * angle.sin());
        text += &anchor([x, y, 2.5], "");
    }
    text + &paths.iter().map(|path| tag("", &format!("path_m = {path}\nclosed = true"))).collect::<String>()
}

/// The text of an anchor, with what more its simulation has.
pub fn anchor([x, y, z]: [f64; 3], simulation: &str) -> String {
    let position = format!("position_m = [{x:.3}, {y:.3}, {z}]");
    format!("[[node]]\nrole = \"anchor\"\n{position}\nsimulation = {{ {simulation} }}\n")
}

/// The text of a tag that is carried 1.2 m high, with more keys of its record, and what its simulation has.
pub fn tag(record: &str, simulation: &str) -> String {
    format!("[[node]]\nrole = \"tag\"\nheight_m = 1.2\n{record}\n[node.simulation]\n{simulation}\n")
}

/// The text of a fault: `off`, `on` or `reset`.
pub fn fault(at_s: f64, node: u16, what: &str) -> String {
    format!("[[simulation.fault]]\nat_s = {at_s}\nnode = {node}\nwhat = \"{what}\"\n")
}

/// The first tag's address in a scenario without addresses.
pub const TAG: u16 = 0x1001;
/// A path through the hall.
pub const WALK: &str = "[[4, 3, 1.2], [16, 3, 1.2], [16, 9, 1.2], [4, 9, 1.2]]";
/// A position in the hall.
pub const STAND: &str = "[[8, 5, 1.2]]";
