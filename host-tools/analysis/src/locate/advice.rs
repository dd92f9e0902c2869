//! What is odd about a recording, a file of positions or the outlines of rooms: sentences that name the likely cause
//! and what to do. Nothing here is an error, because each of them may be meant.

use std::collections::{BTreeMap, HashMap};

use baliza_report::percentile;
use nalgebra::{DMatrix, DVector};
use positioning_core::SolveError;
use positioning_core::engine::Missing;

use crate::survey::presence::Room;
use recording::positions::PositionRow;
use recording::{Anchor, Coordinates, Epoch, Epochs, Recording, Truth};
use recording::{Height, NoPosition, Solved, Space};

/// Anchors lie in one plane where their spread across it is less than this share of the next larger one: as the
/// solvers decide (`positioning_core`'s geometry).
const COPLANAR: f64 = 0.05;
/// Anchors lie nearly on one line where their spread across it is less than this share of that along it.
const COLLINEAR: f64 = 0.05;
/// Anchors closer than this are at one place, metres.
const ONE_PLACE_M: f64 = 0.01;
/// The median range is hardly more than this many times as long as the anchors' extent; from the second number on, the
/// ranges are in millimetres rather than centimetres.
const LONG_RANGES: [f64; 2] = [15.0, 170.0];
/// The anchors' extent is hardly more than this many times as long as the median range, likewise.
const WIDE_ANCHORS: [f64; 2] = [30.0, 530.0];
/// The rows of one epoch are of one fix where their times differ by no more than this, seconds.
const ONE_FIX_S: f64 = 1.0;

/// Warnings about a recording that is to be solved in this space.
pub fn of_recording(recording: &Recording, space: Space) -> Vec<String> {
    let ranged = ranged(recording);
    let places: Vec<&Coordinates> = ranged.iter().map(|anchor| &anchor.place).collect();
    [
        geometry(&places, space),
        without_height(&places, space),
        unit(recording, &places),
        one_place(ranged.iter().map(|anchor| (anchor.name.as_str(), corner(&anchor.place, 0.0)))),
        negative(recording),
        times(&recording.epochs),
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// Whether anchors with known heights lie in one plane.
pub fn coplanar(anchors: &[Anchor]) -> bool {
    let points: Vec<[f64; 3]> = anchors.iter().map(|anchor| corner(&anchor.place, 0.0)).collect();
    are_coplanar(points.len(), spreads(&points))
}

/// Whether anchors lie nearly on one line, seen from above.
pub fn on_a_line(anchors: &[Anchor]) -> bool {
    let points: Vec<[f64; 2]> = anchors.iter().map(|anchor| [anchor.place.x_m, anchor.place.y_m]).collect();
    are_collinear(points.len(), spreads(&points))
}

/// Whether points with these spreads lie in one plane. Three points always do.
fn are_coplanar(count: usize, [up, across, _]: [f64; 3]) -> bool {
    count > 3 && up < COPLANAR * across
}

/// Whether points with these spreads, across and along, lie nearly on one line. Two points always do.
fn are_collinear(count: usize, [across, along]: [f64; 2]) -> bool {
    count > 2 && across < COLLINEAR * along
}

/// The anchors to which there are ranges.
fn ranged(recording: &Recording) -> Vec<&Anchor> {
    let mut has_range = vec![false; recording.anchors.len()];
    for range in recording.epochs.iter().flat_map(|epoch| epoch.ranges.iter()) {
        if let Some(has) = has_range.get_mut(range.anchor) {
            *has = true;
        }
    }
    recording.anchors.iter().zip(has_range).filter_map(|(anchor, has)| has.then_some(anchor)).collect()
}

fn corner(place: &Coordinates, unknown_height_m: f64) -> [f64; 3] {
    [place.x_m, place.y_m, place.z_m.unwrap_or(unknown_height_m)]
}

/// The spreads of points along their principal axes, the smallest first: singular values of their distances from
/// their mean.
fn spreads<const D: usize>(points: &[[f64; D]]) -> [f64; D] {
    let count = points.len().max(1) as f64;
    let mean: [f64; D] = std::array::from_fn(|axis| points.iter().map(|point| point[axis]).sum::<f64>() / count);
    let centred = DMatrix::from_fn(points.len(), D, |row, axis| points[row][axis] - mean[axis]);
    let values: DVector<f64> = (centred.transpose() * centred).symmetric_eigenvalues();
    let mut spreads: [f64; D] = std::array::from_fn(|axis| values[axis].max(0.0).sqrt());
    spreads.sort_by(f64::total_cmp);
    spreads
}

fn geometry(places: &[&Coordinates], space: Space) -> Option<String> {
    const LINE: &str = "the anchors lie nearly on one line, so that each position has a mirror image on its other side: \
                        put an anchor beside the line, or say by --area where the tag is";
    match space {
        Space::Plane(_) => {
            let flat: Vec<[f64; 2]> = places.iter().map(|place| [place.x_m, place.y_m]).collect();
            are_collinear(flat.len(), spreads(&flat)).then(|| LINE.to_owned())
        }
        Space::Full(side) => {
            let points: Vec<[f64; 3]> = places.iter().map(|place| corner(place, 0.0)).collect();
            let [up, across, along] = spreads(&points);
            if are_collinear(points.len(), [across, along]) {
                return Some(LINE.to_owned());
            }
            (are_coplanar(points.len(), [up, across, along]) && side.is_none()).then(|| {
                "the anchors lie in one plane, so that the distance of the tag from that plane is uncertain and its side \
                 is taken to be below: give --dims 2 --height-m Z, or --side"
                    .to_owned()
            })
        }
    }
}

fn without_height(places: &[&Coordinates], space: Space) -> Option<String> {
    // Files of the plane have zeros.
    let heights = places.iter().any(|place| place.z_m.is_some_and(|z_m| z_m != 0.0));
    (space == Space::Plane(Height::Unknown) && heights).then(|| {
        "--dims 2 without a height takes slant ranges for horizontal ones: give --height-m Z or --height-from-truth"
            .to_owned()
    })
}

fn unit(recording: &Recording, places: &[&Coordinates]) -> Option<String> {
    let mut ranges: Vec<f64> =
        recording.epochs.iter().flat_map(|epoch| epoch.ranges.iter()).map(|range| range.range_m).collect();
    ranges.sort_unstable_by(f64::total_cmp);
    let extent = |axis: fn(&Coordinates) -> f64| {
        let (least, greatest) = places
            .iter()
            .map(|place| axis(place))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(least, greatest), at| (least.min(at), greatest.max(at)));
        greatest - least
    };
    let extent_m = extent(|place| place.x_m).hypot(extent(|place| place.y_m));
    let median_m = if ranges.is_empty() { 0.0 } else { percentile(&ranges, 0.5) };
    if !(extent_m > 0.0 && median_m > 0.0) {
        return None;
    }
    let question = |what: &str, ratio: f64, [wrong, millimetres]: [f64; 2]| {
        let unit = if ratio > millimetres { "millimetres" } else { "centimetres" };
        (ratio > wrong).then(|| {
            format!(
                "half of the ranges are longer than {median_m:.1} m, and the anchors are within {extent_m:.1} m of each other: \
                 are {what} in {unit}? Metres are expected"
            )
        })
    };
    question("the ranges", median_m / extent_m, LONG_RANGES)
        .or_else(|| question("the anchors", extent_m / median_m, WIDE_ANCHORS))
}

/// A sentence about the first two of these that are at one place.
pub fn one_place<'a>(placed: impl Iterator<Item = (&'a str, [f64; 3])>) -> Option<String> {
    let mut by_place: HashMap<[i64; 3], &str> = HashMap::new();
    for (name, at_m) in placed {
        let place = at_m.map(|c| (c / ONE_PLACE_M).round() as i64);
        if let Some(other) = by_place.insert(place, name) {
            let [x_m, y_m, z_m] = at_m;
            return Some(format!(
                "the anchors {other} and {name} are both at {x_m:.2}, {y_m:.2}, {z_m:.2} m, so that one of them adds nothing: \
                 correct the place of one"
            ));
        }
    }
    None
}

fn negative(recording: &Recording) -> Option<String> {
    let mut negative = recording
        .epochs
        .iter()
        .flat_map(|epoch| epoch.ranges.iter().map(move |range| (epoch, range)))
        .filter(|(_, range)| range.range_m < 0.0);
    let (epoch, range) = negative.next()?;
    let (mut count, mut are_alike) = (1, true);
    for (_, other) in negative {
        count += 1;
        are_alike &= other.range_m == range.range_m;
    }
    if are_alike && count > 1 {
        return Some(format!(
            "{count} of the ranges are {}, which no measurement gives again and again: leave the field empty where there is no \
             range",
            range.range_m
        ));
    }
    let anchor = recording.anchors.get(range.anchor).map_or("?", |anchor| anchor.name.as_str());
    Some(format!(
        "{count} of the ranges are negative, the first is {} m to anchor {anchor} in epoch {}: calibrate the antenna \
         delays, which are too large",
        range.range_m, epoch.name
    ))
}

fn times(epochs: &Epochs) -> Option<String> {
    let span = |epoch: &Epoch<'_>| {
        let (first, last) = epoch
            .ranges
            .iter()
            .filter_map(|range| range.t_s)
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(first, last), t_s| (first.min(t_s), last.max(t_s)));
        (last - first > ONE_FIX_S).then_some((first, last))
    };
    let mut long = epochs.iter().filter_map(|epoch| Some((epoch, span(&epoch)?)));
    let (epoch, (first, last)) = long.next()?;
    Some(format!(
        "{} of the epochs have rows whose times differ by more than {ONE_FIX_S} s, the first is {} with {first} to {last} s, \
         and the latest time counts: number the epochs again, or make rounds by --group-s",
        1 + long.count(),
        epoch.name
    ))
}

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

/// A warning that epochs had several ranges of one anchor, of which `count` were dropped.
pub fn of_repeats(count: usize) -> Option<String> {
    (count > 0).then(|| {
        format!(
            "epochs have several ranges of one anchor at one time, of which the median counts and {count} were dropped: give \
             each fix an epoch of its own"
        )
    })
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
