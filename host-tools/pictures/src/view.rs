//! The part of the plane that a map shows, and lines and areas cut to it.

use super::Picture;
use super::axes::{BOTTOM, RIGHT, TOP};
use super::ellipses::{SIGMAS, outline};

/// The least and the greatest height of a map, pixels.
const HEIGHTS: (u32, u32) = (260, 760);
/// Coordinates beyond this are not on any map, metres: the earth is smaller.
const FARTHEST_M: f64 = 1e8;

/// A box in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// The least x and y.
    pub least: [f64; 2],
    /// The greatest x and y.
    pub greatest: [f64; 2],
}

impl View {
    /// The area of the map: all anchors and true positions, and the positions within a margin of half that size.
    /// Farther outliers are left out, because they would shrink the rest to a dot.
    pub fn of(picture: &Picture) -> Self {
        let dots = || picture.series.iter().flat_map(|series| &series.dots).map(|dot| dot.at_m);
        let known = Self::around(
            picture
                .anchors
                .iter()
                .chain(&picture.beacons)
                .map(|(_, at)| *at)
                .chain(picture.truth.iter().flat_map(|way| &way.points_m).copied())
                .chain(picture.walls_m.iter().flatten().copied())
                .chain(picture.plan.iter().flat_map(|plan| plan.corners_m)),
        );
        let view = match known {
            Some(known) => {
                let reach = known.grown(0.5, 1.0);
                Self::around([known.least, known.greatest].into_iter().chain(dots().filter(|at| reach.has(*at))))
            }
            None => Self::around(middle(dots())),
        };
        view.unwrap_or(Self { least: [0.0; 2], greatest: [1.0; 2] }).grown(0.05, 0.5)
    }

    /// The smallest box around points; points that are on no map are left out.
    pub fn around(points: impl Iterator<Item = [f64; 2]>) -> Option<Self> {
        let on_earth = points.filter(|at| at.iter().all(|c| c.abs() <= FARTHEST_M));
        on_earth.map(|at| Self { least: at, greatest: at }).reduce(Self::with)
    }

    /// The smallest box around both.
    pub fn with(self, other: Self) -> Self {
        Self {
            least: std::array::from_fn(|axis| self.least[axis].min(other.least[axis])),
            greatest: std::array::from_fn(|axis| self.greatest[axis].max(other.greatest[axis])),
        }
    }

    /// Enlarged on every side by a share of its longer side, and by at least `least_m`.
    pub fn grown(self, share: f64, least_m: f64) -> Self {
        let more = (share * self.longer_side()).max(least_m);
        Self { least: self.least.map(|c| c - more), greatest: self.greatest.map(|c| c + more) }
    }

    /// Width and height.
    pub fn sides(&self) -> [f64; 2] {
        std::array::from_fn(|axis| self.greatest[axis] - self.least[axis])
    }

    /// The greater of width and height.
    pub fn longer_side(&self) -> f64 {
        let [width, height] = self.sides();
        width.max(height)
    }

    /// Whether a point is inside.
    pub fn has(&self, at: [f64; 2]) -> bool {
        (0..2).all(|axis| (self.least[axis]..=self.greatest[axis]).contains(&at[axis]))
    }

    /// Whether two boxes overlap.
    pub fn meets(&self, other: &Self) -> bool {
        (0..2).all(|axis| self.least[axis] < other.greatest[axis] && other.least[axis] < self.greatest[axis])
    }

    /// Whether the map should have the whole width of a picture.
    pub fn is_wide(&self) -> bool {
        let [width, height] = self.sides();
        width > 1.7 * height
    }

    /// Width of the numbers along an axis, pixels.
    pub fn numbers_width(&self, axis: usize) -> u32 {
        let longest = [self.least[axis], self.greatest[axis]].map(|c| format!("{c:.0}").len()).into_iter().max();
        8 * (longest.unwrap_or(0) as u32).clamp(3, 16)
    }

    /// Room for the vertical axis, pixels: it grows with the numbers.
    pub fn left(&self) -> u32 {
        38 + self.numbers_width(1)
    }

    /// Height of a map of that width, pixels.
    pub fn height_for(&self, width: u32) -> u32 {
        let [metres_wide, metres_high] = self.sides();
        let plot = f64::from(width.saturating_sub(self.left() + RIGHT)) * metres_high / metres_wide;
        (plot as u32).saturating_add(TOP + BOTTOM).clamp(HEIGHTS.0, HEIGHTS.1)
    }

    /// Enlarged on two sides to the shape of the paper.
    pub fn shaped(self, paper: [f64; 2]) -> Self {
        let sides = self.sides();
        let metres_a_pixel = (sides[0] / paper[0]).max(sides[1] / paper[1]);
        let more: [f64; 2] = std::array::from_fn(|axis| 0.5 * (metres_a_pixel * paper[axis] - sides[axis]));
        Self {
            least: std::array::from_fn(|axis| self.least[axis] - more[axis]),
            greatest: std::array::from_fn(|axis| self.greatest[axis] + more[axis]),
        }
    }

    /// The part of a straight line that is inside, if any (Liang and Barsky, 1984).
    pub fn cut(&self, [from, to]: [[f64; 2]; 2]) -> Option<[[f64; 2]; 2]> {
        let way: [f64; 2] = std::array::from_fn(|axis| to[axis] - from[axis]);
        let (mut enters, mut leaves) = (0.0_f64, 1.0_f64);
        for axis in 0..2 {
            for (along, room) in
                [(-way[axis], from[axis] - self.least[axis]), (way[axis], self.greatest[axis] - from[axis])]
            {
                if !along.is_finite() || !room.is_finite() || (along == 0.0 && room < 0.0) {
                    return None;
                }
                if along < 0.0 {
                    enters = enters.max(room / along);
                } else if along > 0.0 {
                    leaves = leaves.min(room / along);
                }
            }
        }
        let at = |share: f64| {
            let point = |axis: usize| (from[axis] + share * way[axis]).clamp(self.least[axis], self.greatest[axis]);
            std::array::from_fn(point)
        };
        (enters <= leaves).then(|| [at(enters), at(leaves)])
    }

    /// The parts of a line that are inside.
    pub fn cut_line(&self, points: &[[f64; 2]]) -> Vec<Vec<[f64; 2]>> {
        let mut pieces: Vec<Vec<[f64; 2]>> = Vec::new();
        for ends in points.windows(2) {
            let Some([from, to]) = self.cut([ends[0], ends[1]]) else { continue };
            match pieces.last_mut().filter(|piece| piece.last() == Some(&from)) {
                Some(piece) => piece.push(to),
                None => pieces.push(vec![from, to]),
            }
        }
        pieces
    }

    /// The part of an area that is inside (Sutherland and Hodgman, 1974). The area is convex.
    pub fn cut_area(&self, corners: &[[f64; 2]]) -> Vec<[f64; 2]> {
        let mut corners = corners.to_vec();
        for axis in 0..2 {
            for (edge, side) in [(self.least[axis], 1.0), (self.greatest[axis], -1.0)] {
                let inside = |at: &[f64; 2]| side * (at[axis] - edge) >= 0.0;
                let before = corners.iter().cycle().skip(corners.len().saturating_sub(1));
                let mut kept = Vec::new();
                for (from, to) in before.zip(&corners) {
                    if inside(from) != inside(to) {
                        let share = (edge - from[axis]) / (to[axis] - from[axis]);
                        let mut at: [f64; 2] =
                            std::array::from_fn(|other| from[other] + share * (to[other] - from[other]));
                        at[axis] = edge;
                        kept.push(at);
                    }
                    if inside(to) {
                        kept.push(*to);
                    }
                }
                corners = kept;
            }
        }
        corners
    }
}

/// The points whose coordinates are both among the middle 98 %.
pub fn middle(points: impl Iterator<Item = [f64; 2]>) -> impl Iterator<Item = [f64; 2]> {
    let points: Vec<_> = points.collect();
    let bounds: [(f64, f64); 2] = std::array::from_fn(|axis| {
        let mut sorted: Vec<f64> = points.iter().map(|at| at[axis]).collect();
        sorted.sort_by(f64::total_cmp);
        let cut = sorted.len() / 100;
        let kept = sorted.get(cut..sorted.len() - cut).unwrap_or(&[]);
        (kept.first().copied().unwrap_or(0.0), kept.last().copied().unwrap_or(0.0))
    });
    points.into_iter().filter(move |at| (0..2).all(|axis| (bounds[axis].0..=bounds[axis].1).contains(&at[axis])))
}

/// Boxes to be shown enlarged, each with the name of its tag: tags whose positions and truth fill little of the map.
pub fn zooms(picture: &Picture, view: &View) -> Vec<(String, View)> {
    /// A box is enlarged where its longer side is a smaller share of the map's.
    const SMALL: f64 = 0.12;
    /// The least side of a box, metres.
    const LEAST_M: f64 = 0.01;
    let of_tag = |tag: &str| {
        let ways = picture.truth.iter().filter(|way| way.tag == tag);
        let dots = || picture.series.iter().filter(|series| series.tag == tag).flat_map(|series| &series.dots);
        let around = View::around(
            ways.flat_map(|way| &way.points_m)
                .copied()
                .chain(middle(dots().map(|dot| dot.at_m)).filter(|at| view.has(*at))),
        )?;
        // The ellipse of a position belongs to it, unless it is much larger.
        let ellipse = dots().find_map(|dot| View::around(outline(dot, SIGMAS)?.into_iter()));
        let ellipse = ellipse.filter(|ellipse| ellipse.longer_side() < 4.0 * around.longer_side());
        Some(Tight { tag: tag.to_owned(), view: ellipse.map_or(around, |ellipse| around.with(ellipse)) })
    };
    let tags = super::pens::tags(picture);
    if picture.truth.iter().any(|way| way.are_dwells) || tags.len() > ZOOMED_TAGS {
        return Vec::new();
    }
    let tight: Vec<Tight> = tags.iter().filter_map(|tag| of_tag(tag)).collect();
    let small = |of: &View| of.longer_side() < SMALL * view.longer_side();
    let grown = |of: &View| of.grown(0.08, LEAST_M);
    let all = tight.iter().map(|tight| tight.view).reduce(View::with);
    match all {
        Some(all) if small(&all) => vec![(String::new(), grown(&all))],
        Some(_) | None => {
            let small = tight.into_iter().filter(|tight| small(&tight.view));
            small.map(|tight| (tight.tag, grown(&tight.view))).take(MOST_ZOOMS).collect()
        }
    }
}

/// The greatest number of enlarged boxes.
const MOST_ZOOMS: usize = 3;
/// With more tags nothing is enlarged.
const ZOOMED_TAGS: usize = 24;

/// The box of a tag.
struct Tight {
    tag: String,
    view: View,
}

#[cfg(test)]
mod tests {
    use super::View;

    const UNIT: View = View { least: [0.0; 2], greatest: [1.0; 2] };

    #[test]
    fn a_line_is_cut_where_it_crosses_the_border() {
        // y = x - 0.5 crosses at (0.5, 0) and at (1, 0.5).
        assert_eq!(UNIT.cut([[0.0, -0.5], [2.0, 1.5]]), Some([[0.5, 0.0], [1.0, 0.5]]));
        assert_eq!(UNIT.cut([[-1.0, 0.5], [-0.5, 0.5]]), None);
        // Where the ends are so far that their middle is not exact, the rest is inside all the same.
        assert!(UNIT.cut([[-1e300, 0.5], [1e300, 0.5]]).is_none_or(|ends| ends.iter().all(|at| UNIT.has(*at))));
        assert_eq!(UNIT.cut([[-1.7e308, 0.5], [1.7e308, 0.5]]), None);
        let pieces = UNIT.cut_line(&[[0.5, 0.5], [0.5, 2.0], [0.7, 2.0], [0.7, 0.5]]);
        assert_eq!(pieces, [[[0.5, 0.5], [0.5, 1.0]], [[0.7, 1.0], [0.7, 0.5]]]);
    }

    #[test]
    fn an_area_is_cut_to_the_view() {
        // The right half of a square of 2 m.
        let cut = UNIT.cut_area(&[[-1.0, 0.0], [1.0, 0.0], [1.0, 1.0], [-1.0, 1.0]]);
        assert_eq!(View::around(cut.iter().copied()), Some(UNIT));
        assert!(UNIT.cut_area(&[[2.0, 2.0], [3.0, 2.0], [3.0, 3.0]]).is_empty());
    }
}
