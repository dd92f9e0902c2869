//! The legend of a picture: symbols and names, and each method's figures.

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::map::{SIGMAS, View, ellipse_step, is_still};
use super::style::{INK, pen, pixels, stroke, text};
use super::{Area, Picture, Track};

/// The height of a line, pixels.
const LINE: u32 = 24;
const MARGIN: u32 = 20;
/// Positions of the columns, pixels from the left: symbol, name, and the right edges of the figures.
const SYMBOL: u32 = 66;
const NAME: u32 = 110;
const FIGURES: [u32; 4] = [276, 332, 394, 456];

/// The first line of a list beside a chart, pixels from the top.
const BESIDE_CHART: u32 = 52;

/// Draws the lines of methods beside a chart, from the top of the area; returns the place of the next line, pixels.
///
/// # Errors
/// The drawing library fails.
pub fn methods<'a>(area: &Area, names: impl Iterator<Item = &'a str>) -> Result<i32> {
    let style = text(Pos::new(HPos::Left, VPos::Center));
    let mut y = pixels(BESIDE_CHART) as i32;
    for name in names {
        let ends = vec![(pixels(4) as i32, y), (pixels(36) as i32, y)];
        area.draw(&pen(name).line::<(i32, i32)>(ends))?;
        area.draw_text(name, &style, (pixels(48) as i32, y))?;
        y += pixels(LINE) as i32;
    }
    Ok(y)
}

/// The entries of a legend.
pub struct Key<'a> {
    picture: &'a Picture,
    remarks: Vec<String>,
}

impl<'a> Key<'a> {
    /// The legend of a picture that shows the view.
    pub fn of(picture: &'a Picture, view: &View) -> Self {
        let outside = picture.tracks.iter().flat_map(|track| &track.dots).filter(|dot| !view.has(dot.at_m)).count();
        let remarks = match outside {
            0 => Vec::new(),
            1 => vec!["1 position lies outside of the map".to_owned()],
            _ => vec![format!("{outside} positions lie outside of the map")],
        };
        Self { picture, remarks }
    }

    /// Its height, pixels.
    pub fn height(&self) -> u32 {
        let lines = 4 + usize::from(!self.picture.beacons.is_empty()) + self.picture.tracks.len() + self.remarks.len();
        2 * MARGIN + LINE * lines as u32
    }

    /// Draws it into the upper left of the area.
    ///
    /// # Errors
    /// The drawing library fails.
    pub fn draw(&self, area: &Area) -> Result<()> {
        let mut line = 0;
        let mut next = || {
            line += 1;
            pixels(MARGIN + LINE * line - LINE / 2) as i32
        };
        let symbol = pixels(SYMBOL) as i32;
        let left = text(Pos::new(HPos::Left, VPos::Center));
        let name = |y| (pixels(NAME) as i32, y);

        if !self.picture.anchors.is_empty() {
            let y = next();
            area.draw(&TriangleMarker::new((symbol, y), pixels(6), INK.filled()))?;
            area.draw_text("anchors", &left, name(y))?;
        }
        if !self.picture.beacons.is_empty() {
            let y = next();
            area.draw(&Circle::new((symbol, y), pixels(5), INK.stroke_width(stroke(1.6))))?;
            area.draw_text("beacons", &left, name(y))?;
        }
        if self.picture.truth_m.iter().any(|way| !way.is_empty()) {
            let y = next();
            if self.picture.truth_m.iter().all(|way| is_still(way)) {
                area.draw(&Cross::new((symbol, y), pixels(6), INK.stroke_width(stroke(2.2))))?;
            } else {
                let half = pixels(16) as i32;
                let ends = vec![(symbol - half, y), (symbol + half, y)];
                area.draw(&PathElement::new(ends, INK.stroke_width(stroke(1.3))))?;
            }
            area.draw_text("truth", &left, name(y))?;
        }
        if self.picture.tracks.iter().flat_map(|track| &track.dots).any(|dot| dot.sigma_m.is_some()) {
            let y = next();
            area.draw(&Circle::new((symbol, y), pixels(7), INK.mix(0.45).stroke_width(stroke(0.7))))?;
            let every = match ellipse_step(self.picture) {
                1 => String::new(),
                step => format!(", of one position in {step}"),
            };
            area.draw_text(&format!("{SIGMAS} σ along x and y{every}"), &left, name(y))?;
        }
        let y = next();
        let right = text(Pos::new(HPos::Right, VPos::Center));
        let with_errors = self.picture.tracks.iter().any(|track| track.statistics().is_some());
        let heads: &[&str] = if with_errors { &["positions", "RMSE", "P50", "P90"] } else { &["positions"] };
        for (head, x) in heads.iter().zip(FIGURES) {
            area.draw_text(head, &right, (pixels(x) as i32, y))?;
        }
        for track in &self.picture.tracks {
            self.draw_track(area, track, next())?;
        }
        for remark in &self.remarks {
            area.draw_text(remark, &left, name(next()))?;
        }
        Ok(())
    }

    fn draw_track(&self, area: &Area, track: &Track, y: i32) -> Result<()> {
        let (symbol, half) = (pixels(SYMBOL) as i32, pixels(16) as i32);
        let pen = pen(&track.method);
        if track.statistics().is_some() {
            area.draw(&pen.line::<(i32, i32)>(vec![(symbol - half, y), (symbol + half, y)]))?;
        }
        area.draw(&Circle::new((symbol, y), stroke(3.0), pen.color.filled()))?;
        area.draw_text(&track.method, &text(Pos::new(HPos::Left, VPos::Center)), (pixels(NAME) as i32, y))?;
        let figures = track.statistics().map_or([None; 3], |s| [Some(s.rmse), Some(s.p50), Some(s.p90)]);
        let figures = figures.map(|figure| figure.map_or_else(String::new, |metres| format!("{metres:.3}")));
        let right = text(Pos::new(HPos::Right, VPos::Center));
        for (figure, x) in std::iter::once(track.dots.len().to_string()).chain(figures).zip(FIGURES) {
            area.draw_text(&figure, &right, (pixels(x) as i32, y))?;
        }
        Ok(())
    }
}
