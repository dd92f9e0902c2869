//! The chip's own temperature and supply voltage (DW1000 user manual, 6.4), which change a range by 2.15 mm/°C and 5.35
//! cm/V, and the antenna delays that correct this.

use embedded_hal_async::{delay::DelayNs, digital::Wait};

use super::bus::{ClockedSpi, ResetLine};
use super::register as reg;
use super::startup::Factory;
use super::{Dw1000, Error, configuration};
use crate::bias::Conditions;
use radio::Sensors;

/// The readings relative to the maker's at 23 °C and 3.3 V. If the maker stored none: with the typical offset of
/// Decawave's software.
fn evaluate(voltage: u8, temperature: u8, factory: &Factory) -> Sensors {
    Sensors {
        temperature_celsius: match factory.temperature {
            0 => 1.13 * f32::from(temperature) - 113.0,
            at_23 => (f32::from(temperature) - f32::from(at_23)) * 1.14 + 23.0,
        },
        voltage: match factory.voltage {
            0 => 0.0057 * f32::from(voltage) + 2.3,
            at_3v3 => (f32::from(voltage) - f32::from(at_3v3)) / 173.0 + 3.3,
        },
        raw: [temperature, voltage],
    }
}

impl<S, I, R, D> Dw1000<S, I, R, D>
where
    S: ClockedSpi,
    I: Wait,
    R: ResetLine,
    D: DelayNs,
{
    /// Measures temperature and voltage: 1 ms. A receiver that is on is switched off.
    pub(super) async fn read_sensors(&mut self) -> Result<Sensors, Error<S::Error>> {
        self.ensure_off().await?;
        // Biases, then outputs, one by one (6.4).
        self.bus
            .write_each(&[
                (reg::RF_SENSOR_BIAS, &[0x80]),
                (reg::RF_SENSOR_BIAS.plus(1), &[0x0A]),
                (reg::RF_SENSOR_BIAS.plus(1), &[0x0F]),
                (reg::TC_SARC, &[0x00]),
                (reg::TC_SARC, &[0x01]),
            ])
            .await?;
        self.delay.delay_ms(1).await;
        let [voltage, temperature] = self.bus.read(reg::TC_SARL).await?;
        self.bus.write(reg::TC_SARC, &[0x00]).await?;
        Ok(evaluate(voltage, temperature, &self.factory))
    }

    /// Measures both, and corrects the antenna delays accordingly.
    pub(super) async fn compensate_delays(&mut self) -> Result<Sensors, Error<S::Error>> {
        let sensors = self.read_sensors().await?;
        let drift = Conditions::of(&sensors).delay_ticks();
        if drift != self.delay_drift {
            self.delay_drift = drift;
            let [tx, rx] = self.antenna_delays();
            self.bus.write_each(&[(reg::TX_ANTD, &tx.to_le_bytes()), (reg::LDE_RXANTD, &rx.to_le_bytes())]).await?;
        }
        Ok(sensors)
    }

    /// The antenna delays in force, from the transmitter's timestamp to the antenna and from the antenna to the
    /// receiver's timestamp, ticks.
    pub(super) fn antenna_delays(&self) -> [u16; 2] {
        configuration::antenna_delays(&self.config, &self.factory)
            .map(|delay| delay.saturating_add_signed(self.delay_drift))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn readings_are_taken_against_the_makers() {
        let factory = Factory { voltage: 173, temperature: 116, ..Factory::default() };
        // (126 − 116)·1.14 + 23 = 34.4 °C; (190 − 173)/173 + 3.3 = 3.39827 V.
        let s = evaluate(190, 126, &factory);
        assert!((s.temperature_celsius - 34.4).abs() < 1e-4 && (s.voltage - 3.398_27).abs() < 1e-4, "{s:?}");
        // Unprogrammed: 1.13·120 − 113 = 22.6 °C; 0.0057·175 + 2.3 = 3.2975 V.
        let s = evaluate(175, 120, &Factory::default());
        assert!((s.temperature_celsius - 22.6).abs() < 1e-4 && (s.voltage - 3.2975).abs() < 1e-4, "{s:?}");
    }
}
