//! From SI units to the whole numbers of telemetry: rounded, and held within what a field can say.

use ranging::{Diagnostics, exchange};
use telemetry::Range;

/// Units of 0.1 mm in a metre.
const PER_METRE: f32 = 10_000.0;

/// Metres in 0.1 mm; what is no number is 0.
pub fn tenth_millimetres(metres: f32) -> i32 {
    // `as` saturates.
    nearest(metres * PER_METRE) as i32
}

/// A standard deviation in 0.1 mm.
pub fn deviation(metres: f32) -> u32 {
    nearest(metres * PER_METRE) as u32
}

/// A correlation in 1/127, from a covariance and two deviations; 0 where a deviation is 0.
pub fn correlation(covariance: f32, deviations: [f32; 2]) -> i8 {
    let product = deviations[0] * deviations[1];
    if product > 0.0 { nearest(127.0 * covariance / product).clamp(-127.0, 127.0) as i8 } else { 0 }
}

/// A share of 0 to 1 in 1/255.
pub fn share(value: f32) -> u8 {
    nearest(255.0 * value) as u8
}

/// A range of a round.
pub fn range(t_us: u64, round: u16, range: &exchange::Range) -> Range {
    Range {
        t_us,
        round,
        peer: range.peer,
        distance: tenth_millimetres(range.distance_m),
        deviation: deviation(range.deviation_m),
        place: range.position_m.map(|place| place.map(tenth_millimetres)),
        diagnostics: diagnostics(&range.diagnostics),
    }
}

fn diagnostics(measured: &Diagnostics) -> telemetry::Diagnostics {
    telemetry::Diagnostics {
        rx_power: nearest(measured.rx_power_dbm * 100.0) as i16,
        first_path_power: nearest(measured.first_path_power_dbm * 100.0) as i16,
        first_path_index: nearest(measured.first_path_index * 64.0) as u16,
        first_path_amplitudes: measured.first_path_amplitudes,
        cir_power: measured.cir_power,
        preamble_count: measured.preamble_count,
        noise_deviation: measured.noise_deviation,
        clock_offset: nearest(measured.clock_offset_ppm * 100.0) as i16,
    }
}

/// Half away from zero, before a conversion that cuts the fraction off. `core` has no rounding.
fn nearest(value: f32) -> f32 {
    if value < 0.0 { value - 0.5 } else { value + 0.5 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_rounded_and_held() {
        assert_eq!(tenth_millimetres(1.234_56), 12_346);
        assert_eq!(tenth_millimetres(-1.234_56), -12_346);
        assert_eq!(tenth_millimetres(f32::INFINITY), i32::MAX);
        assert_eq!(tenth_millimetres(f32::NAN), 0);
        assert_eq!((deviation(0.06), deviation(-1.0)), (600, 0));
    }

    #[test]
    fn correlations_and_shares() {
        // 0.5 of 127 is 63.5: away from zero.
        assert_eq!(correlation(0.125, [0.5, 0.5]), 64);
        assert_eq!(correlation(-0.125, [0.5, 0.5]), -64);
        assert_eq!(correlation(1.0, [0.2, 0.3]), 127);
        assert_eq!(correlation(0.0, [0.2, 0.0]), 0);
        assert_eq!((share(0.0), share(0.5), share(1.0), share(2.0)), (0, 128, 255, 255));
    }

    #[test]
    fn a_range_with_what_the_receiver_measured() {
        let told = range(
            7,
            8,
            &exchange::Range {
                peer: 9,
                distance_m: 3.0,
                deviation_m: 0.03,
                position_m: Some([1.0, -2.0, 0.5]),
                diagnostics: Diagnostics {
                    rx_power_dbm: -81.55,
                    first_path_power_dbm: -83.0,
                    first_path_index: 745.25,
                    clock_offset_ppm: -12.34,
                    ..Diagnostics::default()
                },
            },
        );
        assert_eq!((told.t_us, told.round, told.peer, told.distance, told.deviation), (7, 8, 9, 30_000, 300));
        assert_eq!(told.place, Some([10_000, -20_000, 5_000]));
        assert_eq!((told.diagnostics.rx_power, told.diagnostics.first_path_power), (-8155, -8300));
        // 745.25 · 64 = 47 696.
        assert_eq!((told.diagnostics.first_path_index, told.diagnostics.clock_offset), (47_696, -1234));
    }
}
