//! The same samples through the same code on the desktop.

use anyhow::{Result, ensure};
use onchip_bench::cases::{ANCHORS, EPOCHS, Epoch};
use positioning_core::{Constraints, Method, solve};

use super::printed::{Printed, Solve};

/// Chip and desktop may differ by so much, metres.
const TOLERANCE_M: f32 = 1.0e-3;

/// Compares every answer of the chip with the desktop's. The greatest distance, metres; an error where it is too great, where
/// only one of them has a position, or where the chip left a case out.
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

fn answer<const D: usize>(case: &Solve) -> Result<Vec<f32>, String> {
    let epoch = Epoch::<D>::new(case.anchors, case.epoch);
    solve(case.method, epoch.samples(), &Constraints::default())
        .map(|fix| fix.position.to_vec())
        .map_err(|reason| reason.to_string())
}
