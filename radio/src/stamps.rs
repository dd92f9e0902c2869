//! How a radio's timestamps relate to what happens at its antenna: the step of a programmed start, the antenna delay,
//! and the bias of measured distances by received power.

use crate::{RadioDuration, RadioInstant};

/// 10 ⁄ ln 10: converts a natural logarithm to decibels. A logarithm to the base of ten would take 256 bytes more in an
/// image.
const DECIBELS: f32 = 4.342_944_8;

/// A ratio of powers in decibels.
pub fn decibels(ratio: f32) -> f32 {
    DECIBELS * libm::logf(ratio)
}

/// What a protocol must know of its radio to state departures and to correct distances.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StampModel {
    /// A transmission or reception at an instant starts at a multiple of this many ticks, a power of two.
    pub delayed_step: u32,
    /// From the start of a transmission to the antenna.
    pub antenna_delay: RadioDuration,
    /// The bias of distances.
    pub range_bias: RangeBias,
}

impl StampModel {
    /// A radio that starts at every tick, has its antenna inside and measures without bias.
    pub const IDEAL: Self = Self { delayed_step: 1, antenna_delay: RadioDuration::ZERO, range_bias: RangeBias::NONE };

    /// The instant at which a frame's RMARKER is at the antenna when its transmission is programmed for `start`.
    pub const fn departure(&self, start: RadioInstant) -> RadioInstant {
        start.snapped(self.delayed_step).plus(self.antenna_delay)
    }
}

/// The bias that a receiver adds to distances by received power: true distance = measured − [`metres`](Self::metres).
/// A radio's driver has the tables.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RangeBias {
    /// Metres by the power actually received, from `first_dbm` on in steps of `step_db` downwards. In between it is
    /// interpolated linearly; beyond the ends the end value holds. Empty: no bias.
    pub table: &'static [f32],
    /// Power of the table's first entry, dBm.
    pub first_dbm: f32,
    /// From one entry to the next, dB.
    pub step_db: f32,
    /// Points of the curve of the radio's own estimate of a power against the power actually received, dBm. Below the
    /// first point the estimate is correct. Empty: it is correct everywhere.
    pub estimates: &'static [(f32, f32)],
    /// Received power at a distance of one metre with a clear path, dBm.
    pub first_metre_dbm: f32,
}

impl RangeBias {
    /// No bias.
    pub const NONE: Self = Self { table: &[], first_dbm: 0.0, step_db: 1.0, estimates: &[], first_metre_dbm: 0.0 };

    /// The amount by which a distance over a clear path of this length is measured too long, metres. The power is
    /// computed from the distance and not measured.
    pub fn expected(&self, distance_m: f32) -> f32 {
        self.at_power(self.first_metre_dbm - 2.0 * decibels(distance_m.max(0.1)))
    }

    /// The amount by which a distance is measured too long at this received power, as in
    /// [`Diagnostics`](crate::Diagnostics), metres; 0 if the power is not a number.
    pub fn metres(&self, rx_power_dbm: f32) -> f32 {
        if rx_power_dbm.is_nan() {
            return 0.0;
        }
        self.at_power(self.power_of(rx_power_dbm))
    }

    /// The same at the power actually received, which is not the radio's estimate.
    pub fn at_power(&self, power_dbm: f32) -> f32 {
        let Some((&last, _)) = self.table.split_last() else { return 0.0 };
        let place = ((self.first_dbm - power_dbm) / self.step_db).clamp(0.0, (self.table.len() - 1) as f32);
        let below = place as usize;
        let [left, right] = [below, below + 1].map(|index| self.table.get(index).copied().unwrap_or(last));
        left + (right - left) * (place - below as f32)
    }

    /// The received power for which the radio gives this estimate; beyond the curve's end that of the end.
    fn power_of(&self, estimate_dbm: f32) -> f32 {
        let Some((&(mut last), rest)) = self.estimates.split_first() else { return estimate_dbm };
        if estimate_dbm <= last.0 {
            return estimate_dbm;
        }
        for &next in rest {
            if estimate_dbm <= next.0 {
                return last.1 + (next.1 - last.1) * (estimate_dbm - last.0) / (next.0 - last.0);
            }
            last = next;
        }
        last.1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_departure_is_the_start_snapped_down_plus_the_antenna_delay() {
        // 1300 = 2 · 512 + 276.
        let model =
            StampModel { delayed_step: 512, antenna_delay: RadioDuration::from_ticks(100), ..StampModel::IDEAL };
        assert_eq!(model.departure(RadioInstant::from_ticks(1300)).ticks(), 1124);
        assert_eq!(StampModel::IDEAL.departure(RadioInstant::from_ticks(1300)).ticks(), 1300);
    }

    #[test]
    fn bias_is_interpolated_and_estimates_are_corrected_first() {
        let bias = RangeBias {
            table: &[-0.1, 0.0, 0.3],
            first_dbm: -60.0,
            step_db: 10.0,
            estimates: &[(-75.0, -75.0), (-70.0, -65.0)],
            first_metre_dbm: -50.0,
        };
        // Half way from −70 dBm (0) to −80 (0.3); beyond both ends.
        assert!((bias.metres(-75.0) - 0.15).abs() < 1e-6);
        assert_eq!((bias.at_power(-10.0), bias.metres(-500.0), bias.metres(f32::NAN)), (-0.1, 0.3, 0.0));
        // An estimate of −72.5 dBm is −70 dBm; one beyond the curve is −65, half way from −60 to −70.
        assert!(bias.metres(-72.5).abs() < 1e-6);
        assert!((bias.metres(-20.0) + 0.05).abs() < 1e-6);
        // 20 dB less than at one metre are −70 dBm.
        assert!(bias.expected(10.0).abs() < 1e-5);
    }

    #[test]
    fn a_radio_without_tables_has_no_bias() {
        assert_eq!((RangeBias::NONE.metres(-80.0), RangeBias::NONE.expected(5.0)), (0.0, 0.0));
    }
}
