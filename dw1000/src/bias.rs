//! The bias that the DW1000 adds to a distance: by received power, temperature and supply.
//!
//! The first path of a strong signal is found too early, that of a weak one too late. The tables are those of
//! Decawave's application note APS011 (Sources of error in DW1000 based two-way ranging schemes, table 2), in steps of
//! 2 dB. Values in between are interpolated linearly; beyond their ends the end value holds. The tables are indexed by
//! the power actually received. The chip's own estimate of a high power is too low (DW1000 user manual, figure 22).
//! [`RangeBias`] has the formulae.

use radio::phy::{Channel, Prf};
use radio::time::METRES_PER_TICK;
use radio::{PhyConfig, RangeBias, Sensors};

/// Power of the tables' first entry, dBm.
const FIRST_DBM: f32 = -61.0;
/// Step from one entry to the next, dB downwards.
const STEP_DB: f32 = 2.0;

/// 500 MHz channels, PRF 16 MHz: metres, from −61 to −95 dBm.
const NARROW_16: [f32; 18] = [
    -0.198, -0.187, -0.179, -0.163, -0.143, -0.127, -0.109, -0.084, -0.059, -0.031, 0.0, 0.036, 0.065, 0.084, 0.097,
    0.106, 0.110, 0.112,
];
/// 500 MHz channels, PRF 64 MHz.
const NARROW_64: [f32; 18] = [
    -0.110, -0.105, -0.100, -0.093, -0.082, -0.069, -0.051, -0.027, 0.0, 0.021, 0.035, 0.042, 0.049, 0.062, 0.071,
    0.076, 0.081, 0.086,
];
/// 900 MHz channels, PRF 16 MHz.
const WIDE_16: [f32; 18] = [
    -0.275, -0.244, -0.210, -0.176, -0.138, -0.095, -0.051, 0.0, 0.042, 0.097, 0.158, 0.210, 0.254, 0.294, 0.321,
    0.339, 0.356, 0.394,
];
/// 900 MHz channels, PRF 64 MHz.
const WIDE_64: [f32; 18] = [
    -0.295, -0.266, -0.235, -0.199, -0.150, -0.100, -0.058, 0.0, 0.049, 0.091, 0.127, 0.153, 0.175, 0.197, 0.233,
    0.245, 0.264, 0.284,
];

/// Points of the curve of estimated power against received power, dBm, as read off figure 22: estimate, power. Below
/// the first point the estimate is correct.
type Estimates = [(f32, f32); 6];
/// PRF 16 MHz.
const ESTIMATES_16: Estimates =
    [(-90.0, -90.0), (-87.5, -85.0), (-85.0, -77.0), (-82.5, -69.5), (-80.0, -64.0), (-77.5, -58.5)];
/// PRF 64 MHz.
const ESTIMATES_64: Estimates =
    [(-90.0, -90.0), (-87.5, -86.5), (-85.0, -83.5), (-82.5, -80.0), (-80.0, -72.5), (-77.5, -60.0)];

/// The bias of a configuration.
pub const fn of(phy: &PhyConfig) -> RangeBias {
    let (table, estimates): (&[f32], &[(f32, f32)]) = match (phy.channel().is_wide(), phy.prf()) {
        (false, Prf::Mhz16) => (&NARROW_16, &ESTIMATES_16),
        (false, Prf::Mhz64) => (&NARROW_64, &ESTIMATES_64),
        (true, Prf::Mhz16) => (&WIDE_16, &ESTIMATES_16),
        (true, Prf::Mhz64) => (&WIDE_64, &ESTIMATES_64),
    };
    // −41.3 dBm/MHz transmitted, isotropic antennas, Friis (APS011, 3.2).
    let first_metre_dbm = match phy.channel() {
        Channel::Ch1 => -57.6,
        Channel::Ch2 => -58.8,
        Channel::Ch3 => -59.8,
        Channel::Ch4 => -56.2,
        Channel::Ch5 => -63.0,
        Channel::Ch7 => -60.4,
    };
    RangeBias { table, first_dbm: FIRST_DBM, step_db: STEP_DB, estimates, first_metre_dbm }
}

/// The amount by which a distance is measured too long when both chips are warmer than at calibration, metres per
/// degree Celsius (APS011, 4).
pub const METRES_PER_DEGREE: f32 = 2.15e-3;
/// The amount by which a distance is measured too long when both supplies are higher than at calibration, metres per
/// volt (APS011, 4).
pub const METRES_PER_VOLT: f32 = 53.5e-3;

/// The difference of chip temperature and supply from their values at the calibration of the antenna delay.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Conditions {
    /// Temperature above that of the calibration, °C.
    pub warmer_by_c: f32,
    /// Supply above that of the calibration, V.
    pub higher_by_v: f32,
}

impl Conditions {
    /// The conditions of a radio that was calibrated at 23 °C and 3.3 V, as the DW1000's maker does. Readings outside
    /// the limits of a working chip are clamped to them: −40 to 85 °C, 2.8 to 3.6 V (data sheet).
    pub fn of(sensors: &Sensors) -> Self {
        let (temperature, voltage) = (sensors.temperature_celsius.clamp(-40.0, 85.0), sensors.voltage.clamp(2.8, 3.6));
        Self { warmer_by_c: temperature - 23.0, higher_by_v: voltage - 3.3 }
    }

    /// The amount by which a distance is measured too long if one end has these conditions and the other those of
    /// calibration: half of what both ends would add.
    pub fn metres(&self) -> f32 {
        0.5 * (self.warmer_by_c * METRES_PER_DEGREE + self.higher_by_v * METRES_PER_VOLT)
    }

    /// The amount by which each of the chip's two antenna delays is longer, ticks: a distance contains half of the sum
    /// of both.
    pub fn delay_ticks(&self) -> i16 {
        let ticks = self.metres() / METRES_PER_TICK as f32;
        // To the nearest; a saturating cast.
        (ticks + if ticks < 0.0 { -0.5 } else { 0.5 }) as i16
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use radio::phy::{Channel, DataRate, PreambleLength};

    fn bias(channel: Channel, prf: Prf, dbm: f32) -> f32 {
        let phy = PhyConfig::new(channel, prf, DataRate::Kbps6810, PreambleLength::Symbols128).unwrap();
        of(&phy).at_power(dbm)
    }

    #[test]
    fn a_clear_way_has_the_bias_of_the_power_that_comes_through_it() {
        // Channel 5: −41.3 + 10·log 500 = −14.3 dBm transmitted, 20·log(4π·6489.6 MHz/c) = 48.7 dB over a metre: −63.0
        // dBm; 14 dB less at 5.0119 m, −77 dBm, where the table has 0; 6 dB less than that at 10 m, −83 dBm, where it
        // has 42 mm.
        let phy = PhyConfig::new(Channel::Ch5, Prf::Mhz64, DataRate::Kbps6810, PreambleLength::Symbols128).unwrap();
        let bias = of(&phy);
        assert!(bias.expected(5.0119).abs() < 1e-4, "{}", bias.expected(5.0119));
        assert!((bias.expected(10.0) - 0.042).abs() < 1e-4, "{}", bias.expected(10.0));
        assert!(bias.expected(0.0).is_finite());
    }

    #[test]
    fn entries_are_those_of_the_application_note() {
        // APS011, table 2: ends and zeros.
        let cases = [
            (Channel::Ch5, Prf::Mhz64, -93.0, 0.081),
            (Channel::Ch5, Prf::Mhz64, -77.0, 0.0),
            (Channel::Ch5, Prf::Mhz64, -61.0, -0.110),
            (Channel::Ch2, Prf::Mhz16, -93.0, 0.110),
            (Channel::Ch2, Prf::Mhz16, -81.0, 0.0),
            (Channel::Ch2, Prf::Mhz16, -61.0, -0.198),
            (Channel::Ch7, Prf::Mhz64, -95.0, 0.284),
            (Channel::Ch7, Prf::Mhz64, -61.0, -0.295),
            (Channel::Ch4, Prf::Mhz16, -95.0, 0.394),
            (Channel::Ch4, Prf::Mhz16, -61.0, -0.275),
        ];
        for (channel, prf, dbm, metres) in cases {
            assert!((bias(channel, prf, dbm) - metres).abs() < 1e-6, "{channel:?} {prf:?} {dbm} dBm");
        }
    }

    #[test]
    fn between_entries_it_is_linear_and_beyond_them_constant() {
        // Half way from −77 (0) to −79 dBm (+2.1 cm); a quarter from −61 (−11.0) to −63 dBm (−10.5).
        assert!((bias(Channel::Ch5, Prf::Mhz64, -78.0) - 0.0105).abs() < 1e-6);
        assert!((bias(Channel::Ch5, Prf::Mhz64, -61.5) + 0.10875).abs() < 1e-6);
        assert_eq!(bias(Channel::Ch5, Prf::Mhz64, -40.0), -0.110);
        assert_eq!(bias(Channel::Ch5, Prf::Mhz64, f32::NEG_INFINITY), 0.086);
        assert_eq!(bias(Channel::Ch5, Prf::Mhz64, f32::INFINITY), -0.110);
    }

    #[test]
    fn estimates_of_high_powers_are_raised() {
        let metres = |prf, dbm| {
            let phy = PhyConfig::new(Channel::Ch5, prf, DataRate::Kbps6810, PreambleLength::Symbols128).unwrap();
            of(&phy).metres(dbm)
        };
        // −93 dBm is −93; −81.25 is half way from −82.5 (−80) to −80 (−72.5), so −76.25: 3/8 of the way from −77 (0) to
        // −75 (−2.7 cm). PRF 16: −85 is −77, where the table has −5.9 cm. −70 is beyond the curve's end, so above −61.
        assert!((metres(Prf::Mhz64, -93.0) - 0.081).abs() < 1e-6);
        assert!((metres(Prf::Mhz64, -81.25) + 0.010_125).abs() < 1e-6);
        assert!((metres(Prf::Mhz16, -85.0) + 0.059).abs() < 1e-6);
        assert!((metres(Prf::Mhz64, -70.0) + 0.110).abs() < 1e-6);
        assert_eq!((metres(Prf::Mhz64, f32::INFINITY), metres(Prf::Mhz64, f32::NAN)), (-0.110, 0.0));
    }

    #[test]
    fn warm_and_well_fed_chips_read_long() {
        // ½·(20 °C × 2.15 mm + 0.1 V × 53.5 mm) = ½·(43 + 5.35) mm.
        let conditions = Conditions::of(&Sensors { temperature_celsius: 43.0, voltage: 3.4, raw: [0; 2] });
        assert!((conditions.metres() - 24.175e-3).abs() < 1e-6, "{conditions:?}");
        // 24.175 mm of 4.6904 mm a tick: 5.15.
        assert_eq!(conditions.delay_ticks(), 5);
        // ½·(63 °C × 2.15 mm + 0.5 V × 53.5 mm) = 81.1 mm: 17.29 ticks.
        let cold = Conditions::of(&Sensors { temperature_celsius: -300.0, voltage: 0.0, raw: [0; 2] });
        assert_eq!(cold.delay_ticks(), -17);
    }
}
