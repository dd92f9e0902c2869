//! Errors of anchors that last for a whole recording: antenna delays, and surveyed positions that are a little wrong.
//!
//! The input is the ranges and smoothed positions. The median of all anchors' median residuals is common to all. What
//! an anchor's median differs from that is its own, at most as much as an anchor in line of sight has: beyond, its link
//! was blocked. Of both, the share counts that is not the positions' own error: the prior variance by the sum of that and
//! of the positions' mean variance along a horizontal axis.

use baliza_report::{mean, percentile};
use recording::{Anchor, Epochs, Position, Solved};

use crate::Setup;
use crate::locate::residuals::{Reference, residuals};

/// The prior variance of an anchor's error, m²: that of a direct link, 0.1 m, and that common to all ranges, 0.14 m.
const PRIOR_M2: f64 = 0.1 * 0.1 + 0.14 * 0.14;
/// The greatest error of an anchor in line of sight beside the common one, and of both together, metres: three standard
/// deviations of a surveyed position with its antenna, and of an antenna delay that was never calibrated.
const OWN_M: f64 = 0.15;
const MOST_M: f64 = 0.42;
/// The error of an anchor with fewer ranges is not known.
const LEAST: usize = 20;

/// The errors by anchor, metres; 0 where an error is not known.
pub(super) fn of_anchors(anchors: &[Anchor], epochs: &Epochs, setup: &Setup, smoothed: &[Solved]) -> Vec<f64> {
    let positions = smoothed.iter().filter_map(|solved| solved.outcome.ok());
    let of_axis = |Position { sigma, .. }: Position| 0.5 * (sigma.x_m * sigma.x_m + sigma.y_m * sigma.y_m);
    let share = PRIOR_M2 / (PRIOR_M2 + mean(positions.map(of_axis)));
    let of_anchors = residuals(anchors, epochs, setup, Reference::Solved(smoothed));
    let medians_m = of_anchors.iter().map(|of| of.median_m.filter(|_| of.ranges >= LEAST)).collect::<Vec<_>>();
    let mut known_m: Vec<f64> = medians_m.iter().copied().flatten().collect();
    known_m.sort_by(f64::total_cmp);
    let common_m = percentile(&known_m, 0.5);
    let error = |median_m: Option<f64>| {
        let own_m = median_m.map_or(0.0, |median_m| median_m - common_m);
        share * (common_m + own_m.clamp(-OWN_M, OWN_M))
    };
    medians_m.into_iter().map(error).map(|error_m| if error_m.abs() <= MOST_M { error_m } else { 0.0 }).collect()
}

#[cfg(test)]
mod tests {
    use recording::{Anchor, Coordinates, Diagnostics, Epochs, Height, Measured, Position, Solved, Space};

    use super::{LEAST, of_anchors};
    use crate::Setup;

    #[test]
    fn what_is_common_counts_and_a_blocked_link_is_no_error_of_its_anchor() {
        // Four anchors 5 m from a tag at the origin. Their ranges are 0.1 m too long, those of a blocked one 0.7 m. The
        // fifth has too few ranges.
        let place = |x_m, y_m| Coordinates { x_m, y_m, z_m: None };
        let places = [place(5.0, 0.0), place(0.0, 5.0), place(-5.0, 0.0), place(0.0, -5.0), place(3.0, 4.0)];
        let anchors = places.map(|place| Anchor { name: String::new(), place });
        let mut epochs = Epochs::default();
        for at in 0..LEAST {
            epochs.push(&at.to_string(), None, None);
            for anchor in 0..if at == 0 { 5 } else { 4 } {
                let range_m = if anchor == 3 { 5.7 } else { 5.1 };
                let diagnostics = Diagnostics::default();
                epochs.push_range(&Measured { anchor, range_m, t_s: None, line_of_sight: None, diagnostics });
            }
        }
        // Variances of 0.0074 m² beside the prior's 0.0296 m²: four fifths count.
        let sigma = place(0.0074_f64.sqrt(), 0.0074_f64.sqrt());
        let position = Position {
            place: place(0.0, 0.0),
            sigma,
            covariance_xy: 0.0,
            covariance_z: None,
            velocity_m_s: None,
            used: 4,
            alternative: None,
            flag: None,
        };
        let smoothed = vec![Solved { outcome: Ok(position), error_m: None }; LEAST];
        let setup = Setup::of(Space::Plane(Height::Unknown));
        let found = of_anchors(&anchors, &epochs, &setup, &smoothed);
        // 0.8 · 0.1; of the blocked one 0.8 · (0.1 + 0.15).
        for (found_m, expected_m) in found.iter().zip([0.08, 0.08, 0.08, 0.2, 0.08]) {
            assert!((found_m - expected_m).abs() < 1e-9, "{found:?}");
        }
    }
}
