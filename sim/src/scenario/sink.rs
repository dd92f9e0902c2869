//! Where the apps' results go: beside the truth, into the log, and with the time that a board's processor would take.

use std::cell::RefCell;
use std::collections::HashMap;
use std::fmt::Debug;
use std::rc::Rc;

use firmware_common::lines::LinePace;
use firmware_tag::{Measured, RoomReport};
use ranging::RadioInstant;
use ranging::exchange::{Difference, Guidance, Link, Report};
use ranging::node::Listener;
use wire::telemetry::{Condition, MotionSensor, Sighting};

use super::record::{DifferenceRecord, Epoch, RangeRecord, Record, Source, What};
use super::{FaultKind, Scenario, Walk, distance};
use crate::costs::Costs;
use crate::{Processor, World};

/// All that was recorded.
#[derive(Default)]
pub(super) struct Log {
    /// Since they were last taken.
    pub(super) records: Vec<Record>,
    /// Epochs of all tags.
    epochs: u64,
    /// Positions found by each tag.
    pub(super) fixes: HashMap<u16, usize>,
    /// Errors of all positions, metres.
    pub(super) errors_m: Vec<(Source, f64)>,
}

/// What writes a node's records.
#[derive(Clone)]
pub(super) struct Notebook {
    pub(super) world: World,
    pub(super) scenario: Rc<Scenario>,
    pub(super) node: u16,
    pub(super) log: Rc<RefCell<Log>>,
}

impl Notebook {
    fn write(&self, what: What) {
        let t_s = self.world.now().as_secs_f64();
        self.log.borrow_mut().records.push(Record { t_s, node: self.node, what });
    }

    pub(super) fn fault(&self, fault: FaultKind) {
        self.write(What::Fault(fault));
    }
}

/// An anchor's listener.
pub(super) struct AnchorSink(pub(super) Notebook);

impl Listener for AnchorSink {
    async fn report(&mut self, report: Report<'_>, _: RadioInstant) -> Guidance {
        match report {
            // What tags tell is recorded where it is measured.
            Report::Round(_) | Report::Differences(_) => {}
            Report::Link(link) => self.0.write(What::Link(link)),
        }
        Guidance::NONE
    }

    async fn radio_failed(&mut self, _: &impl Debug, failures: u32) {
        self.0.write(What::RadioFailed(failures));
    }
}

/// A tag's sink.
pub(super) struct TagSink {
    pub(super) notebook: Notebook,
    pub(super) walk: Walk,
    pub(super) processor: Processor,
    /// Which positions a board would log.
    pub(super) lines: RefCell<LinePace>,
}

impl TagSink {
    /// What the tag knows of levels on the spot is not used.
    pub(super) fn unused(&self, condition: Condition) {
        self.notebook.write(What::Beacon(condition));
    }
}

impl firmware_tag::Sink for TagSink {
    fn now_us(&self) -> u64 {
        let now = self.processor.settle(self.notebook.world.now());
        (now.as_secs_f64() * 1e6) as u64
    }

    async fn publish(&self, epoch: firmware_tag::Epoch<'_>) {
        let Notebook { world, scenario, log, .. } = &self.notebook;
        // The tag moves a few millimetres while the ranges of a round are made: this is the truth of their end.
        let truth_m = self.walk.at(world.now().as_secs_f64());
        let ranges = epoch.measured.ranges().iter().filter_map(|range| {
            let anchor = scenario.anchors.iter().find(|anchor| anchor.address == range.peer)?;
            let los = !scenario.walls.iter().any(|wall| wall.crosses(anchor.at, truth_m));
            let sounding = epoch.sounding.filter(|sounding| sounding.peer == range.peer);
            let (truth_m, shape) = (distance(anchor.at, truth_m), sounding.map(|sounding| sounding.shape));
            Some(RangeRecord { range: *range, truth_m, los, shape })
        });
        let ranges: Vec<_> = ranges.collect();
        let place =
            |address: u16| scenario.anchors.iter().find(|anchor| anchor.address == address).map(|found| found.at);
        let heard = epoch.measured.differences().into_iter().flat_map(|round| {
            let reference = Difference {
                peer: round.reference,
                difference_m: 0.0,
                deviation_m: round.reference_deviation_m,
                position_m: round.reference_m,
                diagnostics: round.reference_diagnostics,
            };
            std::iter::once(reference).chain(round.differences.iter().copied()).map(|heard| (round.reference, heard))
        });
        let differences = heard.filter_map(|(reference, difference)| {
            let (from, at) = (place(reference)?, place(difference.peer)?);
            let los = !scenario.walls.iter().any(|wall| wall.crosses(at, truth_m));
            let truth_m = distance(at, truth_m) - distance(from, truth_m);
            Some(DifferenceRecord { reference, difference, truth_m, los })
        });
        let differences: Vec<_> = differences.collect();
        let measured = epoch.measured.count();
        let source = match epoch.measured {
            Measured::Ranges(_) | Measured::Differences(_) => Source::Anchors,
            Measured::Levels(_) => Source::Beacons,
        };
        // The position has been made in no time; what it takes is waited for before anybody hears of it.
        let costs = &Costs::of(self.processor.board().core).tag;
        let space = scenario.tag.height_m.is_none();
        let round = costs.round(scenario.tag.method.is_none(), space, measured);
        let line = if self.lines.borrow_mut().is_due(self.now_us()) { costs.line } else { 0 };
        self.processor.background(world, round + costs.publish_range * measured as u32 + line).await;
        let number = log.borrow().epochs;
        let record = Epoch {
            number,
            source,
            truth_m,
            outcome: epoch.outcome,
            asked: epoch.measured.asked(),
            ranges,
            differences,
        };
        let error_m = record.error_m();
        {
            let mut log = log.borrow_mut();
            log.epochs += 1;
            if error_m.is_some() {
                *log.fixes.entry(self.notebook.node).or_default() += 1;
            }
            log.errors_m.extend(error_m.map(|error_m| (source, error_m)));
        }
        self.notebook.write(What::Epoch(record));
    }

    fn link(&self, link: Link) {
        self.notebook.write(What::Link(link));
    }

    fn sighting(&self, sighting: Sighting) {
        self.processor.charge_background(Costs::of(self.processor.board().core).tag.advert);
        self.notebook.write(What::Sighting(sighting));
    }

    fn beacon(&self, word: Condition) {
        self.notebook.write(What::Beacon(word));
    }

    fn motion_sensor(&self, state: MotionSensor) {
        self.notebook.write(What::MotionSensor(state));
    }

    fn room(&self, told: RoomReport) {
        if told.is_news {
            self.notebook.write(What::Room(told.room.is));
        }
    }

    fn radio_failed(&self, _: &impl Debug, failures: u32) {
        self.notebook.write(What::RadioFailed(failures));
    }
}
