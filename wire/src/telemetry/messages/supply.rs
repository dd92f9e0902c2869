//! What a radio measures of its supply and its temperature.

use core::fmt;

use postcard::experimental::max_size::MaxSize;
use serde::{Deserialize, Serialize};

use crate::telemetry::quantised::{from_hundredths, hundredths, nearest};
use crate::telemetry::{Body, Tone};

/// Supply voltage and chip temperature, as the radio measures both to correct its antenna delays: about once a minute.
/// Where a regulator feeds the radio, the voltage says little about the battery before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Supply {
    /// Since the node started, microseconds.
    pub t_us: u64,
    /// Millivolts.
    pub supply_mv: u16,
    /// Hundredths of a degree Celsius; [`UNKNOWN_POWER`](crate::telemetry::quantised::UNKNOWN_POWER): unknown.
    pub temperature_centi_celsius: i16,
}

impl Supply {
    /// The message of a voltage, V, and a temperature, °C. NaN becomes 0 V.
    pub fn new(t_us: u64, supply_v: f32, temperature_celsius: f32) -> Self {
        // `as` saturates.
        let supply_mv = nearest(supply_v * 1000.0) as u16;
        Self { t_us, supply_mv, temperature_centi_celsius: hundredths(temperature_celsius) }
    }

    /// Volts.
    pub fn supply_v(&self) -> f64 {
        f64::from(self.supply_mv) / 1000.0
    }

    /// Degrees Celsius, if known.
    pub fn temperature_celsius(&self) -> Option<f64> {
        from_hundredths(self.temperature_centi_celsius)
    }
}

impl fmt::Display for Supply {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "{:.2} V", self.supply_v())?;
        self.temperature_celsius().map_or(Ok(()), |celsius| write!(out, ", radio at {celsius:.1} °C"))
    }
}

impl Body for Supply {
    const KIND: &'static str = "supply";
    const LABEL: &'static str = "volt";

    fn tone(&self) -> Tone {
        Tone::Quiet
    }

    #[cfg(feature = "host")]
    fn json(&self) -> serde_json::Value {
        serde_json::json!({ "supply_v": self.supply_v(), "temperature_c": self.temperature_celsius() })
    }
}

#[cfg(test)]
mod tests {
    use std::string::ToString;

    use super::*;

    #[test]
    fn readings_are_rounded_and_nonsense_is_no_reading() {
        let supply = Supply::new(1, 3.2996, 24.486);
        assert_eq!((supply.supply_mv, supply.temperature_centi_celsius), (3300, 2449));
        assert_eq!(supply.to_string(), "3.30 V, radio at 24.5 °C");
        let none = Supply::new(1, f32::NAN, f32::NAN);
        assert_eq!((none.supply_mv, none.temperature_celsius()), (0, None));
        assert_eq!(none.to_string(), "0.00 V");
        assert_eq!([1e9, -1.0].map(|volts| Supply::new(1, volts, 0.0).supply_mv), [u16::MAX, 0]);
    }
}
