//! Frames between nodes: which nodes receive a frame, at which time of their own clocks, and with which diagnostics.

use heapless::{Deque, HistoryBuf, Vec};
use ranging::radio::MAX_FRAME;
use ranging::time::METRES_PER_TICK;
use ranging::{Diagnostics, PhyConfig, RadioInstant};

use crate::clock::{Crystal, micros, span, ticks};
use crate::random::Random;

/// The maximum number of nodes in a world.
pub const MAX_NODES: usize = 9;
/// From the end of a frame until the node has read it, microseconds. Together with the 100 µs of [`STARTING_US`] this
/// is less than the 250 µs that a DWM1001 has for an answer.
const READING_US: u64 = 120;
/// From a command until the first pulse can leave.
pub const STARTING_US: u64 = 100;
/// From the end of a frame until a receiver that stays on can receive the next one.
const LISTEN_AGAIN_US: u64 = 30;
/// From the end of a frame at the sender until it has passed every node: 900 m.
const PASSED_US: u64 = 3;
/// Frames kept to find overlaps. No more are on the air at the same time.
const RECENT: usize = 16;
/// Two receive buffers: a third frame that ends before the first is read is lost.
const BUFFERS: usize = 2;
/// Standard deviation of a reception's time stamp, thousandths of a tick: 0.1 ns.
const STAMP_NOISE: i64 = 6_400;
/// Standard deviation of the carrier integrator's clock offset, thousandths of a part per billion: 0.2 ppm.
const CARRIER_NOISE: i64 = 200_000;
/// The chip's estimate for −77 dBm, where its range bias is zero (PRF 64).
const RX_POWER_DBM: f32 = -81.5;
/// Micrometres that light travels in a million ticks.
const UM_IN_A_MILLION_TICKS: u64 = (METRES_PER_TICK * 1e12) as u64;

/// The position of a node.
#[derive(Clone, Copy, Debug)]
pub enum Path {
    /// A fixed position, millimetres.
    Fixed([i32; 3]),
    /// The position after a time in microseconds, millimetres.
    Walk(fn(u64) -> [i32; 3]),
}

impl Path {
    fn at(self, time: u64) -> [i32; 3] {
        match self {
            Self::Fixed(place) => place,
            Self::Walk(walk) => walk(micros(time)),
        }
    }
}

/// A node with its antenna.
pub struct Node {
    place: Path,
    pub crystal: Crystal,
    /// The time since which the receiver is on.
    pub listening: Option<u64>,
    /// The receiver stays on after a frame.
    pub stays_on: bool,
    pub heard: Deque<Arrival, BUFFERS>,
    /// The number of times it slept.
    pub naps: u32,
}

impl Node {
    /// Switches transmitter and receiver off.
    pub fn switch_off(&mut self) {
        self.listening = None;
        self.heard.clear();
    }
}

/// A frame that arrived, intact or broken.
pub struct Arrival {
    /// The time at which the node has read it.
    pub ready: u64,
    /// The time at which the receiver was on again, if it stayed on.
    pub listening: Option<u64>,
    /// The frame; none if it is broken.
    pub frame: Option<Received>,
}

/// A frame that was received without errors.
pub struct Received {
    pub bytes: Vec<u8, MAX_FRAME>,
    pub rx_time: RadioInstant,
    pub diagnostics: Diagnostics,
}

/// A frame on the air: first pulse, RMARKER and last pulse, in true time at the sender.
#[derive(Clone)]
struct Flight {
    sender: usize,
    begin: u64,
    rmarker: u64,
    end: u64,
    bytes: Vec<u8, MAX_FRAME>,
}

/// The time during which a frame was on the air.
#[derive(Clone, Copy)]
struct Span {
    sender: usize,
    begin: u64,
    end: u64,
}

/// The air.
pub struct Air {
    pub phy: PhyConfig,
    random: Random,
    loss_per_mille: u32,
    pub nodes: Vec<Node, MAX_NODES>,
    flying: Vec<Flight, MAX_NODES>,
    recent: HistoryBuf<Span, RECENT>,
}

impl Air {
    pub fn new(phy: PhyConfig, seed: u64, loss_per_mille: u32) -> Self {
        let random = Random::new(seed);
        Self { phy, random, loss_per_mille, nodes: Vec::new(), flying: Vec::new(), recent: HistoryBuf::new() }
    }

    /// Adds a node. Returns its number, or none if there is no room.
    pub fn add(&mut self, place: Path, crystal: Crystal) -> Option<usize> {
        let node = Node { place, crystal, listening: None, stays_on: false, heard: Deque::new(), naps: 0 };
        self.nodes.push(node).ok().map(|()| self.nodes.len() - 1)
    }

    /// Puts a frame on the air whose RMARKER leaves at `rmarker`. Returns the time of its end.
    pub fn send(&mut self, sender: usize, rmarker: u64, bytes: &[u8]) -> u64 {
        let begin = rmarker - span(self.phy.time_to_rmarker());
        let end = rmarker + span(self.phy.time_after_rmarker(bytes.len() as u16 + 2));
        self.recent.write(Span { sender, begin, end });
        let bytes = bytes.iter().copied().collect();
        // Each node sends one frame at a time.
        let _ = self.flying.push(Flight { sender, begin, rmarker, end, bytes });
        end
    }

    /// The time at which the next frame has passed every node.
    pub fn next(&self) -> Option<u64> {
        self.flying.iter().map(|flight| flight.end + ticks(PASSED_US)).min()
    }

    /// Delivers the frames that have passed by now to the nodes that they reached.
    pub fn pass(&mut self, now: u64) {
        while let Some(index) = self.flying.iter().position(|flight| flight.end + ticks(PASSED_US) <= now) {
            let flight = self.flying.remove(index);
            for node in 0..self.nodes.len() {
                if node != flight.sender {
                    self.reach(node, &flight);
                }
            }
        }
    }

    fn reach(&mut self, index: usize, flight: &Flight) {
        let way = self.way(index, flight.sender, flight.rmarker);
        let Some(sender) = self.nodes.get(flight.sender).map(|sender| sender.crystal) else { return };
        let collision = self.collides(index, flight, way);
        let Some(node) = self.nodes.get_mut(index) else { return };
        let Some(since) = node.listening else { return };
        // A third of the preamble is enough.
        if since > flight.begin + way + (flight.rmarker - flight.begin) * 6 / 10 {
            return;
        }
        if self.random.happens(self.loss_per_mille) {
            return;
        }
        let end = flight.end + way;
        let frame = (!collision).then(|| {
            let stamp = (flight.rmarker + way).saturating_add_signed(self.random.normal(STAMP_NOISE));
            let offset_ppb = i64::from(sender.fast_ppb) - i64::from(node.crystal.fast_ppb);
            let reading_ppb = offset_ppb + self.random.normal(CARRIER_NOISE);
            let diagnostics = Diagnostics {
                rx_power_dbm: RX_POWER_DBM,
                first_path_power_dbm: RX_POWER_DBM - 2.0,
                clock_offset_ppm: reading_ppb as f32 / 1000.0,
                ..Diagnostics::default()
            };
            Received { bytes: flight.bytes.clone(), rx_time: node.crystal.local(stamp), diagnostics }
        });
        let previous = node.heard.back().map_or(0, |arrival| arrival.ready);
        let ready = end.max(previous) + ticks(READING_US);
        let listening = node.stays_on.then_some(end + ticks(LISTEN_AGAIN_US));
        // A full buffer loses the frame.
        let _ = node.heard.push_back(Arrival { ready, listening, frame });
        node.listening = listening;
    }

    fn collides(&self, index: usize, flight: &Flight, way: u64) -> bool {
        self.recent.iter().any(|other| {
            let other_way = self.way(index, other.sender, other.begin);
            other.sender != flight.sender
                && other.sender != index
                && other.begin + other_way < flight.end + way
                && other.end + other_way > flight.begin + way
        })
    }

    /// The flight time of a signal between two nodes.
    fn way(&self, a: usize, b: usize, time: u64) -> u64 {
        let place = |node: usize| self.nodes.get(node).map_or([0; 3], |node| node.place.at(time));
        let square: u64 =
            place(a).iter().zip(place(b)).map(|(a, b)| u64::from(a.abs_diff(b)) * u64::from(a.abs_diff(b))).sum();
        // Square millimetres are converted to micrometres.
        let micrometres = (square * 1_000_000).isqrt();
        (micrometres * 1_000_000 + UM_IN_A_MILLION_TICKS / 2) / UM_IN_A_MILLION_TICKS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_takes_its_time() {
        let mut air = Air::new(PhyConfig::FAST, 1, 0);
        let crystal = Crystal { start: 0, fast_ppb: 0 };
        air.add(Path::Fixed([0, 0, 0]), crystal);
        air.add(Path::Fixed([3_000, 4_000, 0]), crystal);
        air.add(Path::Fixed([0, 0, 100_000]), crystal);
        // 5 m at 299 704 645 m/s and 63.8976 ticks per nanosecond: 1066.0 ticks. A hundred metres: 21 320.2 ticks.
        assert_eq!((air.way(0, 1, 0), air.way(2, 0, 0)), (1066, 21_320));
    }
}
