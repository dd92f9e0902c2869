//! The charge that a sleeping tag draws from its supply, on register-level chips, in the scenarios of
//! `examples/battery*.toml`.

use sim::scenario::{AirModel, Charges, Scenario, Simulation, Summary};

fn summary(text: &str, rate_hz: Option<f64>, seconds: f64) -> Summary {
    let mut scenario = Scenario::parse(text).unwrap();
    scenario.change_tags(|tag| tag.rate_chz = rate_hz.map(|hz| (100.0 * hz).round() as u32).or(tag.rate_chz));
    scenario.seconds = seconds;
    // This is about charges. An error of a decimetre must show that a position is wrong, not that links err.
    scenario.air = AirModel::Ideal;
    let mut simulation = Simulation::new(scenario);
    simulation.run_until(seconds);
    simulation.summary()
}

const WALKING: &str = include_str!("../../../examples/battery.toml");
const STILL: &str = include_str!("../../../examples/battery-still.toml");
const SEARCHING: &str = include_str!("../../../examples/battery-searching.toml");

fn assert_draws(summary: &Summary, fixes_per_s: f64, at_most_ma: f64) {
    assert!(summary.fixes_per_s > 0.97 * fixes_per_s, "{summary:?}");
    let current = summary.tag_mean_current_ma.unwrap();
    assert!(current < at_most_ma, "{summary:?}");
    let parts = summary.tag_currents_ma.as_ref().map(Charges::sum).unwrap();
    assert!((parts - current).abs() < 1e-9);
    assert!(summary.p90_m.unwrap() < 0.2, "{summary:?}");
}

#[test]
fn a_tag_that_walks_draws_little_more_than_its_rounds_take() {
    assert_draws(&summary(WALKING, Some(10.0), 120.0), 10.0, 2.4);
    assert_draws(&summary(WALKING, Some(1.0), 1_200.0), 1.0, 0.30);
    assert_draws(&summary(WALKING, Some(0.1), 3_600.0), 0.1, 0.031);
}

#[test]
fn a_tag_that_lies_still_draws_some_ten_microamperes() {
    assert_draws(&summary(STILL, None, 28_800.0), 1.0 / 64.0, 0.012);
}

#[test]
fn a_tag_without_a_network_draws_a_third_of_a_milliampere_at_most() {
    let summary = summary(SEARCHING, None, 7_200.0);
    assert_eq!(summary.fixes, 0);
    let current = summary.tag_mean_current_ma.unwrap();
    assert!(current < 0.3, "{summary:?}");
    // The tag does search for anchors: 120 ms of 113 mA in 64 s are 0.21 mA.
    assert!(current > 0.2, "{summary:?}");
}
