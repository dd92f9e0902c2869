//! The legend of a picture: what is drawn, symbols and names, and each series' figures.

use super::drawing::{Across, Area, Down, Font, Point};
use super::ellipses::{self, SIGMAS, have_ellipses};
use super::labels::{short, short_path};
use super::map::{MOST_MARKS, is_still};
use super::pens::{methods, tags};
use super::style::{AXIS, INK, Pen, pen, pixels, printable, stroke, text};
use super::view::View;
use super::{Picture, Series};

/// The height of a line, pixels.
const LINE: u32 = 24;
const MARGIN: u32 = 20;
/// Positions of the columns, pixels from the left: symbol, name, and the right edges of the figures.
const SYMBOL: u32 = 34;
const NAME: u32 = 62;
const FIGURES: [u32; 5] = [264, 320, 376, 432, 488];
/// Characters of a name, of the source, and of a series.
const LONGEST: usize = 56;
const LONGEST_SERIES: usize = 18;
/// With more series, those behind have neither a line in the legend nor a curve.
const MOST: usize = 16;

/// Text to the right of its point, and to the left of it.
const BESIDE: Font = text(Across::Left, Down::Middle);
const BEFORE: Font = text(Across::Right, Down::Middle);

/// The first line of a list beside a chart, pixels from the top.
const BESIDE_CHART: u32 = 52;

/// Draws the lines of methods beside a chart, from the top of the area; returns the place of the next line, in
/// units of the drawing.
pub fn methods_beside<'a>(area: Area, names: impl Iterator<Item = &'a str>) -> i32 {
    let mut y = pixels(BESIDE_CHART) as i32;
    for name in names {
        pen(name).line(area, [[pixels(4) as i32, y], [pixels(36) as i32, y]]);
        area.text(name, [pixels(48) as i32, y], BESIDE);
        y += pixels(LINE) as i32;
    }
    y
}

/// The curves of errors: those of the series that the legend names.
pub fn shown<'a>(picture: &'a Picture, pens: &[Pen]) -> Vec<(Pen, &'a [f64])> {
    picture.series.iter().zip(pens).take(MOST).map(|(series, pen)| (*pen, series.errors_m.as_slice())).collect()
}

/// The entries of a legend.
pub struct Key<'a> {
    picture: &'a Picture,
    pens: &'a [Pen],
    /// What is drawn: lines above the symbols.
    captions: Vec<String>,
    symbols: Vec<(Symbol, String)>,
    remarks: Vec<String>,
}

/// The symbol of an entry.
#[derive(Clone, Copy)]
enum Symbol {
    Anchor,
    Beacon,
    Cross,
    Line,
    Ellipse,
    Wall,
}

impl<'a> Key<'a> {
    /// The legend of a picture that shows the view, and enlarges some parts of it.
    pub fn of(picture: &'a Picture, pens: &'a [Pen], view: &View, zooms: usize) -> Self {
        let outside = picture.series.iter().flat_map(|series| &series.dots).filter(|dot| !view.has(dot.at_m)).count();
        let mut remarks = match outside {
            0 => Vec::new(),
            1 => vec!["1 position lies outside of the map".to_owned()],
            _ => vec![format!("{outside} positions lie outside of the map")],
        };
        match zooms {
            0 => {}
            1 => remarks.push("the box on the map is shown enlarged".to_owned()),
            _ => remarks.push("the boxes on the map are shown enlarged".to_owned()),
        }
        if picture.series.iter().map(|series| series.dots.len()).sum::<usize>() > MOST_MARKS {
            remarks.push("positions that others would cover are not drawn".to_owned());
        }
        if let Some(more) = picture.series.len().checked_sub(MOST).filter(|more| *more > 0) {
            remarks.push(format!("{more} more series are on the map only"));
        }
        Self { picture, pens, captions: captions(picture), symbols: symbols(picture, view), remarks }
    }

    /// Its height, pixels.
    pub fn height(&self) -> u32 {
        let series = self.picture.series.len().min(MOST);
        // Above the series: the name of the errors, and the heads of the columns.
        let lines = self.captions.len() + self.symbols.len() + 2 + series + self.remarks.len();
        2 * MARGIN + LINE * lines as u32
    }

    /// Draws it into the upper left of the area.
    pub fn draw(&self, area: Area) {
        let mut line = 0;
        let mut next = || {
            line += 1;
            pixels(MARGIN + LINE * line - LINE / 2) as i32
        };
        let name = |y| [pixels(NAME) as i32, y];
        for caption in &self.captions {
            area.text(caption, [pixels(SYMBOL - 16) as i32, next()], BESIDE);
        }
        for (symbol, text) in &self.symbols {
            let y = next();
            symbol.draw(area, [pixels(SYMBOL) as i32, y]);
            area.text(text, name(y), BESIDE);
        }
        let with_errors = self.picture.has_errors();
        let y = next();
        if with_errors {
            let what = format!("{}, metres", self.picture.errors.name());
            area.text(what, [pixels(FIGURES[4]) as i32, y], BEFORE);
        }
        let y = next();
        let heads: &[&str] = if with_errors { &["positions", "RMSE", "P50", "P90", "max"] } else { &["positions"] };
        for (head, x) in heads.iter().zip(FIGURES) {
            area.text(*head, [pixels(x) as i32, y], BEFORE);
        }
        for (series, pen) in self.picture.series.iter().zip(self.pens).take(MOST) {
            self.draw_series(area, series, pen, next());
        }
        for remark in &self.remarks {
            area.text(remark, name(next()), BESIDE);
        }
    }

    fn draw_series(&self, area: Area, series: &Series, pen: &Pen, y: i32) {
        let (symbol, half) = (pixels(SYMBOL) as i32, pixels(16) as i32);
        let statistics = series.statistics();
        if statistics.is_some() {
            pen.line(area, [[symbol - half, y], [symbol + half, y]]);
        }
        pen.mark(area, [symbol, y], 3.0);
        let named = name_of(self.picture, series);
        area.text(named, [pixels(NAME) as i32, y], BESIDE);
        let worst = series.errors_m.iter().copied().fold(0.0, f64::max);
        let figures = statistics.map_or_else(Vec::new, |s| vec![s.rmse, s.p50, s.p90, worst]);
        let figures = std::iter::once(series.dots.len().to_string()).chain(figures.into_iter().map(metres));
        for (figure, x) in figures.zip(FIGURES) {
            area.text(figure, [pixels(x) as i32, y], BEFORE);
        }
    }
}

/// A number of metres in the width of a column.
fn metres(value: f64) -> String {
    if value < 9999.0 { format!("{value:.3}") } else { format!("{value:.0e}") }
}

/// The method, with several tags the tag, or both.
fn name_of(picture: &Picture, series: &Series) -> String {
    let several = (tags(picture).len() > 1, methods(&picture.series).len() > 1);
    let name = match several {
        (true, true) => format!("{} {}", series.tag, series.method),
        (true, false) => series.tag.clone(),
        (false, _) => series.method.clone(),
    };
    short(&printable(&name), LONGEST_SERIES)
}

/// What is drawn, how long, of which tags.
fn captions(picture: &Picture) -> Vec<String> {
    let mut captions = Vec::new();
    if !picture.source.is_empty() {
        captions.push(short_path(&printable(&picture.source), LONGEST));
    }
    let mut facts = Vec::new();
    if let Some([first, last]) = picture.times_s.filter(|times| times.iter().all(|t_s| t_s.abs() < 1e12)) {
        facts.push(format!("{}, from {first:.1} to {last:.1} s", duration(last - first)));
    }
    let (tags, methods) = (tags(picture), methods(&picture.series));
    match tags.as_slice() {
        [] => {}
        [tag] if tag.is_empty() => {}
        [tag] => facts.push(format!("tag {}", short(&printable(tag), LONGEST_SERIES))),
        tags if methods.len() == 1 => {
            facts.push(format!("{} tags by {}", tags.len(), short(&methods[0], LONGEST_SERIES)))
        }
        tags => facts.push(format!("{} tags", tags.len())),
    }
    if !facts.is_empty() {
        captions.push(facts.join("; "));
    }
    captions
}

/// A duration for reading: from two minutes on, hours and minutes.
fn duration(seconds: f64) -> String {
    let minutes = (seconds / 60.0).round();
    if seconds < 120.0 {
        format!("{seconds:.1} s")
    } else if minutes < 60.0 {
        format!("{minutes} min")
    } else {
        format!("{} h {} min", (minutes / 60.0).floor(), minutes % 60.0)
    }
}

fn symbols(picture: &Picture, view: &View) -> Vec<(Symbol, String)> {
    let mut symbols = Vec::new();
    let mut add = |when: bool, symbol, text: &str| {
        if when {
            symbols.push((symbol, text.to_owned()));
        }
    };
    add(!picture.anchors.is_empty(), Symbol::Anchor, "anchors");
    add(!picture.preferred_m.is_empty(), Symbol::Cross, "where the ranges prefer an anchor");
    add(!picture.beacons.is_empty(), Symbol::Beacon, "beacons");
    add(!picture.walls_m.is_empty(), Symbol::Wall, "walls");
    let ways = || picture.truth.iter().filter(|way| !way.points_m.is_empty());
    let several = tags(picture).len() > 1;
    let crosses = ways().any(|way| way.are_dwells || is_still(way));
    let lines = ways().any(|way| !way.are_dwells && !is_still(way));
    add(
        lines,
        Symbol::Line,
        if several { "truth, darker than its tag; ring: start; arrows: time" } else { "truth; arrows: time" },
    );
    let dwells = ways().any(|way| way.are_dwells);
    add(crosses, Symbol::Cross, if dwells { "truth, with a line to each estimate" } else { "truth" });
    let dots = || {
        let series = picture.series.iter().filter(|series| have_ellipses(picture, series));
        series.flat_map(|series| &series.dots).filter_map(|dot| dot.covariance_m2)
    };
    let along = if dots().any(|[_, xy, _]| xy != 0.0) { "" } else { " along x and y" };
    let methods = methods(&picture.series);
    let of = match methods.first().filter(|first| methods.len() > 2 && !first.is_empty()) {
        Some(first) => format!(" of {}", short(first, LONGEST_SERIES)),
        None => String::new(),
    };
    add(ellipses::any(picture, view), Symbol::Ellipse, &format!("{SIGMAS} σ{along}, of some positions{of}"));
    symbols
}

impl Symbol {
    fn draw(self, area: Area, at: Point) {
        let ([x, y], half) = (at, pixels(16) as i32);
        let ends = [[x - half, y], [x + half, y]];
        match self {
            Self::Anchor => area.triangle(at, pixels(6), INK),
            Self::Beacon => area.circle(at, pixels(5), INK.line(stroke(1.6))),
            Self::Cross => area.cross(at, pixels(5), INK.line(stroke(1.8))),
            Self::Line => {
                area.path(ends, INK.line(stroke(1.3)));
                let [back, side] = [5, 4].map(|shown| pixels(shown) as i32);
                area.polygon([[x + back, y], [x - back, y - side], [x - back, y + side]], INK);
            }
            Self::Ellipse => area.circle(at, pixels(7), INK.faded(0.5).line(stroke(0.8))),
            Self::Wall => area.path(ends, AXIS.line(stroke(3.0))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{duration, metres};

    #[test]
    fn durations_and_errors_are_short() {
        assert_eq!([0.0, 119.94, 150.0, 10_465.0].map(duration), ["0.0 s", "119.9 s", "3 min", "2 h 54 min"]);
        assert_eq!([0.1, 9998.0, 3e12].map(metres), ["0.100", "9998.000", "3e12"]);
    }
}
