//! The room of each position: by the rooms' outlines, and as the room estimate of a tag from one position to the
//! next.
//!
//! The input is positions of any method, UWB or Bluetooth; `positioning_core::ble::rooms` classifies them.

use std::collections::HashMap;
use std::path::Path;

use positioning_core::ble::rooms::{
    Classifier, MAX_ROOMS, Outlines, RoomEstimate, RoomHysteresis, Settings, Spot, likeliest,
};

use recording::positions::PositionRow;
use recording::{Table, UserError};

/// How long a change of room takes, seconds, at most: that of a tag that knows its room by RSSI values.
pub const SLOWEST_S: f64 = 4.6;
/// The same at least: several rounds of any tag, and a sway in a doorway.
pub const FASTEST_S: f64 = 1.0;
/// A person walks this fast, metres per second.
const WALKING_M_S: f64 = 1.0;

/// The largest number of corners of a room.
const MOST_CORNERS: usize = 1000;

/// A room and its outline.
#[derive(Clone, Debug, PartialEq)]
pub struct Room {
    /// Its name.
    pub name: String,
    /// Its corners in their order, metres.
    pub corners_m: Vec<[f32; 2]>,
}

/// A position's room.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found {
    /// The most probable room, by its index in the list, and its probability; `None` outside of all rooms.
    pub likeliest: Option<(usize, f32)>,
    /// The room estimate of a tag.
    pub answer: RoomEstimate,
}

/// Reads `room,x_m,y_m`: the corners of each room in their order.
///
/// # Errors
/// A line is wrong (the first one is reported), a room has fewer than three corners, or there are more than
/// [`MAX_ROOMS`] rooms.
pub fn read_outlines(file: &Path) -> Result<Vec<Room>, UserError> {
    let mut table = Table::open(file)?;
    let (room, x, y) = (table.column("room")?, table.column("x_m")?, table.column("y_m")?);
    let mut rooms: Vec<Room> = Vec::new();
    let mut by_name: HashMap<String, usize> = HashMap::new();
    while let Some(row) = table.next_row()? {
        let (name, corner) = (row.some_text(room)?, [row.some_number(x)? as f32, row.some_number(y)? as f32]);
        let at = *by_name.entry(name.to_owned()).or_insert_with(|| {
            rooms.push(Room { name: name.to_owned(), corners_m: Vec::new() });
            rooms.len() - 1
        });
        rooms[at].corners_m.push(corner);
        if rooms[at].corners_m.len() > MOST_CORNERS {
            return Err(row.wrong(room, &format!("{name:?} has more than {MOST_CORNERS} corners")));
        }
    }
    if let Some(room) = rooms.iter().find(|room| room.corners_m.len() < 3) {
        return Err(UserError::file(file, format!("room {:?} has fewer than three corners", room.name)));
    }
    match rooms.len() {
        0 => Err(UserError::line(file, 1, "no rooms below the header")),
        count if count > MAX_ROOMS => {
            Err(UserError::file(file, format!("{count} rooms, where {MAX_ROOMS} are told apart")))
        }
        _ => Ok(rooms),
    }
}

/// The room of a position that is known exactly.
pub fn room_of(rooms: &[Room], [x, y]: [f64; 2]) -> Option<usize> {
    let spot = Spot { position_m: [x as f32, y as f32], covariance_m2: [0.0; 3] };
    outlines(rooms, |outlines| outlines.probabilities(&spot)).as_ref().and_then(likeliest).map(|(room, _)| room)
}

/// How long a change of room should take, seconds: the time that a walking person needs from two standard deviations
/// before a wall to two behind it, within [`FASTEST_S`] and [`SLOWEST_S`]. Errors of a position last for about that
/// way. The standard deviation is the median over positions.
pub fn settling_s(rows: &[PositionRow]) -> f64 {
    let mut sigmas_m: Vec<f64> = rows.iter().filter_map(|row| row.sigma_m).map(|[x, y]| x.max(y)).collect();
    sigmas_m.sort_by(f64::total_cmp);
    let middle = sigmas_m.get(sigmas_m.len() / 2);
    middle.map_or(SLOWEST_S, |sigma_m| (4.0 * sigma_m / WALKING_M_S).clamp(FASTEST_S, SLOWEST_S))
}

/// Hysteresis whose answer changes this number of seconds after positions have become certain of another room: then
/// the smoothed probability of the new room, 1 − e^(−t ⁄ τ), reaches 0.9.
fn hysteresis(settle_s: f64) -> RoomHysteresis {
    let usual = Settings::default();
    let time_constants = -(1.0 - f64::from(usual.enter)).ln();
    let smoothing_us = (1e6 * settle_s / time_constants) as u32;
    RoomHysteresis::new(Settings { smoothing_us, ..usual })
}

/// The rooms of one method's positions, in order of time, with changes that take `settle_s`. The time is that of the
/// row, or else a second after the row before.
pub fn follow(rooms: &[Room], rows: &[PositionRow], settle_s: f64) -> Vec<Found> {
    let mut presence = hysteresis(settle_s);
    let mut t_s = 0.0;
    rows.iter()
        .map(|row| {
            t_s = row.t_s.unwrap_or(t_s + 1.0).max(0.0);
            let spot = row.place.as_ref().map(|place| {
                let [sx, sy] = row.sigma_m.unwrap_or([0.0; 2]);
                let covariance_m2 = [(sx * sx) as f32, 0.0, (sy * sy) as f32];
                Spot { position_m: [place.x_m as f32, place.y_m as f32], covariance_m2 }
            });
            let probabilities = spot.and_then(|spot| outlines(rooms, |outlines| outlines.probabilities(&spot)));
            let answer = presence.step((1e6 * t_s) as u64, probabilities.as_ref());
            Found { likeliest: probabilities.as_ref().and_then(likeliest), answer }
        })
        .collect()
}

fn outlines<T>(rooms: &[Room], judge: impl FnOnce(Outlines<'_>) -> T) -> T {
    let corners: Vec<&[[f32; 2]]> = rooms.iter().map(|room| room.corners_m.as_slice()).collect();
    judge(Outlines { rooms: &corners })
}

#[cfg(test)]
mod tests {
    use positioning_core::ble::rooms::RoomEstimate;

    use super::{Room, SLOWEST_S, follow, room_of, settling_s};
    use recording::Coordinates;
    use recording::positions::PositionRow;

    fn rooms() -> Vec<Room> {
        let square = |name: &str, x: f32| Room {
            name: name.to_owned(),
            corners_m: vec![[x, 0.0], [x + 4.0, 0.0], [x + 4.0, 4.0], [x, 4.0]],
        };
        vec![square("hall", 0.0), square("attic", 4.0)]
    }

    #[test]
    fn the_room_changes_after_the_given_time() {
        // One second in the hall, then in the attic, certainly; ten positions a second.
        let row = |index: u32| PositionRow {
            t_s: Some(f64::from(index) * 0.1),
            place: Some(Coordinates { x_m: if index < 10 { 1.0 } else { 7.0 }, y_m: 2.0, z_m: None }),
            sigma_m: Some([0.1; 2]),
            ..PositionRow::default()
        };
        let rows: Vec<_> = (0..120).map(row).collect();
        for (settle_s, changed) in [(0.0, 10), (1.0, 19), (4.6, 55)] {
            let answers = follow(&rooms(), &rows, settle_s);
            // The first position in the attic, at 1.0 s, counts as the time since the last one in the hall, 0.1 s.
            let at = answers.iter().position(|found| found.answer == RoomEstimate::Room(1)).expect("it changes");
            assert!(at.abs_diff(changed) <= 1, "{settle_s} s: {at}");
        }
    }

    #[test]
    fn a_walk_through_a_door_changes_rooms_once() {
        assert_eq!((room_of(&rooms(), [1.0, 1.0]), room_of(&rooms(), [9.0, 1.0])), (Some(0), None));
        // Ten positions a second at 0.5 m/s through the wall at 4 m, swinging by 0.2 m about the way.
        let row = |index: u32| {
            let t_s = f64::from(index) * 0.1;
            let sway = if index.is_multiple_of(2) { 0.2 } else { -0.2 };
            let place = Some(Coordinates { x_m: 1.0 + 0.5 * t_s + sway, y_m: 2.0, z_m: None });
            PositionRow {
                epoch: index.to_string(),
                t_s: Some(t_s),
                place,
                sigma_m: Some([0.1; 2]),
                ..PositionRow::default()
            }
        };
        let rows: Vec<_> = (0..120).map(row).collect();
        // Four times 0.1 m at 1 m/s is less than the least.
        assert_eq!((settling_s(&rows), settling_s(&[])), (1.0, SLOWEST_S));
        let found = follow(&rooms(), &rows, settling_s(&rows));
        let mut answers: Vec<RoomEstimate> = found.iter().map(|found| found.answer).collect();
        answers.dedup();
        assert_eq!(answers, [RoomEstimate::Room(0), RoomEstimate::Room(1)]);
        let mut likeliest: Vec<_> = found.iter().map(|found| found.likeliest.map(|(room, _)| room)).collect();
        likeliest.dedup();
        assert!(likeliest.len() > 4, "the positions alone change rooms more often: {likeliest:?}");
    }
}
