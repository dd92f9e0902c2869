//! Questions about where the anchors are: whether positions have mirror images, and whether heights are missing.

use std::collections::HashMap;

use nalgebra::{DMatrix, DVector};
use recording::{Anchor, Coordinates, Height, Recording, Space};

use super::{Finding, FindingCode};

/// Anchors lie in one plane where their spread across it is less than this share of the next larger one: as the
/// solvers decide (`positioning_core`'s geometry).
const COPLANAR: f64 = 0.05;
/// Anchors lie nearly on one line where their spread across it is less than this share of that along it.
const COLLINEAR: f64 = 0.05;
/// Anchors closer than this are at one place, metres.
const ONE_PLACE_M: f64 = 0.01;
/// What the places of the anchors that have ranges say about the space in which the recording is to be solved.
pub(super) fn questions(recording: &Recording, space: Space) -> Vec<Finding> {
    let ranged = ranged(recording);
    let places: Vec<&Coordinates> = ranged.iter().map(|anchor| &anchor.place).collect();
    let findings = [geometry(&places, space), without_height(&places, space), coincident(&ranged)];
    findings.into_iter().flatten().collect()
}

/// Whether two of the anchors are at one place.
fn coincident(anchors: &[&Anchor]) -> Option<Finding> {
    let placed = anchors.iter().map(|anchor| (anchor.name.as_str(), corner(&anchor.place, 0.0)));
    one_place(placed).map(|message| Finding::new(FindingCode::AnchorsCoincide, message))
}

/// Whether two of the anchors that have ranges are at one place.
pub fn of_places(recording: &Recording) -> Option<Finding> {
    coincident(&ranged(recording))
}

fn ambiguous(message: &str) -> Finding {
    Finding::new(FindingCode::AmbiguousGeometry, message.to_owned())
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
pub(super) fn ranged(recording: &Recording) -> Vec<&Anchor> {
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

fn geometry(places: &[&Coordinates], space: Space) -> Option<Finding> {
    const LINE: &str = "the anchors lie nearly on one line, so that each position has a mirror image on its other side: \
                        put an anchor beside the line, or say by --area where the tag is";
    match space {
        Space::Plane(_) => {
            let flat: Vec<[f64; 2]> = places.iter().map(|place| [place.x_m, place.y_m]).collect();
            are_collinear(flat.len(), spreads(&flat)).then(|| ambiguous(LINE))
        }
        Space::Full(side) => {
            let points: Vec<[f64; 3]> = places.iter().map(|place| corner(place, 0.0)).collect();
            let [up, across, along] = spreads(&points);
            if are_collinear(points.len(), [across, along]) {
                return Some(ambiguous(LINE));
            }
            (are_coplanar(points.len(), [up, across, along]) && side.is_none()).then(|| {
                ambiguous(
                    "the anchors lie in one plane, so that the distance of the tag from that plane is uncertain and its side \
                 is taken to be below: give --dims 2 --height-m Z, or --side",
                )
            })
        }
    }
}

fn without_height(places: &[&Coordinates], space: Space) -> Option<Finding> {
    // Files of the plane have zeros.
    let heights = places.iter().any(|place| place.z_m.is_some_and(|z_m| z_m != 0.0));
    (space == Space::Plane(Height::Unknown) && heights).then(|| {
        let message = "--dims 2 without a height takes slant ranges for horizontal ones: give --height-m Z or \
                       --height-from-truth";
        Finding::new(FindingCode::HeightMissing, message.to_owned())
    })
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
