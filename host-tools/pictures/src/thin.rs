//! Fewer marks for the same picture: of marks that would cover each other one is drawn.
//!
//! The plane is divided into cells. A point is left out only if another one of its cell is drawn, so that every point
//! is at most a cell's diagonal from a drawn one; the outermost points are always drawn. Where marks are still too
//! many, cells grow.

use std::collections::HashSet;

/// Cells grow by this factor.
const GROWS: f64 = 1.5;

type Cell = [i64; 2];

fn cell_of(at: [f64; 2], side_m: f64) -> Cell {
    at.map(|c| (c / side_m).floor() as i64)
}

/// The indices of the points to be drawn, at most about `most` of them; `side_m` is the side of a cell at first.
pub fn points(points: &[[f64; 2]], side_m: f64, most: usize) -> Vec<usize> {
    let outermost: HashSet<usize> = (0..2)
        .flat_map(|axis| {
            let by = |one: &usize, other: &usize| points[*one][axis].total_cmp(&points[*other][axis]);
            [(0..points.len()).min_by(by), (0..points.len()).max_by(by)]
        })
        .flatten()
        .collect();
    let mut side_m = side_m;
    loop {
        let mut cells = HashSet::new();
        let mut kept = Vec::new();
        for (index, at) in points.iter().enumerate() {
            if cells.insert(cell_of(*at, side_m)) || outermost.contains(&index) {
                kept.push(index);
            }
        }
        if kept.len() <= most.max(4) || !side_m.is_finite() {
            return kept;
        }
        side_m *= GROWS;
    }
}

/// The pieces of a line to be drawn, with at most about `most` points; a piece that would cover another one is left
/// out.
pub fn line(points: &[[f64; 2]], side_m: f64, most: usize) -> Vec<Vec<[f64; 2]>> {
    let mut side_m = side_m;
    loop {
        let pieces = pieces(points, side_m);
        if pieces.iter().map(Vec::len).sum::<usize>() <= most.max(4) || !side_m.is_finite() {
            return pieces;
        }
        side_m *= GROWS;
    }
}

fn pieces(points: &[[f64; 2]], side_m: f64) -> Vec<Vec<[f64; 2]>> {
    let mut drawn: HashSet<[Cell; 2]> = HashSet::new();
    let mut pieces: Vec<Vec<[f64; 2]>> = Vec::new();
    let mut last: Option<Cell> = None;
    for at in points {
        let cell = cell_of(*at, side_m);
        let Some(before) = last.replace(cell) else {
            pieces.push(vec![*at]);
            continue;
        };
        if cell == before {
            continue;
        }
        match pieces.last_mut().filter(|_| drawn.insert([cell.min(before), cell.max(before)])) {
            Some(piece) => piece.push(*at),
            None => pieces.push(vec![*at]),
        }
    }
    pieces.retain(|piece| piece.len() > 1);
    pieces
}

#[cfg(test)]
mod tests {
    use super::{line, points};

    #[test]
    fn a_crowd_becomes_one_point_and_its_outermost_ones() {
        // A thousand points in a cell, and one far away.
        let mut crowd: Vec<[f64; 2]> = (0..1000).map(|k| [1e-3 * f64::from(k) + 1e-6, 0.5]).collect();
        crowd.push([7.5, 0.2]);
        // The first, the far one, and those with the least x, greatest x, least y and greatest y.
        assert_eq!(points(&crowd, 1.0, 100), [0, 999, 1000]);
        assert!(points(&crowd, 1e-4, 100).len() <= 100);
        assert_eq!(points(&[], 1.0, 10), [0_usize; 0]);
    }

    #[test]
    fn a_round_that_is_walked_a_thousand_times_is_drawn_once() {
        let corners = [[0.5, 0.5], [10.5, 0.5], [10.5, 10.5], [0.5, 10.5]];
        let walk: Vec<[f64; 2]> = corners.iter().copied().cycle().take(4001).collect();
        let pieces = line(&walk, 1.0, 1000);
        assert_eq!(pieces, [[corners[0], corners[1], corners[2], corners[3], corners[0]]]);
    }
}
