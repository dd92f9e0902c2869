//! A message as one object of JSON: every key of its type is always there, `null` where nothing is known.

use serde::Serialize;
use wire::telemetry::{
    Condition, Counters, Diagnostics, Difference, Fix, Hello, Message, Range, RecordError, Reset, ResetCause, Room,
    RssiModelError, Sighting, State,
};

use super::beacon_name;

/// A message as one line of JSON, without the line's end.
///
/// # Errors
/// The serializer's.
pub fn json(message: &Message) -> serde_json::Result<Vec<u8>> {
    serde_json::to_vec(&Object::of(message))
}

/// Seconds since the node started.
fn seconds(t_us: u64) -> f64 {
    t_us as f64 / 1e6
}

/// Bytes in hexadecimal.
pub(super) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[derive(Serialize)]
#[serde(tag = "type", rename_all = "kebab-case")]
enum Object {
    Hello {
        t_s: f64,
        eui: String,
        address: u16,
        role: &'static str,
        board: &'static str,
        build: String,
    },
    Fix {
        t_s: f64,
        round: u16,
        age_s: f64,
        asked: u8,
        x_m: Option<f64>,
        y_m: Option<f64>,
        z_m: Option<f64>,
        sigma_x_m: Option<f64>,
        sigma_y_m: Option<f64>,
        sigma_z_m: Option<f64>,
        covariance_m2: Option<[[f64; 3]; 3]>,
        used: Option<u32>,
        used_ranges: Option<Vec<u16>>,
        quality: Option<f64>,
        reason: Option<&'static str>,
        solver: Option<&'static str>,
    },
    Range {
        t_s: f64,
        round: u16,
        peer: u16,
        range_m: f64,
        #[serde(flatten)]
        received: Received,
    },
    Sighting {
        t_s: f64,
        beacon: String,
        network: u32,
        major: u16,
        minor: u16,
        rssi_dbm: i8,
        measured_power_dbm: i8,
    },
    State {
        t_s: f64,
        state: &'static str,
        peer: Option<u16>,
        slots: Option<u8>,
        times: Option<u32>,
        record_fault: Option<&'static str>,
        record_version: Option<u8>,
        levels_fault: Option<&'static str>,
        levels_version: Option<u8>,
        beacon: Option<String>,
        for_s: Option<u16>,
    },
    Counters {
        t_s: f64,
        sent: u32,
        received: u32,
        timeouts: u32,
        corrupt: u32,
        late: u32,
        not_sent: u32,
        radio_failures: u32,
        rounds_dropped: u32,
        telemetry_dropped: u32,
        sightings: u32,
        sightings_dropped: u32,
    },
    Reset {
        t_s: f64,
        cause: &'static str,
        cause_number: Option<u32>,
        crash: Option<Crash>,
    },
    Difference {
        t_s: f64,
        round: u16,
        reference: u16,
        peer: u16,
        difference_m: f64,
        #[serde(flatten)]
        received: Received,
    },
    Room {
        t_s: f64,
        is: &'static str,
        rooms: Vec<u8>,
        probabilities: Vec<f64>,
    },
}

/// What the receiver measured of a peer.
#[derive(Serialize)]
struct Received {
    sigma_m: f64,
    peer_x_m: Option<f64>,
    peer_y_m: Option<f64>,
    peer_z_m: Option<f64>,
    rx_power_dbm: Option<f64>,
    fp_power_dbm: Option<f64>,
    fp_idx: f64,
    fp_amp1: u16,
    fp_amp2: u16,
    fp_amp3: u16,
    cir_pwr: u16,
    rxpacc: u16,
    std_noise: u16,
    clock_offset_ppm: Option<f64>,
}

impl Received {
    fn of(measured: Diagnostics, sigma_m: f64, place_m: Option<[f64; 3]>) -> Self {
        let [peer_x_m, peer_y_m, peer_z_m] = apart(place_m);
        let [fp_amp1, fp_amp2, fp_amp3] = measured.first_path_amplitudes;
        Self {
            sigma_m,
            peer_x_m,
            peer_y_m,
            peer_z_m,
            rx_power_dbm: measured.rx_power_dbm(),
            fp_power_dbm: measured.first_path_power_dbm(),
            fp_idx: measured.first_path_index(),
            fp_amp1,
            fp_amp2,
            fp_amp3,
            cir_pwr: measured.cir_power,
            rxpacc: measured.preamble_count,
            std_noise: measured.noise_deviation,
            clock_offset_ppm: measured.clock_offset_ppm(),
        }
    }
}

#[derive(Serialize)]
struct Crash {
    reason: &'static str,
    program_counter: String,
    line: u32,
    file_hash: String,
}

impl Object {
    fn of(message: &Message) -> Self {
        match message {
            Message::Hello(hello) => Self::hello(hello),
            Message::Fix(fix) => Self::fix(fix),
            Message::Range(range) => Self::range(range),
            Message::Sighting(sighting) => Self::sighting(sighting),
            Message::State(state) => Self::state(state),
            Message::Counters(counters) => Self::counters(counters),
            Message::Reset(reset) => Self::reset(reset),
            Message::Difference(difference) => Self::difference(difference),
            Message::Room(room) => Self::room(room),
        }
    }

    fn hello(hello: &Hello) -> Self {
        Self::Hello {
            t_s: seconds(hello.t_us),
            eui: format!("{:016x}", hello.eui),
            address: hello.address,
            role: hello.role.as_str(),
            board: hello.board.name(),
            build: hex(&hello.build),
        }
    }

    fn fix(fix: &Fix) -> Self {
        let [x_m, y_m, z_m] = apart(fix.position_m());
        let [sigma_x_m, sigma_y_m, sigma_z_m] = apart(fix.deviation_m());
        let used_ranges = fix.used().map(|used| (0..16).filter(|bit| used >> bit & 1 == 1).collect::<Vec<u16>>());
        Self::Fix {
            t_s: seconds(fix.t_us),
            round: fix.round,
            age_s: fix.age_s(),
            asked: fix.asked,
            x_m,
            y_m,
            z_m,
            sigma_x_m,
            sigma_y_m,
            // A height that was given has none.
            sigma_z_m: sigma_z_m.filter(|sigma| *sigma != 0.0),
            covariance_m2: fix.covariance_m2().map(|rows| rows.map(|row| row.map(|value| rounded(value, 1e9)))),
            used: fix.used().map(u16::count_ones),
            used_ranges,
            quality: fix.quality().map(|quality| rounded(quality, 1e3)),
            reason: fix.reason().map(|reason| reason.as_str()),
            solver: fix.solver.as_str(),
        }
    }

    fn range(range: &Range) -> Self {
        Self::Range {
            t_s: seconds(range.t_us),
            round: range.round,
            peer: range.peer,
            range_m: range.distance_m(),
            received: Received::of(range.diagnostics, range.deviation_m(), range.place_m()),
        }
    }

    fn difference(difference: &Difference) -> Self {
        Self::Difference {
            t_s: seconds(difference.t_us),
            round: difference.round,
            reference: difference.reference,
            peer: difference.peer,
            difference_m: difference.difference_m(),
            received: Received::of(difference.diagnostics, difference.deviation_m(), difference.place_m()),
        }
    }

    fn sighting(sighting: &Sighting) -> Self {
        Self::Sighting {
            t_s: seconds(sighting.t_us),
            beacon: beacon_name(sighting.beacon),
            network: sighting.beacon.network,
            major: sighting.beacon.major,
            minor: sighting.beacon.minor,
            rssi_dbm: sighting.rssi,
            measured_power_dbm: sighting.measured_power,
        }
    }

    fn state(state: &State) -> Self {
        let (mut peer, mut slots, mut times, mut record_fault, mut record_version) = (None, None, None, None, None);
        let (mut levels_fault, mut levels_version) = (None, None);
        let (mut beacon, mut for_s) = (None, None);
        match state.is {
            Condition::NoRecord(fault) => {
                record_fault = Some(fault.as_str());
                record_version = match fault {
                    RecordError::Version(version) => Some(version),
                    RecordError::Missing | RecordError::Corrupt | RecordError::Invalid => None,
                };
            }
            Condition::Paired(of) | Condition::Synchronised(of) | Condition::Following(of) => peer = Some(of),
            Condition::Joined(of) => slots = Some(of),
            Condition::RadioFailed(of) | Condition::ScannerRestarted(of) => times = Some(of),
            Condition::Unused(_, fault) => {
                levels_fault = Some(fault.as_str());
                levels_version = match fault {
                    RssiModelError::Version(version) => Some(version),
                    RssiModelError::Corrupt | RssiModelError::Invalid | RssiModelError::OtherBeacons => None,
                };
            }
            Condition::BeaconMoved(of) | Condition::BeaconDuplicated(of) | Condition::BeaconRestored(of) => {
                beacon = Some(format!("{}-{}", of.major, of.minor));
                for_s = Some(of.seconds);
            }
            Condition::WrongRecord
            | Condition::Searching
            | Condition::NetworkFull
            | Condition::MotionSensor(_)
            | Condition::Coordinating
            | Condition::Advertising => {}
        }
        let (t_s, state) = (seconds(state.t_us), state.is.as_str());
        Self::State {
            t_s,
            state,
            peer,
            slots,
            times,
            record_fault,
            record_version,
            levels_fault,
            levels_version,
            beacon,
            for_s,
        }
    }

    fn room(room: &Room) -> Self {
        let likely = room.is.rooms();
        Self::Room {
            t_s: seconds(room.t_us),
            is: room.is.as_str(),
            rooms: likely.iter().map(|likely| likely.room).collect(),
            probabilities: likely.iter().map(|likely| rounded(likely.probability(), 1e3)).collect(),
        }
    }

    fn counters(counters: &Counters) -> Self {
        Self::Counters {
            t_s: seconds(counters.t_us),
            sent: counters.sent,
            received: counters.received,
            timeouts: counters.timeouts,
            corrupt: counters.corrupt,
            late: counters.late,
            not_sent: counters.not_sent,
            radio_failures: counters.radio_failures,
            rounds_dropped: counters.rounds_dropped,
            telemetry_dropped: counters.telemetry_dropped,
            sightings: counters.sightings,
            sightings_dropped: counters.sightings_dropped,
        }
    }

    fn reset(reset: &Reset) -> Self {
        let cause_number = match reset.cause {
            ResetCause::Other(number) => Some(number),
            ResetCause::PowerOn
            | ResetCause::BrownOut
            | ResetCause::Pin
            | ResetCause::Software
            | ResetCause::Watchdog
            | ResetCause::Lockup
            | ResetCause::Wake => None,
        };
        let crash = reset.crash.map(|crash| Crash {
            reason: crash.reason.as_str(),
            program_counter: format!("{:08x}", crash.program_counter),
            line: crash.line,
            file_hash: format!("{:08x}", crash.file),
        });
        Self::Reset { t_s: seconds(reset.t_us), cause: reset.cause.as_str(), cause_number, crash }
    }
}

/// The coordinates one by one.
fn apart(place: Option<[f64; 3]>) -> [Option<f64>; 3] {
    place.map_or([None; 3], |place| place.map(Some))
}

/// To so many parts of one.
fn rounded(value: f64, parts: f64) -> f64 {
    (value * parts).round() / parts
}
