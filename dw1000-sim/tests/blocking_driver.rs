//! The example of drivers in the manner of C: it compiles, and it measures.

// Its `main` has no use here.
#[allow(dead_code)]
#[path = "../examples/blocking_driver.rs"]
mod blocking_driver;

#[test]
fn two_blocking_drivers_measure_their_distance() {
    for metres in [1.0, 30.0, 100.0] {
        let measured = blocking_driver::exchange(metres);
        // Each of two stamps is rounded to a tick, and their difference halved; a tick is 4.7 mm.
        assert!((measured - metres).abs() < 0.01, "{metres}: {measured}");
    }
}
