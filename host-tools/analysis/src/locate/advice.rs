//! What is odd about a file of positions or the outlines of rooms, and why there is no position: sentences that name the
//! likely cause and what to do. What is odd about a recording is in [`crate::check`].

use std::collections::BTreeMap;

use positioning_core::SolveError;
use positioning_core::engine::Missing;

use crate::survey::presence::Room;
use recording::positions::PositionRow;
use recording::{Epochs, NoPosition, Solved, Truth};

/// A warning that no epoch has a true position, though there is a truth.
pub fn without_truth(epochs: &Epochs, truth: &Truth) -> String {
    let span = |times_s: &mut dyn Iterator<Item = f64>| {
        let none = (f64::INFINITY, f64::NEG_INFINITY);
        let (first, last) = times_s.fold(none, |(first, last), t_s| (first.min(t_s), last.max(t_s)));
        if first <= last { format!("{first} to {last} s") } else { "no times".to_owned() }
    };
    let (ranges, truths) =
        (span(&mut epochs.times_s().flatten()), span(&mut truth.rows().filter_map(|(_, t_s, _)| t_s)));
    format!(
        "no epoch has a true position, so there are no errors: the ranges have {ranges}, the truth has {truths}, and their \
         epochs have other names; --time-offset-s adds seconds to the times of the truth"
    )
}

/// Why there is no position at all: the sentence of the most frequent reason. `None` where there is a position, or
/// nothing was to be solved. `in_space`: heights are solved for. `stations`: "anchors" or "beacons".
pub fn nothing_solved<'a>(solved: impl Iterator<Item = &'a Solved>, stations: &str, in_space: bool) -> Option<String> {
    let mut counts: BTreeMap<&str, (usize, NoPosition)> = BTreeMap::new();
    for solved in solved {
        match solved.outcome {
            Ok(_) => return None,
            Err(reason) => counts.entry(reason.as_str()).or_insert((0, reason)).0 += 1,
        }
    }
    let epochs: usize = counts.values().map(|(count, _)| count).sum();
    let (count, reason) = counts.into_values().max_by_key(|(count, _)| *count)?;
    Some(format!(
        "none of {epochs} epochs has a position; {count} of them: {}: {}",
        reason.as_str(),
        because(reason, stations, in_space)
    ))
}

fn because(reason: NoPosition, stations: &str, in_space: bool) -> String {
    let least = if in_space { 4 } else { 3 };
    let text = match reason {
        NoPosition::SolveError(error) | NoPosition::Missing(Missing::SolveError(error)) => match error {
            SolveError::TooFewAnchors => {
                return format!(
                    "at least {least} {stations} are needed{}; rows of one fix must have one epoch, and each station a \
                     known position",
                    if in_space { ", 3 where the height is known (--dims 2 --height-m Z)" } else { "" }
                );
            }
            SolveError::TooManyAnchors => return format!("there are more {stations} than a fix takes"),
            SolveError::NotFinite => "a range or a position is beyond what is possible",
            SolveError::CoincidentAnchors => {
                return format!("all {stations} are at one place: correct their positions");
            }
            SolveError::CollinearAnchors => {
                return format!("all {stations} lie on one line: move one of them, or leave its height out (--dims 2)");
            }
            SolveError::RangesDisjoint if !in_space => {
                "the ranges cannot meet: is the tag's height (--height-m) right, are ranges and positions both in metres, and \
                 do the names belong to the positions?"
            }
            SolveError::RangesDisjoint => {
                "the ranges cannot meet: are ranges and positions both in metres, and do the names belong to the positions?"
            }
            SolveError::Diverged => {
                "the ranges contradict the positions: check the positions and the unit of the ranges"
            }
            SolveError::SightUnknown => "the method needs a column los that says which ranges are direct",
        },
        NoPosition::HeightUnknown => {
            "the height is to come from the truth, which has none for these epochs: give --height-m"
        }
        NoPosition::Missing(Missing::RoundOpen) => "the rounds do not end: single ranges need --group-s",
        NoPosition::Missing(Missing::Lost(_)) => {
            "the track does not begin or is lost at once: see what baliza solve says of the same files"
        }
        NoPosition::Unmatched(_) => "no scan fits to the map: was it made with the same beacons?",
    };
    text.to_owned()
}

/// A warning about positions whose deviations are negative.
pub fn of_positions(rows: &[PositionRow]) -> Option<String> {
    let mut negative = rows.iter().filter(|row| row.sigma_m.is_some_and(|sigma| sigma.iter().any(|s| *s < 0.0)));
    let first = negative.next()?;
    Some(format!(
        "{} of the positions have a negative standard deviation, the first is that of epoch {}: its magnitude counts",
        1 + negative.count(),
        first.epoch
    ))
}

/// Warnings about outlines that cross themselves or each other.
pub fn of_outlines(rooms: &[Room]) -> Vec<String> {
    let mut warnings = Vec::new();
    for room in rooms {
        let sides = sides(room);
        let crossing =
            sides.iter().enumerate().any(|(at, side)| sides[at + 1..].iter().any(|other| cross(*side, *other)));
        if crossing {
            warnings.push(format!(
                "the outline of room {} crosses itself: give its corners in their order along the walls",
                room.name
            ));
        }
    }
    for (at, room) in rooms.iter().enumerate() {
        for other in &rooms[at + 1..] {
            let theirs = sides(other);
            if sides(room).iter().any(|side| theirs.iter().any(|other| cross(*side, *other))) {
                warnings.push(format!(
                    "the outlines of the rooms {} and {} cross: a position in both counts for both",
                    room.name, other.name
                ));
            }
        }
    }
    warnings
}

type Side = [[f64; 2]; 2];

fn sides(room: &Room) -> Vec<Side> {
    let corners = room.corners_m.iter().map(|corner| corner.map(f64::from));
    corners.clone().zip(corners.cycle().skip(1)).map(|(from, to)| [from, to]).collect()
}

/// Whether two sides cross between their ends: each has the ends of the other on both of its sides. Sides that only
/// touch do not cross.
fn cross(one: Side, other: Side) -> bool {
    let area = |[[x0, y0], [x1, y1]]: Side, [x, y]: [f64; 2]| (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0);
    let parted = |by: Side, of: Side| area(by, of[0]) * area(by, of[1]) < 0.0;
    parted(one, other) && parted(other, one)
}
