//! The error of a reception's time stamp that depends on its power (Decawave APS011, tables 1 and 2).
//!
//! The leading edge of a strong pulse crosses the detector's threshold earlier, so a range is too short at high power
//! and too long at low power. `true range = reported − bias`. Each of the two receptions of an exchange is shifted by
//! the whole bias; their mean shifts the range by it.

use super::phy::{Phy, Prf};

/// Step of the tables, dB.
const STEP_DB: f64 = 2.0;
/// 500 MHz, PRF 16, cm, from −93 dBm.
const NARROW_16: [f64; 17] =
    [11.0, 10.6, 9.7, 8.4, 6.5, 3.6, 0.0, -3.1, -5.9, -8.4, -10.9, -12.7, -14.3, -16.3, -17.9, -18.7, -19.8];
/// 500 MHz, PRF 64, cm, from −93 dBm.
const NARROW_64: [f64; 17] =
    [8.1, 7.6, 7.1, 6.2, 4.9, 4.2, 3.5, 2.1, 0.0, -2.7, -5.1, -6.9, -8.2, -9.3, -10.0, -10.5, -11.0];
/// 900 MHz, PRF 16, cm, from −95 dBm.
const WIDE_16: [f64; 18] =
    [39.4, 35.6, 33.9, 32.1, 29.4, 25.4, 21.0, 15.8, 9.7, 4.2, 0.0, -5.1, -9.5, -13.8, -17.6, -21.0, -24.4, -27.5];
/// 900 MHz, PRF 64, cm, from −95 dBm.
const WIDE_64: [f64; 18] =
    [28.4, 26.4, 24.5, 23.3, 19.7, 17.5, 15.3, 12.7, 9.1, 4.9, 0.0, -5.8, -10.0, -15.0, -19.9, -23.5, -26.6, -29.5];

/// The bias at `power_dbm` at the receiver's input, metres. It is constant beyond the ends of the table.
pub fn range_bias_m(channel: u8, prf: Prf, power_dbm: f64) -> f64 {
    let (table, first): (&[f64], f64) = match (Phy::is_wide(channel), prf) {
        (false, Prf::Mhz16) => (&NARROW_16, -93.0),
        (false, Prf::Mhz64) => (&NARROW_64, -93.0),
        (true, Prf::Mhz16) => (&WIDE_16, -95.0),
        (true, Prf::Mhz64) => (&WIDE_64, -95.0),
    };
    let place = ((power_dbm - first) / STEP_DB).clamp(0.0, (table.len() - 1) as f64);
    let below = (place as usize).min(table.len() - 2);
    let part = place - below as f64;
    (table[below] * (1.0 - part) + table[below + 1] * part) / 100.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_and_zeros_of_the_published_tables() {
        let at = |channel, prf, power| range_bias_m(channel, prf, power);
        for (channel, prf, power, published_cm) in [
            (5, Prf::Mhz64, -93.0, 8.1),
            (5, Prf::Mhz64, -77.0, 0.0),
            (5, Prf::Mhz64, -61.0, -11.0),
            (2, Prf::Mhz16, -81.0, 0.0),
            (2, Prf::Mhz16, -40.0, -19.8),
            (7, Prf::Mhz64, -110.0, 28.4),
            (7, Prf::Mhz64, -61.0, -29.5),
            (4, Prf::Mhz16, -95.0, 39.4),
        ] {
            assert!((at(channel, prf, power) * 100.0 - published_cm).abs() < 1e-9, "{channel} {prf:?} {power}");
        }
        // Half-way from 0.0 to −2.7 cm.
        assert!((at(5, Prf::Mhz64, -76.0) + 0.0135).abs() < 1e-12);
    }

    #[test]
    fn the_published_crate_interpolates_alike() {
        use dw1000::configs::{PulseRepetitionFrequency as Theirs, RxConfig, UwbChannel};
        use dw1000::range_bias::get_range_bias_cm;
        for (channel, number) in [(UwbChannel::Channel5, 5), (UwbChannel::Channel7, 7)] {
            for (theirs, ours) in [(Theirs::Mhz16, Prf::Mhz16), (Theirs::Mhz64, Prf::Mhz64)] {
                let config = RxConfig { channel, pulse_repetition_frequency: theirs, ..RxConfig::default() };
                for tenth_db in -1100..-400 {
                    let power = tenth_db as f32 / 10.0;
                    let expected = f64::from(get_range_bias_cm(power, &config)) / 100.0;
                    let got = range_bias_m(number, ours, f64::from(power));
                    assert!((got - expected).abs() < 1e-5, "{channel:?} {ours:?} {power}: {got} {expected}");
                }
            }
        }
    }
}
