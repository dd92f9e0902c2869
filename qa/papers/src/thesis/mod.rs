//! The benchmark of P. M. de Rojas Malpartida's thesis (Universidad de Sevilla, 2021, chapter 8): every method on
//! simulated ranges, half of which lack their direct path.
//!
//! The non-linear methods of the thesis search a grid that covers the box in which points are drawn; here that box is
//! the search area of a solver.

pub mod printed;
mod table;

use baliza_report::Statistics;
use positioning_core::{Area, Constraints, MAX_ANCHORS, Method, RangeSample, Side};
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;
use sim::alavi_pahlavan::{ANCHORS, POINTS_M, Point, anchors_m, point};

pub use table::to_markdown;

const _: () = assert!(ANCHORS <= MAX_ANCHORS);

/// Scores of one method over a set of points.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct ThesisScore {
    /// The method's name.
    pub method: &'static str,
    /// The points with this number of detected direct paths; all of them where `None`.
    pub ddp_anchors: Option<usize>,
    /// Number of points.
    pub points: usize,
    /// Root mean square error, metres; `None` where no position was found.
    pub rmse_m: Option<f64>,
    /// Mean error, metres.
    pub mae_m: Option<f64>,
}

/// Draws the points.
pub fn points(count: usize, seed: u64) -> Vec<Point> {
    let mut random = Pcg64Mcg::seed_from_u64(seed);
    (0..count).map(|_| point(&mut random)).collect()
}

/// Solves a point; `None` where there is no position, otherwise its error, metres.
pub fn error_m(method: Method, point: &Point) -> Option<f64> {
    let anchors = anchors_m();
    let samples: [RangeSample<f32, 2>; ANCHORS] = std::array::from_fn(|i| {
        let range = point.ranges[i];
        let anchor = anchors[i].map(|coordinate| coordinate as f32);
        // Annex G blocks every second range, and `robust` may know how many are blocked, though not which.
        RangeSample { los: Some(range.detected), p_blocked: 0.5, ..RangeSample::new(anchor, range.range_m as f32) }
    });
    let [min, max] = POINTS_M.map(|corner| corner.map(|coordinate| coordinate as f32));
    let constraints = Constraints { side: Side::Unknown, area: Some(Area { min, max }) };
    let fix = positioning_core::solve(method, &samples, &constraints).ok()?;
    let [x, y] = std::array::from_fn(|axis| f64::from(fix.position[axis]) - point.position_m[axis]);
    Some((x * x + y * y).sqrt())
}

/// Scores of one method: over all points first, then by the number of detected direct paths. `errors` are those of the
/// points.
pub fn score(method: Method, points: &[Point], errors: &[Option<f64>]) -> Vec<ThesisScore> {
    let detected = |point: &Point| point.ranges.iter().filter(|range| range.detected).count();
    let classes = std::iter::once(None).chain((0..=ANCHORS).map(Some));
    let scores = classes.map(|class| {
        let members: Vec<_> =
            points.iter().zip(errors).filter(|(p, _)| class.is_none_or(|c| c == detected(p))).collect();
        let errors: Vec<f64> = members.iter().filter_map(|(_, error)| **error).collect();
        let figures = Statistics::of(&errors);
        ThesisScore {
            method: method.as_str(),
            ddp_anchors: class,
            points: members.len(),
            rmse_m: figures.map(|figures| figures.rmse),
            mae_m: figures.map(|figures| figures.mae),
        }
    });
    scores.filter(|score| score.points > 0).collect()
}
