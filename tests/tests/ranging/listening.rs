//! Tags that only listen, in whole nodes: eight anchors range among each other, and any number of tags computes
//! positions from that.

use sim::scenario::{AirModel, Fidelity, LISTENING, NETWORK, Scenario, Simulation};
use system_tests::Run;
use wire::config::{Mode, Network};

/// Positions per second and tag after the first second, the root mean square of their errors in metres, and collisions,
/// on the ideal air.
fn listen(level: Fidelity, tags: usize, seconds: f64, loss: f64) -> (f64, f64, u64) {
    listen_on(AirModel::Ideal, level, tags, seconds, loss)
}

fn listen_on(air: AirModel, level: Fidelity, tags: usize, seconds: f64, loss: f64) -> (f64, f64, u64) {
    let scenario = Scenario { air, fidelity: level, seconds, loss, ..Scenario::listening(8, tags) };
    let mut simulation = Simulation::new(scenario);
    simulation.run_until(1.0);
    let joined = simulation.summary();
    let records = simulation.run_until(seconds);
    let errors_m = records.iter().filter_map(|record| record.epoch()?.error_m());
    let errors_m: Vec<f64> = errors_m.collect();
    let rate = errors_m.len() as f64 / (seconds - 1.0) / tags as f64;
    let mean_square = errors_m.iter().map(|error| error * error).sum::<f64>() / errors_m.len() as f64;
    (rate, mean_square.sqrt(), simulation.summary().collisions - joined.collisions)
}

#[test]
fn a_hundred_tags_have_fifty_positions_a_second_each() {
    let (rate, rmse_m, collisions) = listen(Fidelity::Air, 100, 2.0, 0.0);
    // Eight anchors with ten rounds per second each: eighty rounds.
    assert!(rate >= 50.0, "{rate} a second");
    assert!(rmse_m <= 0.15, "{rmse_m} m");
    assert_eq!(collisions, 0);
}

#[test]
fn on_register_level_chips_as_well() {
    let (rate, rmse_m, collisions) = listen(Fidelity::Spi, 3, 4.0, 0.0);
    assert!(rate >= 70.0, "{rate} a second");
    assert!(rmse_m <= 0.10, "{rmse_m} m");
    assert_eq!(collisions, 0);
}

#[test]
fn a_lost_frame_costs_a_difference_and_not_the_position() {
    let (rate, rmse_m, _) = listen(Fidelity::Air, 20, 4.0, 0.3);
    // Seven polls in ten are received.
    assert!(rate >= 40.0, "{rate} a second");
    assert!(rmse_m <= 0.15, "{rmse_m} m");
}

#[test]
fn on_an_air_as_recorded_they_err_by_a_decimetre() {
    let (_, rmse_m, _) = listen_on(AirModel::Recorded, Fidelity::Air, 20, 6.0, 0.0);
    // A difference has the lasting errors of three links: two to the tag, one between anchors.
    assert!((0.05..0.30).contains(&rmse_m), "{rmse_m} m");
}

/// What walls add to the paths between anchors is measured. The error of a tag that listens is at most two and a half
/// times that of a tag that polls: a difference contains two links, neither shows which one is blocked, and there is no
/// distance by itself. On the ideal air, walls are the only cause of errors.
#[test]
fn walls_between_anchors_are_not_in_the_differences() {
    let mean_square = |mode: Mode| {
        let squares = (1..=6).map(|seed| {
            let scenario = match Scenario::parse(include_str!("../../../examples/walls.toml")) {
                Ok(scenario) => scenario,
                Err(error) => panic!("line {error}"),
            };
            let networks = vec![Network { mode, ..NETWORK }];
            let scenario = Scenario { air: AirModel::Ideal, fidelity: Fidelity::Air, seed, networks, ..scenario };
            let run = Run::of(scenario);
            run.summary.rmse_m.map_or(f64::NAN, |rmse_m| rmse_m * rmse_m)
        });
        squares.sum::<f64>() / 6.0
    };
    let (asks, listens) = (mean_square(Mode::Native), mean_square(LISTENING));
    assert!(listens <= 6.25 * asks, "{listens} m² and {asks} m²");
}
