//! The map: walls, anchors, beacons, true positions, estimated positions and ellipses. One metre has the same length in
//! x and y.

use super::axes::{Axes, BOTTOM, Chart, RIGHT, Scale, TOP};
use super::drawing::{Area, Colour, Line};
use super::labels::Labels;
use super::pens::tags;
use super::style::{AXIS, INK, Pen, darker, pixels, stroke};
use super::view::View;
use super::{Picture, Series, Way, ellipses, thin};

/// A true position that stays within a box of this size is drawn as a point and not as a path, metres.
const STILL_M: f64 = 0.02;
/// Greatest number of marks, of points of lines, and of walls in a picture.
pub const MOST_MARKS: usize = 9000;
const MOST_POINTS: usize = 40_000;
const MOST_ANCHORS: usize = 1000;
/// The side of a cell in which one mark is drawn, and one point of a line, pixels.
const MARK_CELL: f64 = 1.0;
const LINE_CELL: f64 = 0.7;
/// The distance between two arrows on a path, pixels, and their greatest number.
const ARROWS_APART: f64 = 130.0;
const MOST_ARROWS: usize = 10;
/// Positions without truth are joined by a line where there are at least [`LEAST_PATH`] of them, and where the line
/// through every eighth one has at least the share [`SMOOTH`] of the length. Otherwise the line would show noise rather
/// than the path.
const LEAST_PATH: usize = 24;
const SMOOTH: f64 = 0.5;

/// The map of a picture.
pub struct Map<'a> {
    /// The picture.
    pub picture: &'a Picture,
    /// The pen of each series.
    pub pens: &'a [Pen],
    /// The parts that are shown enlarged, with their tags.
    pub zooms: &'a [(String, View)],
}

/// Whether the true position is one point.
pub fn is_still(way: &Way) -> bool {
    View::around(way.points_m.iter().copied()).is_some_and(|view| view.longer_side() < STILL_M)
}

impl Map<'_> {
    /// Draws the map over the whole area.
    pub fn draw(&self, area: Area, view: &View) {
        self.panel(area, view, "Positions", self.zooms);
    }

    /// Draws the enlarged parts side by side.
    pub fn draw_zooms(&self, area: Area) {
        for (panel, (tag, view)) in area.split_evenly(1, self.zooms.len()).zip(self.zooms) {
            let title = if tag.is_empty() { "Enlarged".to_owned() } else { format!("Enlarged: {tag}") };
            self.panel(panel, view, &title, &[]);
        }
    }

    /// A map with frames around parts of it.
    fn panel(&self, area: Area, view: &View, title: &str, framed: &[(String, View)]) {
        let [width, height] = area.size();
        // Numbers with decimals are wider.
        let left = view.left().max(if view.longer_side() < 5.0 { 76 } else { 0 });
        let paper = [(width, left + RIGHT), (height, TOP + BOTTOM)];
        let paper = paper.map(|(whole, margin)| f64::from((whole - pixels(margin) as i32).max(pixels(1) as i32)));
        let view = view.shaped(paper);
        let ticks = |axis: usize, spacing: u32| (paper[axis] / f64::from(pixels(spacing))).ceil() as usize;
        let axes = Axes {
            title,
            names: ["x, metres", "y, metres"],
            left,
            ticks: [ticks(0, 50 + view.numbers_width(0)), ticks(1, 70)],
            x_scale: Scale::Linear,
            unit: "",
        };
        let chart = axes.draw(area, view.least[0]..view.greatest[0], view.least[1]..view.greatest[1]);
        let metres_a_pixel = view.sides()[0] / paper[0] * f64::from(pixels(1));
        if let Some(plan) = &self.picture.plan {
            plan.put_beneath(chart.paper, &view);
        }
        self.contents(&chart, &view, metres_a_pixel);
        self.names(&chart, &view, metres_a_pixel, !framed.is_empty() || self.zooms.is_empty());
        frames(&chart, &view, metres_a_pixel, framed);
    }

    fn contents(&self, chart: &Chart, view: &View, metres_a_pixel: f64) {
        let Picture { series, truth, walls_m, .. } = self.picture;
        for (series, pen) in series.iter().zip(self.pens) {
            ellipses::draw(chart, view, self.picture, series, pen);
        }
        let walls = walls_m.iter().filter_map(|wall| view.cut(*wall)).take(MOST_POINTS);
        walls.for_each(|wall| chart.path(&wall, AXIS.line(stroke(3.0))));
        for (series, pen) in series.iter().zip(self.pens) {
            self.dwell_lines(chart, view, series, pen);
        }
        let most = MOST_MARKS / series.len().max(1);
        for (series, pen) in series.iter().zip(self.pens) {
            let inside: Vec<[f64; 2]> = series.dots.iter().map(|dot| dot.at_m).filter(|at| view.has(*at)).collect();
            if self.is_path(series, view) {
                let points: Vec<[f64; 2]> = series.dots.iter().map(|dot| dot.at_m).collect();
                self.path(chart, view, &points, pen.color.line(stroke(0.8)), metres_a_pixel);
            }
            for index in thin::points(&inside, MARK_CELL * metres_a_pixel, most) {
                pen.mark(chart.paper, chart.at(inside[index]), 2.0);
            }
        }
        for way in truth {
            self.way(chart, view, way, metres_a_pixel);
        }
        for line in &self.picture.preferred_m {
            view.cut(*line).iter().for_each(|line| chart.path(line, INK.line(stroke(1.3))));
            if view.has(line[1]) {
                chart.paper.cross(chart.at(line[1]), pixels(6), INK.line(stroke(2.2)));
            }
        }
    }

    /// Whether positions are joined by a line: without truth, and where the line shows a way.
    fn is_path(&self, series: &Series, view: &View) -> bool {
        if series.dots.len() < LEAST_PATH || self.picture.truth.iter().any(|way| way.tag == series.tag) {
            return false;
        }
        let every = |step: usize| -> f64 {
            let points: Vec<[f64; 2]> = series.dots.iter().map(|dot| dot.at_m).step_by(step).collect();
            points.windows(2).map(|ends| length([ends[0], ends[1]])).sum()
        };
        series.dots.iter().any(|dot| view.has(dot.at_m)) && every(8) >= SMOOTH * every(1)
    }

    /// The lines from the points where a tag dwelt to their estimates.
    fn dwell_lines(&self, chart: &Chart, view: &View, series: &Series, pen: &Pen) {
        if !self.picture.truth.iter().any(|way| way.are_dwells && way.tag == series.tag) {
            return;
        }
        let lines = series.dots.iter().filter_map(|dot| view.cut([dot.truth_m?, dot.at_m]));
        let lines = lines.take(MOST_MARKS / self.picture.series.len().max(1));
        lines.for_each(|line| chart.path(&line, pen.color.faded(0.55).line(stroke(0.8))));
    }

    fn way(&self, chart: &Chart, view: &View, way: &Way, metres_a_pixel: f64) {
        let colour = self.colour_of_truth(&way.tag);
        if way.are_dwells || is_still(way) {
            let most = if way.are_dwells { MOST_MARKS / 4 } else { 1 };
            let inside: Vec<[f64; 2]> = way.points_m.iter().copied().filter(|at| view.has(*at)).collect();
            let kept = thin::points(&inside, 2.0 * metres_a_pixel, most.max(4)).into_iter().take(most);
            let (size, width) = if way.are_dwells { (4, 1.4) } else { (6, 2.2) };
            for index in kept {
                chart.paper.cross(chart.at(inside[index]), pixels(size), colour.line(stroke(width)));
            }
            return;
        }
        self.path(chart, view, &way.points_m, colour.line(stroke(1.3)), metres_a_pixel);
    }

    /// A line with arrows in the direction of time.
    fn path(&self, chart: &Chart, view: &View, points: &[[f64; 2]], line: Line, metres_a_pixel: f64) {
        let most = MOST_POINTS / (self.picture.truth.len() + self.picture.series.len()).max(1);
        for piece in thin::line(points, LINE_CELL * metres_a_pixel, most) {
            view.cut_line(&piece).iter().for_each(|piece| chart.path(piece, line));
        }
        let heads = arrows(points, metres_a_pixel).into_iter().filter(|head| head.iter().all(|at| view.has(*at)));
        heads.for_each(|head| chart.paper.polygon(head.map(|at| chart.at(at)), line.colour));
    }

    /// The colour of a tag's truth: that of the tag, but darker.
    fn colour_of_truth(&self, tag: &str) -> Colour {
        let series = self.picture.series.iter().zip(self.pens).find(|(series, _)| series.tag == tag);
        match series {
            Some((_, pen)) if tags(self.picture).len() > 1 => darker(pen.color),
            Some(_) | None => INK,
        }
    }

    /// Anchors and beacons with their names, and `with_tags` the beginnings of the tags' ways.
    fn names(&self, chart: &Chart, view: &View, metres_a_pixel: f64, with_tags: bool) {
        let Picture { anchors, beacons, truth, series, walls_m, .. } = self.picture;
        let mut labels = Labels::new(view, metres_a_pixel, walls_m);
        let shown = |list: &[(String, [f64; 2])]| -> Vec<(String, [f64; 2])> {
            list.iter().filter(|(_, at)| view.has(*at)).take(MOST_ANCHORS).cloned().collect()
        };
        let (anchors, beacons) = (shown(anchors), shown(beacons));
        anchors.iter().chain(&beacons).for_each(|(_, at)| labels.avoid(*at));
        let paper = chart.paper;
        anchors.iter().for_each(|(_, at)| paper.triangle(chart.at(*at), pixels(6), INK));
        let ring = |colour: Colour| colour.line(stroke(1.6));
        beacons.iter().for_each(|(_, at)| paper.circle(chart.at(*at), pixels(5), ring(INK)));
        for way in truth {
            labels.avoid_crowd(&way.points_m);
        }
        for series in series {
            labels.avoid_crowd(&series.dots.iter().map(|dot| dot.at_m).collect::<Vec<_>>());
        }
        for (name, at) in anchors.iter().chain(&beacons) {
            labels.draw(chart, *at, name, INK, true);
        }
        let tags = tags(self.picture);
        if !with_tags || tags.len() <= 1 && truth.iter().any(|way| way.are_dwells || is_still(way)) {
            return;
        }
        for tag in &tags {
            let way = truth.iter().find(|way| way.tag == *tag && !way.points_m.is_empty());
            let mut dots = series.iter().filter(|series| series.tag == *tag && self.is_path(series, view));
            let first = match way {
                Some(way) => way.points_m.first().copied(),
                None => dots.find_map(|series| series.dots.first()).map(|dot| dot.at_m),
            };
            let Some(first) = first.filter(|at| view.has(*at)) else { continue };
            let colour = self.colour_of_truth(tag);
            let name = if tags.len() > 1 { tag.as_str() } else { "start" };
            paper.circle(chart.at(first), pixels(4), ring(colour));
            labels.draw(chart, first, name, colour, false);
        }
    }
}

/// Frames around parts of a map, which may be small on it.
fn frames(chart: &Chart, view: &View, metres_a_pixel: f64, framed: &[(String, View)]) {
    /// The least side of a frame, pixels.
    const LEAST: f64 = 22.0;
    for (_, part) in framed {
        let more = 0.5 * (LEAST * metres_a_pixel - part.longer_side()).max(0.0);
        let ([x0, y0], [x1, y1]) = (part.least.map(|c| c - more), part.greatest.map(|c| c + more));
        let frame = [[x0, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]];
        view.cut_line(&frame).iter().for_each(|piece| chart.path(piece, INK.line(stroke(0.8))));
    }
}

fn length([from, to]: [[f64; 2]; 2]) -> f64 {
    (to[0] - from[0]).hypot(to[1] - from[1])
}

/// Heads of arrows along a path, at equal distances: three corners each.
fn arrows(points: &[[f64; 2]], metres_a_pixel: f64) -> Vec<[[f64; 2]; 3]> {
    /// Length and half the width of a head, pixels.
    const HEAD: [f64; 2] = [10.0, 4.5];
    let whole: f64 = points.windows(2).map(|ends| length([ends[0], ends[1]])).sum();
    let apart = (ARROWS_APART * metres_a_pixel).max(whole / MOST_ARROWS as f64);
    let mut heads = Vec::new();
    let (mut gone, mut next) = (0.0, 0.5 * apart);
    // The direction is that of a piece as long as a head: neighbouring points may be equal, or noisy.
    let mut tail = points.first().copied();
    for ends in points.windows(2) {
        gone += length([ends[0], ends[1]]);
        let Some(from) = tail else { break };
        let piece = length([from, ends[1]]);
        if piece < HEAD[0] * metres_a_pixel {
            continue;
        }
        tail = Some(ends[1]);
        if gone < next || heads.len() >= MOST_ARROWS || !piece.is_finite() {
            continue;
        }
        next = gone + apart;
        let along: [f64; 2] = std::array::from_fn(|axis| (ends[1][axis] - from[axis]) / piece);
        let middle: [f64; 2] = std::array::from_fn(|axis| 0.5 * (ends[1][axis] + from[axis]));
        let corner = |forward: f64, left: f64| {
            let [forward, left] = [forward, left].map(|pixels| pixels * metres_a_pixel);
            [middle[0] + forward * along[0] - left * along[1], middle[1] + forward * along[1] + left * along[0]]
        };
        heads.push([corner(0.5 * HEAD[0], 0.0), corner(-0.5 * HEAD[0], HEAD[1]), corner(-0.5 * HEAD[0], -HEAD[1])]);
    }
    heads
}

#[cfg(test)]
mod tests {
    use super::arrows;

    #[test]
    fn arrows_point_where_the_tag_goes() {
        // 10 m to the right at 100 pixels a metre: heads after 65 pixels and each 130 pixels more.
        let walk: Vec<[f64; 2]> = (0..=1000).map(|k| [0.01 * f64::from(k), 3.0]).collect();
        let heads = arrows(&walk, 0.01);
        assert!((7..=8).contains(&heads.len()), "{}", heads.len());
        for [tip, one, other] in heads {
            assert!(tip[0] > one[0] && tip[1] == 3.0 && (one[1] + other[1] - 6.0).abs() < 1e-9);
        }
        assert!(arrows(&[[1.0, 1.0]; 50], 0.01).is_empty());
    }
}
