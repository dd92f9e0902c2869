//! The same samples through the same code on the desktop.

use anyhow::{Result, ensure};
use onchip_bench::cases::{self, DrawnEpoch, EPOCHS};
use onchip_bench::walk::{self, WARM_UP, WalkStep, walk};
use onchip_bench::{beacons, response, rooms};
use positioning_core::nlos::Feature;
use positioning_core::{Constraints, Method, solve};

use super::printed::Printed;

/// A call by its words, with its results.
type Call = (String, Vec<f32>);

/// The greatest accepted difference between chip and desktop, metres.
const TOLERANCE_M: f32 = 1.0e-3;
/// The same for the engine, whose errors of rounding add up from step to step.
const ENGINE_TOLERANCE_M: f32 = 5.0e-3;
/// The greatest accepted difference of a probability.
const TOLERANCE_P: f32 = 1.0e-4;

/// Compares every result of the chip with the desktop's, and returns the greatest distance between solvers' positions,
/// metres.
///
/// # Errors
/// A result differs by more than its tolerance, or is missing.
pub fn compare(chip: &Printed) -> Result<f32> {
    same(chip, "nlos ", &sights(), TOLERANCE_P)?;
    same(chip, "beacons ", &of_beacons(), TOLERANCE_M)?;
    same(chip, "engine ", &of_engine(), ENGINE_TOLERANCE_M)?;
    same(chip, "solve ", &solves(), TOLERANCE_M)
}

/// Compares the calls whose words begin alike, and returns the greatest distance.
fn same(chip: &Printed, begin: &str, here: &[Call], tolerance: f32) -> Result<f32> {
    let there: Vec<_> = chip.calls(begin).map(|(_, call)| call).collect();
    ensure!(there.len() == here.len(), "the chip made {} of {} calls of {begin}", there.len(), here.len());
    let mut greatest = 0.0_f32;
    for (there, (words, results)) in there.into_iter().zip(here) {
        let distance = there.results.iter().zip(results).map(|(t, h)| (t - h).powi(2)).sum::<f32>().sqrt();
        let is_same = there.words == *words && there.results.len() == results.len() && distance <= tolerance;
        ensure!(is_same, "chip and desktop disagree: {there:?}, here {words} {results:?}");
        greatest = greatest.max(distance);
    }
    Ok(greatest)
}

fn solves() -> Vec<Call> {
    let mut calls = Vec::new();
    for method in Method::ALL {
        for anchors in cases::ANCHORS {
            for number in 0..EPOCHS {
                calls.push(solved::<2>(method, anchors, number));
                calls.push(solved::<3>(method, anchors, number));
            }
        }
    }
    calls
}

fn solved<const D: usize>(method: Method, anchors: usize, number: u32) -> Call {
    let epoch = DrawnEpoch::<D>::new(anchors, number);
    let words = format!("solve {method} {D} {anchors} {number}");
    match solve(method, epoch.samples(), &Constraints::default()) {
        Ok(fix) => (words, fix.position.to_vec()),
        Err(reason) => (format!("{words} {reason}"), Vec::new()),
    }
}

fn sights() -> Vec<Call> {
    let features = response::features(&response::response());
    let number = |value: Option<f32>| vec![value.unwrap_or(f32::NAN)];
    let mut calls = vec![("nlos features".to_owned(), number(features.get(Feature::SkewnessNear)))];
    response::for_each_classifier(&mut |name, classifier| {
        calls.push((format!("nlos {name}"), number(classifier.nlos_probability(&features))));
    });
    calls
}

fn of_beacons() -> Vec<Call> {
    struct Here(Vec<Call>);
    impl beacons::Measure for Here {
        fn call<S: Clone>(&mut self, what: &str, state: &S, call: impl Fn(&mut S) -> f32) {
            self.0.push((format!("beacons {what}"), vec![call(&mut state.clone())]));
        }
    }
    let mut here = Here(Vec::new());
    beacons::for_each(&mut here);
    rooms::for_each(&mut here);
    here.0
}

fn of_engine() -> Vec<Call> {
    let mut calls = Vec::new();
    for space in [false, true] {
        for anchors in walk::ANCHORS {
            let warm_up = WARM_UP * (u32::from(anchors) + 1);
            let mut count = 0;
            walk(anchors, space, |engine, step, now, measurement| {
                count += 1;
                let output = engine.step(now, measurement);
                if count > warm_up || step == WalkStep::Start {
                    let position = output.fix.map_or([f32::NAN; 3], |fix| fix.position);
                    let dims = if space { 3 } else { 2 };
                    calls.push((format!("engine {} {dims} {anchors}", step.as_str()), position.to_vec()));
                }
                output
            });
        }
    }
    calls
}
