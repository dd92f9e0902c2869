//! How much of each pixel an area covers.
//!
//! Each edge adds to the pixels that it crosses the signed area between itself and the pixel's right border, and to the
//! next pixel the rest of its height; the sum of a row from the left is then the covered share (R. Levien, font-rs,
//! 2016; as the `smooth` rasteriser of FreeType). Areas of one orientation that overlap count once.

use std::ops::Range;

/// A place in pixels, y down.
pub type Place = [f64; 2];

/// The edges of areas: closed polygons.
#[derive(Clone, Debug, Default)]
pub struct Outline {
    edges: Vec<[Place; 2]>,
}

impl Outline {
    /// Adds a polygon.
    pub fn add(&mut self, corners: impl IntoIterator<Item = Place>) {
        let mut corners = corners.into_iter();
        let Some(first) = corners.next() else { return };
        let mut last = first;
        for corner in corners {
            self.edges.push([last, corner]);
            last = corner;
        }
        self.edges.push([last, first]);
    }
}

/// The coverage of the pixels of a picture. It is empty between two areas.
#[derive(Debug)]
pub struct Coverage {
    width: usize,
    height: usize,
    /// Row by row, two more than the width each.
    cells: Vec<f32>,
    /// Which cells of a row have been changed.
    changed: Vec<Range<usize>>,
    /// Which rows have been changed.
    rows: Range<usize>,
}

/// No rows or columns yet: the least is above all.
const NOTHING: Range<usize> = Range { start: usize::MAX, end: 0 };

impl Coverage {
    /// For pictures of this size.
    pub fn new([width, height]: [usize; 2]) -> Self {
        Self { width, height, cells: vec![0.0; (width + 2) * height], changed: vec![NOTHING; height], rows: NOTHING }
    }

    /// Calls `paint` with column, row and covered share of each pixel that the area covers.
    pub fn of(&mut self, outline: &Outline, mut paint: impl FnMut(usize, usize, f32)) {
        for edge in &outline.edges {
            self.add(*edge);
        }
        let stride = self.width + 2;
        for row in std::mem::replace(&mut self.rows, NOTHING) {
            let Some(changed) = self.changed.get_mut(row) else { break };
            let columns = std::mem::replace(changed, NOTHING);
            let mut covered = 0.0_f32;
            for column in columns {
                let Some(cell) = self.cells.get_mut(row * stride + column) else { break };
                covered += std::mem::take(cell);
                let share = covered.abs().min(1.0);
                if share > 1e-3 && column < self.width {
                    paint(column, row, share);
                }
            }
        }
    }

    /// Adds an edge, which is cut above and below the picture, and moved to its borders left and right of it.
    fn add(&mut self, [from, to]: [Place; 2]) {
        if from[1] == to[1] || !from.iter().chain(&to).all(|c| c.is_finite()) {
            return;
        }
        let (sign, [x0, y0], [x1, y1]) = if from[1] < to[1] { (1.0, from, to) } else { (-1.0, to, from) };
        let slope = (x1 - x0) / (y1 - y0);
        let (top, bottom) = (y0.max(0.0), y1.min(self.height as f64));
        if top >= bottom {
            return;
        }
        let right = self.width as f64;
        let at = |y: f64| (x0 + (y - y0) * slope).clamp(0.0, right);
        for row in top as usize..(bottom.ceil() as usize).min(self.height) {
            let (above, below) = (top.max(row as f64), bottom.min((row + 1) as f64));
            self.add_to_row(row, (sign * (below - above)) as f32, [at(above), at(below)]);
        }
    }

    /// Adds a piece of an edge within a row: its signed height, and the x of its ends.
    fn add_to_row(&mut self, row: usize, height: f32, ends: [f64; 2]) {
        let [left, right] = if ends[0] < ends[1] { ends } else { [ends[1], ends[0]] };
        let (first, end) = (left as usize, (right.ceil() as usize).max(left as usize + 1));
        let start = row * (self.width + 2);
        let Some(cells) = self.cells.get_mut(start..start + self.width + 2) else { return };
        // The integral, up to x, of the share of the piece that is to the left of x.
        let span = right - left;
        let integral = |x: f64| match x {
            x if x <= left => 0.0,
            x if x < right => (x - left).powi(2) / (2.0 * span),
            x => 0.5 * span + (x - right),
        };
        let mut done = 0.0;
        let mut given = 0.0_f32;
        for column in first..=end {
            // The sum of all cells up to this one is what the piece covers of the pixel.
            let up_to = integral((column + 1) as f64);
            let covered = (up_to - done) as f32;
            done = up_to;
            if let Some(cell) = cells.get_mut(column) {
                *cell += height * (covered - given);
            }
            given = covered;
        }
        let changed = &mut self.changed[row];
        *changed = changed.start.min(first)..changed.end.max(end + 1);
        self.rows = self.rows.start.min(row)..self.rows.end.max(row + 1);
    }
}

#[cfg(test)]
mod tests {
    use super::{Coverage, Outline, Place};

    /// The coverage of a picture of 4 × 3 pixels.
    fn covered(polygons: &[&[Place]]) -> [[f32; 4]; 3] {
        let mut outline = Outline::default();
        polygons.iter().for_each(|corners| outline.add(corners.iter().copied()));
        let mut coverage = Coverage::new([4, 3]);
        let mut pixels = [[0.0; 4]; 3];
        coverage.of(&outline, |column, row, share| pixels[row][column] = share);
        // Nothing is left for the next area.
        coverage.of(&Outline::default(), |column, row, share| panic!("{column} {row} {share}"));
        pixels
    }

    #[test]
    fn a_pixel_is_covered_by_the_share_of_its_area() {
        let square = [[0.5, 1.0], [2.25, 1.0], [2.25, 1.5], [0.5, 1.5]];
        let expected = [[0.0; 4], [0.25, 0.5, 0.125, 0.0], [0.0; 4]];
        assert_eq!(covered(&[&square]), expected);
        // The other way round, and twice.
        let back: Vec<Place> = square.iter().rev().copied().collect();
        assert_eq!(covered(&[&back]), expected);
        let pixel: &[Place] = &[[1.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0]];
        assert_eq!(covered(&[pixel, pixel])[0], [0.0, 1.0, 0.0, 0.0]);
        // A triangle of 4 × 3 pixels: its hypotenuse y = 3 x ⁄ 4. The first row has 4 ⁄ 3 · 1 ⁄ 2 to the left of it:
        // 1 − 3 ⁄ 8 is covered of the first pixel, 1 ⁄ 24 of the second one.
        let rows = covered(&[&[[0.0, 0.0], [4.0, 3.0], [0.0, 3.0]]]);
        assert!((rows[0][0] - 0.625).abs() < 1e-6 && (rows[0][1] - 1.0 / 24.0).abs() < 1e-6, "{rows:?}");
        let sum: f32 = rows.iter().flatten().sum();
        assert!((sum - 6.0).abs() < 1e-5, "{sum}");
    }

    #[test]
    fn areas_are_cut_at_the_borders() {
        let around = [[-1e9, -50.0], [1e9, -50.0], [1e9, 50.0], [-1e9, 50.0]];
        assert_eq!(covered(&[&around]), [[1.0; 4]; 3]);
        assert_eq!(covered(&[&[[9.0, 0.0], [12.0, 0.0], [12.0, 3.0]]]), [[0.0; 4]; 3]);
        assert_eq!(covered(&[&[[-9.0, 0.0], [-2.0, 0.0], [-2.0, 3.0]]]), [[0.0; 4]; 3]);
        assert_eq!(covered(&[&[[f64::NAN, 0.0], [1.0, f64::INFINITY], [1e300, -1e300]]]), [[0.0; 4]; 3]);
        assert_eq!(covered(&[&[], &[[1.0, 1.0]]]), [[0.0; 4]; 3]);
    }
}
