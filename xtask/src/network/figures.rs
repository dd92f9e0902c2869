//! The figures that are compared.

use dw1000_sim::{Node, TrueTime};
use sim::scenario::{Scenario, Simulation, What};
use wire::telemetry::Message;

use super::scene::NetworkRun;

/// The figures of a network.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Figures {
    /// The time of the first position, seconds; the end, where there was none.
    pub first_s: f64,
    /// Positions a second, from the first one on.
    pub fixes_per_s: f64,
    /// Ranges a round, from the first position on.
    pub ranges_a_round: f64,
    /// Frames a second.
    pub frames_per_s: f64,
    /// Late starts of all nodes, a second.
    pub late_per_s: f64,
    /// Transactions on the buses of all nodes, a second.
    pub transactions_per_s: f64,
    /// Run time of the tag's processor for each frame on the air, microseconds.
    pub tag_us_a_frame: f64,
    /// The same for an anchor's processor, on average.
    pub anchor_us_a_frame: f64,
}

/// One figure.
type Figure = fn(&Figures) -> f64;

/// A round: the time of its position, or of the failure, and its number of ranges.
struct Round {
    t_s: f64,
    ranges: usize,
    is_fix: bool,
}

impl Figures {
    /// The figures of images.
    pub fn of_images(outcome: &NetworkRun, seconds: f64) -> Self {
        let mut rounds = Vec::new();
        for tag in &outcome.tags {
            let mut ranges = 0;
            for (time, message) in &tag.life.telemetry {
                if let Message::Range(_) = message {
                    ranges += 1;
                }
                if let Message::Fix(fix) = message {
                    let (ranges, is_fix) = (std::mem::take(&mut ranges), fix.position_m().is_some());
                    rounds.push(Round { t_s: time.as_secs_f64(), ranges, is_fix });
                }
            }
        }
        let tags: Vec<_> = outcome.tags.iter().map(|tag| &tag.node).collect();
        let anchors: Vec<_> = outcome.anchors.iter().map(|anchor| &anchor.node).collect();
        Self::of(&rounds, seconds, outcome.air.frames_sent, &tags, &anchors)
    }

    /// The figures of a simulation.
    pub fn of_simulation(scenario: &Scenario) -> Self {
        let mut simulation = Simulation::new(scenario.clone());
        let records = simulation.run_until(scenario.seconds);
        let mut rounds = Vec::new();
        for record in &records {
            if let What::Epoch(epoch) = &record.what {
                let (ranges, is_fix) = (epoch.ranges.len(), epoch.fix.reason().is_none());
                rounds.push(Round { t_s: record.t_s, ranges, is_fix });
            }
        }
        let tags: Vec<_> = scenario.tags.iter().filter_map(|tag| simulation.node(tag.address)).collect();
        let anchors: Vec<_> = scenario.anchors.iter().filter_map(|anchor| simulation.node(anchor.address)).collect();
        Self::of(&rounds, scenario.seconds, simulation.summary().frames_sent, &tags, &anchors)
    }

    fn of(rounds: &[Round], seconds: f64, frames: u64, tags: &[&Node], anchors: &[&Node]) -> Self {
        let end = TrueTime::from_secs_f64(seconds);
        let chips = || tags.iter().chain(anchors).map(|node| node.chip_statistics());
        let busy = |nodes: &[&Node]| {
            let running: f64 = nodes.iter().map(|node| node.processor().times(end).running.as_secs_f64()).sum();
            quotient(1e6 * running, (nodes.len() as u64 * frames) as f64)
        };
        Self {
            frames_per_s: quotient(frames as f64, seconds),
            late_per_s: quotient(chips().map(|chip| chip.late as f64).sum(), seconds),
            transactions_per_s: quotient(chips().map(|chip| chip.transactions as f64).sum(), seconds),
            tag_us_a_frame: busy(tags),
            anchor_us_a_frame: busy(anchors),
            ..Self::of_rounds(rounds, seconds)
        }
    }

    fn of_rounds(rounds: &[Round], seconds: f64) -> Self {
        let first_s = rounds.iter().find(|round| round.is_fix).map_or(seconds, |round| round.t_s);
        let counted = || rounds.iter().filter(|round| round.t_s > first_s);
        let fixes = counted().filter(|round| round.is_fix).count() as f64;
        let ranges = counted().map(|round| round.ranges as f64).sum();
        Self {
            first_s,
            fixes_per_s: quotient(fixes, seconds - first_s),
            ranges_a_round: quotient(ranges, counted().count() as f64),
            ..Self::default()
        }
    }

    /// A table of the figures of images and simulation.
    pub fn table(&self, simulation: &Self) -> String {
        let rows: [(&str, Figure); 8] = [
            ("first position, s", |it| it.first_s),
            ("positions a second", |it| it.fixes_per_s),
            ("ranges a round", |it| it.ranges_a_round),
            ("late starts a second", |it| it.late_per_s),
            ("frames a second", |it| it.frames_per_s),
            ("transactions a second", |it| it.transactions_per_s),
            ("tag's processor, us a frame", |it| it.tag_us_a_frame),
            ("an anchor's, us a frame", |it| it.anchor_us_a_frame),
        ];
        let mut text = format!("{:28} {:>10} {:>10} {:>8}\n", "", "images", "simulate", "apart");
        for (name, figure) in rows {
            let (ours, theirs) = (figure(self), figure(simulation));
            let apart = 100.0 * difference(ours, theirs);
            text += &format!("{name:28} {ours:10.3} {theirs:10.3} {apart:+7.1}%\n");
        }
        text
    }

    /// The figures that differ by more than `tolerance`, a share.
    pub fn disagreements(&self, simulation: &Self, tolerance: f64) -> Vec<String> {
        let mut found = Vec::new();
        let compared = [
            ("positions a second", self.fixes_per_s, simulation.fixes_per_s),
            ("ranges a round", self.ranges_a_round, simulation.ranges_a_round),
        ];
        for (name, ours, theirs) in compared {
            if !(difference(ours, theirs).abs() <= tolerance) {
                found.push(format!("{name}: images {ours:.1}, simulation {theirs:.1}"));
            }
        }
        // A few of thousands may be late by chance, so that their share of all frames is compared.
        let (ours, theirs) = (self.late_per_s, simulation.late_per_s);
        if !((ours - theirs).abs() <= tolerance * ours.max(theirs).max(0.01 * simulation.frames_per_s)) {
            found.push(format!("late starts a second: images {ours:.1}, simulation {theirs:.1}"));
        }
        if self.fixes_per_s == 0.0 && simulation.fixes_per_s == 0.0 {
            found.push("neither finds a position".to_owned());
        }
        found
    }
}

/// The quotient; zero where the divisor is zero.
fn quotient(part: f64, of: f64) -> f64 {
    if of > 0.0 { part / of } else { 0.0 }
}

/// The relative difference of `ours` from `theirs`.
fn difference(ours: f64, theirs: f64) -> f64 {
    if ours == theirs { 0.0 } else { (ours - theirs) / theirs }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALIKE: Figures = Figures {
        first_s: 0.5,
        fixes_per_s: 400.0,
        ranges_a_round: 4.0,
        frames_per_s: 2000.0,
        late_per_s: 0.0,
        transactions_per_s: 50_000.0,
        tag_us_a_frame: 200.0,
        anchor_us_a_frame: 100.0,
    };

    #[test]
    fn rounds_count_from_the_first_position_on() {
        let round = |t_s, ranges, is_fix| Round { t_s, ranges, is_fix };
        let rounds =
            [round(0.5, 1, false), round(1.0, 3, true), round(1.5, 4, true), round(2.0, 1, false), round(2.5, 4, true)];
        let figures = Figures::of_rounds(&rounds, 3.0);
        // Two positions in two seconds; 9 ranges in three rounds.
        assert_eq!((figures.first_s, figures.fixes_per_s, figures.ranges_a_round), (1.0, 1.0, 3.0));
        let none = Figures::of_rounds(&rounds[..1], 3.0);
        assert_eq!((none.first_s, none.fixes_per_s, none.ranges_a_round), (3.0, 0.0, 0.0));
    }

    #[test]
    fn a_tenth_apart_is_agreement_and_more_is_not() {
        let of = |figures: Figures| figures.disagreements(&ALIKE, 0.1).len();
        assert_eq!(of(ALIKE), 0);
        assert_eq!(of(Figures { fixes_per_s: 361.0, ranges_a_round: 4.3, ..ALIKE }), 0);
        assert_eq!(of(Figures { fixes_per_s: 359.0, ranges_a_round: 3.5, ..ALIKE }), 2);
        assert_eq!(of(Figures { fixes_per_s: f64::NAN, ..ALIKE }), 1);
    }

    #[test]
    fn a_late_start_in_a_thousand_frames_is_chance_and_more_is_not() {
        let late = |ours, theirs| {
            let theirs = Figures { late_per_s: theirs, ..ALIKE };
            Figures { late_per_s: ours, ..ALIKE }.disagreements(&theirs, 0.1).len()
        };
        // A tenth of a hundredth of 2000 a second.
        assert_eq!((late(2.0, 0.0), late(2.1, 0.0)), (0, 1));
        assert_eq!((late(109.0, 100.0), late(115.0, 100.0)), (0, 1));
    }

    #[test]
    fn networks_that_both_do_not_work_do_not_agree() {
        let dead = Figures { fixes_per_s: 0.0, ranges_a_round: 0.0, ..ALIKE };
        assert_eq!(dead.disagreements(&dead, 0.1), ["neither finds a position"]);
    }
}
