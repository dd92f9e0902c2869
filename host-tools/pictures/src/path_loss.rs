//! RSSI values against distance, with the path loss by regression and, dotted, as a node learns it point by point;
//! one panel a beacon (figure 4.5 of A. Linde Cerezo's thesis). The first panel has the legend.

use positioning_core::ble::path_loss::PathLoss;

use super::axes::{Axes, RIGHT, Scale, TOP};
use super::drawing::{Across, Area, Down, Drawing};
use super::style::{INK, number, pen, pixels, stroke, text};
use analysis::survey::calibration::{Calibrated, RssiAtDistance};

/// Number of panels side by side.
const ACROSS: usize = 3;
/// Size of a panel, pixels.
const PANEL: (u32, u32) = (400, 300);
/// The method whose pen the curve of a node has.
const LEARNT: &str = "bb-nls-r";
/// Points of a curve.
const POINTS: u32 = 120;

/// Draws every beacon that was received.
pub fn path_loss(calibrated: &[Calibrated]) -> Drawing {
    let heard: Vec<_> = calibrated.iter().filter_map(|beacon| Some((beacon, beacon.path_loss?))).collect();
    let across = heard.len().clamp(1, ACROSS);
    let down = heard.len().div_ceil(across).max(1);
    let points = || calibrated.iter().flat_map(|beacon| &beacon.points).filter(|point| can_be_drawn(point));
    let farthest = 1.05 * points().map(|point| point.distance_m).fold(1.0, f64::max);
    let loudest = points().map(|point| point.rssi_dbm).fold(-60.0, f64::max);
    let faintest = points().map(|point| point.rssi_dbm).fold(-80.0, f64::min);
    Drawing::new([PANEL.0 * across as u32, PANEL.1 * down as u32], |area| {
        let panels = area.split_evenly(down, across);
        for (index, (panel, (beacon, path_loss))) in panels.zip(heard).enumerate() {
            let title = format!(
                "{}: n {}, {} dBm at 1 m",
                beacon.beacon,
                number((path_loss.exponent * 100.0).round() / 100.0),
                number((path_loss.level_1m * 10.0).round() / 10.0)
            );
            let axes = Axes {
                title: &title,
                names: ["distance, metres", "RSSI, dBm"],
                left: 60,
                ticks: [6, 6],
                x_scale: Scale::Linear,
                unit: "",
            };
            let chart = axes.draw(panel, 0.0..farthest, faintest - 4.0..loudest + 4.0);
            let curve = |method: &str, model: &PathLoss<f64>| {
                let distances = (1..=POINTS).map(|step| farthest * f64::from(step) / f64::from(POINTS));
                let points = distances.map(|distance| [distance, model.rssi(distance)]);
                let points = points.filter(|[_, rssi]| (faintest - 4.0..=loudest + 4.0).contains(rssi));
                pen(method).line(chart.paper, points.map(|at| chart.at(at)));
            };
            curve("robust", &path_loss);
            if let Some(online) = &beacon.online {
                curve(LEARNT, &online.path_loss);
            }
            if index == 0 {
                legend(panel, calibrated.iter().any(|beacon| beacon.online.is_some()));
            }
            for point in beacon.points.iter().filter(|point| can_be_drawn(point)) {
                let at = chart.at([point.distance_m, point.rssi_dbm]);
                chart.paper.circle(at, stroke(3.0), INK.faded(0.6).fill());
            }
        }
    })
}

/// Whether a point is within a hundred kilometres and a thousand decibels.
fn can_be_drawn(point: &RssiAtDistance) -> bool {
    point.distance_m.abs() <= 1e5 && point.rssi_dbm.abs() <= 1e3
}

/// The names of the curves, in the upper right: RSSI values are low there.
fn legend(panel: Area, with_online: bool) {
    let right = panel.size()[0] - pixels(RIGHT + 8) as i32;
    let lines = [("robust", "regression"), (LEARNT, "learnt point by point")];
    for (index, (method, name)) in (0..).zip(lines).take(if with_online { 2 } else { 1 }) {
        let y = pixels(TOP + 12 + 20 * index) as i32;
        pen(method).line(panel, [[right - pixels(28) as i32, y], [right, y]]);
        panel.text(name, [right - pixels(36) as i32, y], text(Across::Right, Down::Middle));
    }
}
