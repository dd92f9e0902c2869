//! Places for names beside marks: not over other names and marks, walls, nor the border.

use super::axes::Chart;
use super::drawing::{Across, Colour, Down, Font, Point};
use super::style::{FINE, printable, text};
use super::thin;
use super::view::View;

/// Height of a name, and the mean width of a character, pixels.
const HEIGHT: f64 = 15.0;
const CHARACTER: f64 = 8.3;
/// Half a mark's side, pixels.
const MARK: f64 = 7.0;
/// With more marks their names would not be readable.
const MOST: usize = 300;
/// Walls that names avoid, at most: each name is compared with each of them.
const MOST_WALLS: usize = 2000;
/// Positions of a tag that names avoid.
const MOST_CROWD: usize = 400;
/// Directions from a mark to its name, the best first.
const SIDES: [[f64; 2]; 8] =
    [[0.0, 1.0], [1.0, 0.0], [-1.0, 0.0], [0.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]];

/// Puts names into a map. Its coordinates are pixels from the lower left corner.
pub struct Labels {
    view: View,
    metres_a_pixel: f64,
    paper: View,
    taken: Vec<View>,
    walls: Vec<[[f64; 2]; 2]>,
    /// Positions and truth.
    crowd: Vec<[f64; 2]>,
}

impl Labels {
    /// A map without names. The view has this many metres a pixel.
    pub fn new(view: &View, metres_a_pixel: f64, walls_m: &[[[f64; 2]; 2]]) -> Self {
        let paper = View { least: [0.0; 2], greatest: view.sides().map(|side| side / metres_a_pixel) };
        let mut labels =
            Self { view: *view, metres_a_pixel, paper, taken: Vec::new(), walls: Vec::new(), crowd: Vec::new() };
        let shown = walls_m.iter().filter_map(|wall| view.cut(*wall)).take(MOST_WALLS);
        labels.walls = shown.map(|wall| wall.map(|at| labels.pixel(at))).collect();
        labels
    }

    fn pixel(&self, at_m: [f64; 2]) -> [f64; 2] {
        std::array::from_fn(|axis| (at_m[axis] - self.view.least[axis]) / self.metres_a_pixel)
    }

    /// Keeps names away from a mark.
    pub fn avoid(&mut self, at_m: [f64; 2]) {
        if self.view.has(at_m) && self.taken.len() < MOST {
            self.taken.push(around(self.pixel(at_m), [MARK; 2]));
        }
    }

    /// Keeps names away from positions, as far as there is room elsewhere.
    pub fn avoid_crowd(&mut self, points_m: &[[f64; 2]]) {
        let inside: Vec<[f64; 2]> = points_m.iter().copied().filter(|at| self.view.has(*at)).collect();
        let kept = thin::points(&inside, 5.0 * self.metres_a_pixel, MOST_CROWD);
        self.crowd.extend(kept.into_iter().map(|index| self.pixel(inside[index])).collect::<Vec<_>>());
    }

    /// The middle of a name beside a mark, as pixels to the right and up from the mark; `None` where the mark is not on
    /// the map, too many are, or the name would be over others and must not.
    fn place(&mut self, at_m: [f64; 2], name: &str, over_others: bool) -> Option<[f64; 2]> {
        if !self.view.has(at_m) || self.taken.len() >= 2 * MOST {
            return None;
        }
        let (at, half) = (self.pixel(at_m), half_size(name));
        let costs = SIDES.iter().enumerate().map(|(rank, side)| {
            let away: [f64; 2] = std::array::from_fn(|axis| side[axis] * (half[axis] + MARK + 1.0));
            let name = around([at[0] + away[0], at[1] + away[1]], half);
            let outside = name.least.iter().chain(&name.greatest).any(|c| *c < 1.0) || !self.paper.has(name.greatest);
            let taken = self.taken.iter().filter(|other| other.meets(&name)).count();
            let crossed = self.walls.iter().filter(|wall| name.cut(**wall).is_some()).count();
            let crowd = self.crowd.iter().filter(|at| name.has(**at)).count();
            let cost = 1000 * usize::from(outside) + 30 * taken + 15 * crossed.min(20) + 3 * crowd.min(8) + rank;
            (cost, taken, away, name)
        });
        let (_, _, away, name) =
            costs.min_by_key(|(cost, ..)| *cost).filter(|(_, taken, ..)| over_others || *taken == 0)?;
        self.taken.push(name);
        Some(away)
    }

    /// Draws a name beside a mark; where all places are taken, `over_others` or not at all.
    pub fn draw(&mut self, chart: &Chart, at_m: [f64; 2], name: &str, colour: Colour, over_others: bool) {
        let name = short(&printable(name), 24);
        let Some(away) = self.place(at_m, &name, over_others) else { return };
        let half = half_size(&name);
        let mark = chart.at(at_m);
        let beside = |right: f64, up: f64| -> Point {
            let away = [right, -up].map(|pixels| (pixels * f64::from(FINE)) as i32);
            std::array::from_fn(|axis| mark[axis] + away[axis])
        };
        let corner = |side: f64| beside(away[0] + side * half[0], away[1] + side * half[1]);
        chart.paper.rectangle([corner(-1.0), corner(1.0)], Colour::WHITE.faded(0.75).fill());
        let font = Font { colour, ..text(Across::Middle, Down::Middle) };
        chart.paper.text(name, beside(away[0], away[1]), font);
    }
}

fn around(middle: [f64; 2], half: [f64; 2]) -> View {
    View {
        least: std::array::from_fn(|axis| middle[axis] - half[axis]),
        greatest: std::array::from_fn(|axis| middle[axis] + half[axis]),
    }
}

fn half_size(name: &str) -> [f64; 2] {
    [0.5 * CHARACTER * name.chars().count() as f64, 0.5 * HEIGHT]
}

/// A path of `most` characters or fewer: its end, after an ellipsis.
pub fn short_path(path: &str, most: usize) -> String {
    let characters = path.chars().count();
    if characters <= most {
        path.to_owned()
    } else {
        ['…'].into_iter().chain(path.chars().skip(characters + 1 - most)).collect()
    }
}

/// A name of `most` characters or fewer: its beginning, before an ellipsis.
pub fn short(name: &str, most: usize) -> String {
    match name.char_indices().nth(most) {
        Some(_) => name.chars().take(most - 1).chain(['…']).collect(),
        None => name.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::{Labels, View, short, short_path};

    #[test]
    fn a_name_is_above_its_mark_unless_a_wall_another_name_or_the_border_is_there() {
        let view = View { least: [0.0; 2], greatest: [10.0; 2] };
        let side = |labels: &mut Labels, at| {
            labels.place(at, "A1", true).map(|away| away.map(|c| if c == 0.0 { 0.0 } else { c.signum() }))
        };
        let mut free = Labels::new(&view, 0.05, &[]);
        assert_eq!(free.place([5.0, 5.0], "A1", true), Some([0.0, 15.5]));
        assert_eq!(side(&mut free, [5.0, 5.0]), Some([1.0, 0.0]));
        // Two pixels below the border, and in the corner.
        assert_eq!(side(&mut free, [5.0, 9.9]), Some([0.0, -1.0]));
        assert_eq!(side(&mut free, [9.9, 9.9]), Some([-1.0, -1.0]));
        assert_eq!(side(&mut free, [11.0, 9.9]), None);
        // All sides are taken.
        for _ in 0..8 {
            free.place([5.0, 5.0], "A1", true);
        }
        assert_eq!(free.place([5.0, 5.0], "A1", false), None);
        let mut walled = Labels::new(&view, 0.05, &[[[0.0, 5.7], [10.0, 5.7]]]);
        assert_eq!(side(&mut walled, [5.0, 5.0]), Some([1.0, 0.0]));
    }

    #[test]
    fn long_names_are_cut() {
        assert_eq!((short("anchor", 6), short("anchors", 6)), ("anchor".to_owned(), "ancho…".to_owned()));
        assert_eq!((short_path("a/b.csv", 7), short_path("aa/b.csv", 7)), ("a/b.csv".to_owned(), "…/b.csv".to_owned()));
    }
}
