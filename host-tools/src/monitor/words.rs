//! A telemetry message as one line for a person. The words are those of the node's log, so that a screen that shows both can leave
//! out what it would show twice.

use super::image::Build;
use telemetry::{
    Condition, Counters, Crash, CrashReason, Fix, Hello, Message, Range, RecordFault, Reset, ResetCause, Sighting,
    State,
};

/// What stands before the words: `fix`, `range`, …, five letters at most.
pub fn label(message: &Message) -> &'static str {
    match message {
        Message::Hello(_) => "hello",
        Message::Fix(_) => "fix",
        Message::Range(_) => "range",
        Message::Sighting(_) => "ble",
        Message::State(_) => "state",
        Message::Counters(_) => "count",
        Message::Reset(_) => "reset",
    }
}

/// The words.
pub fn words(message: &Message) -> String {
    match message {
        Message::Hello(hello) => of_hello(hello),
        Message::Fix(fix) => of_fix(fix),
        Message::Range(range) => of_range(range),
        Message::Sighting(sighting) => of_sighting(sighting),
        Message::State(State { is, .. }) => condition(*is),
        Message::Counters(counters) => of_counters(counters),
        Message::Reset(reset) => of_reset(reset),
    }
}

/// Whether a line of the log says the same as a message.
pub fn says_the_same(text: &str, message: &Message) -> bool {
    match message {
        // How many answered is in the log alone.
        Message::Fix(fix) if fix.position_m().is_none() => text.starts_with("no fix: "),
        Message::Fix(_) => text.starts_with("fix x="),
        Message::Counters(_) => text.ends_with(" telemetry frames dropped"),
        Message::Reset(_) => text.starts_with("reset: "),
        Message::Hello(_) | Message::State(_) => text == words(message),
        Message::Range(_) | Message::Sighting(_) => false,
    }
}

fn of_hello(hello: &Hello) -> String {
    let Hello { role, address, board, eui, build, .. } = hello;
    format!("{} {address:04x} on {}, EUI {eui:016x}, build {}", role.as_str(), board.as_str(), Build(*build))
}

fn of_fix(fix: &Fix) -> String {
    let (Some([x, y, z]), Some(deviation)) = (fix.position_m(), fix.deviation_m()) else {
        let reason = fix.reason().map_or("", |reason| reason.as_str());
        return format!("none: {reason}, {} asked", fix.asked);
    };
    // Of the distance to the true position; a height that was given has none.
    let size = deviation.iter().map(|axis| axis * axis).sum::<f64>().sqrt();
    let given = if deviation[2] == 0.0 { " (given)" } else { "" };
    let used = fix.used().unwrap_or(0).count_ones();
    format!("x={x:.2} y={y:.2} z={z:.2}{given} ±{size:.2} m, {used} anchors, {:.0} ms", fix.age_s() * 1e3)
}

fn of_range(range: &Range) -> String {
    let mut text = format!("{:04x} {:.3} ±{:.3} m", range.peer, range.distance_m(), range.deviation_m());
    let mut power = |name: &str, dbm: Option<f64>| {
        if let Some(dbm) = dbm {
            text += &format!(", {name} {dbm:.1} dBm");
        }
    };
    power("received", range.diagnostics.rx_power_dbm());
    power("first path", range.diagnostics.first_path_power_dbm());
    if let Some(ppm) = range.diagnostics.clock_offset_ppm() {
        text += &format!(", clock {ppm:+.2} ppm");
    }
    if let Some([x, y, z]) = range.place_m() {
        text += &format!(", at {x:.2} {y:.2} {z:.2}");
    }
    text
}

fn of_sighting(sighting: &Sighting) -> String {
    let Sighting { beacon, rssi, measured_power, .. } = sighting;
    format!("{:08x} {}.{} {rssi} dBm ({measured_power} dBm at 1 m)", beacon.network, beacon.major, beacon.minor)
}

/// A state.
pub fn condition(is: Condition) -> String {
    match is {
        Condition::NoRecord(RecordFault::Missing) => {
            "no record in flash: nothing is sent; `baliza provision` writes one".into()
        }
        Condition::NoRecord(RecordFault::Version(version)) => {
            format!("the record in flash is of version {version}, which this image does not read: nothing is sent")
        }
        Condition::NoRecord(RecordFault::Corrupt) => "the record in flash is corrupt: nothing is sent".into(),
        Condition::NoRecord(RecordFault::Invalid) => "the record in flash cannot be followed: nothing is sent".into(),
        Condition::WrongRecord => "the record in flash is for another role or board: nothing is sent".into(),
        Condition::Searching => "searching".into(),
        Condition::Paired(peer) => format!("paired with {peer:04x}"),
        Condition::Synchronised(coordinator) => format!("synchronised with the network of {coordinator:04x}"),
        Condition::Joined(slots) => format!("joined, {slots} slots a superframe"),
        Condition::Coordinating => "coordinating".into(),
        Condition::Following(coordinator) => format!("following {coordinator:04x}"),
        Condition::RadioFailed(times) => format!("radio failed, {times} in a row; starting it again"),
        Condition::ScannerRestarted(times) => format!("scanner silent, restarted {times} times"),
        Condition::Advertising => "advertising".into(),
    }
}

fn of_counters(counters: &Counters) -> String {
    let Counters {
        t_us: _,
        sent,
        received,
        timeouts,
        corrupt,
        late,
        not_sent,
        radio_failures,
        rounds_dropped,
        telemetry_dropped,
        sightings,
        sightings_dropped,
    } = counters;
    format!(
        "{sent} sent, {received} received, {timeouts} timeouts, {corrupt} corrupt, {late} late, {not_sent} not sent, \
         {radio_failures} radio failures; {sightings} sightings; dropped: {rounds_dropped} rounds, {sightings_dropped} sightings, \
         {telemetry_dropped} telemetry frames"
    )
}

fn of_reset(reset: &Reset) -> String {
    let cause = match reset.cause {
        ResetCause::Other(number) => format!("other ({number:08x})"),
        named => named.as_str().to_owned(),
    };
    match reset.crash {
        None => cause,
        Some(Crash { reason: CrashReason::Panic, program_counter, line, file }) => {
            format!("{cause}; crashed before: panic at pc 0x{program_counter:08x}, line {line} of file {file:08x}")
        }
        Some(Crash { reason, program_counter, .. }) => {
            format!("{cause}; crashed before: {} at pc 0x{program_counter:08x}", reason.as_str())
        }
    }
}
