//! What a picture is made of: shapes on paper, which become SVG text (`svg`) or pixels (`pixels`).
//!
//! Lengths are whole numbers, [`FINE`] to a pixel of the shown picture; y goes down.

use std::cell::RefCell;
use std::sync::Arc;

use super::image::Image;

/// Units of length for one pixel of the shown picture.
pub const FINE: u32 = 8;

/// Coordinates on paper.
pub type Point = [i32; 2];

/// A colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Colour {
    /// Red, green and blue.
    pub rgb: [u8; 3],
    /// From 0, invisible, to 1.
    pub opacity: f64,
}

impl Colour {
    /// White.
    pub const WHITE: Self = Self::of(255, 255, 255);

    /// The colour of these parts.
    pub const fn of(red: u8, green: u8, blue: u8) -> Self {
        Self { rgb: [red, green, blue], opacity: 1.0 }
    }

    /// The colour with this opacity.
    pub const fn faded(self, opacity: f64) -> Self {
        Self { opacity, ..self }
    }

    /// A line of this colour.
    pub const fn line(self, width: u32) -> Line {
        Line { colour: self, width }
    }

    /// An area of this colour.
    pub const fn fill(self) -> Paint {
        Paint::Fill(self)
    }
}

/// The look of a line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// Its colour.
    pub colour: Colour,
    /// Its width.
    pub width: u32,
}

/// How a shape is painted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Paint {
    /// Its area.
    Fill(Colour),
    /// Its border.
    Border(Line),
}

impl From<Line> for Paint {
    fn from(line: Line) -> Self {
        Self::Border(line)
    }
}

/// Which edge of a text is at its point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Across {
    /// The left edge.
    Left,
    /// The middle.
    Middle,
    /// The right edge.
    Right,
}

/// Which height of a text is at its point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Down {
    /// The upper edge of capitals.
    Top,
    /// The middle.
    Middle,
    /// The lower edge.
    Bottom,
}

/// The look of a text.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Font {
    /// The side of an em.
    pub size: u32,
    /// Its colour.
    pub colour: Colour,
    /// What is at its point.
    pub anchor: (Across, Down),
    /// Whether it goes from the bottom to the top.
    pub is_upright: bool,
}

/// A shape.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// From the upper left corner to the lower right one.
    Rectangle([Point; 2], Paint),
    /// A straight line between two points.
    Straight([Point; 2], Line),
    /// A line through points.
    Path(Vec<Point>, Line),
    /// The area between corners.
    Polygon(Vec<Point>, Colour),
    /// The middle, and the radius.
    Circle(Point, u32, Paint),
    /// A line of text.
    Text(String, Point, Font),
}

/// An image beneath everything else.
#[derive(Clone, Debug, PartialEq)]
pub struct Placed {
    /// The image.
    pub image: Arc<Image>,
    /// What is visible of the paper: the upper left and the lower right corner.
    pub window: [Point; 2],
    /// The image's upper left corner, from that of the window.
    pub at: [f64; 2],
    /// Its width and height.
    pub size: [f64; 2],
}

/// The opacity of images.
pub const IMAGE_OPACITY: f64 = 0.6;

/// A picture, drawn.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Drawing {
    /// Width and height of the shown picture, pixels.
    pub size: [u32; 2],
    /// What is beneath the shapes.
    pub images: Vec<Placed>,
    /// The shapes, the lowest first.
    pub shapes: Vec<Shape>,
}

impl Drawing {
    /// A drawing of this size in pixels on white ground.
    pub fn new(size: [u32; 2], draw: impl FnOnce(Area)) -> Self {
        let drawing = RefCell::new(Self { size, ..Self::default() });
        draw(Area { drawing: &drawing, least: [0; 2], greatest: size.map(|side| super::style::pixels(side) as i32) });
        drawing.into_inner()
    }
}

/// A rectangle of a drawing. Points of shapes are from its upper left corner.
#[derive(Clone, Copy, Debug)]
pub struct Area<'a> {
    drawing: &'a RefCell<Drawing>,
    least: Point,
    greatest: Point,
}

impl Area<'_> {
    /// Its width and height.
    pub fn size(&self) -> [i32; 2] {
        std::array::from_fn(|axis| self.greatest[axis] - self.least[axis])
    }

    /// The parts to the left and to the right of a place.
    pub fn split_at_x(self, x: u32) -> [Self; 2] {
        self.split_at(0, x)
    }

    /// The parts above and below a place.
    pub fn split_at_y(self, y: u32) -> [Self; 2] {
        self.split_at(1, y)
    }

    fn split_at(self, axis: usize, at: u32) -> [Self; 2] {
        let (mut first, mut second) = (self, self);
        first.greatest[axis] = self.least[axis] + at as i32;
        second.least[axis] = first.greatest[axis];
        [first, second]
    }

    /// Equal parts, row by row.
    pub fn split_evenly(self, rows: usize, columns: usize) -> impl Iterator<Item = Self> {
        let edge = move |axis: usize, count: usize, index: usize| {
            let (side, count, index) = (self.size()[axis], count as i32, index as i32);
            self.least[axis] + index * (side / count) + index.min(side % count)
        };
        (0..rows).flat_map(move |row| {
            (0..columns).map(move |column| Self {
                least: [edge(0, columns, column), edge(1, rows, row)],
                greatest: [edge(0, columns, column + 1), edge(1, rows, row + 1)],
                ..self
            })
        })
    }

    /// The part that is left inside of margins: left, top, right and bottom.
    pub fn inside(self, [left, top, right, bottom]: [u32; 4]) -> Self {
        let [left, top, right, bottom] = [left, top, right, bottom].map(|side| side as i32);
        let [x0, y0] = self.least;
        let [x1, y1] = self.greatest;
        Self { least: [x0 + left, y0 + top], greatest: [x1 - right, y1 - bottom], ..self }
    }

    fn absolute(&self, at: Point) -> Point {
        std::array::from_fn(|axis| self.least[axis].saturating_add(at[axis]))
    }

    fn put(&self, shape: Shape) {
        self.drawing.borrow_mut().shapes.push(shape);
    }

    /// Draws a rectangle between two opposite corners.
    pub fn rectangle(&self, corners: [Point; 2], paint: impl Into<Paint>) {
        let [one, other] = corners.map(|corner| self.absolute(corner));
        let least = std::array::from_fn(|axis| one[axis].min(other[axis]));
        let greatest = std::array::from_fn(|axis| one[axis].max(other[axis]));
        self.put(Shape::Rectangle([least, greatest], paint.into()));
    }

    /// Draws a line through points.
    pub fn path(&self, points: impl IntoIterator<Item = Point>, line: Line) {
        self.put(Shape::Path(points.into_iter().map(|at| self.absolute(at)).collect(), line));
    }

    /// Draws a line of dashes: their length, and the length of the gaps.
    pub fn dashed_path(&self, points: impl IntoIterator<Item = Point>, lengths: [u32; 2], line: Line) {
        let points: Vec<Point> = points.into_iter().map(|at| self.absolute(at)).collect();
        for dash in dashes(&points, lengths.map(|length| length as f32)) {
            self.put(Shape::Path(dash, line));
        }
    }

    /// Fills the area between corners.
    pub fn polygon(&self, corners: impl IntoIterator<Item = Point>, colour: Colour) {
        self.put(Shape::Polygon(corners.into_iter().map(|at| self.absolute(at)).collect(), colour));
    }

    /// Draws a circle.
    pub fn circle(&self, middle: Point, radius: u32, paint: impl Into<Paint>) {
        self.put(Shape::Circle(self.absolute(middle), radius, paint.into()));
    }

    /// Draws a cross of two diagonals.
    pub fn cross(&self, middle: Point, radius: u32, line: Line) {
        let ([x, y], radius) = (self.absolute(middle), radius as i32);
        let ([left, up], [right, down]) =
            ([x, y].map(|c| c.saturating_sub(radius)), [x, y].map(|c| c.saturating_add(radius)));
        self.put(Shape::Straight([[left, up], [right, down]], line));
        self.put(Shape::Straight([[left, down], [right, up]], line));
    }

    /// Fills a triangle with equal sides that points up; its corners are on a circle.
    pub fn triangle(&self, middle: Point, radius: u32, colour: Colour) {
        let [x, y] = self.absolute(middle).map(f64::from);
        let corners = [-90.0_f64, -210.0, -330.0].map(|degrees| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            [(cos * f64::from(radius) + x).ceil() as i32, (sin * f64::from(radius) + y).ceil() as i32]
        });
        self.put(Shape::Polygon(corners.to_vec(), colour));
    }

    /// Writes a line of text.
    pub fn text(&self, text: impl Into<String>, at: Point, font: Font) {
        self.put(Shape::Text(text.into(), self.absolute(at), font));
    }

    /// Puts an image beneath this area, which cuts it: the place of its upper left corner in the area, and its width
    /// and height.
    pub fn put_beneath(&self, image: Arc<Image>, at: [f64; 2], size: [f64; 2]) {
        let window = [self.least, self.greatest];
        self.drawing.borrow_mut().images.push(Placed { image, window, at, size });
    }
}

/// The dashes of a line through points.
fn dashes(points: &[Point], [dash, gap]: [f32; 2]) -> Vec<Vec<Point>> {
    let whole = |at: [f32; 2]| at.map(|c| c.round() as i32);
    let mut dashes = Vec::new();
    let Some(first) = points.first() else { return dashes };
    let mut at = first.map(|c| c as f32);
    let mut open = vec![*first];
    let (mut is_dash, mut left) = (true, dash);
    for end in points.iter().skip(1).map(|end| end.map(|c| c as f32)) {
        while at != end {
            let way = [end[0] - at[0], end[1] - at[1]];
            let length = way[0].hypot(way[1]);
            if left < length {
                at = std::array::from_fn(|axis| at[axis] + way[axis] * (left / length));
                left = 0.0;
            } else {
                at = end;
                left -= length;
            }
            if is_dash {
                open.push(whole(at));
            }
            if left <= 0.0 {
                is_dash = !is_dash;
                left = if is_dash { dash } else { gap };
                if is_dash {
                    open.push(whole(at));
                } else {
                    dashes.push(std::mem::take(&mut open));
                }
            }
        }
    }
    if open.len() > 1 {
        dashes.push(open);
    }
    dashes
}

#[cfg(test)]
mod tests {
    use super::{Colour, Drawing, Shape, dashes};

    #[test]
    fn dashes_and_gaps_alternate_along_the_whole_line() {
        // 20 units down, with a corner after 3: dashes of 5 and gaps of 2 end at 5, 7, 12, 14, 19.
        let line = dashes(&[[100, 100], [100, 103], [100, 120]], [5.0, 2.0]);
        assert_eq!(
            line,
            [vec![[100, 100], [100, 103], [100, 105]], vec![[100, 107], [100, 112]], vec![[100, 114], [100, 119]]]
        );
        assert!(dashes(&[], [5.0, 2.0]).is_empty() && dashes(&[[1, 1]], [5.0, 2.0]).is_empty());
    }

    #[test]
    fn points_of_an_area_are_from_its_corner() {
        let drawing = Drawing::new([10, 10], |area| {
            let [_, below] = area.split_at_y(16);
            let parts: Vec<_> = below.split_evenly(1, 3).collect();
            // 80 units in three parts: 27, 27 and 26.
            parts[2].polygon([[0, 0], [1, 1]], Colour::WHITE);
            parts[1].inside([1, 2, 3, 4]).rectangle([[1, 1], [0, 0]], Colour::WHITE.fill());
            assert_eq!(parts[2].size(), [26, 64]);
        });
        let expected = [
            Shape::Polygon(vec![[54, 16], [55, 17]], Colour::WHITE),
            Shape::Rectangle([[28, 18], [29, 19]], Colour::WHITE.fill()),
        ];
        assert_eq!(drawing.shapes, expected);
    }
}
