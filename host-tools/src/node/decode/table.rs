//! Messages as rows of CSV tables, with the columns that `solve`, `plot` and the commands for beacons read.

use wire::telemetry::{BeaconId, Diagnostics, Difference, Fix, Message, Range, Room, Sighting};

use super::Stamp;
use crate::files::positions::{CHIP_COLUMNS, COLUMNS, POWER_COLUMNS};

/// A table, and which messages are its rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Table {
    /// Fixes, with or without a position.
    Positions,
    /// Ranges, each with what the receiver measured.
    Ranges,
    /// Differences of arrivals, each with what the receiver measured; of each round the reference first.
    Differences,
    /// Sightings of beacons.
    Rssi,
    /// In which rooms a tag is.
    Rooms,
}

impl Table {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Positions, Self::Ranges, Self::Differences, Self::Rssi, Self::Rooms];

    /// Its file in a recording.
    pub const fn file(self) -> &'static str {
        match self {
            Self::Positions => "positions.csv",
            Self::Ranges => "ranges.csv",
            Self::Differences => "differences.csv",
            Self::Rssi => "rssi.csv",
            Self::Rooms => "rooms.csv",
        }
    }

    /// The columns.
    pub fn columns(self) -> Vec<&'static str> {
        let received = || POWER_COLUMNS.into_iter().chain(CHIP_COLUMNS).chain(["sigma_m", "clock_offset_ppm"]);
        match self {
            Self::Positions => COLUMNS.to_vec(),
            Self::Ranges => ["epoch", "t_s", "anchor", "range_m"].into_iter().chain(received()).collect(),
            Self::Differences => {
                ["epoch", "t_s", "reference", "anchor", "difference_m"].into_iter().chain(received()).collect()
            }
            Self::Rssi => vec!["epoch", "t_s", "beacon", "rssi_dbm", "measured_power_dbm"],
            Self::Rooms => vec!["epoch", "t_s", "is", "room", "probability", "other_room", "other_probability"],
        }
    }

    /// The row that a message is; `None` where it is in another table, or in none.
    pub fn row(self, stamp: Stamp, message: &Message) -> Option<Vec<String>> {
        let start = [stamp.epoch.to_string(), format!("{:.6}", stamp.t_s)];
        let fields = match (self, message) {
            (Self::Positions, Message::Fix(fix)) => position(fix),
            (Self::Ranges, Message::Range(of)) => range(of),
            (Self::Differences, Message::Difference(of)) => difference(of),
            (Self::Rssi, Message::Sighting(of)) => sighting(of),
            (Self::Rooms, Message::Room(of)) => room(of),
            (Self::Positions | Self::Ranges | Self::Differences | Self::Rssi | Self::Rooms, _) => return None,
        };
        Some(start.into_iter().chain(fields).collect())
    }
}

/// How files call a beacon: network, major and minor number.
pub fn beacon_name(beacon: BeaconId) -> String {
    format!("{:08x}-{}-{}", beacon.network, beacon.major, beacon.minor)
}

fn position(fix: &Fix) -> Vec<String> {
    let mut fields = vec!["tag".to_owned()];
    match (fix.position_m(), fix.deviation_m()) {
        (Some(position), Some([x, y, z])) => {
            fields.extend(position.map(metres));
            // A height that was given has no deviation.
            fields.extend([metres(x), metres(y), if z == 0.0 { String::new() } else { metres(z) }]);
        }
        (None, _) | (_, None) => fields.extend([const { String::new() }; 6]),
    }
    fields.push(fix.used().map_or_else(String::new, |used| used.count_ones().to_string()));
    fields.push(fix.reason().map_or_else(String::new, |reason| reason.as_str().to_owned()));
    fields
}

fn range(range: &Range) -> Vec<String> {
    let start = [range.peer.to_string(), metres(range.distance_m())];
    start.into_iter().chain(received(range.diagnostics, range.deviation_m())).collect()
}

fn difference(difference: &Difference) -> Vec<String> {
    let start = [difference.reference.to_string(), difference.peer.to_string(), metres(difference.difference_m())];
    start.into_iter().chain(received(difference.diagnostics, difference.deviation_m())).collect()
}

/// What the receiver measured, and the deviation of what came of it.
fn received(measured: Diagnostics, deviation_m: f64) -> [String; 11] {
    let hundredths = |value: Option<f64>| value.map_or_else(String::new, |value| format!("{value:.2}"));
    let [amp1, amp2, amp3] = measured.first_path_amplitudes.map(|amplitude| amplitude.to_string());
    [
        hundredths(measured.rx_power_dbm()),
        hundredths(measured.first_path_power_dbm()),
        measured.first_path_index().to_string(),
        amp1,
        amp2,
        amp3,
        measured.cir_power.to_string(),
        measured.preamble_count.to_string(),
        measured.noise_deviation.to_string(),
        metres(deviation_m),
        hundredths(measured.clock_offset_ppm()),
    ]
}

fn sighting(sighting: &Sighting) -> Vec<String> {
    vec![beacon_name(sighting.beacon), sighting.rssi.to_string(), sighting.measured_power.to_string()]
}

fn room(room: &Room) -> Vec<String> {
    let likely = |place: usize| {
        let likely = room.is.rooms().get(place);
        likely.map_or([const { String::new() }; 2], |of| [of.room.to_string(), format!("{:.3}", of.probability())])
    };
    std::iter::once(room.is.as_str().to_owned()).chain(likely(0)).chain(likely(1)).collect()
}

/// As fine as the wire has it.
pub(crate) fn metres(value: f64) -> String {
    format!("{value:.4}")
}
