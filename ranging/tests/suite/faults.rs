//! Networks that go through drawn faults: nodes that are reset, switched off, halted, carried away or slow, and bad air.
//! When the faults are over, every network has one coordinator again, and every tag ranges in turns of its own.

use std::env;

use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

use crate::air::anchors::{self, drift};
use crate::air::{Air, Boxed, boxed};
use ranging::native::{Network, NetworkKey, PollContent, Rate, Scheme, Tag, TagConfig};
use ranging::{PhyConfig, RadioDuration};
use wire::uwb::native::{Frame, Message, software_code};

/// Faults begin when the network is there, and are over after this time, seconds.
const FAULTY: std::ops::Range<f64> = 3.0..20.0;
/// A minute later everything works again, and is looked at for ten seconds. Two networks with terms far apart need ten seconds
/// for each anchor on the way between them.
const MENDED: f64 = 80.0;
const END: f64 = 90.0;
/// Farther than any frame is received.
const AWAY: [f64; 3] = [10_000.0, 0.0, 0.0];

/// What happens to a network at a time, seconds.
#[derive(Clone, Copy, Debug)]
enum Fault {
    Reset(usize),
    Off(usize),
    On(usize),
    Halt(usize, f64),
    Carry(usize),
    Back(usize),
    Slow(usize, f64),
    Loss(f64),
}

struct Site {
    air: Air,
    network: Network,
    anchors: u16,
    /// Periods of the tags, milliseconds.
    periods_ms: Vec<u32>,
    places: Vec<[f64; 3]>,
    /// How often nodes have started: each has other random numbers then.
    starts: u64,
}

impl Site {
    fn draw(rng: &mut Pcg64) -> Self {
        let mut network = Network::new(0xBA1A, PhyConfig::FAST);
        if rng.random_bool(0.3) {
            network.key = Some(NetworkKey::new([7; 16], 0, software_code));
        }
        let anchors = rng.random_range(2..=5);
        let periods = [50, 100, 200, 500, 1000];
        let periods_ms: Vec<u32> = (0..rng.random_range(1..=4)).map(|_| periods[rng.random_range(0..5)]).collect();
        let mut air = Air::new(network.phy, rng.random());
        // In one room, or along a corridor, where an anchor receives its neighbours alone.
        let is_corridor = rng.random_bool(0.5);
        air.reach = if is_corridor { 45.0 } else { 1_000.0 };
        let apart = if is_corridor { 30.0 } else { 8.0 };
        let anchor_places = (0..anchors).map(|i| [apart * f64::from(i), 3.0 * f64::from(i % 2), 2.5]);
        let mut places: Vec<[f64; 3]> = anchor_places.collect();
        let reach = apart * f64::from(anchors - 1);
        places.extend(periods_ms.iter().map(|_| [rng.random_range(0.0..reach), 2.0, 1.0]));
        Self { air, network, anchors, periods_ms, places, starts: rng.random() }
    }

    fn machine(&mut self, node: usize) -> Boxed {
        self.starts += 1;
        let mut network = self.network;
        if let Some(key) = &mut network.key {
            *key = NetworkKey::new([7; 16], self.starts, software_code);
        }
        let Some(of_tags) = node.checked_sub(self.anchors.into()) else {
            return anchors::anchor(network, node as u16 + 1, self.places[node], None);
        };
        let rate = Rate::Every(RadioDuration::from_micros(1_000 * self.periods_ms[of_tags]));
        boxed(Tag::new(TagConfig {
            address: 0x100 + of_tags as u16,
            network,
            anchors: 4,
            rate,
            scheme: Scheme::SingleSided,
            tells: PollContent::Nothing,
            blinks: false,
        }))
    }

    fn suffer(&mut self, fault: Fault) {
        match fault {
            Fault::Reset(node) | Fault::On(node) => {
                let machine = self.machine(node);
                self.air.switch_on(node, machine);
            }
            Fault::Off(node) => self.air.switch_off(node),
            Fault::Halt(node, seconds) => self.air.halt(node, seconds),
            Fault::Carry(node) => self.air.move_to(node, AWAY),
            Fault::Back(node) => self.air.move_to(node, self.places[node]),
            Fault::Slow(node, slowness) => self.air.slow_down(node, slowness),
            Fault::Loss(loss) => self.air.loss = loss,
        }
    }
}

/// Faults with their times, in order.
fn draw_faults(rng: &mut Pcg64, nodes: usize) -> Vec<(f64, Fault)> {
    let mut faults = Vec::new();
    for _ in 0..rng.random_range(1..=8) {
        let at = rng.random_range(FAULTY);
        let end = rng.random_range(at..FAULTY.end);
        let node = rng.random_range(0..nodes);
        match rng.random_range(0..6) {
            0 => faults.push((at, Fault::Reset(node))),
            1 => faults.extend([(at, Fault::Off(node)), (end, Fault::On(node))]),
            2 => faults.push((at, Fault::Halt(node, end - at))),
            3 => faults.extend([(at, Fault::Carry(node)), (end, Fault::Back(node))]),
            4 => faults.extend([(at, Fault::Slow(node, rng.random_range(1.0..3.0))), (end, Fault::Slow(node, 1.0))]),
            _ => faults.extend([(at, Fault::Loss(rng.random_range(0.0..0.8))), (end, Fault::Loss(0.02))]),
        }
    }
    faults.sort_by(|a, b| a.0.total_cmp(&b.0));
    // Whatever was switched off, carried away, or slow is not any more.
    faults.extend((0..nodes).flat_map(|node| [(FAULTY.end, Fault::Back(node)), (FAULTY.end, Fault::Slow(node, 1.0))]));
    faults.push((FAULTY.end, Fault::Loss(0.02)));
    faults
}

/// What is wrong with a network after its faults.
fn complaint(seed: u64) -> Option<String> {
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut site = Site::draw(&mut rng);
    let nodes = site.places.len();
    for node in 0..nodes {
        let machine = site.machine(node);
        site.air.add(site.places[node], drift(node as u16), machine);
    }
    let faults = draw_faults(&mut rng, nodes);
    for (at, fault) in &faults {
        site.air.run_until(*at);
        site.suffer(*fault);
    }
    site.air.run_until(MENDED);
    site.air.sent.clear();
    let collisions = site.air.collisions;
    site.air.run_until(END);
    let collisions = site.air.collisions - collisions;
    let Site { air, network, anchors, periods_ms, .. } = &site;
    let told = || {
        format!(
            "seed {seed}: {anchors} anchors, reach {}, key {}, tags {periods_ms:?}, {faults:?}",
            air.reach,
            network.key.is_some()
        )
    };
    let mut followed = Vec::new();
    for anchor in 0..usize::from(*anchors) {
        let of_anchor = air.sent.iter().filter(|flight| flight.sender == anchor);
        let sync_frames = of_anchor.filter_map(|flight| match Frame::parse(&flight.bytes).ok()?.message {
            Message::SyncFrame(sync_frame) => Some(sync_frame.coordinator),
            _ => None,
        });
        let coordinators: Vec<u16> = sync_frames.collect();
        if coordinators.len() < 80 {
            return Some(format!("anchor {anchor} sent {} sync frames\n{}", coordinators.len(), told()));
        }
        followed.extend(coordinators);
    }
    if followed.iter().any(|coordinator| *coordinator != followed[0]) {
        followed.sort_unstable();
        followed.dedup();
        return Some(format!("coordinators {followed:?}\n{}", told()));
    }
    for (i, period_ms) in periods_ms.iter().enumerate() {
        let tag = usize::from(*anchors) + i;
        let expected = 1_000.0 * (END - MENDED) / f64::from(*period_ms);
        let rounds = air.rounds(tag, MENDED).into_iter().filter(|(_, ranges)| !ranges.is_empty()).count();
        if (rounds as f64) < 0.8 * expected {
            return Some(format!("tag {i}: {rounds} rounds of {expected}\n{}", told()));
        }
    }
    (collisions > 40).then(|| format!("{collisions} collisions\n{}", told()))
}

/// Seeds of networks that did not recover, or not in time, for these reasons: two coordinators that send at the same
/// time, halves of a session that are a superframe apart, a lease in a slot that is not leased any more, another network's
/// leases, a tag that was halted and believed to be slow, a coordinator that has forgotten its leases.
const ONCE_LOST: [u64; 12] = [31, 59, 125, 154, 274, 380, 499, 1_135, 1_221, 2_023, 2_559, 17_162];

/// `BALIZA_FAULTS=FIRST..END cargo test --release -p baliza-ranging --test suite faults` tries other seeds.
#[test]
fn networks_recover_from_drawn_faults() {
    let asked = env::var("BALIZA_FAULTS").ok();
    let asked = asked.as_deref().and_then(|seeds| seeds.split_once(".."));
    let seeds: Vec<u64> = match asked {
        Some((first, end)) => (first.parse().unwrap()..end.parse().unwrap()).collect(),
        None => (0..20).chain(ONCE_LOST).collect(),
    };
    let complaints: Vec<String> = seeds.iter().filter_map(|&seed| complaint(seed)).collect();
    assert!(complaints.is_empty(), "{} of {}:\n{}", complaints.len(), seeds.len(), complaints.join("\n"));
}
