//! A small deterministic model of the air for the protocols: nodes with drifting 40-bit clocks, flight times,
//! collisions, loss; no chip.
//!
//! Time is true time in seconds since the beginning. A node executes its protocol's actions as a radio would: delayed
//! starts snap to 512 ticks, a start too near is late, and a receiver receives one frame at a time and returns it after
//! reading it.

pub mod anchors;

use std::collections::VecDeque;

use rand::{Rng, SeedableRng};
use rand_distr::{Distribution, Normal};
use rand_pcg::Pcg64;
use ranging::exchange::{Action, Arrival, Difference, Event, Link, Protocol, Range, ReceivedMessage, Report};
use ranging::{Diagnostics, Pace, PhyConfig, RadioDuration, RadioInstant, RangeBias, RxFrame, StampModel, Start};
use wire::uwb::native::Downlink;

pub const TICKS: f64 = 63_897_600_000.0;
/// Speed of light in air, metres per second.
pub const LIGHT: f64 = 299_792_458.0 / 1.000_293;
/// From the end of a frame until the node has read it, and from a command until the first pulse can leave, on a quick
/// board. A node's slowness multiplies both.
const READING: f64 = 120e-6;
const STARTING: f64 = 100e-6;
const COMPENSATING: f64 = 1.2e-3;
/// From the end of one frame until a receiver that stays on can receive the next.
const LISTEN_AGAIN: f64 = 30e-6;
/// Transmitting antenna delay of every node, ticks.
pub const ANTENNA_DELAY: i64 = 16_436;
/// Every node's radio. Nothing biases the timestamps of this air.
pub const STAMPS: StampModel = StampModel {
    delayed_step: 512,
    antenna_delay: RadioDuration::from_ticks(ANTENNA_DELAY),
    range_bias: RangeBias::NONE,
};

/// A protocol that may be replaced or switched off between steps.
pub type Boxed = Box<dyn FnMut(RadioInstant, Pace, Event<'_>) -> Owned>;

/// An action that owns its data.
#[derive(Clone, Debug)]
pub enum Owned {
    Transmit { frame: Vec<u8>, start: Start, listen: bool },
    Receive { start: Start, window: RadioDuration, keep_listening: bool },
    WaitUntil(RadioInstant),
    Compensate,
    Sleep { from: RadioInstant, duration: RadioDuration, may: bool },
    Round { asked: u8, ranges: Vec<Range> },
    Differences { reference: u16, differences: Vec<Difference> },
    Polled,
    Arrival(Arrival),
    Downlink { message: Downlink, is_trusted: bool },
    Link(Link),
}

impl From<Action<'_>> for Owned {
    fn from(action: Action<'_>) -> Self {
        match action {
            Action::Transmit { frame, start, listen } => Self::Transmit { frame: frame.to_vec(), start, listen },
            Action::Receive { start, window, keep_listening } => Self::Receive { start, window, keep_listening },
            Action::WaitUntil(instant) => Self::WaitUntil(instant),
            Action::Compensate => Self::Compensate,
            Action::Sleep { from, duration } => Self::Sleep { from, duration, may: false },
            Action::Report(Report::Round(round)) => Self::Round { asked: round.asked, ranges: round.ranges.to_vec() },
            Action::Report(Report::Differences(round)) => {
                Self::Differences { reference: round.reference, differences: round.differences.to_vec() }
            }
            Action::Report(Report::Polled(_)) => Self::Polled,
            Action::Report(Report::Arrival(arrival)) => Self::Arrival(arrival),
            Action::Report(Report::Downlink(&ReceivedMessage { message, is_trusted })) => {
                Self::Downlink { message, is_trusted }
            }
            Action::Report(Report::Link(link)) => Self::Link(link),
        }
    }
}

pub fn boxed(machine: impl Protocol + 'static) -> Boxed {
    boxed_on(&STAMPS, machine)
}

/// As [`boxed`], on a radio with this stamp model.
pub fn boxed_on(stamps: &StampModel, mut machine: impl Protocol + 'static) -> Boxed {
    machine.calibrate(stamps);
    Box::new(move |now, pace, event| {
        machine.pace(pace);
        machine.step(now, event).into()
    })
}

/// As [`boxed`], on a radio that sleeps when it may: its clock restarts then.
pub fn boxed_sleeper(mut machine: impl Protocol + 'static) -> Boxed {
    machine.calibrate(&STAMPS);
    Box::new(move |now, pace, event| {
        machine.pace(pace);
        match machine.step(now, event).into() {
            // As in the driver: shorter sleeps are not worth it.
            Owned::Sleep { from, duration, .. } => Owned::Sleep { from, duration, may: duration.as_micros() > 7_000 },
            action => action,
        }
    })
}

/// A node that receives every frame and sends some again: unchanged, cut, with flipped bits, with another PAN, or
/// later.
pub fn mischief(seed: u64) -> Boxed {
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut kept: Vec<Vec<u8>> = Vec::new();
    Box::new(move |now, _, event| {
        if let Event::Received(frame) = event {
            kept.push(frame.bytes.to_vec());
            if kept.len() > 200 {
                kept.remove(0);
            }
        }
        if kept.is_empty() || !rng.random_bool(0.05) {
            let window = RadioDuration::from_micros(2000);
            return Owned::Receive { start: Start::Now, window, keep_listening: true };
        }
        let last = kept.len() - 1;
        let pick = if rng.random_bool(0.5) { last } else { rng.random_range(0..=last) };
        let mut frame = kept[pick].clone();
        match rng.random_range(0..5) {
            0 => frame.truncate(rng.random_range(0..frame.len())),
            1 => {
                let bit = rng.random_range(0..frame.len() * 8);
                frame[bit / 8] ^= 1 << (bit % 8);
            }
            2 if frame.len() > 4 => frame[3] ^= 0x55,
            _ => {}
        }
        let start = if rng.random_bool(0.5) {
            Start::Now
        } else {
            Start::At(now.plus(RadioDuration::from_micros(rng.random_range(500..20_000))))
        };
        Owned::Transmit { frame, start, listen: true }
    })
}

/// Mean and standard deviation.
pub fn moments(values: &[f64]) -> (f64, f64) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    (mean, (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / n).sqrt())
}

/// A node's report, and its time.
#[derive(Clone, Debug)]
pub struct Reported {
    pub time: f64,
    pub node: usize,
    pub what: What,
}

#[derive(Clone, Debug)]
pub enum What {
    Round { asked: u8, ranges: Vec<Range> },
    Differences { reference: u16, differences: Vec<Difference> },
    Arrival(Arrival),
    Downlink { message: Downlink, is_trusted: bool },
    Link(Link),
}

/// A frame on the air.
#[derive(Clone, Debug)]
pub struct Flight {
    pub sender: usize,
    pub begin: f64,
    pub rmarker: f64,
    pub end: f64,
    pub bytes: Vec<u8>,
}

struct Node {
    machine: Option<Boxed>,
    /// How many times slower than a quick board.
    slowness: f64,
    /// The node's pace for the next step.
    pace: Pace,
    position: [f64; 3],
    /// Fast by this fraction.
    drift: f64,
    /// The clock's count at true time 0.
    start: u64,
    state: State,
    /// The receiver is on since this time.
    listening: Option<f64>,
    /// Frames received and not yet returned, with the time at which they can be: (when, outcome).
    heard: VecDeque<(f64, Received)>,
    /// How long its receiver was on, without what follows a transmission, seconds.
    received: f64,
    /// When the last reception began.
    receiving: f64,
}

enum State {
    /// Steps the protocol at this time with this event.
    Step(f64, Plain),
    /// Waits for a frame until this time.
    Listening {
        until: f64,
        keep: bool,
    },
    /// Transmits: (end, departure in its clock, whether to listen then).
    Transmitting {
        end: f64,
        departure: RadioInstant,
        listen: bool,
    },
    Off,
}

#[derive(Clone, Copy, Debug)]
enum Plain {
    Started,
    Late,
    Woken,
    /// Woken with another clock.
    Slept,
    Reported,
}

enum Received {
    Frame { bytes: Vec<u8>, rx_time: RadioInstant, diagnostics: Diagnostics, listening: RadioInstant },
    Corrupt,
}

/// The simulated air with all nodes.
pub struct Air {
    pub rng: Pcg64,
    pub phy: PhyConfig,
    /// Probability that a frame does not reach a node.
    pub loss: f64,
    /// Probability that a frame reaches a node with errors.
    pub corruption: f64,
    /// Standard deviation of reception timestamps, ticks.
    pub stamp_noise: f64,
    /// Standard deviation of the carrier's reading, ppm.
    pub carrier_noise: f64,
    pub power_dbm: f32,
    /// Frames are not received beyond this many metres.
    pub reach: f64,
    pub now: f64,
    pub reports: Vec<Reported>,
    /// Every frame ever sent.
    pub sent: Vec<Flight>,
    pub collisions: usize,
    nodes: Vec<Node>,
    flying: Vec<Flight>,
}

impl Air {
    pub fn new(phy: PhyConfig, seed: u64) -> Self {
        Self {
            rng: Pcg64::seed_from_u64(seed),
            phy,
            loss: 0.0,
            corruption: 0.0,
            stamp_noise: 6.4,
            carrier_noise: 0.2,
            // The chip's estimate for −77 dBm, where its range bias is zero (PRF 64).
            power_dbm: -81.5,
            reach: f64::INFINITY,
            now: 0.0,
            reports: Vec::new(),
            sent: Vec::new(),
            collisions: 0,
            nodes: Vec::new(),
            flying: Vec::new(),
        }
    }

    pub fn add(&mut self, position: [f64; 3], drift_ppm: f64, machine: Boxed) -> usize {
        let start = self.rng.random_range(0..1 << 40);
        let begin = self.now;
        self.nodes.push(Node {
            machine: Some(machine),
            slowness: 1.0,
            pace: Pace::default(),
            position,
            drift: drift_ppm * 1e-6,
            start,
            state: State::Step(begin, Plain::Started),
            listening: None,
            heard: VecDeque::new(),
            received: 0.0,
            receiving: 0.0,
        });
        self.nodes.len() - 1
    }

    /// Makes a node this many times slower than a quick board.
    pub fn slow_down(&mut self, node: usize, slowness: f64) {
        self.nodes[node].slowness = slowness;
    }

    /// Makes a node's clock read `ticks` now.
    pub fn set_clock(&mut self, node: usize, ticks: u64) {
        let now = self.now;
        let node = &mut self.nodes[node];
        let elapsed = (now * TICKS * (1.0 + node.drift)) as u64;
        node.start = ticks.wrapping_sub(elapsed) & ((1 << 40) - 1);
    }

    /// Halts a node: it executes nothing for this time, and its clock goes on.
    pub fn halt(&mut self, node: usize, seconds: f64) {
        let end = self.now + seconds;
        let node = &mut self.nodes[node];
        (node.listening, node.state) = (None, State::Step(end, Plain::Woken));
        node.heard.clear();
    }

    pub fn move_to(&mut self, node: usize, position: [f64; 3]) {
        self.nodes[node].position = position;
    }

    pub fn distance(&self, a: usize, b: usize) -> f64 {
        let (a, b) = (self.nodes[a].position, self.nodes[b].position);
        (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()
    }

    pub fn switch_off(&mut self, node: usize) {
        let node = &mut self.nodes[node];
        (node.machine, node.listening, node.state) = (None, None, State::Off);
        node.heard.clear();
    }

    /// Switches a node on (again): another clock count, all state lost.
    pub fn switch_on(&mut self, node: usize, machine: Boxed) {
        self.switch_off(node);
        let start = self.rng.random_range(0..1 << 40);
        let now = self.now;
        let node = &mut self.nodes[node];
        (node.machine, node.start, node.state) = (Some(machine), start, State::Step(now, Plain::Started));
    }

    pub fn local(&self, node: usize, time: f64) -> RadioInstant {
        let node = &self.nodes[node];
        RadioInstant::from_ticks(node.start.wrapping_add((time * TICKS * (1.0 + node.drift)).round() as i64 as u64))
    }

    /// The true time of an instant of a node's clock near `near`.
    fn global(&self, node: usize, instant: RadioInstant, near: f64) -> f64 {
        let ahead = instant.since(self.local(node, near)).ticks();
        near + ahead as f64 / (TICKS * (1.0 + self.nodes[node].drift))
    }

    pub fn run_until(&mut self, end: f64) {
        loop {
            let next_node = (0..self.nodes.len()).map(|node| (self.due(node), node));
            let (node_time, node) = next_node.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((f64::INFINITY, 0));
            let arrivals = self.flying.iter().enumerate().map(|(i, flight)| (flight.end + 2e-6, i));
            let (flight_time, flight) = arrivals.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((f64::INFINITY, 0));
            if node_time.min(flight_time) > end {
                self.now = end;
                return;
            }
            self.now = node_time.min(flight_time);
            if flight_time <= node_time {
                self.land(flight);
            } else {
                self.wake(node);
            }
        }
    }

    /// The time of the next event at a node.
    fn due(&self, node: usize) -> f64 {
        let node = &self.nodes[node];
        match &node.state {
            State::Step(time, _) => *time,
            State::Transmitting { end, .. } => *end,
            State::Listening { until, .. } => node.heard.front().map_or(*until, |(ready, _)| ready.max(0.0)),
            State::Off => f64::INFINITY,
        }
    }

    fn wake(&mut self, node: usize) {
        let now = self.now;
        if let State::Step(_, Plain::Slept) = self.nodes[node].state {
            let count = self.rng.random_range(0..1 << 40);
            self.set_clock(node, count);
        }
        let local = self.local(node, now);
        let this = &mut self.nodes[node];
        if let State::Listening { .. } = this.state {
            this.received += (now - this.receiving).max(0.0);
        }
        match std::mem::replace(&mut this.state, State::Off) {
            State::Off => {}
            State::Step(_, plain) => {
                let event = match plain {
                    Plain::Started | Plain::Slept => Event::Started,
                    Plain::Late => Event::Late,
                    Plain::Woken => Event::Woken,
                    Plain::Reported => Event::Reported,
                };
                self.step(node, local, event);
            }
            State::Transmitting { departure, listen, .. } => {
                this.listening = listen.then_some(now + 5e-6);
                self.step(node, departure, Event::Sent(departure));
            }
            State::Listening { keep, .. } => match this.heard.pop_front() {
                None => {
                    this.listening = None;
                    self.step(node, local, Event::Timeout);
                }
                Some((_, heard)) => {
                    if !keep {
                        this.listening = None;
                        this.heard.clear();
                    }
                    match heard {
                        Received::Corrupt => self.step(node, local, Event::Corrupt),
                        Received::Frame { bytes, rx_time, diagnostics, listening } => {
                            self.nodes[node].pace.listening = keep.then_some(listening);
                            let frame = RxFrame { bytes: &bytes, rx_time, diagnostics };
                            self.step(node, rx_time, Event::Received(frame));
                        }
                    }
                }
            },
        }
    }

    fn step(&mut self, node: usize, local: RadioInstant, event: Event<'_>) {
        let now = self.now;
        let reported = event == Event::Reported;
        let this = &mut self.nodes[node];
        let Some(machine) = &mut this.machine else { return };
        let pace = std::mem::take(&mut this.pace);
        let action = machine(local, Pace { ready: reported.then_some(local), ..pace }, event);
        let state = match action {
            Owned::Round { asked, ranges } => {
                self.reports.push(Reported { time: now, node, what: What::Round { asked, ranges } });
                State::Step(now, Plain::Reported)
            }
            Owned::Differences { reference, differences } => {
                self.reports.push(Reported { time: now, node, what: What::Differences { reference, differences } });
                State::Step(now, Plain::Reported)
            }
            Owned::Link(link) => {
                self.reports.push(Reported { time: now, node, what: What::Link(link) });
                State::Step(now, Plain::Reported)
            }
            Owned::Polled => State::Step(now, Plain::Reported),
            Owned::Arrival(arrival) => {
                self.reports.push(Reported { time: now, node, what: What::Arrival(arrival) });
                State::Step(now, Plain::Reported)
            }
            Owned::Downlink { message, is_trusted } => {
                self.reports.push(Reported { time: now, node, what: What::Downlink { message, is_trusted } });
                State::Step(now, Plain::Reported)
            }
            Owned::WaitUntil(instant) => {
                self.nodes[node].listening = None;
                self.nodes[node].heard.clear();
                // Woken by a slow clock of 32 768 Hz: up to 30 µs late.
                let late = self.rng.random_range(0.0..30e-6);
                State::Step(self.global(node, instant, now).max(now) + late, Plain::Woken)
            }
            Owned::Compensate => {
                self.nodes[node].listening = None;
                self.nodes[node].heard.clear();
                State::Step(now + COMPENSATING, Plain::Woken)
            }
            Owned::Sleep { from, duration, may } => {
                self.nodes[node].listening = None;
                self.nodes[node].heard.clear();
                let local_s = duration.ticks() as f64 / TICKS;
                let end = self.global(node, from, now) + local_s / (1.0 + self.nodes[node].drift);
                // The slow clock's steps. If the radio sleeps, waking takes 300 µs longer than the node knows.
                let late = if may { 300e-6 } else { 0.0 } + self.rng.random_range(0.0..30e-6);
                State::Step(end.max(now) + late, if may { Plain::Slept } else { Plain::Woken })
            }
            Owned::Receive { start, window, keep_listening } => {
                let on = match start {
                    Start::Now => now,
                    Start::At(instant) => self.global(node, instant, now),
                };
                if on < now {
                    State::Step(now, Plain::Late)
                } else {
                    self.nodes[node].receiving = on;
                    self.nodes[node].listening.get_or_insert(on + 5e-6);
                    State::Listening { until: on + window.ticks() as f64 / TICKS, keep: keep_listening }
                }
            }
            Owned::Transmit { frame, start, listen } => self.transmit(node, frame, start, listen),
        };
        self.nodes[node].state = state;
    }

    fn transmit(&mut self, node: usize, bytes: Vec<u8>, start: Start, listen: bool) -> State {
        let now = self.now;
        self.nodes[node].listening = None;
        self.nodes[node].heard.clear();
        let seconds = |duration: RadioDuration| duration.ticks() as f64 / TICKS;
        let lead = seconds(self.phy.time_to_rmarker());
        let starting = STARTING * self.nodes[node].slowness;
        let departure = match start {
            Start::Now => self.local(node, now + starting + lead),
            Start::At(at) => STAMPS.departure(at),
        };
        let rmarker = self.global(node, departure, now);
        let begin = rmarker - lead;
        if start != Start::Now {
            self.nodes[node].pace.armed = Some(self.local(node, now + starting));
        }
        if begin < now + starting - 1e-9 {
            return State::Step(now + starting, Plain::Late);
        }
        let end = rmarker + seconds(self.phy.time_after_rmarker(bytes.len() as u16 + 2));
        let flight = Flight { sender: node, begin, rmarker, end, bytes };
        self.sent.push(flight.clone());
        self.flying.push(flight);
        State::Transmitting { end, departure, listen }
    }

    /// A frame has passed all nodes.
    fn land(&mut self, index: usize) {
        let flight = self.flying[index].clone();
        for node in 0..self.nodes.len() {
            if node == flight.sender || self.distance(node, flight.sender) > self.reach {
                continue;
            }
            let way = self.distance(node, flight.sender) / LIGHT;
            let (begin, end) = (flight.begin + way, flight.end + way);
            let Some(since) = self.nodes[node].listening else { continue };
            // A third of the preamble is enough.
            if since > begin + (flight.rmarker - flight.begin) * 0.6 {
                continue;
            }
            let overlaps = |other: &Flight| {
                let way = self.distance(node, other.sender) / LIGHT;
                let heard = other.sender != flight.sender && self.distance(node, other.sender) <= self.reach;
                heard && other.begin + way < end && other.end + way > begin
            };
            let recent = self.sent.iter().rev().take(64);
            let collision = recent.clone().any(overlaps);
            let corrupted = self.rng.random_bool(self.corruption);
            if self.rng.random_bool(self.loss) {
                continue;
            }
            let slowness = self.nodes[node].slowness;
            let (reading, listen_again) = (READING * slowness, LISTEN_AGAIN * slowness);
            let ready = end + reading;
            let heard = if collision {
                self.collisions += 1;
                Received::Corrupt
            } else if corrupted {
                Received::Corrupt
            } else {
                let noise = Normal::new(0.0, self.stamp_noise).unwrap().sample(&mut self.rng);
                let rx_time = self.local(node, flight.rmarker + way + noise / TICKS);
                let offset = (1.0 + self.nodes[flight.sender].drift) / (1.0 + self.nodes[node].drift) - 1.0;
                let reading = Normal::new(offset * 1e6, self.carrier_noise).unwrap().sample(&mut self.rng);
                let diagnostics = Diagnostics {
                    rx_power_dbm: self.power_dbm,
                    first_path_power_dbm: self.power_dbm - 2.0,
                    clock_offset_ppm: reading as f32,
                    ..Diagnostics::default()
                };
                let listening = self.local(node, end + listen_again);
                Received::Frame { bytes: flight.bytes.clone(), rx_time, diagnostics, listening }
            };
            let keeps = !matches!(self.nodes[node].state, State::Listening { keep: false, .. });
            let this = &mut self.nodes[node];
            // Two receive buffers: a third frame is lost if it comes before the first is read.
            if this.heard.len() < 2 {
                let previous = this.heard.back().map_or(0.0, |(ready, _)| *ready);
                this.heard.push_back((ready.max(previous + reading), heard));
            }
            this.listening = keeps.then_some(end + listen_again);
        }
        self.flying.remove(index);
    }

    /// Rounds that a node reported from `from` on: (time, ranges).
    pub fn rounds(&self, node: usize, from: f64) -> Vec<(f64, Vec<Range>)> {
        let of = |report: &Reported| match &report.what {
            What::Round { ranges, .. } if report.node == node && report.time >= from => {
                Some((report.time, ranges.clone()))
            }
            What::Round { .. }
            | What::Differences { .. }
            | What::Arrival(_)
            | What::Downlink { .. }
            | What::Link(_) => None,
        };
        self.reports.iter().filter_map(of).collect()
    }

    /// Rounds that a listening node reported from `from` on: (reference, differences).
    pub fn heard(&self, node: usize, from: f64) -> Vec<(u16, Vec<Difference>)> {
        let of = |report: &Reported| match &report.what {
            What::Differences { reference, differences } if report.node == node && report.time >= from => {
                Some((*reference, differences.clone()))
            }
            What::Differences { .. }
            | What::Round { .. }
            | What::Arrival(_)
            | What::Downlink { .. }
            | What::Link(_) => None,
        };
        self.reports.iter().filter_map(of).collect()
    }

    /// How long a node has listened, seconds.
    pub fn received(&self, node: usize) -> f64 {
        self.nodes[node].received
    }

    /// Changes that a node reported: (time, change).
    pub fn links(&self, node: usize) -> Vec<(f64, Link)> {
        let of = |report: &Reported| match report.what {
            What::Link(link) if report.node == node => Some((report.time, link)),
            What::Link(_)
            | What::Arrival(_)
            | What::Downlink { .. }
            | What::Round { .. }
            | What::Differences { .. } => None,
        };
        self.reports.iter().filter_map(of).collect()
    }
}
