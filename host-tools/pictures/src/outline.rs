//! The outlines of lines and circles.

use super::coverage::{Outline, Place};

/// Corners of lines are pointed up to this multiple of the line's width, and blunt beyond, as SVG has it.
const MITER_LIMIT: f64 = 4.0;
/// The greatest distance between a circle and its polygon, pixels.
const FLAT: f64 = 0.01;

/// A line of this width through points, without caps.
pub fn line(points: &[Place], width: f64) -> Outline {
    let mut outline = Outline::default();
    let half = 0.5 * width;
    let mut before: Option<Place> = None;
    for ends in points.windows(2) {
        let (from, to) = (ends[0], ends[1]);
        let way = [to[0] - from[0], to[1] - from[1]];
        let length = way[0].hypot(way[1]);
        if !(length > 0.0 && length.is_finite()) {
            continue;
        }
        let along = way.map(|c| c / length);
        // All parts have the same orientation: where they overlap, they count once.
        let side = |at: Place, sign: f64| [at[0] - sign * half * along[1], at[1] + sign * half * along[0]];
        outline.add([side(from, 1.0), side(to, 1.0), side(to, -1.0), side(from, -1.0)]);
        if let Some(before) = before.replace(along) {
            join(&mut outline, from, half, [before, along]);
        }
    }
    outline
}

/// What is missing between two pieces of a line on the outer side of their corner.
fn join(outline: &mut Outline, at: Place, half: f64, [before, after]: [Place; 2]) {
    let cross = before[0] * after[1] - before[1] * after[0];
    let cosine = before[0] * after[0] + before[1] * after[1];
    let sign = if cross > 0.0 { -half } else { half };
    let corner = |along: Place| [at[0] - sign * along[1], at[1] + sign * along[0]];
    let (first, last) = (corner(before), corner(after));
    // The square of the tip's distance, in half widths: 1 ⁄ cos² of half the turn.
    let reach = 2.0 / (1.0 + cosine);
    let tip = (reach <= MITER_LIMIT * MITER_LIMIT).then(|| {
        let middle: Place = std::array::from_fn(|axis| 0.5 * (first[axis] + last[axis]) - at[axis]);
        std::array::from_fn(|axis| at[axis] + reach * middle[axis])
    });
    let mut corners: Vec<Place> = [Some(at), Some(first), tip, Some(last)].into_iter().flatten().collect();
    if cross > 0.0 {
        corners.reverse();
    }
    outline.add(corners);
}

/// A circle, or a ring of this width around it.
pub fn circle(middle: Place, radius: f64, ring: Option<f64>) -> Outline {
    let mut outline = Outline::default();
    match ring {
        None => outline.add(around(middle, radius)),
        Some(width) => {
            outline.add(around(middle, radius + 0.5 * width));
            let inner = radius - 0.5 * width;
            if inner > 0.0 {
                let mut hole = around(middle, inner);
                hole.reverse();
                outline.add(hole);
            }
        }
    }
    outline
}

fn around([x, y]: Place, radius: f64) -> Vec<Place> {
    let angle = (1.0 - FLAT / radius.max(FLAT)).acos().max(0.01);
    let corners = (std::f64::consts::PI / angle).ceil().clamp(8.0, 400.0);
    let corner = |index: u32| {
        let (sin, cos) = (std::f64::consts::TAU * f64::from(index) / corners).sin_cos();
        [x + radius * cos, y + radius * sin]
    };
    (0..corners as u32).map(corner).collect()
}

#[cfg(test)]
mod tests {
    use super::super::coverage::Coverage;
    use super::{Outline, circle, line};

    /// The covered area in square pixels, and the covered share of some pixels.
    fn area<const N: usize>(outline: &Outline, pixels: [[usize; 2]; N]) -> (f64, [f32; N]) {
        let mut sum = 0.0;
        let mut shares = [0.0; N];
        Coverage::new([40, 40]).of(outline, |column, row, share| {
            sum += f64::from(share);
            pixels.iter().zip(&mut shares).filter(|(at, _)| **at == [column, row]).for_each(|(_, to)| *to = share);
        });
        (sum, shares)
    }

    #[test]
    fn a_line_has_its_width_and_pointed_corners() {
        // 20 pixels to the right and 10 down, 2 wide: 2 · 30, of which the inner quarter of the corner is covered
        // twice and the outer one is the miter: 60.
        let bent = line(&[[5.0, 10.0], [25.0, 10.0], [25.0, 20.0]], 2.0);
        let (sum, shares) = area(&bent, [[25, 9], [24, 10], [26, 9], [25, 8], [4, 9], [5, 9]]);
        assert!((sum - 60.0).abs() < 1e-3, "{sum}");
        assert_eq!(shares, [1.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
        // The other way round, and turning to the other side.
        for points in [[[25.0, 20.0], [25.0, 10.0], [5.0, 10.0]], [[5.0, 20.0], [25.0, 20.0], [25.0, 10.0]]] {
            let (sum, _) = area(&line(&points, 2.0), []);
            assert!((sum - 60.0).abs() < 1e-3, "{sum}");
        }
        // A sharp corner is blunt: nothing reaches beyond half the width.
        let (_, shares) = area(&line(&[[5.0, 10.0], [25.0, 10.0], [5.0, 11.0]], 2.0), [[26, 10], [24, 10]]);
        assert_eq!(shares, [0.0, 1.0]);
        // Nothing is between equal points.
        assert_eq!(area(&line(&[[5.0, 5.0], [5.0, 5.0], [f64::NAN, 5.0]], 2.0), []).0, 0.0);
    }

    #[test]
    fn circles_and_rings_have_their_areas() {
        let disc = area(&circle([20.0, 20.0], 10.0, None), [[20, 20], [20, 10], [20, 9]]);
        assert!((disc.0 - std::f64::consts::PI * 100.0).abs() < 0.7, "{}", disc.0);
        assert!(disc.1[0] == 1.0 && disc.1[1] > 0.9 && disc.1[2] < 0.01, "{:?}", disc.1);
        // Between radii of 9 and 11.
        let ring = area(&circle([20.0, 20.0], 10.0, Some(2.0)), [[20, 20], [20, 10], [20, 9]]);
        assert!((ring.0 - std::f64::consts::PI * 40.0).abs() < 0.4, "{}", ring.0);
        assert_eq!((ring.1[0], ring.1[1] > 0.9, ring.1[2] > 0.9), (0.0, true, true));
        // A ring thicker than its radius has no hole.
        assert!(area(&circle([20.0, 20.0], 1.0, Some(4.0)), [[20, 20]]).1 == [1.0]);
    }
}
