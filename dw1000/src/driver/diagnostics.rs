//! From the chip's diagnostic registers to [`Diagnostics`]: powers according to the DW1000 user manual, 4.7, and the
//! clock offset.

use super::configuration::ppm_per_carrier_step;
use radio::phy::{DataRate, Prf, Sfd};
use radio::{Config, Diagnostics, decibels};

/// The registers of one received frame as read, before any check.
pub(super) struct RawDiagnostics {
    /// RX_FINFO, four bytes: RXPACC in its upper twelve bits.
    pub frame_info: u32,
    /// RX_TIME from its sixth byte: FP_INDEX, FP_AMPL1.
    pub first_path: [u8; 4],
    /// RX_FQUAL: STD_NOISE, FP_AMPL2, FP_AMPL3, CIR_PWR.
    pub quality: [u8; 8],
    /// DRX_CAR_INT (three bytes), two bytes that the host does not use, RXPACC_NOSAT from the fifth byte.
    pub carrier: [u8; 6],
}

impl RawDiagnostics {
    pub fn evaluate(&self, config: &Config) -> Diagnostics {
        let half = |bytes: &[u8], at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
        let preamble_count = (self.frame_info >> 20) as u16;
        let unsaturated = half(&self.carrier, 4);
        let symbols = accumulated_symbols(config, preamble_count, unsaturated);
        let first_path_amplitudes = [half(&self.first_path, 2), half(&self.quality, 2), half(&self.quality, 4)];
        let cir_power = half(&self.quality, 6);

        let offset = power_offset_db(config.phy.prf());
        let first_path: f32 = first_path_amplitudes.iter().map(|&a| f32::from(a) * f32::from(a)).sum();
        Diagnostics {
            rx_power_dbm: power_dbm(f32::from(cir_power) * 131_072.0, symbols, offset),
            first_path_power_dbm: power_dbm(first_path, symbols, offset),
            // Ten bits before the binary point, six after.
            first_path_index: f32::from(half(&self.first_path, 0)) / 64.0,
            first_path_amplitudes,
            cir_power,
            preamble_count,
            noise_deviation: half(&self.quality, 0),
            clock_offset_ppm: carrier_integrator(&self.carrier) as f32 * ppm_per_carrier_step(config),
        }
    }
}

/// 10·log₁₀(energy/N²) − A, equations of 4.7.1 and 4.7.2. NaN if the registers show no energy: a receiver that was
/// switched on at the end of a preamble has accumulated less than their step.
fn power_dbm(energy: f32, symbols: f32, offset_db: f32) -> f32 {
    if energy > 0.0 { decibels(energy / (symbols * symbols)) - offset_db } else { f32::NAN }
}

/// A of 4.7.1, dB.
const fn power_offset_db(prf: Prf) -> f32 {
    match prf {
        Prf::Mhz16 => 113.77,
        Prf::Mhz64 => 121.74,
    }
}

/// N of 4.7.1. If the count has included the delimiter (it equals the unsaturated one), the delimiter's share is
/// subtracted (table 18). N is at least one, whatever the chip counted.
fn accumulated_symbols(config: &Config, counted: u16, unsaturated: u16) -> f32 {
    let delimiter = match (config.phy.sfd(), config.phy.data_rate()) {
        (Sfd::Standard, DataRate::Kbps110) => 64,
        (Sfd::Decawave, DataRate::Kbps110) => 82,
        (Sfd::Standard, DataRate::Kbps850 | DataRate::Kbps6810) => 5,
        (Sfd::Decawave, DataRate::Kbps850) => 18,
        (Sfd::Decawave, DataRate::Kbps6810) => 10,
    };
    let symbols = if counted == unsaturated { counted.saturating_sub(delimiter) } else { counted };
    f32::from(symbols.max(1))
}

/// The 21-bit signed integrator in the low bits of three bytes.
fn carrier_integrator(bytes: &[u8; 6]) -> i32 {
    let raw = i32::from_le_bytes([bytes[0], bytes[1], bytes[2], 0]);
    (raw << 11) >> 11
}

#[cfg(test)]
mod tests {
    use super::*;
    use radio::phy::{Channel, PhyConfig, PreambleLength};

    fn frame(preamble_count: u16, unsaturated: u16, carrier: [u8; 3]) -> RawDiagnostics {
        let n = unsaturated.to_le_bytes();
        RawDiagnostics {
            frame_info: u32::from(preamble_count) << 20 | 29,
            // FP_INDEX 750.5 = 48032/64 = 0xBBA0; FP_AMPL1 12000 = 0x2EE0.
            first_path: [0xA0, 0xBB, 0xE0, 0x2E],
            // STD_NOISE 52, FP_AMPL2 11000 = 0x2AF8, FP_AMPL3 9000 = 0x2328, CIR_PWR 20000 = 0x4E20.
            quality: [52, 0, 0xF8, 0x2A, 0x28, 0x23, 0x20, 0x4E],
            carrier: [carrier[0], carrier[1], carrier[2], 0, n[0], n[1]],
        }
    }

    fn close(value: f32, expected: f32, tolerance: f32) {
        assert!((value - expected).abs() <= tolerance, "{value} against {expected}");
    }

    #[test]
    fn powers_follow_the_manual() {
        let config = Config::new(PhyConfig::FAST);
        // RXPACC 118 ≠ RXPACC_NOSAT 122: N = 118.
        // RX: 20000·2¹⁷/118² = 2.62144e9/13924 = 188267.7; 10·log₁₀ = 52.7478; − 121.74 = −68.992 dBm.
        // First path: (144e6 + 121e6 + 81e6)/13924 = 346e6/13924 = 24849.2; 43.9531 − 121.74 = −77.787 dBm.
        let d = frame(118, 122, [0; 3]).evaluate(&config);
        close(d.rx_power_dbm, -68.992, 0.002);
        close(d.first_path_power_dbm, -77.787, 0.002);
        assert_eq!((d.first_path_index, d.first_path_amplitudes), (750.5, [12_000, 11_000, 9_000]));
        assert_eq!((d.cir_power, d.preamble_count, d.noise_deviation), (20_000, 118, 52));
    }

    #[test]
    fn a_count_that_ran_into_the_delimiter_is_corrected() {
        // N = 118 − 5 = 113: 2.62144e9/12769 = 205297.2; 53.1238 − 121.74 = −68.616 dBm.
        close(frame(118, 118, [0; 3]).evaluate(&Config::new(PhyConfig::FAST)).rx_power_dbm, -68.616, 0.002);
        // Mode 5: 110 kbit/s, Decawave's delimiter, PRF 16: N = 1000 − 82 = 918.
        // 2.62144e9/842724 = 3110.67; 34.9285 − 113.77 = −78.8415 dBm.
        let mode_5 = Config::new(PhyConfig::evk1000_mode(5).unwrap());
        close(frame(1000, 1000, [0; 3]).evaluate(&mode_5).rx_power_dbm, -78.8415, 0.002);
    }

    #[test]
    fn nonsense_counts_give_finite_powers() {
        let d = frame(0, 0, [0; 3]).evaluate(&Config::new(PhyConfig::FAST));
        assert!(d.rx_power_dbm.is_finite() && d.first_path_power_dbm.is_finite());
    }

    #[test]
    fn no_energy_gives_no_power() {
        // One symbol at −79.6 dBm: 10^((121.74 − 79.6)/10)/2¹⁷ = 0.12, which CIR_PWR shows as zero.
        let late = RawDiagnostics { quality: [52, 0, 0xF8, 0x2A, 0x28, 0x23, 0, 0], ..frame(11, 11, [0; 3]) };
        let d = late.evaluate(&Config::new(PhyConfig::FAST));
        assert!(d.rx_power_dbm.is_nan() && d.first_path_power_dbm.is_finite());
        let silent = RawDiagnostics { frame_info: 0, first_path: [0; 4], quality: [0; 8], carrier: [0; 6] };
        let d = silent.evaluate(&Config::new(PhyConfig::FAST));
        assert!(d.rx_power_dbm.is_nan() && d.first_path_power_dbm.is_nan());
    }

    #[test]
    fn carrier_integrator_is_signed_with_21_bits() {
        // 998.4e6/2/1024/2¹⁷ = 3.719330 Hz for each step; 20 ppm of 6489.6 MHz = 129792 Hz = 34896.6 steps = 0x008850
        // (34896).
        let mut config = Config::new(PhyConfig::FAST);
        close(frame(1, 0, [0x50, 0x88, 0x00]).evaluate(&config).clock_offset_ppm, -20.0, 0.001);
        // −34896 in 21 bits: 2097152 − 34896 = 2062256 = 0x1F77B0.
        close(frame(1, 0, [0xB0, 0x77, 0x1F]).evaluate(&config).clock_offset_ppm, 20.0, 0.001);
        // Bits above the 21st are not part of it.
        close(frame(1, 0, [0xB0, 0x77, 0xFF]).evaluate(&config).clock_offset_ppm, 20.0, 0.001);
        // Channel 2, 110 kbit/s: 0.4649162 Hz for each step; 20 ppm of 3993.6 MHz = 79872 Hz = 171799 steps = 0x029F17.
        config.phy = PhyConfig::new(Channel::Ch2, Prf::Mhz64, DataRate::Kbps110, PreambleLength::Symbols1024).unwrap();
        close(frame(1, 0, [0x17, 0x9F, 0x02]).evaluate(&config).clock_offset_ppm, -20.0, 0.001);

        // All channels, by the manual's formula.
        for channel in [Channel::Ch1, Channel::Ch2, Channel::Ch3, Channel::Ch4, Channel::Ch5, Channel::Ch7] {
            config.phy = PhyConfig::new(channel, Prf::Mhz64, DataRate::Kbps6810, PreambleLength::Symbols128).unwrap();
            let step_hz = 998.4e6 / 2.0 / 1024.0 / 131_072.0;
            let steps = (20e-6 * channel.centre_frequency_hz() / step_hz) as u32;
            let [low, middle, high, _] = steps.to_le_bytes();
            close(frame(1, 0, [low, middle, high]).evaluate(&config).clock_offset_ppm, -20.0, 0.002);
        }
    }
}
