//! RSSI values against distance, with the path loss by regression and, dotted, as a node learns it point by point;
//! one panel a beacon (figure 4.5 of A. Linde Cerezo's thesis).

use anyhow::Result;
use plotters::prelude::*;
use positioning_core::ble::path_loss::PathLoss;

use super::axes::Axes;
use super::drawing;
use super::style::{INK, number, pen, stroke};
use crate::survey::calibration::Calibrated;

/// Number of panels side by side.
const ACROSS: usize = 3;
/// Size of a panel, pixels.
const PANEL: (u32, u32) = (400, 300);
/// Points of a curve.
const POINTS: u32 = 120;

/// Draws every beacon that was received.
///
/// # Errors
/// The drawing library fails.
pub fn path_loss(calibrated: &[Calibrated]) -> Result<String> {
    let heard: Vec<_> = calibrated.iter().filter_map(|beacon| Some((beacon, beacon.path_loss?))).collect();
    let across = heard.len().clamp(1, ACROSS);
    let down = heard.len().div_ceil(across).max(1);
    let points = || calibrated.iter().flat_map(|beacon| &beacon.points);
    let farthest = 1.05 * points().map(|point| point.distance_m).fold(1.0, f64::max);
    let loudest = points().map(|point| point.rssi_dbm).fold(-60.0, f64::max);
    let faintest = points().map(|point| point.rssi_dbm).fold(-80.0, f64::min);
    drawing((PANEL.0 * across as u32, PANEL.1 * down as u32), |area| {
        let panels = area.split_evenly((down, across));
        for (panel, (beacon, path_loss)) in panels.iter().zip(heard) {
            let title = format!(
                "{}: n {}, {} dBm at 1 m",
                beacon.beacon,
                number((path_loss.exponent * 100.0).round() / 100.0),
                number((path_loss.level_1m * 10.0).round() / 10.0)
            );
            let axes =
                Axes { title: &title, names: ["distance, metres", "RSSI, dBm"], left: 60, ticks: [6, 6], unit: "" };
            let mut chart = axes.draw(panel, 0.0..farthest, faintest - 4.0..loudest + 4.0)?;
            let curve = |model: &PathLoss<f64>| -> Vec<(f64, f64)> {
                let distances = (1..=POINTS).map(|step| farthest * f64::from(step) / f64::from(POINTS));
                let points = distances.map(|distance| (distance, model.rssi(distance)));
                points.filter(|(_, rssi)| (faintest - 4.0..=loudest + 4.0).contains(rssi)).collect()
            };
            chart.draw_series([pen("robust").line::<(f64, f64)>(curve(&path_loss))])?;
            if let Some(online) = &beacon.online {
                chart.draw_series([pen("bb-nls-r").line::<(f64, f64)>(curve(&online.path_loss))])?;
            }
            let dots = beacon.points.iter().map(|point| (point.distance_m, point.rssi_dbm));
            chart.draw_series(dots.map(|at| Circle::new(at, stroke(3.0), INK.mix(0.6).filled())))?;
        }
        Ok(())
    })
}
