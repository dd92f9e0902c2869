//! The same samples through the same code on the desktop.

use anyhow::{Result, ensure};
use onchip_bench::cases::{ANCHORS, DrawnEpoch, EPOCHS};
use onchip_bench::{beacons, response, rooms};
use positioning_core::nlos::Feature;
use positioning_core::{Constraints, Method, solve};

use super::printed::{Call, Printed, Solve};

/// The greatest accepted difference between chip and desktop, metres.
const TOLERANCE_M: f32 = 1.0e-3;

/// Compares every answer of the chip with the desktop's, and returns the greatest distance, metres.
///
/// # Errors
/// The distance is too great, only one of them has a position, or the chip left a case out.
pub fn compare(chip: &Printed) -> Result<f32> {
    let mut greatest = 0.0_f32;
    let mut seen = Vec::new();
    for case in &chip.solves {
        let here = match case.dims {
            2 => answer::<2>(case),
            _ => answer::<3>(case),
        };
        let distance = match (&case.answer, &here) {
            (Ok(there), Ok(here)) => there.iter().zip(here).map(|(t, h)| (t - h).powi(2)).sum::<f32>().sqrt(),
            (Err(there), Err(here)) if there == here => 0.0,
            (Ok(_), Err(_)) | (Err(_), Ok(_)) | (Err(_), Err(_)) => f32::INFINITY,
        };
        ensure!(distance <= TOLERANCE_M, "chip and desktop disagree: {case:?}, here {here:?}");
        greatest = greatest.max(distance);
        seen.push((case.method.as_str(), case.dims, case.anchors, case.epoch));
    }
    seen.sort_unstable();
    seen.dedup();
    let cases = Method::ALL.len() * 2 * ANCHORS.len() * EPOCHS as usize;
    ensure!(seen.len() == cases, "the chip solved {} of {cases} cases", seen.len());
    Ok(greatest)
}

/// Compares the features and every probability of the chip with the desktop's.
///
/// # Errors
/// A value differs or is missing.
pub fn compare_sight(chip: &Printed) -> Result<()> {
    let features = response::features(&response::response());
    let mut here = vec![("features".to_owned(), features.get(Feature::SkewnessNear))];
    response::for_each_classifier(&mut |name, classifier| {
        here.push((name.to_owned(), classifier.nlos_probability(&features)));
    });
    let same = |(there, (what, value)): (&Call, &(String, Option<f32>))| {
        there.what == *what && value.is_some_and(|value| (value - there.value).abs() <= 1.0e-4)
    };
    let all = chip.sights.len() == here.len() && chip.sights.iter().zip(&here).all(same);
    ensure!(all, "chip and desktop disagree: {:?}, here {here:?}", chip.sights);
    Ok(())
}

/// Compares the chip's results of the functions on the RSSI of beacons with the desktop's.
///
/// # Errors
/// A value differs or is missing.
pub fn compare_beacons(chip: &Printed) -> Result<()> {
    struct Here(Vec<(String, f32)>);
    impl beacons::Measure for Here {
        fn call<S: Clone>(&mut self, what: &str, state: &S, call: impl Fn(&mut S) -> f32) {
            self.0.push((what.to_owned(), call(&mut state.clone())));
        }
    }
    let mut here = Here(Vec::new());
    beacons::for_each(&mut here);
    rooms::for_each(&mut here);
    let same = |(there, (what, value)): (&Call, &(String, f32))| {
        there.what == *what && (value - there.value).abs() <= TOLERANCE_M
    };
    let all = chip.beacons.len() == here.0.len() && chip.beacons.iter().zip(&here.0).all(same);
    ensure!(all, "chip and desktop disagree: {:?}, here {:?}", chip.beacons, here.0);
    Ok(())
}

fn answer<const D: usize>(case: &Solve) -> Result<Vec<f32>, String> {
    let epoch = DrawnEpoch::<D>::new(case.anchors, case.epoch);
    solve(case.method, epoch.samples(), &Constraints::default())
        .map(|fix| fix.position.to_vec())
        .map_err(|reason| reason.to_string())
}
