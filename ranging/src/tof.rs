//! Time of flight from the intervals of an exchange.
//!
//! An exchange is poll, response and, if double-sided, final. Each side measures two intervals in its own clock. They
//! are differences of instants by [`RadioInstant::since`](crate::RadioInstant::since), which is safe across the
//! counter's wrap:
//!
//! | interval | measured by | from | to |
//! |---|---|---|---|
//! | `round1` | initiator | poll TX | response RX |
//! | `reply1` | responder | poll RX | response TX |
//! | `round2` | responder | response TX | final RX |
//! | `reply2` | initiator | response RX | final TX |
//!
//! The errors below are for clocks that run fast by the fractions e_A (initiator) and e_B (responder). All arithmetic
//! is on integers and keeps 16 bits below the tick: nothing is rounded to 4.7 mm. A negative result is valid: at short
//! range noise and bias exceed the flight.

use crate::RadioDuration;
use crate::time::METRES_PER_TICK;

/// Bits below the tick.
const FRACTION_BITS: u32 = 16;

/// A time of flight, signed, in 2⁻¹⁶ ticks (0.24 fs).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TimeOfFlight(i64);

impl TimeOfFlight {
    /// From whole ticks, as in DecaRanging's report.
    pub const fn from_ticks(ticks: i64) -> Self {
        Self(ticks.saturating_mul(1 << FRACTION_BITS))
    }

    /// In ticks, rounded to the nearest.
    pub const fn to_ticks(self) -> i64 {
        self.0.saturating_add(1 << (FRACTION_BITS - 1)) >> FRACTION_BITS
    }

    /// In ticks, including the fraction.
    pub fn ticks(self) -> f32 {
        self.0 as f32 / (1u32 << FRACTION_BITS) as f32
    }

    /// The difference to another time of flight, as a distance, metres.
    pub fn apart_from(self, other: Self) -> f32 {
        Self(self.0.saturating_sub(other.0).saturating_abs()).metres()
    }

    /// The distance that light travels in this time, in air, metres (P. M. de Rojas Malpartida's thesis, Universidad de
    /// Sevilla, 2021, equation 5-1).
    pub fn metres(self) -> f32 {
        self.ticks() * METRES_PER_TICK as f32
    }
}

/// Times 2 to the power of `bits`, within 64 bits: 128 would cost a node 1.4 kB.
fn shifted(ticks: i64, bits: u32) -> i64 {
    ticks.clamp(i64::MIN >> bits, i64::MAX >> bits) << bits
}

/// Single-sided: ½·(round1 − reply1) (A. Linde Cerezo's thesis, Universitat Oberta de Catalunya, 2024, equation 3: ((T4
/// − T1) − (T3 − T2)) / 2).
///
/// Error under drift: ½·(e_A − e_B)·reply1: 20 ppm at 400 µs are 1.2 m.
pub fn single_sided(round1: RadioDuration, reply1: RadioDuration) -> TimeOfFlight {
    single_sided_corrected(round1, reply1, 0.0)
}

/// Single-sided with the responder's interval converted to the initiator's clock: ½·(round1 − reply1 / (1 + o)). Here
/// `clock_offset` o = (1 + e_B)/(1 + e_A) − 1 is the rate of the responder's clock relative to the initiator's as a
/// fraction, positive if it is faster.
///
/// Error under drift: ½·δ·reply1, where δ is the error of `clock_offset`: 0.1 ppm at 400 µs are 6 mm. The flight itself
/// is measured in the initiator's clock, which adds e_A·ToF: 2 mm at 100 m and 20 ppm.
pub fn single_sided_corrected(round1: RadioDuration, reply1: RadioDuration, clock_offset: f32) -> TimeOfFlight {
    // For a reply of milliseconds the correction is some thousand ticks at most: f32 holds it to 10⁻³ ticks.
    let correction = reply1.ticks() as f32 * (clock_offset / (1.0 + clock_offset));
    let correction = (correction * (1_u32 << (FRACTION_BITS - 1)) as f32) as i64;
    let uncorrected = shifted(round1.ticks().saturating_sub(reply1.ticks()), FRACTION_BITS - 1);
    TimeOfFlight(uncorrected.saturating_add(correction))
}

/// Symmetric double-sided: ¼·(round1 − reply1 + round2 − reply2) (P. M. de Rojas Malpartida's thesis, 2021, equation
/// 5-2).
///
/// Error under drift: ¼·(e_A − e_B)·(reply2 − reply1): none for equal replies, 1.5 m for 20 ppm and a difference of 1
/// ms between the replies.
pub fn double_sided_symmetric(
    round1: RadioDuration,
    reply1: RadioDuration,
    round2: RadioDuration,
    reply2: RadioDuration,
) -> TimeOfFlight {
    let [round1, reply1, round2, reply2] = [round1, reply1, round2, reply2].map(RadioDuration::ticks);
    let sum = round1.saturating_sub(reply1).saturating_add(round2.saturating_sub(reply2));
    TimeOfFlight(shifted(sum, FRACTION_BITS - 2))
}

/// Asymmetric double-sided: (round1·round2 − reply1·reply2) / (round1 + round2 + reply1 + reply2), the product form of
/// the DW1000 user manual, 12.3.2. `None` if the intervals are impossible: their sum is not positive, or rounds and
/// replies differ by more than 2²³ ticks (130 µs) and last for seconds.
///
/// Error under drift: ½·(e_A + e_B)·ToF for any replies: at most 2 mm at 100 m and 20 ppm.
pub fn double_sided_asymmetric(
    round1: RadioDuration,
    reply1: RadioDuration,
    round2: RadioDuration,
    reply2: RadioDuration,
) -> Option<TimeOfFlight> {
    let [round1, reply1, round2, reply2] = [round1, reply1, round2, reply2].map(RadioDuration::ticks);
    let sum = round1.checked_add(reply1)?.checked_add(round2)?.checked_add(reply2)?;
    if sum <= 0 {
        return None;
    }
    // The same numerator, from factors that are small if the intervals belong to one exchange: 64 bits are enough, and
    // a node needs no 128-bit division.
    let [excess1, excess2] = [round1.checked_sub(reply1)?, round2.checked_sub(reply2)?];
    let product = excess1.checked_mul(round2)?.checked_add(reply1.checked_mul(excess2)?)?;
    let whole = (product / sum).checked_mul(1 << FRACTION_BITS)?;
    let rest = (product % sum).checked_mul(1 << FRACTION_BITS)? / sum;
    whole.checked_add(rest).map(TimeOfFlight)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::RadioInstant;

    /// Two clocks, fast by fractions e_a and e_b; a flight of `tof` ticks of true time; replies in ticks of true time.
    /// The instants are near a wrap of both counters. Returns round1, reply1, round2, reply2, rounded to the tick as
    /// the chip does.
    fn exchange(e_a: f64, e_b: f64, tof: f64, reply1: f64, reply2: f64) -> [RadioDuration; 4] {
        let stamp = |clock: f64, start: u64, t: f64| {
            RadioInstant::from_ticks(start.wrapping_add(((1.0 + clock) * t).round() as u64))
        };
        let a = |t| stamp(e_a, (1 << 40) - 20_000_000, t);
        let b = |t| stamp(e_b, (1 << 40) - 30_000_000, t);
        let [poll_rx, resp_tx] = [tof, tof + reply1];
        let [resp_rx, final_tx] = [resp_tx + tof, resp_tx + tof + reply2];
        [
            a(resp_rx).since(a(0.0)),
            b(resp_tx).since(b(poll_rx)),
            b(final_tx + tof).since(b(resp_tx)),
            a(final_tx).since(a(resp_rx)),
        ]
    }

    const MICROSECOND: f64 = 63_897.6;
    const METRE: f64 = 1.0 / METRES_PER_TICK;

    #[test]
    fn equation_3_by_hand() {
        // Round 1 000 101 ticks, reply 1 000 000: half of 101 ticks is 50.5.
        let tof = single_sided(RadioDuration::from_ticks(1_000_101), RadioDuration::from_ticks(1_000_000));
        assert_eq!(tof.ticks(), 50.5);
        // 50.5 ticks × 4.6904 mm (299792458 / 1.000293 / 63.8976e9) = 0.23686 m.
        assert!((tof.metres() - 0.236_86).abs() < 1e-4, "{}", tof.metres());
        assert_eq!(tof.to_ticks(), 51);
        // Negative flights are valid, with their fraction: (100 − 103) / 2.
        let negative = single_sided(RadioDuration::from_ticks(100), RadioDuration::from_ticks(103));
        assert_eq!((negative.ticks(), negative.to_ticks()), (-1.5, -1));
    }

    #[test]
    fn equation_5_2_by_hand() {
        // (1201 − 1000 + 903 − 700) / 4 = 404 / 4 = 101; with one tick less, 100.75.
        let d = RadioDuration::from_ticks;
        assert_eq!(double_sided_symmetric(d(1201), d(1000), d(903), d(700)).ticks(), 101.0);
        assert_eq!(double_sided_symmetric(d(1200), d(1000), d(903), d(700)).ticks(), 100.75);
    }

    #[test]
    fn product_form_by_hand() {
        // (1200·900 − 1000·700) / (1200 + 900 + 1000 + 700) = 380 000 / 3800 = 100.
        let d = RadioDuration::from_ticks;
        assert_eq!(double_sided_asymmetric(d(1200), d(1000), d(900), d(700)).map(TimeOfFlight::ticks), Some(100.0));
        assert_eq!(double_sided_asymmetric(d(0), d(0), d(0), d(0)), None);
        assert_eq!(double_sided_asymmetric(d(-5), d(1), d(1), d(1)), None);
        let extreme = [i64::MAX, i64::MIN, i64::MAX, i64::MIN + 1].map(d);
        let [a, b, c, e] = extreme;
        assert_eq!(double_sided_asymmetric(a, b, c, e), None);
        assert_eq!(double_sided_symmetric(a, b, c, e).ticks(), i64::MAX as f32 / 65536.0);
    }

    #[test]
    fn errors_under_drift_are_those_documented() {
        let tof = 10.0 * METRE;
        for (e_a, e_b) in [(20e-6, -20e-6), (-20e-6, 20e-6), (20e-6, 0.0), (20e-6, 20e-6)] {
            for (reply1, reply2) in [(400.0, 400.0), (400.0, 1400.0), (1400.0, 400.0)] {
                let [reply1, reply2] = [reply1, reply2].map(|us| us * MICROSECOND);
                let [r1, d1, r2, d2] = exchange(e_a, e_b, tof, reply1, reply2);
                let error = |t: TimeOfFlight| (f64::from(t.ticks()) - tof) * METRES_PER_TICK;
                let check = |name: &str, found: f64, predicted: f64| {
                    // 5 mm: half a tick of rounding in each of two to four intervals.
                    assert!((found - predicted).abs() < 5e-3, "{name}: {found} m, predicted {predicted} m");
                };
                check("single-sided", error(single_sided(r1, d1)), 0.5 * (e_a - e_b) * reply1 * METRES_PER_TICK);
                let offset = (1.0 + e_b) / (1.0 + e_a) - 1.0;
                check("corrected", error(single_sided_corrected(r1, d1, offset as f32)), 0.0);
                let symmetric = 0.25 * (e_a - e_b) * (reply1 - reply2) * METRES_PER_TICK;
                check("symmetric", error(double_sided_symmetric(r1, d1, r2, d2)), symmetric);
                check("asymmetric", error(double_sided_asymmetric(r1, d1, r2, d2).unwrap()), 0.0);
            }
        }
    }

    #[test]
    fn a_millisecond_more_of_reply_at_20_ppm_is_the_published_metre_and_a_half() {
        let [r1, d1, r2, d2] = exchange(20e-6, 0.0, 10.0 * METRE, 400.0 * MICROSECOND, 1400.0 * MICROSECOND);
        let symmetric = double_sided_symmetric(r1, d1, r2, d2).metres() - 10.0;
        assert!((symmetric + 1.5).abs() < 0.01, "{symmetric}");
        let asymmetric = double_sided_asymmetric(r1, d1, r2, d2).unwrap().metres() - 10.0;
        assert!(asymmetric.abs() < 5e-3, "{asymmetric}");
    }
}
