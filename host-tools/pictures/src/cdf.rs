//! The cumulative distribution of errors: the share of positions with an error up to each value, from none to all.

use std::ops::Range;

use super::axes::{Axes, LEFT, Scale};
use super::drawing::Area;
use super::style::Pen;

/// Greatest number of steps of a curve; more would not be visible.
const STEPS: usize = 400;
/// Errors are drawn on a logarithmic axis where the greatest one is more than this multiple of the least median:
/// otherwise a few outliers, or a bad method, would flatten the rest.
const FAR: f64 = 8.0;
/// A logarithmic axis begins where this share of the best series' errors is less.
const BEGINS: f64 = 0.02;
/// The least and the greatest error that an axis shows, metres.
const SHOWN_M: (f64, f64) = (1e-4, 1e8);

/// Draws the curves of errors, metres, over the whole area. `name` is the name of the errors.
pub fn draw(area: Area, curves: &[(Pen, &[f64])], name: &str) {
    let sorted: Vec<(Pen, Vec<f64>)> = curves
        .iter()
        .map(|(pen, errors)| {
            let mut errors: Vec<f64> = errors.iter().map(|error| error.min(SHOWN_M.1)).collect();
            errors.retain(|error| error.is_finite());
            errors.sort_by(f64::total_cmp);
            (*pen, errors)
        })
        .filter(|(_, errors)| !errors.is_empty())
        .collect();
    let (scale, range) = axis(sorted.iter().map(|(_, errors)| errors.as_slice()));
    let logarithmic = if scale == Scale::Logarithmic { ", logarithmic" } else { "" };
    let axes = Axes {
        title: "Distance from the truth",
        names: [&format!("{name}, metres{logarithmic}"), "share of positions"],
        left: LEFT,
        ticks: [9, 6],
        x_scale: scale,
        unit: " %",
    };
    let chart = axes.draw(area, range.clone(), 0.0..100.0);
    let place = |error: f64| match scale {
        Scale::Linear => error,
        Scale::Logarithmic => error.max(1e-300).log10(),
    };
    for (pen, errors) in &sorted {
        let (start, end) = (range.start, range.end);
        let points = steps(errors).into_iter().map(|(error, share)| [place(error).clamp(start, end), share]);
        pen.line(chart.paper, points.chain([[end, 100.0]]).map(|at| chart.at(at)));
    }
}

/// The axis of errors, which ends behind the greatest one.
fn axis<'a>(sorted: impl Iterator<Item = &'a [f64]> + Clone) -> (Scale, Range<f64>) {
    let of = |errors: &[f64], share: f64| errors.get((share * errors.len() as f64) as usize).copied();
    let worst = sorted.clone().filter_map(|errors| errors.last().copied()).fold(SHOWN_M.0, f64::max);
    let median = sorted.clone().filter_map(|errors| of(errors, 0.5)).fold(worst, f64::min).max(SHOWN_M.0);
    if worst <= FAR * median {
        return (Scale::Linear, 0.0..1.02 * worst);
    }
    let least = sorted.filter_map(|errors| of(errors, BEGINS)).fold(median, f64::min).max(SHOWN_M.0);
    (Scale::Logarithmic, least.log10()..(1.05 * worst).log10())
}

/// The corners of the curve: at each error the share of the sorted errors that are less, and that are not greater.
fn steps(sorted: &[f64]) -> Vec<(f64, f64)> {
    let share = |count: usize| 100.0 * count as f64 / sorted.len().max(1) as f64;
    let every = sorted.len().div_ceil(STEPS).max(1);
    let mut counts: Vec<usize> = (0..sorted.len()).step_by(every).skip(1).chain([sorted.len()]).collect();
    counts.dedup();
    let mut before = 0;
    let mut points = Vec::with_capacity(2 * counts.len());
    for count in counts {
        let Some(error) = count.checked_sub(1).and_then(|last| sorted.get(last)) else { continue };
        points.extend([(*error, share(before)), (*error, share(count))]);
        before = count;
    }
    points
}

#[cfg(test)]
mod tests {
    use super::{Scale, axis, steps};

    #[test]
    fn a_curve_rises_at_each_error_and_ends_at_all() {
        assert_eq!(steps(&[0.1, 0.3]), [(0.1, 0.0), (0.1, 50.0), (0.3, 50.0), (0.3, 100.0)]);
        let many: Vec<f64> = (1..=10_000).map(f64::from).collect();
        let curve = steps(&many);
        assert!(curve.len() <= 802, "{}", curve.len());
        assert_eq!((curve[1], curve.last()), ((25.0, 0.25), Some(&(10_000.0, 100.0))));
    }

    #[test]
    fn the_axis_reaches_the_greatest_error_and_is_logarithmic_where_that_is_far() {
        let (near, far) = ([0.1, 0.2, 0.4], [0.1, 0.2, 20.0]);
        let (scale, range) = axis([near.as_slice()].into_iter());
        assert!(scale == Scale::Linear && range.start == 0.0 && (range.end - 0.408).abs() < 1e-9, "{range:?}");
        let (scale, range) = axis([near.as_slice(), far.as_slice()].into_iter());
        assert_eq!(scale, Scale::Logarithmic);
        // From log 0.1 to log 21.
        assert!((range.start + 1.0).abs() < 1e-9 && (range.end - 1.322_219).abs() < 1e-6, "{range:?}");
    }
}
