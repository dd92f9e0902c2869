//! The receiver's diagnostics of each reception in a file. [`Features`] are computed from them, or are read from
//! columns with the features' names.

use positioning_core::nlos::{Feature, Features, first_path_to_noise_db, power_difference_db};

use crate::{Column, Row, Table, UserError};

/// The columns that a file has.
pub struct DiagnosticColumns {
    /// The range, metres.
    pub range: Column,
    power: Column,
    first_path_power: Column,
    amplitudes: [Column; 3],
    cir_power: Column,
    noise: Column,
    deviation: Column,
    /// Features that have a column of their own, with that column.
    named: Vec<(Feature, Column)>,
}

/// The diagnostics of one row; NaN where a value is not known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Diagnostics {
    /// The features of the reception.
    pub features: Features,
    /// The received power, dBm.
    pub power_dbm: f32,
    /// The expected standard deviation of the range or difference with line of sight, metres, which nodes report.
    pub deviation_m: f32,
}

impl Default for Diagnostics {
    /// Nothing is known.
    fn default() -> Self {
        Self { features: Features::default(), power_dbm: f32::NAN, deviation_m: f32::NAN }
    }
}

impl DiagnosticColumns {
    /// The columns of a `ranges.csv`.
    pub fn of_ranges(table: &Table) -> Self {
        Self::of(table, ["rx_power_dbm", "fp_power_dbm", "std_noise"])
    }

    /// The columns of a `cir.csv`.
    pub fn of_responses(table: &Table) -> Self {
        Self::of(table, ["rsl_dbm", "fsl_dbm", "noise_std_est"])
    }

    fn of(table: &Table, [power, first_path_power, noise]: [&'static str; 3]) -> Self {
        Self {
            range: table.optional("range_m"),
            power: table.optional(power),
            first_path_power: table.optional(first_path_power),
            amplitudes: ["fp_amp1", "fp_amp2", "fp_amp3"].map(|name| table.optional(name)),
            cir_power: table.optional("cir_pwr"),
            noise: table.optional(noise),
            deviation: table.optional("sigma_m"),
            named: Feature::ALL
                .map(|feature| (feature, table.optional(feature.as_str())))
                .into_iter()
                .filter(|(_, column)| column.is_present())
                .collect(),
        }
    }

    /// Reads the diagnostics of a row.
    ///
    /// # Errors
    /// A field is not a number.
    pub fn read(&self, row: &Row<'_>) -> Result<Diagnostics, UserError> {
        let known =
            |column| -> Result<f32, UserError> { Ok(row.number(column)?.map_or(f32::NAN, |number| number as f32)) };
        let mut amplitudes = [f32::NAN; 3];
        for (amplitude, column) in amplitudes.iter_mut().zip(self.amplitudes) {
            *amplitude = known(column)?;
        }
        let (power_dbm, first_path_dbm) = (known(self.power)?, known(self.first_path_power)?);
        let mut features = Features::default();
        let difference = power_difference_db(known(self.cir_power)?, amplitudes);
        features.set(Feature::PowerDifference, difference.unwrap_or(power_dbm - first_path_dbm));
        features.set_known(Feature::FirstPathToNoise, first_path_to_noise_db(amplitudes, known(self.noise)?));
        for (feature, column) in &self.named {
            if let Some(value) = row.number(*column)? {
                features.set(*feature, value as f32);
            }
        }
        let deviation_m = known(self.deviation)?;
        Ok(Diagnostics { features, power_dbm, deviation_m: if deviation_m > 0.0 { deviation_m } else { f32::NAN } })
    }
}
