//! What the receiver measured on a frame.

use core::fmt;

use postcard::experimental::max_size::MaxSize;
use serde::{Deserialize, Serialize};

use crate::telemetry::quantised::{from_hundredths, hundredths, nearest};

/// Units of an index in the accumulator, per sample.
const PER_SAMPLE: f32 = 64.0;

/// What the receiver measured on a frame: `radio::Diagnostics`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Diagnostics {
    /// Received power, 0.01 dBm.
    pub rx_power_cdbm: i16,
    /// Power of the first path, 0.01 dBm.
    pub first_path_power_cdbm: i16,
    /// Index of the first path in the accumulator, 1/64 sample.
    pub first_path_index_64ths: u16,
    /// FP_AMPL1 to 3.
    pub first_path_amplitudes: [u16; 3],
    /// CIR_PWR.
    pub cir_power: u16,
    /// RXPACC.
    pub preamble_count: u16,
    /// STD_NOISE.
    pub noise_deviation: u16,
    /// The rate of the sender's clock relative to the receiver's, 0.01 ppm.
    pub clock_offset_cppm: i16,
}

impl Diagnostics {
    /// Received power, dBm; `None` if the receiver gave none.
    pub fn rx_power_dbm(&self) -> Option<f64> {
        from_hundredths(self.rx_power_cdbm)
    }

    /// Power of the first path, dBm; `None` if the receiver gave none.
    pub fn first_path_power_dbm(&self) -> Option<f64> {
        from_hundredths(self.first_path_power_cdbm)
    }

    /// Index of the first path in the accumulator, samples.
    pub fn first_path_index(&self) -> f64 {
        f64::from(self.first_path_index_64ths) / f64::from(PER_SAMPLE)
    }

    /// The rate of the sender's clock relative to the receiver's, parts per million, positive if it is faster; `None`
    /// if the receiver gave none.
    pub fn clock_offset_ppm(&self) -> Option<f64> {
        from_hundredths(self.clock_offset_cppm)
    }
}

impl From<radio::Diagnostics> for Diagnostics {
    fn from(measured: radio::Diagnostics) -> Self {
        Self {
            rx_power_cdbm: hundredths(measured.rx_power_dbm),
            first_path_power_cdbm: hundredths(measured.first_path_power_dbm),
            first_path_index_64ths: nearest(measured.first_path_index * PER_SAMPLE) as u16,
            first_path_amplitudes: measured.first_path_amplitudes,
            cir_power: measured.cir_power,
            preamble_count: measured.preamble_count,
            noise_deviation: measured.noise_deviation,
            clock_offset_cppm: hundredths(measured.clock_offset_ppm),
        }
    }
}

/// Unknown values become NaN.
impl From<Diagnostics> for radio::Diagnostics {
    fn from(quantised: Diagnostics) -> Self {
        let known = |value: Option<f64>| value.map_or(f32::NAN, |value| value as f32);
        Self {
            rx_power_dbm: known(quantised.rx_power_dbm()),
            first_path_power_dbm: known(quantised.first_path_power_dbm()),
            first_path_index: quantised.first_path_index() as f32,
            first_path_amplitudes: quantised.first_path_amplitudes,
            cir_power: quantised.cir_power,
            preamble_count: quantised.preamble_count,
            noise_deviation: quantised.noise_deviation,
            clock_offset_ppm: known(quantised.clock_offset_ppm()),
        }
    }
}

/// What the receiver measured of a peer, and the position that the peer reports: the end of a line.
pub(super) struct Reception {
    pub(super) diagnostics: Diagnostics,
    pub(super) position_m: Option<[f64; 3]>,
}

impl fmt::Display for Reception {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let powers =
            [("received", self.diagnostics.rx_power_dbm()), ("first path", self.diagnostics.first_path_power_dbm())];
        for (name, dbm) in powers {
            if let Some(dbm) = dbm {
                write!(out, ", {name} {dbm:.1} dBm")?;
            }
        }
        if let Some(ppm) = self.diagnostics.clock_offset_ppm() {
            write!(out, ", clock {ppm:+.2} ppm")?;
        }
        if let Some([x, y, z]) = self.position_m {
            write!(out, ", at {x:.2} {y:.2} {z:.2}")?;
        }
        Ok(())
    }
}

/// The columns of the receiver's measurements, as `solve` reads them, and of the result's deviation. They follow a
/// table's own columns.
#[cfg(feature = "host")]
macro_rules! reception_columns {
    ($($own:literal),+) => {
        &[
            $($own,)+ "rx_power_dbm", "fp_power_dbm", "fp_idx", "fp_amp1", "fp_amp2", "fp_amp3", "cir_pwr", "rxpacc",
            "std_noise", "sigma_m", "clock_offset_ppm",
        ]
    };
}
#[cfg(feature = "host")]
pub(super) use reception_columns;

#[cfg(feature = "host")]
impl Reception {
    /// An object's keys, after `own`.
    pub(super) fn json(&self, own: serde_json::Value, sigma_m: f64) -> serde_json::Value {
        let [peer_x, peer_y, peer_z] = self.position_m.map_or([None; 3], |position| position.map(Some));
        let Diagnostics { first_path_amplitudes: [amp1, amp2, amp3], .. } = self.diagnostics;
        let received = serde_json::json!({
            "sigma_m": sigma_m,
            "peer_x_m": peer_x,
            "peer_y_m": peer_y,
            "peer_z_m": peer_z,
            "rx_power_dbm": self.diagnostics.rx_power_dbm(),
            "fp_power_dbm": self.diagnostics.first_path_power_dbm(),
            "fp_idx": self.diagnostics.first_path_index(),
            "fp_amp1": amp1,
            "fp_amp2": amp2,
            "fp_amp3": amp3,
            "cir_pwr": self.diagnostics.cir_power,
            "rxpacc": self.diagnostics.preamble_count,
            "std_noise": self.diagnostics.noise_deviation,
            "clock_offset_ppm": self.diagnostics.clock_offset_ppm(),
        });
        crate::telemetry::host::joined(own, received)
    }

    /// A row's fields, after its own.
    pub(super) fn fields(
        &self,
        own: impl IntoIterator<Item = std::string::String>,
        sigma_m: f64,
    ) -> std::vec::Vec<std::string::String> {
        use std::string::{String, ToString};
        let hundredths = |value: Option<f64>| value.map_or_else(String::new, |value| std::format!("{value:.2}"));
        let measured = self.diagnostics;
        let mut fields = std::vec::Vec::from_iter(own);
        fields.extend([measured.rx_power_dbm(), measured.first_path_power_dbm()].map(hundredths));
        fields.push(measured.first_path_index().to_string());
        fields.extend(measured.first_path_amplitudes.map(|amplitude| amplitude.to_string()));
        fields.extend([measured.cir_power, measured.preamble_count, measured.noise_deviation].map(|of| of.to_string()));
        fields.extend([crate::telemetry::metres(sigma_m), hundredths(measured.clock_offset_ppm())]);
        fields
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn diagnostics_come_back_as_fine_as_the_wire_has_them() {
        let measured = radio::Diagnostics {
            rx_power_dbm: -79.254,
            first_path_power_dbm: f32::NEG_INFINITY,
            first_path_index: 745.516,
            first_path_amplitudes: [1, 2, 3],
            cir_power: 4,
            preamble_count: 5,
            noise_deviation: 6,
            clock_offset_ppm: -2.349,
        };
        let told = Diagnostics::from(measured);
        // 745.516 · 64 = 47713.02.
        assert_eq!((told.rx_power_cdbm, told.first_path_index_64ths, told.clock_offset_cppm), (-7925, 47_713, -235));
        let back = radio::Diagnostics::from(told);
        assert!(back.first_path_power_dbm.is_nan());
        let known = radio::Diagnostics { first_path_power_dbm: 0.0, ..back };
        let expected = radio::Diagnostics {
            rx_power_dbm: -79.25,
            first_path_power_dbm: 0.0,
            first_path_index: 745.515_6,
            clock_offset_ppm: -2.35,
            ..measured
        };
        assert_eq!(known, expected);
    }
}
