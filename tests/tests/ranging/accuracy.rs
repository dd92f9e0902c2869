//! What nodes add to the errors of the air: the accuracy of ranges of whole nodes on register-level chips, calibrated,
//! with clocks up to ±20 ppm off, on the ideal air.

use sim::scenario::{Scenario, Simulation};
use system_tests::{Run, TAG};

/// One anchor and one tag: a range over `distance_m` metres in a mode of the network.
fn over(distance_m: f64, network: &str, seconds: f64, seed: u64) -> Run {
    Run::of_text(&site(distance_m, network, seconds, seed))
}

fn site(distance_m: f64, network: &str, seconds: f64, seed: u64) -> String {
    format!(
        "[simulation]\nseconds = {seconds}\nseed = {seed}\nair = \"ideal\"\n[network]\n{network}\n\
         [[node]]\nrole = \"anchor\"\nposition_m = [0, 0, 1.5]\n\
         [[node]]\nrole = \"tag\"\nheight_m = 1.5\nsimulation = {{ path_m = [[{distance_m}, 0, 1.5]] }}\n"
    )
}

/// Modes of the EVK1000: 1, 3, 5, 7 at 110 kbit/s, the others at 6.81 Mbit/s.
fn seconds_of(mode: u8) -> f64 {
    if mode % 2 == 1 { 30.0 } else { 3.0 }
}

fn assert_true(run: &Run, least: usize, what: &str) {
    let ranges = run.ranges(TAG, 1, 0.0, f64::INFINITY).len();
    assert!(ranges >= least, "{what}: {ranges} ranges");
    let (bias, deviation) = run.range_error(TAG, 1, 0.0, f64::INFINITY);
    assert!(bias.abs() <= 0.01, "{what}: bias {bias} m of {ranges}");
    assert!(deviation <= 0.03, "{what}: deviation {deviation} m of {ranges}");
}

#[test]
fn native_ranges_are_true_from_0_3_to_50_metres_in_every_mode() {
    for mode in 1..=8 {
        for (seed, distance_m) in [0.3, 1.0, 3.0, 10.0, 25.0, 50.0].into_iter().enumerate() {
            let run = over(distance_m, &format!("evk1000_mode = {mode}"), seconds_of(mode), seed as u64 + 1);
            assert_true(&run, 60, &format!("mode {mode}, {distance_m} m"));
        }
    }
}

#[test]
fn decaranging_ranges_are_true_from_0_3_to_50_metres_in_every_mode() {
    for mode in 1..=8 {
        for (seed, distance_m) in [0.3, 10.0, 50.0].into_iter().enumerate() {
            for variant in ["decaranging", "decaranging-fast"] {
                let network = format!("mode = \"{variant}\"\nevk1000_mode = {mode}");
                let run = over(distance_m, &network, 2.0 * seconds_of(mode), seed as u64 + 1);
                assert_true(&run, 60, &format!("{variant}, mode {mode}, {distance_m} m"));
            }
        }
    }
}

#[test]
fn ranges_are_true_again_soon_after_the_chips_have_warmed_up() {
    for mode in ["native", "decaranging"] {
        let text = site(10.0, &format!("mode = \"{mode}\""), 40.0, 1);
        let mut simulation = Simulation::new(Scenario::parse(&text).unwrap());
        let mut records = simulation.run_until(15.0);
        for node in [1, TAG] {
            simulation.node(node).unwrap().chip().set_temperature(63.0);
        }
        records.extend(simulation.run_until(40.0));
        let run = Run { records, summary: simulation.summary() };
        // 40 °C × 2.15 mm, until a node measures its temperature, which it does every 10 to 12.5 s. The remaining
        // errors are steps of 4.7 mm in four delays, and the sensor's steps of 1.14 °C.
        let (cold_m, _) = run.range_error(TAG, 1, 1.0, 14.9);
        let (warm_m, _) = run.range_error(TAG, 1, 15.1, 15.5);
        let (corrected_m, _) = run.range_error(TAG, 1, 30.0, 40.0);
        assert!(cold_m.abs() < 0.01, "{mode}: {cold_m} m");
        assert!((warm_m - cold_m - 0.086).abs() < 0.015, "{mode}: {warm_m} m");
        assert!(corrected_m.abs() < 0.015, "{mode}: {corrected_m} m");
    }
}
