//! The walk of a tag that has no path in its file: round within the anchors' hull.

use super::Walk;

/// The height at which a tag is carried, metres above the floor, where the file gives none.
const CARRIED_M: f64 = 1.2;
/// A ceiling is at most this high above a tag, metres: anchors of an upper floor have their tags on that floor.
const BELOW_ANCHORS_M: f64 = 2.0;
/// The part of the way from the hull's middle to a corner.
const TOWARDS_CORNER: f64 = 0.7;
/// By how much the walk of each further tag is narrower, and after how many tags widths begin again.
const NARROWER: f64 = 0.05;
const TAGS: usize = 10;
/// After twice as many, tags begin farther along the same walks, by this part of them: never in the same place (the golden
/// section).
const FARTHER: f64 = 0.618_033_988_75;
/// Where a tag stands beside a single anchor, metres.
const BESIDE_M: f64 = 2.0;
/// The greatest number of corners of a walk.
const CORNERS: usize = 12;
/// Metres per second.
const WALKING_M_S: f64 = 1.0;

/// The positions among which tags walk.
pub(super) struct Landmarks {
    /// The corners of their hull, metres.
    corners: Vec<[f64; 2]>,
    middle: [f64; 2],
    /// The height at which tags are carried that do not know theirs, metres.
    height_m: f64,
}

impl Landmarks {
    /// Landmarks at these positions, metres.
    pub(super) fn new(positions: &[[f64; 3]]) -> Self {
        let heights = || positions.iter().map(|[_, _, z]| *z);
        let lowest = heights().fold(f64::INFINITY, f64::min);
        let highest = heights().fold(f64::NEG_INFINITY, f64::max);
        let all = hull(positions.iter().map(|[x, y, _]| [*x, *y]).collect());
        let corners: Vec<[f64; 2]> = all.iter().copied().step_by(all.len().div_ceil(CORNERS).max(1)).collect();
        let count = corners.len().max(1) as f64;
        Self {
            middle: [0, 1].map(|axis: usize| corners.iter().map(|corner| corner[axis]).sum::<f64>() / count),
            height_m: CARRIED_M.max(lowest - BELOW_ANCHORS_M).min(highest.max(CARRIED_M)),
            corners,
        }
    }

    /// A closed walk within the hull at a height (metres), for the tag with this number. Tags walk in turns in one
    /// direction and the other.
    pub(super) fn walk(&self, height_m: Option<f32>, number: usize) -> Walk {
        let (mut corners, middle) = (self.corners.clone(), self.middle);
        let z = height_m.map_or(self.height_m, f64::from);
        if corners.len() < 2 {
            return Walk::standing([middle[0] + BESIDE_M, middle[1], z]);
        }
        let part = TOWARDS_CORNER - NARROWER * (number % TAGS) as f64;
        let first = number % corners.len();
        corners.rotate_left(first);
        if number % 2 == 1 {
            corners.reverse();
        }
        let inside = |axis: usize, corner: [f64; 2]| middle[axis] + part * (corner[axis] - middle[axis]);
        let points: Vec<_> = corners.into_iter().map(|corner| [inside(0, corner), inside(1, corner), z]).collect();
        let standing = Walk::standing(points[0]);
        Walk::new(points, WALKING_M_S, true).unwrap_or(standing).ahead((number / (2 * TAGS)) as f64 * FARTHER % 1.0)
    }
}

/// The corners of the convex hull, anticlockwise (Andrew's monotone chain); the two ends where all points lie on one
/// line, the point where there is only one.
fn hull(mut points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    points.dedup();
    if points.len() < 3 {
        return points;
    }
    let chain = |points: &mut dyn Iterator<Item = [f64; 2]>| {
        let mut chain: Vec<[f64; 2]> = Vec::new();
        for point in points {
            while let [.., a, b] = chain[..]
                && (b[0] - a[0]) * (point[1] - a[1]) - (b[1] - a[1]) * (point[0] - a[0]) <= 0.0
            {
                chain.pop();
            }
            chain.push(point);
        }
        chain.pop();
        chain
    };
    let mut lower = chain(&mut points.iter().copied());
    lower.extend(chain(&mut points.iter().rev().copied()));
    lower
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::distance;

    /// Four corners of 10 m × 6 m, and an anchor within.
    const ROOM: [[f64; 3]; 5] = [[0.0, 0.0, 2.4], [10.0, 0.0, 2.4], [4.0, 3.0, 2.4], [10.0, 6.0, 0.6], [0.0, 6.0, 2.4]];

    fn walk_among(positions: &[[f64; 3]], height_m: Option<f32>, number: usize) -> Walk {
        Landmarks::new(positions).walk(height_m, number)
    }

    #[test]
    fn tags_walk_round_within_the_hull_at_their_height() {
        for (number, height_m) in (0..24).zip([None, Some(1.7)].into_iter().cycle()) {
            let walk = walk_among(&ROOM, height_m, number);
            let places: Vec<_> = (0..100).map(|second| walk.at(f64::from(second))).collect();
            for [x, y, z] in &places {
                assert!((1.4..=8.6).contains(x) && (0.85..=5.15).contains(y), "{number}: {x} {y}");
                assert_eq!(*z, height_m.map_or(1.2, f64::from));
            }
            assert!(places.iter().any(|at| at[0] > 6.0) && places.iter().any(|at| at[0] < 4.0), "{number}");
        }
        // 7/10 of the way from (5, 3) to the corner (0, 0).
        assert!(distance(walk_among(&ROOM, None, 0).at(0.0), [1.5, 0.9, 1.2]) < 1e-9);
    }

    #[test]
    fn few_anchors_and_those_of_an_upper_floor_have_a_walk_too() {
        let two = walk_among(&[[0.0, 0.0, 2.0], [10.0, 0.0, 2.0]], None, 0);
        // From 1.5 m to 8.5 m and back.
        assert!((two.at(7.0)[0] - 8.5).abs() < 1e-9 && (two.at(14.0)[0] - 1.5).abs() < 1e-9);
        let one = walk_among(&[[3.0, 1.0, 1.5], [3.0, 1.0, 1.5]], None, 0);
        assert_eq!(one.place(), Some([5.0, 1.0, 1.2]));
        let upstairs = ROOM.map(|[x, y, _]| [x, y, 12.4]);
        assert_eq!(walk_among(&upstairs, None, 0).at(0.0)[2], 10.4);
        let in_line = [[0.0, 0.0, 2.0], [4.0, 4.0, 2.0], [8.0, 8.0, 2.0]];
        assert!(walk_among(&in_line, None, 3).place().is_none());
        assert_eq!(walk_among(&[], None, 0).place(), Some([2.0, 0.0, 1.2]));
    }
}
