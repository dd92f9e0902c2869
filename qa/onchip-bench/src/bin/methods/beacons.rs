//! The costs of the RSSI values of Bluetooth beacons: an advertisement, a scan, every method from RSSI values to
//! a position, and rooms.

use core::hint::black_box;

use onchip_bench::beacons::{Measure, for_each};
use onchip_bench::instrument::Instrument;
use onchip_bench::rooms;

struct Printer<'a>(&'a mut Instrument);

impl Measure for Printer<'_> {
    fn call<S: Clone>(&mut self, what: &str, state: &S, call: impl Fn(&mut S) -> f32) {
        let cost = self.0.cost_on(state, |state| {
            black_box(call(black_box(state)));
        });
        let value = call(&mut state.clone());
        cost.print(format_args!("beacons {what}"), &[value]);
    }
}

/// Measures and prints.
pub fn print(instrument: &mut Instrument) {
    let mut printer = Printer(instrument);
    for_each(&mut printer);
    rooms::for_each(&mut printer);
}
