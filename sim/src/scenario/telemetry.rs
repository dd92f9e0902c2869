//! What a node reports: frames of telemetry are taken from its queue, as a host takes them from its channel, and become
//! records beside the true values.

use std::cell::{Cell, RefCell};
use std::collections::{HashMap, VecDeque};
use std::fmt::Debug;
use std::rc::Rc;

use blinks::{Multilateration, Solved};
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use firmware_tag::{Measured, RoundOutcome, Sounding};
use ranging::exchange::{Event, Protocol};
use ranging::{Diagnostics, RadioInstant};
use wire::telemetry::{Condition, Difference, Message, Range, State};
use wire::uwb::native::Downlink;

use super::attacker::Attack;
use super::downlink::Sender;
use super::record::{DifferenceRecord, PositionError, RangeRecord, Record, SimulatedEpoch, Source, Unrounded, What};
use super::uplink::Uplink;
use super::{FaultKind, Scenario, distance};
use crate::{Processor, TrueTime, World};

/// Bytes of telemetry that a node can queue: ten times what the busiest tag reports between two reads.
const QUEUE_BYTES: usize = 1 << 14;

/// A node's reporter.
pub(super) type Reporter = firmware_common::Reporter<NoopRawMutex, QUEUE_BYTES, Box<dyn Fn() -> u64>>;

/// All that was recorded.
#[derive(Default)]
pub(super) struct Log {
    /// The records since they were last taken, each with the earliest time at which its node had reported it.
    records: Vec<(f64, Record)>,
    /// Epochs of all tags.
    epochs: u64,
    /// Positions found by each tag.
    pub(super) fixes: HashMap<u16, usize>,
    /// When each tag had slots for the first time, seconds.
    pub(super) joined_s: HashMap<u16, f64>,
    /// Errors of all positions.
    pub(super) errors: Vec<PositionError>,
    /// The positions that tags tell in their polls.
    pub(super) uplink: Uplink,
    /// The station that sends messages to tags.
    pub(super) sender: Sender,
    /// The station that computes the positions of tags that blink.
    pub(super) blinks: Multilateration,
    /// The frames of attackers.
    pub(super) attack: Rc<Attack>,
}

impl Log {
    /// Takes the records since the last call, in the order of time. The count of all tags' epochs continues.
    pub(super) fn take(&mut self) -> Vec<Record> {
        let mut records = std::mem::take(&mut self.records);
        records.sort_by(|(a, _), (b, _)| a.total_cmp(b));
        let mut records: Vec<Record> = records.into_iter().map(|(_, record)| record).collect();
        for record in &mut records {
            if let What::Epoch(epoch) = &mut record.what {
                epoch.number = self.epochs;
                self.epochs += 1;
            }
        }
        records
    }
}

/// The reader of a node's telemetry.
pub(super) struct Outlet {
    node: u16,
    world: World,
    scenario: Rc<Scenario>,
    log: Rc<RefCell<Log>>,
    has_host: bool,
    /// Whether it is a tag that tells its positions in its polls.
    tells_position: bool,
    /// Positions that the node has advertised.
    pub(super) advertised: Cell<u32>,
    /// The reporter of the node's present run, and the time of its start, microseconds.
    life: RefCell<Option<(Rc<Reporter>, u64)>>,
    /// The time up to which the log is complete, seconds.
    reported_s: RefCell<f64>,
    round: RefCell<Round>,
}

/// The parts of a tag's round before its end is reported.
#[derive(Default)]
struct Round {
    truths: VecDeque<Truth>,
    ranges: Vec<Range>,
    differences: Vec<Difference>,
}

/// The true position of a tag at the end of a round, and what the tag does not report of the round.
struct Truth {
    round: u16,
    at_m: [f64; 3],
    sounding: Option<Sounding>,
    /// By the address of the anchor.
    unrounded: Vec<(u16, Unrounded)>,
}

impl Truth {
    fn unrounded(&self, anchor: u16) -> Option<Unrounded> {
        self.unrounded.iter().find(|(of, _)| *of == anchor).map(|(_, unrounded)| *unrounded)
    }
}

/// What an engine was given of the receptions of a round.
fn unrounded(measured: &Measured<'_>) -> Vec<(u16, Unrounded)> {
    let of = |measured_m, deviation_m, diagnostics: &Diagnostics| {
        let powers_dbm = [diagnostics.rx_power_dbm, diagnostics.first_path_power_dbm];
        Unrounded { measured_m, deviation_m, powers_dbm }
    };
    let ranges = measured.ranges().iter();
    let ranges = ranges.map(|range| (range.peer, of(range.distance_m, range.deviation_m, &range.diagnostics)));
    let differences = measured.differences().into_iter().flat_map(|round| {
        let reference = of(0.0, round.reference_deviation_m, &round.reference_diagnostics);
        let others = round.differences.iter();
        let others =
            others.map(|of_peer| (of_peer.peer, of(of_peer.difference_m, of_peer.deviation_m, &of_peer.diagnostics)));
        [(round.reference, reference)].into_iter().chain(others)
    });
    ranges.chain(differences).collect()
}

fn micros(time: TrueTime) -> u64 {
    (time.as_secs_f64() * 1e6) as u64
}

impl Outlet {
    /// For a node, which may be a tag that tells its positions in its polls.
    pub(super) fn new(
        (node, tells_position): (u16, bool),
        world: &World,
        scenario: &Rc<Scenario>,
        log: &Rc<RefCell<Log>>,
    ) -> Rc<Self> {
        Rc::new(Self {
            node,
            world: world.clone(),
            scenario: scenario.clone(),
            log: log.clone(),
            has_host: scenario.has_host(node),
            tells_position,
            advertised: Cell::new(0),
            life: RefCell::default(),
            reported_s: RefCell::default(),
            round: RefCell::default(),
        })
    }

    /// Judges whether the node's protocol believes attackers.
    pub(super) fn judge<P: Protocol + Clone + Debug>(&self) -> impl Fn(&P, RadioInstant, &Event<'_>) + use<P> {
        self.log.borrow().attack.judge(&self.world)
    }

    /// The node starts: makes its reporter. The reporter's clock gives the time at which the processor has done the
    /// work charged so far.
    pub(super) fn boot(&self, processor: Option<Processor>) -> Rc<Reporter> {
        self.drain();
        let (world, boot_us) = (self.world.clone(), micros(self.world.now()));
        let reporter = Rc::new(Reporter::new(Box::new(move || {
            let now = world.now();
            micros(processor.as_ref().map_or(now, |processor| processor.settle(now))).saturating_sub(boot_us)
        })));
        reporter.host.set(self.has_host);
        *self.life.borrow_mut() = Some((reporter.clone(), boot_us));
        *self.round.borrow_mut() = Round::default();
        self.log.borrow_mut().uplink.restart(self.node);
        reporter
    }

    /// Notes that a tag ends this round at this position and is about to report it.
    pub(super) fn note_truth(&self, epoch: &RoundOutcome<'_>, at_m: [f64; 3]) {
        let RoundOutcome { measured, sounding, .. } = epoch;
        let (round, unrounded) = (measured.number(), unrounded(measured));
        self.round.borrow_mut().truths.push_back(Truth { round, at_m, sounding: sounding.copied(), unrounded });
    }

    /// The tag's user sends data, which the tag takes under this number, or refuses.
    pub(super) fn sends_data(&self, number: Option<u8>) {
        self.log.borrow_mut().uplink.sends_data(self.node, number);
    }

    /// The node's host, if it has one, has a message to a tag. A node that is off does not get it.
    pub(super) fn tell(&self, message: Downlink) {
        if let Some((reporter, _)) = self.life.borrow().as_ref().filter(|_| self.has_host) {
            reporter.host.put(message);
        }
    }

    /// The scenario applies this fault to the node. Reports made before it are kept; later ones are lost.
    pub(super) fn fault(&self, fault: FaultKind) {
        self.drain();
        self.write(self.world.now().as_secs_f64(), What::Fault(fault));
    }

    /// Takes all queued frames.
    pub(super) fn drain(&self) {
        let Some((reporter, boot_us)) = self.life.borrow().clone() else { return };
        reporter.event_log.drain(|frame| {
            match wire::telemetry::decode(frame) {
                Ok(message) => self.message(boot_us, message),
                Err(error) => unreachable!("a node's frame is malformed: {error:?}"),
            }
            true
        });
    }

    fn write(&self, t_s: f64, what: What) {
        let mut reported_s = self.reported_s.borrow_mut();
        *reported_s = reported_s.max(t_s);
        self.log.borrow_mut().records.push((*reported_s, Record { t_s, node: self.node, what }));
    }

    fn message(&self, boot_us: u64, message: Message) {
        let mut round = self.round.borrow_mut();
        let t_s = (boot_us + message.t_us()) as f64 / 1e6;
        let what = match message {
            // For an anchor that receives its tags' ranges, `truths` is empty: it has no rounds.
            Message::Range(range) if !round.truths.is_empty() => return round.ranges.push(range),
            Message::Difference(difference) if !round.truths.is_empty() => return round.differences.push(difference),
            Message::Fix(fix) => {
                let Round { truths, ranges, differences } = &mut *round;
                let truth = loop {
                    match truths.pop_front() {
                        Some(truth) if truth.round == fix.round => break truth,
                        Some(_) => {}
                        None => unreachable!("a round ended that nobody noted"),
                    }
                };
                let epoch = SimulatedEpoch {
                    number: 0,
                    truth_m: truth.at_m,
                    fix,
                    is_of_station: false,
                    ranges: std::mem::take(ranges).into_iter().filter_map(|range| self.range(range, &truth)).collect(),
                    differences: std::mem::take(differences)
                        .into_iter()
                        .filter_map(|difference| self.difference(difference, &truth))
                        .collect(),
                };
                self.count(&epoch, t_s);
                What::Epoch(epoch)
            }
            other => What::Message(other),
        };
        match message {
            Message::State(State { is: Condition::Joined(_), .. }) => {
                self.log.borrow_mut().joined_s.entry(self.node).or_insert(t_s);
            }
            Message::TagFix(told) if self.has_host => {
                if let Some(fix) = told.fix() {
                    self.log.borrow_mut().uplink.arrived(told.tag, fix.round, t_s);
                }
            }
            Message::TagData(told) if self.has_host => {
                self.log.borrow_mut().uplink.data_arrived(told.tag, told.number);
            }
            // A tag at a cable reports its own answers, too: what came through the air counts.
            Message::TagAnswer(told) if self.has_host && told.tag != self.node => {
                self.log.borrow_mut().sender.answered(&told, t_s);
            }
            Message::Arrival(arrival) if self.has_host => {
                self.log.borrow_mut().blinks.take(t_s, t_s, self.node, &arrival);
            }
            _ => {}
        }
        self.write(t_s, what);
    }

    /// The station has computed the position of this tag's blink, or found none.
    pub(super) fn blinked(&self, solved: &Solved) {
        let Some(tag) = self.scenario.tags.iter().find(|tag| tag.address == solved.tag) else { return };
        let now = self.world.now();
        let (fix, truth_m) = (solved.fix(micros(now)), tag.walk.at(solved.t_s));
        let (ranges, differences) = (Vec::new(), Vec::new());
        let epoch = SimulatedEpoch { number: 0, truth_m, fix, is_of_station: true, ranges, differences };
        self.count(&epoch, now.as_secs_f64());
        self.write(now.as_secs_f64(), What::Epoch(epoch));
    }

    fn count(&self, epoch: &SimulatedEpoch, t_s: f64) {
        if let Some(error_m) = epoch.error_m() {
            let mut log = self.log.borrow_mut();
            if self.tells_position && epoch.source() == Source::Anchors {
                log.uplink.found(self.node, epoch.fix.round, t_s);
            }
            *log.fixes.entry(self.node).or_default() += 1;
            let (source, normalised_square) = (epoch.source(), epoch.normalised_square());
            log.errors.push(PositionError { source, error_m, normalised_square });
        }
    }

    fn range(&self, range: Range, truth: &Truth) -> Option<RangeRecord> {
        let (truth_m, los) = self.sight(range.peer, truth.at_m)?;
        let sounding = truth.sounding.filter(|sounding| sounding.peer == range.peer);
        let unrounded = truth.unrounded(range.peer)?;
        Some(RangeRecord { range, unrounded, truth_m, los, shape: sounding.map(|sounding| sounding.shape) })
    }

    fn difference(&self, difference: Difference, truth: &Truth) -> Option<DifferenceRecord> {
        let ((from_m, _), (to_m, los)) =
            (self.sight(difference.reference, truth.at_m)?, self.sight(difference.peer, truth.at_m)?);
        let unrounded = truth.unrounded(difference.peer)?;
        Some(DifferenceRecord { difference, unrounded, truth_m: to_m - from_m, los })
    }

    /// The distance of an anchor from a position, metres, and whether nothing is in between.
    fn sight(&self, anchor: u16, from_m: [f64; 3]) -> Option<(f64, bool)> {
        let at = self.scenario.anchors.iter().find(|known| known.address == anchor)?.at;
        Some((distance(at, from_m), !self.scenario.walls.iter().any(|wall| wall.crosses(at, from_m))))
    }
}
