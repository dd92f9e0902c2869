//! Error ellipses of positions.

use std::f64::consts::TAU;

use super::axes::Chart;
use super::pens::methods;
use super::style::{Pen, stroke};
use super::view::View;
use super::{Dot, Picture, Series, thin};

/// Radius of an ellipse in standard deviations.
pub const SIGMAS: f64 = 2.0;
/// Greatest number of ellipses of a picture.
const MOST: usize = 60;
/// With more methods, only the first one has ellipses.
const METHODS: usize = 2;
/// Greatest number of positions that are compared.
const COMPARED: usize = 800;
/// An ellipse is left out where its middle is nearer to that of another one, in units of its greater radius.
const APART: f64 = 0.8;
/// Corners of an outline.
const CORNERS: u32 = 48;

/// The outline of a covariance at this many standard deviations: x = μ + L u for each point u of a circle, with the
/// Cholesky factor L of the covariance. `None` where the covariance is none.
pub fn outline(dot: &Dot, sigmas: f64) -> Option<Vec<[f64; 2]>> {
    let [xx, xy, yy] = dot.covariance_m2?;
    let below = if xx > 0.0 { xy / xx.sqrt() } else { 0.0 };
    let rest = yy - below * below;
    if !(xx >= 0.0 && yy >= 0.0 && rest >= -1e-9 * yy) {
        return None;
    }
    let (x, y) = (sigmas * xx.sqrt(), sigmas * rest.max(0.0).sqrt());
    let points = (0..CORNERS).map(|corner| (TAU * f64::from(corner) / f64::from(CORNERS)).sin_cos());
    let points = points.map(|(sin, cos)| [dot.at_m[0] + x * cos, dot.at_m[1] + sigmas * below * cos + y * sin]);
    let points: Vec<[f64; 2]> = points.collect();
    points.iter().flatten().all(|c| c.is_finite()).then_some(points)
}

/// Which series have ellipses: all of two methods, else those of the first one.
pub fn have_ellipses(picture: &Picture, series: &Series) -> bool {
    let methods = methods(&picture.series);
    methods.len() <= METHODS || methods.first() == Some(&series.method)
}

/// Whether any ellipse of a picture is visible.
pub fn any(picture: &Picture, view: &View) -> bool {
    let series = picture.series.iter().filter(|series| have_ellipses(picture, series));
    let mut dots = series.flat_map(|series| chosen(&series.dots, view, MOST));
    dots.any(|dot| outline(dot, SIGMAS).is_some_and(|outline| !border(view, &outline).is_empty()))
}

/// The parts of an outline that are on the map.
fn border(view: &View, outline: &[[f64; 2]]) -> Vec<Vec<[f64; 2]>> {
    let closed: Vec<[f64; 2]> = outline.iter().chain(outline.first()).copied().collect();
    view.cut_line(&closed)
}

/// Draws the ellipses of a series.
pub fn draw(chart: &Chart, view: &View, picture: &Picture, series: &Series, pen: &Pen) {
    if !have_ellipses(picture, series) {
        return;
    }
    let most = (MOST / picture.series.len().max(1)).max(4);
    for dot in chosen(&series.dots, view, most) {
        let Some(outline) = outline(dot, SIGMAS) else { continue };
        let pieces = border(view, &outline);
        // An ellipse around the whole map would only tint it.
        if pieces.is_empty() {
            continue;
        }
        let area = view.cut_area(&outline);
        chart.paper.polygon(area.into_iter().map(|at| chart.at(at)), pen.color.faded(0.06));
        for piece in pieces {
            chart.path(&piece, pen.color.faded(0.5).line(stroke(0.8)));
        }
    }
}

/// Positions whose ellipses do not cover each other, at most `most`, spread over the series.
fn chosen<'a>(dots: &'a [Dot], view: &View, most: usize) -> Vec<&'a Dot> {
    let inside: Vec<&Dot> = dots.iter().filter(|dot| view.has(dot.at_m) && dot.covariance_m2.is_some()).collect();
    // Each is compared with those before, so that they are thinned first.
    let points: Vec<[f64; 2]> = inside.iter().map(|dot| dot.at_m).collect();
    let candidates = thin::points(&points, view.longer_side() / 200.0, COMPARED);
    let mut apart: Vec<&Dot> = Vec::new();
    for dot in candidates.into_iter().map(|index| inside[index]) {
        let [xx, _, yy] = dot.covariance_m2.unwrap_or_default();
        let reach = APART * SIGMAS * xx.max(yy).max(0.0).sqrt();
        if apart.iter().all(|other| (dot.at_m[0] - other.at_m[0]).hypot(dot.at_m[1] - other.at_m[1]) > reach) {
            apart.push(dot);
        }
    }
    let step = apart.len().div_ceil(most).max(1);
    apart.into_iter().step_by(step).collect()
}

#[cfg(test)]
mod tests {
    use super::{Dot, chosen, outline};
    use crate::view::View;

    #[test]
    fn an_ellipse_is_that_of_its_covariance() {
        // Variances of 5 m² and a covariance of 4 m²: the axes are the diagonals, with 3 and 1 m.
        let dot = Dot { at_m: [1.0, 2.0], covariance_m2: Some([5.0, 4.0, 5.0]), ..Dot::default() };
        let points = outline(&dot, 1.0).expect("a covariance");
        let radii: Vec<f64> = points.iter().map(|[x, y]| (x - 1.0).hypot(y - 2.0)).collect();
        let (least, greatest) =
            (radii.iter().fold(9.0_f64, |a, b| a.min(*b)), radii.iter().fold(0.0_f64, |a, b| a.max(*b)));
        assert!((least - 1.0).abs() < 0.02 && (greatest - 3.0).abs() < 0.02, "{least} {greatest}");
        // The longer axis goes up to the right.
        let far = points.iter().max_by(|a, b| (a[0] + a[1]).total_cmp(&(b[0] + b[1]))).expect("points");
        assert!((far[0] - 1.0 - 3.0 / 2_f64.sqrt()).abs() < 0.2 && far[1] > 3.9, "{far:?}");
    }

    #[test]
    fn what_is_no_covariance_has_no_ellipse() {
        for covariance in [[1.0, 2.0, 1.0], [-1.0, 0.0, 1.0], [f64::NAN, 0.0, 1.0], [1e308, 0.0, f64::INFINITY]] {
            let dot = Dot { covariance_m2: Some(covariance), ..Dot::default() };
            assert_eq!(outline(&dot, 2.0), None, "{covariance:?}");
        }
    }

    #[test]
    fn ellipses_of_a_tag_at_rest_are_one() {
        let dot = |x| Dot { at_m: [x, 0.5], covariance_m2: Some([0.01, 0.0, 0.01]), ..Dot::default() };
        let view = View { least: [0.0; 2], greatest: [10.0; 2] };
        let rests: Vec<Dot> = (0..500).map(|k| dot(5.0 + 1e-4 * f64::from(k))).collect();
        assert_eq!(chosen(&rests, &view, 30).len(), 1);
        let walks: Vec<Dot> = (0..500).map(|k| dot(0.02 * f64::from(k))).collect();
        assert!((20..=30).contains(&chosen(&walks, &view, 30).len()), "{}", chosen(&walks, &view, 30).len());
    }
}
