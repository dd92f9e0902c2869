//! The room "Sala": walls, beacons, and the meshes of receivers and of fingerprints.
//!
//! The thesis prints the twelve positions of table 4.1 and the room's area, about 37 m²; walls and furniture are in
//! its figures only. The positions are listed in their order along the walls. Joined in that order they enclose 32.5
//! m², so that they serve as the corners of the walls here. There is no furniture.

use positioning_core::ble::path_loss::Wall;

/// Table 4.1, from A to L, metres: the corners of the outline.
pub const PLACES_M: [[f64; 2]; 12] = [
    [0.20, 0.12],
    [2.30, 0.12],
    [5.40, 0.12],
    [5.25, 1.63],
    [6.88, 3.73],
    [5.70, 5.18],
    [5.40, 6.78],
    [3.70, 6.55],
    [1.65, 6.78],
    [1.65, 4.60],
    [1.20, 4.48],
    [0.45, 3.22],
];
/// A, E, H and J, as in annex A.
pub const BEACONS_M: [[f64; 2]; 4] = [PLACES_M[0], PLACES_M[4], PLACES_M[7], PLACES_M[9]];
/// The box around the room, metres.
pub const BOX_M: [[f64; 2]; 2] = [[0.20, 0.12], [6.88, 6.78]];
/// Where the receivers' mesh begins and ends in x and y, metres: the middle of the room ("localizado principalmente
/// en el centro").
const MIDDLE_M: [f64; 2] = [1.25, 5.75];
/// Distance between two receivers of the mesh, metres; the thesis does not print it.
const RECEIVERS_M: f64 = 0.5;
/// Distance between two fingerprints, metres, and where they begin; the thesis does not print them. No receiver is at
/// a fingerprint.
const FINGERPRINTS_M: [f64; 2] = [1.0, 0.5];

/// The walls.
pub fn walls() -> Vec<Wall<f64>> {
    let next = PLACES_M.iter().cycle().skip(1);
    PLACES_M.iter().zip(next).map(|(&from, &to)| Wall { ends: [from, to], attenuation: 0.0 }).collect()
}

/// Whether no wall is between two positions.
pub fn in_sight(walls: &[Wall<f64>], from: [f64; 2], to: [f64; 2]) -> bool {
    !walls.iter().any(|wall| wall.is_crossed(from, to))
}

/// The receivers' mesh, metres.
pub fn receivers() -> Vec<[f64; 2]> {
    mesh(MIDDLE_M, RECEIVERS_M)
}

/// The points of the survey, all over the room, metres.
pub fn fingerprints() -> Vec<[f64; 2]> {
    let [step, begin] = FINGERPRINTS_M;
    mesh([begin, 7.0], step)
}

fn mesh([begin, end]: [f64; 2], step: f64) -> Vec<[f64; 2]> {
    let count = ((end - begin) / step).floor() as usize + 1;
    let walls = walls();
    let along = move |index: usize| begin + step * index as f64;
    let all = (0..count).flat_map(|row| (0..count).map(move |column| [along(column), along(row)]));
    all.filter(|&at| is_inside(&walls, at)).collect()
}

/// A straight line out of the room crosses an odd number of walls. The far point is on no line through a point of the
/// meshes and a corner.
fn is_inside(walls: &[Wall<f64>], at: [f64; 2]) -> bool {
    let far = [at[0] + 101.3, at[1] + 17.9];
    walls.iter().filter(|wall| wall.is_crossed(at, far)).count() % 2 == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_outline_is_the_thesis_room_but_for_the_strip_behind_the_beacons() {
        let next = PLACES_M.iter().cycle().skip(1);
        let area: f64 = PLACES_M.iter().zip(next).map(|(a, b)| 0.5 * (a[0] * b[1] - b[0] * a[1])).sum();
        // Computed independently (a shoelace over table 4.1): 32.53 m². The thesis prints about 37 m², because its
        // beacons are in front of the walls.
        assert!((area - 32.53).abs() < 0.01, "{area}");
    }

    #[test]
    fn a_corner_that_stands_in_stops_a_ray() {
        let walls = walls();
        let [_, e, ..] = BEACONS_M;
        // By hand: from E at (6.88, 3.73) to (5.1, 0.5) the ray meets the wall from C (5.40, 0.12) to D (5.25, 1.63)
        // at (5.32, 0.90). The middle of the room is in line of sight.
        assert!(!in_sight(&walls, e, [5.1, 0.5]));
        assert!(in_sight(&walls, e, [4.0, 3.5]));
    }

    #[test]
    fn meshes_are_inside() {
        let walls = walls();
        assert!(is_inside(&walls, [3.5, 3.5]) && !is_inside(&walls, [0.5, 5.5]) && !is_inside(&walls, [6.5, 1.0]));
        // Counted independently, by winding numbers: 92 of the ten by ten from 1.25 m to 5.75 m.
        assert_eq!(receivers().len(), 92);
        assert!(fingerprints().contains(&[0.5, 0.5]) && !fingerprints().contains(&[0.5, 4.5]));
    }
}
