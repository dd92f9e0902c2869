//! Conversions between the quantised numbers of the wire and SI units.
//!
//! Numbers beyond the wire's range become its greatest or least. NaN never becomes zero: a deviation becomes the
//! greatest, a power [`UNKNOWN_POWER`].

/// Units of a length per metre.
const PER_METRE: f32 = 1e4;
/// Units of powers and of parts per million per unit.
const HUNDREDTHS: f32 = 100.0;

/// Represents an unknown power or offset.
pub const UNKNOWN_POWER: i16 = i16::MIN;

/// To the nearest integer; NaN stays NaN.
pub(crate) fn nearest(value: f32) -> f32 {
    // `as` rounds towards zero.
    value + if value < 0.0 { -0.5 } else { 0.5 }
}

/// 0.1 mm, saturated at the ends of the range; NaN becomes the greatest.
pub fn length(metres: f32) -> i32 {
    if metres.is_nan() { i32::MAX } else { nearest(metres * PER_METRE) as i32 }
}

/// 0.1 mm of a deviation. Zero means exactly known, so no other deviation becomes zero.
pub fn deviation(metres: f32) -> u32 {
    if metres <= 0.0 {
        0
    } else if metres.is_nan() {
        u32::MAX
    } else {
        (nearest(metres * PER_METRE) as u32).max(1)
    }
}

/// From a length in 0.1 mm.
pub(crate) fn metres(tenth_mm: i32) -> f64 {
    f64::from(tenth_mm) / f64::from(PER_METRE)
}

/// From a deviation in 0.1 mm.
pub(crate) fn deviation_m(tenth_mm: u32) -> f64 {
    f64::from(tenth_mm) / f64::from(PER_METRE)
}

/// Hundredths; NaN and infinities become [`UNKNOWN_POWER`], and no finite value does.
pub fn hundredths(value: f32) -> i16 {
    if value.is_finite() { (nearest(value * HUNDREDTHS) as i16).max(-i16::MAX) } else { UNKNOWN_POWER }
}

/// From hundredths.
pub(crate) fn from_hundredths(value: i16) -> Option<f64> {
    (value != UNKNOWN_POWER).then(|| f64::from(value) / f64::from(HUNDREDTHS))
}

/// Three lengths in 0.1 mm, if all are numbers.
pub fn position(metres: [f32; 3]) -> Option<[i32; 3]> {
    metres.iter().all(|coordinate| coordinate.is_finite()).then(|| metres.map(length))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_beyond_the_wire_become_its_ends() {
        assert_eq!([1e30, -1e30].map(length), [i32::MAX, i32::MIN]);
        assert_eq!([1e30, -1e30].map(deviation), [u32::MAX, 0]);
        assert_eq!([1e30, -1e30, f32::NAN].map(hundredths), [i16::MAX, -i16::MAX, UNKNOWN_POWER]);
        assert_eq!(length(f32::NAN), i32::MAX);
    }
}
