//! Messages of a node and their bytes, for the tests of commands that read telemetry.

use std::io::Write;
use std::process::{Output, Stdio};

use positioning_core::Method;
use sim::scenario::{Scenario, Simulation, What};
use wire::telemetry::{
    BeaconId, Board, Condition, Counters, Diagnostics, Difference, Fix, Hello, MAX_FRAME, Message, Range, Reset,
    ResetCause, Role, Sighting, State, encode,
};

use crate::support::Folder;

/// Diagnostics of a reception: 2.25 dB between received power and first-path power.
pub const DIAGNOSTICS: Diagnostics = Diagnostics {
    rx_power_cdbm: -7925,
    first_path_power_cdbm: -8150,
    first_path_index_64ths: 47_712,
    first_path_amplitudes: [9000, 10_500, 8000],
    cir_power: 12_000,
    preamble_count: 118,
    noise_deviation: 52,
    clock_offset_cppm: -235,
};

/// A range of 4.5 m, with a deviation of 30 mm, to an anchor of unknown position.
pub fn range(t_us: u64, peer: u16) -> Range {
    Range {
        t_us,
        round: 0,
        peer,
        distance_tenth_mm: 45_000,
        deviation_tenth_mm: 300,
        position_tenth_mm: None,
        diagnostics: DIAGNOSTICS,
    }
}

/// A difference of arrivals with a deviation of 30 mm: `peer` is 1.2345 m nearer than `reference`, or is the reference
/// itself.
pub fn difference(t_us: u64, reference: u16, peer: u16) -> Difference {
    Difference {
        t_us,
        round: 0,
        reference,
        peer,
        difference_tenth_mm: if reference == peer { 0 } else { -12_345 },
        deviation_tenth_mm: 300,
        position_tenth_mm: None,
        diagnostics: DIAGNOSTICS,
    }
}

/// The telemetry of a tag that walks for two seconds among six anchors, with ten positions a second and one beacon in
/// range.
pub fn walk() -> Vec<Message> {
    let mut scenario = Scenario::rooms(6, 1);
    scenario.seconds = 2.0;
    scenario.change_tags(|tag| tag.rate_chz = Some(1000));
    // This method does not use weights, which the files do not have.
    scenario.method = Some(Method::Nls);
    let mut simulation = Simulation::new(scenario);
    let hello = |t_us| Hello {
        t_us,
        eui: 0x1020_5F12_3456_7890,
        address: 4097,
        role: Role::Tag,
        board: Board::Simulated,
        build: [1, 2, 3, 4, 5, 6, 7, 0xAB],
        keyed: false,
    };
    let mut sent = vec![
        Message::Hello(hello(1000)),
        Message::Reset(Reset { t_us: 1100, cause: ResetCause::PowerOn, crash: None }),
        Message::State(State { t_us: 1200, is: Condition::Searching }),
    ];
    for record in simulation.run_until(2.0) {
        let What::Epoch(epoch) = &record.what else { continue };
        let (t_us, round) = (epoch.fix.t_us, epoch.number as u16);
        sent.extend(record.messages().map(|message| match message {
            Message::Range(range) => Message::Range(Range { round, ..range }),
            Message::Fix(fix) => Message::Fix(Fix { round, age_us: 8500, ..fix }),
            other => other,
        }));
        let beacon = BeaconId { network: 0xB940_7F30, major: 7, minor: 513 };
        sent.push(Message::Sighting(Sighting { t_us: t_us + 20_000, beacon, rssi_dbm: -67, measured_power_dbm: -59 }));
    }
    let counters = Counters { t_us: 2_000_000, sent: 20, telemetry_dropped: 2, ..Counters::default() };
    sent.push(Message::Counters(counters));
    sent.push(Message::Hello(hello(2_000_100)));
    sent
}

pub fn frame(message: &Message) -> Vec<u8> {
    encode(message, &mut [0; MAX_FRAME]).to_vec()
}

pub fn stream(messages: &[Message]) -> Vec<u8> {
    messages.iter().flat_map(frame).collect()
}

/// A folder with the walk's stream as `walk.bin`.
pub fn walk_folder() -> Folder {
    let folder = Folder::with(&[]);
    folder.write("walk.bin", &stream(&walk()));
    folder
}

/// Runs with `bytes` on standard input.
pub fn run_with(folder: &Folder, arguments: &str, bytes: &[u8]) -> Output {
    let mut command = folder.command(arguments);
    let mut child =
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().expect("baliza runs");
    let mut stdin = child.stdin.take().expect("piped");
    let bytes = bytes.to_vec();
    let writer = std::thread::spawn(move || stdin.write_all(&bytes));
    let output = child.wait_with_output().expect("it ends");
    writer.join().expect("no panic").expect("all is read");
    output
}
