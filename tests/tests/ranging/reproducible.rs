//! Equal scenarios and seeds give equal records, and the two fidelities give equivalent results.

use sim::scenario::{Fidelity, Scenario};
use system_tests::Run;

fn records(level: Fidelity, seed: u64) -> String {
    let run = Run::of(Scenario { fidelity: level, seed, seconds: 2.0, loss: 0.1, ..Scenario::rooms(6, 3) });
    format!("{:?}\n{:?}", run.records, run.summary)
}

#[test]
fn equal_seeds_give_equal_records_and_others_do_not() {
    for level in [Fidelity::Spi, Fidelity::Air] {
        assert!(records(level, 7) == records(level, 7), "{level:?}");
        assert!(records(level, 7) != records(level, 8), "{level:?}");
    }
}

#[test]
fn a_radio_straight_on_the_air_finds_what_a_chip_finds() {
    let median = |level| {
        let run = Run::of(Scenario { fidelity: level, seconds: 5.0, ..Scenario::rooms(8, 1) });
        assert!(run.summary.fixes_per_s > 150.0, "{level:?}: {:?}", run.summary);
        run.summary.p50_m.unwrap_or(f64::NAN)
    };
    let (chip, air) = (median(Fidelity::Spi), median(Fidelity::Air));
    assert!((chip - air).abs() < 0.01, "{chip} m and {air} m");
}
