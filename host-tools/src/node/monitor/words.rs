//! A telemetry message as one line for a person. The words are those of the node's log, so that a screen that shows both can leave
//! out what it would show twice.

use std::fmt::Display;

use firmware_common::lines::{FixLine, HelloLine, ResetLine, RoomLine, StateLine};
use wire::telemetry::{
    Counters, Crash, CrashReason, Diagnostics, Difference, Fix, Message, Outcome, Range, Reset, Sighting, State,
};

/// What stands before the words: `fix`, `range`, …, five letters at most.
pub fn label(message: &Message) -> &'static str {
    match message {
        Message::Hello(_) => "hello",
        Message::Fix(_) => "fix",
        Message::Range(_) => "range",
        Message::Difference(_) => "tdoa",
        Message::Sighting(_) => "ble",
        Message::State(_) => "state",
        Message::Counters(_) => "count",
        Message::Reset(_) => "reset",
        Message::Room(_) => "room",
    }
}

/// The words.
pub fn words(message: &Message) -> String {
    match message {
        Message::Hello(hello) => HelloLine(*hello).to_string(),
        Message::Fix(fix) => of_fix(fix),
        Message::Range(range) => of_range(range),
        Message::Difference(difference) => of_difference(difference),
        Message::Sighting(sighting) => of_sighting(sighting),
        Message::State(State { is, .. }) => StateLine(*is).to_string(),
        Message::Counters(counters) => of_counters(counters),
        Message::Reset(reset) => of_reset(reset),
        Message::Room(room) => without("room ", RoomLine(room.is)),
    }
}

/// Whether a line of the log says the same as a message.
pub fn says_the_same(text: &str, message: &Message) -> bool {
    match message {
        Message::Fix(fix) if fix.position_m().is_none() => text.starts_with("no fix: "),
        Message::Fix(_) => text.starts_with("fix x="),
        Message::Counters(_) => text.ends_with(" telemetry frames dropped"),
        Message::Reset(_) => text.starts_with("reset: "),
        Message::Room(room) => text == RoomLine(room.is).to_string(),
        Message::Hello(_) | Message::State(_) => text == words(message),
        Message::Range(_) | Message::Difference(_) | Message::Sighting(_) => false,
    }
}

/// A line of the log without what the screen shows as the label.
fn without(label: &str, line: impl Display) -> String {
    let line = line.to_string();
    line.strip_prefix(label).map(str::to_owned).unwrap_or(line)
}

fn of_fix(fix: &Fix) -> String {
    match fix.outcome {
        Outcome::Position { .. } => without("fix ", FixLine::of(fix, 0)),
        // How many answered is in the log alone.
        Outcome::Reason(reason) => format!("none: {}, {} asked", reason.as_str(), fix.asked),
    }
}

fn of_range(range: &Range) -> String {
    let text = format!("{:04x} {:.3} ±{:.3} m", range.peer, range.distance_m(), range.deviation_m());
    text + &of_reception(&range.diagnostics, range.place_m())
}

fn of_difference(difference: &Difference) -> String {
    let Difference { reference, peer, .. } = difference;
    let deviation_m = difference.deviation_m();
    let text = if peer == reference {
        format!("{peer:04x} polls, ±{deviation_m:.3} m")
    } else {
        format!("{peer:04x} {:+.3} ±{deviation_m:.3} m from {reference:04x}", difference.difference_m())
    };
    text + &of_reception(&difference.diagnostics, difference.place_m())
}

/// What the receiver measured, and where the sender says it stands.
fn of_reception(diagnostics: &Diagnostics, place_m: Option<[f64; 3]>) -> String {
    let mut text = String::new();
    let mut power = |name: &str, dbm: Option<f64>| {
        if let Some(dbm) = dbm {
            text += &format!(", {name} {dbm:.1} dBm");
        }
    };
    power("received", diagnostics.rx_power_dbm());
    power("first path", diagnostics.first_path_power_dbm());
    if let Some(ppm) = diagnostics.clock_offset_ppm() {
        text += &format!(", clock {ppm:+.2} ppm");
    }
    if let Some([x, y, z]) = place_m {
        text += &format!(", at {x:.2} {y:.2} {z:.2}");
    }
    text
}

fn of_sighting(sighting: &Sighting) -> String {
    let Sighting { beacon, rssi, measured_power, .. } = sighting;
    format!("{:08x} {}.{} {rssi} dBm ({measured_power} dBm at 1 m)", beacon.network, beacon.major, beacon.minor)
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
    let mut text = without("reset: ", ResetLine(*reset));
    // The file's hash is in telemetry alone.
    if let Some(Crash { reason: CrashReason::Panic, file, .. }) = reset.crash {
        text += &format!(" of file {file:08x}");
    }
    text
}
