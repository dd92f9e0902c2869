//! The LIS2DH12 itself: registers, sampling, filter and interrupt generator (data sheet DocID025056, application note
//! AN5005).
//!
//! Its input is one acceleration per sample; its output is the level of INT1. Modelled are power-down and the three
//! modes, the data rates, the full scales, the high-pass filter with its modes and cut-off frequencies, the first
//! interrupt generator (OR and AND of high and low events, threshold, duration, latch), data-ready on INT1 and its
//! polarity, and the status and output registers. Not modelled are the second generator, 6D, click, activity, FIFO,
//! self-test and temperature: their registers keep what is written.
//!
//! The documents do not specify two things. This model assumes that the filter is of first order, with the pole that
//! its cut-off frequency gives, and that an event occurs when the filter's output exceeds the threshold before it is
//! rounded.

use std::time::Duration;

use super::registers::address::*;
use super::registers::{at_power_on, is_read_only};

/// CTRL_REG1.
const LOW_POWER: u8 = 1 << 3;
/// CTRL_REG2.
const FILTERED_DATA: u8 = 1 << 3;
const FILTERED_INT1: u8 = 1 << 0;
/// CTRL_REG3.
const INT1_OF_GENERATOR: u8 = 1 << 6;
const INT1_OF_DATA: u8 = 1 << 4;
/// CTRL_REG4.
const HIGH_RESOLUTION: u8 = 1 << 3;
/// CTRL_REG5.
const LATCH_INT1: u8 = 1 << 3;
/// CTRL_REG6.
const ACTIVE_LOW: u8 = 1 << 1;
/// INT1_CFG.
const ALL_EVENTS: u8 = 1 << 7;
/// INT1_SRC.
const ACTIVE: u8 = 1 << 6;
/// STATUS_REG: new data, for all axes and for each one; the same for data that were overwritten.
const NEW: u8 = 0x0F;
const OVERWRITTEN: u8 = 0xF0;
/// The sub-address is incremented with each byte.
const INCREMENT: u8 = 0x80;

/// Cut-off frequencies of the high-pass filter, Hz, by HPCF and the data rates from 1 to 400 Hz (AN5005, table of
/// cut-off frequencies).
const CUT_OFF_HZ: [[f64; 7]; 4] = [
    [0.02, 0.2, 0.5, 1.0, 2.0, 4.0, 8.0],
    [0.008, 0.08, 0.2, 0.5, 1.0, 2.0, 4.0],
    [0.004, 0.04, 0.1, 0.2, 0.5, 1.0, 2.0],
    [0.002, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0],
];
/// Data rates, Hz, by ODR. Higher ODR values have a rate that depends on the mode.
const RATES_HZ: [f64; 8] = [0.0, 1.0, 10.0, 25.0, 50.0, 100.0, 200.0, 400.0];
/// Supply current, microamperes, by ODR, in low-power mode and in the others (data sheet, table of current
/// consumption).
const LOW_POWER_UA: [f64; 8] = [0.5, 2.0, 3.0, 4.0, 6.0, 10.0, 18.0, 36.0];
const OTHER_UA: [f64; 8] = [0.5, 2.0, 4.0, 6.0, 11.0, 20.0, 38.0, 73.0];

/// The sensor's measuring mode.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mode {
    LowPower,
    Normal,
    HighResolution,
}

/// A sensor whose supply is on.
#[derive(Clone, Debug)]
pub struct Device {
    registers: [u8; 0x40],
    /// The sub-address of the next byte.
    address: u8,
    /// The last sample, as measured, mg.
    measured_mg: [f64; 3],
    /// The constant part in the filter's state, mg.
    constant_mg: [f64; 3],
    /// The number of consecutive samples that met the generator's condition.
    lasting: u8,
}

impl Default for Device {
    fn default() -> Self {
        Self::new()
    }
}

impl Device {
    /// A sensor after power-on: powered down.
    pub fn new() -> Self {
        let (measured_mg, constant_mg) = ([0.0; 3], [0.0; 3]);
        Self { registers: at_power_on(), address: 0, measured_mg, constant_mg, lasting: 0 }
    }

    /// The same with the identity of another device.
    pub fn foreign() -> Self {
        let mut device = Self::new();
        device.registers[usize::from(WHO_AM_I)] = 0x44;
        device
    }

    fn register(&self, register: u8) -> u8 {
        self.registers[usize::from(register)]
    }

    /// Bytes of one write on the bus: the sub-address, and data. Returns whether the data rate was written, which
    /// restarts the sampling.
    pub fn write(&mut self, bytes: &[u8]) -> bool {
        let [address, data @ ..] = bytes else { return false };
        self.address = *address;
        let mut restarts = false;
        for byte in data {
            let register = self.next_register();
            if register < 0x40 && !is_read_only(register) {
                let before = self.register(register);
                self.registers[usize::from(register)] = *byte;
                restarts |= register == CTRL_REG1 && (before ^ byte) & 0xF0 != 0;
                if register == INT1_CFG {
                    self.lasting = 0;
                }
            }
        }
        restarts
    }

    /// Bytes of one read on the bus.
    pub fn read(&mut self, into: &mut [u8]) {
        for byte in into {
            let register = self.next_register();
            *byte = if register < 0x40 { self.register(register) } else { 0 };
            match register {
                REFERENCE if self.filter_mode() == 0 => self.constant_mg = self.measured_mg,
                INT1_SRC => self.registers[usize::from(INT1_SRC)] = 0,
                // The last byte of the last axis was read: the sample is no longer new.
                OUT_Z_H => self.registers[usize::from(STATUS_REG)] = 0,
                _ => {}
            }
        }
    }

    fn next_register(&mut self) -> u8 {
        let register = self.address & !INCREMENT;
        if self.address & INCREMENT != 0 {
            self.address = INCREMENT | (register + 1) & !INCREMENT;
        }
        register
    }

    fn mode(&self) -> Mode {
        if self.register(CTRL_REG1) & LOW_POWER != 0 {
            Mode::LowPower
        } else if self.register(CTRL_REG4) & HIGH_RESOLUTION != 0 {
            Mode::HighResolution
        } else {
            Mode::Normal
        }
    }

    fn rate(&self) -> usize {
        usize::from(self.register(CTRL_REG1) >> 4)
    }

    fn filter_mode(&self) -> u8 {
        self.register(CTRL_REG2) >> 6
    }

    /// From one sample to the next; `None`: powered down.
    pub fn period(&self) -> Option<Duration> {
        let hz = match (self.rate(), self.mode()) {
            (0, _) => return None,
            (8, Mode::LowPower) => 1_620.0,
            (9, Mode::LowPower) => 5_376.0,
            (9, _) => 1_344.0,
            (rate, _) => *RATES_HZ.get(rate)?,
        };
        Some(Duration::from_secs_f64(1.0 / hz))
    }

    /// Supply current, microamperes.
    pub fn current_ua(&self) -> f64 {
        let table = if self.mode() == Mode::LowPower { &LOW_POWER_UA } else { &OTHER_UA };
        let fastest_ua = if self.rate() == 8 { 100.0 } else { 185.0 };
        table.get(self.rate()).copied().unwrap_or(fastest_ua)
    }

    /// mg per digit in the mode's resolution, and the number of digits to each side (data sheet, sensitivity).
    fn digit(&self) -> (f64, f64) {
        let scale = usize::from(self.register(CTRL_REG4) >> 4 & 3);
        let high_resolution_mg = [1.0, 2.0, 4.0, 12.0][scale];
        match self.mode() {
            Mode::LowPower => (16.0 * high_resolution_mg, 128.0),
            Mode::Normal => (4.0 * high_resolution_mg, 512.0),
            Mode::HighResolution => (high_resolution_mg, 2_048.0),
        }
    }

    /// mg per step of the threshold.
    fn threshold_step_mg(&self) -> f64 {
        [16.0, 32.0, 62.0, 186.0][usize::from(self.register(CTRL_REG4) >> 4 & 3)]
    }

    /// Takes the acceleration at the sample's instant, mg along the sensor's axes, noise included.
    pub fn sample(&mut self, acceleration_mg: [f64; 3]) {
        let (digit_mg, most) = self.digit();
        let digits = acceleration_mg.map(|mg| (mg / digit_mg).round().clamp(-most, most - 1.0));
        self.measured_mg = digits.map(|digits| digits * digit_mg);
        let filtered_mg = self.filter();
        let of_filter = |bit: u8| if self.register(CTRL_REG2) & bit != 0 { filtered_mg } else { self.measured_mg };
        let (shown_mg, judged_mg) = (of_filter(FILTERED_DATA), of_filter(FILTERED_INT1));
        for (axis, mg) in shown_mg.into_iter().enumerate() {
            // Left-justified.
            let value = ((mg / digit_mg).round().clamp(-most, most - 1.0) * (32_768.0 / most)) as i16;
            let at = usize::from(OUT_X_L) + 2 * axis;
            self.registers[at..at + 2].copy_from_slice(&value.to_le_bytes());
        }
        let status = &mut self.registers[usize::from(STATUS_REG)];
        *status = NEW | if *status & NEW != 0 { OVERWRITTEN } else { *status & OVERWRITTEN };
        self.evaluate(judged_mg);
    }

    /// The acceleration without its constant part.
    fn filter(&mut self) -> [f64; 3] {
        if self.filter_mode() == 1 {
            let reference = f64::from(self.register(REFERENCE) as i8) * self.threshold_step_mg();
            return self.measured_mg.map(|mg| mg - reference);
        }
        let cut_off = usize::from(self.register(CTRL_REG2) >> 4 & 3);
        let rate = self.rate().clamp(1, 7);
        let pole = (-std::f64::consts::TAU * CUT_OFF_HZ[cut_off][rate - 1] / RATES_HZ[rate]).exp();
        // y[n] = pole · (y[n−1] + x[n] − x[n−1]), written with the constant part c = x − y.
        for axis in 0..3 {
            let output = pole * (self.measured_mg[axis] - self.constant_mg[axis]);
            self.constant_mg[axis] = self.measured_mg[axis] - output;
        }
        std::array::from_fn(|axis| self.measured_mg[axis] - self.constant_mg[axis])
    }

    /// The interrupt generator.
    fn evaluate(&mut self, acceleration_mg: [f64; 3]) {
        let threshold_mg = f64::from(self.register(INT1_THS) & 0x7F) * self.threshold_step_mg();
        let axes = self.register(CTRL_REG1);
        let mut events = 0;
        for (axis, mg) in acceleration_mg.into_iter().enumerate() {
            if axes >> axis & 1 == 1 {
                let is_high = mg.abs() > threshold_mg;
                events |= if is_high { 0b10 } else { 0b01 } << (2 * axis);
            }
        }
        let enabled = self.register(INT1_CFG) & 0x3F;
        let found = events & enabled;
        let is_met =
            if self.register(INT1_CFG) & ALL_EVENTS != 0 { enabled != 0 && found == enabled } else { found != 0 };
        let duration = self.register(INT1_DURATION) & 0x7F;
        self.lasting = if is_met { self.lasting.saturating_add(1) } else { 0 };
        let is_active = self.lasting > duration;
        let latched = self.register(CTRL_REG5) & LATCH_INT1 != 0 && self.register(INT1_SRC) & ACTIVE != 0;
        if is_active {
            self.registers[usize::from(INT1_SRC)] = ACTIVE | found;
            if self.filter_mode() == 3 {
                self.constant_mg = self.measured_mg;
            }
        } else if !latched {
            self.registers[usize::from(INT1_SRC)] = events & 0x3F & self.register(INT1_CFG);
        }
    }

    /// The level of the pin INT1.
    pub fn int1(&self) -> bool {
        let routed = self.register(CTRL_REG3);
        let of_generator = routed & INT1_OF_GENERATOR != 0 && self.register(INT1_SRC) & ACTIVE != 0;
        let of_data = routed & INT1_OF_DATA != 0 && self.register(STATUS_REG) & NEW != 0;
        (of_generator || of_data) != (self.register(CTRL_REG6) & ACTIVE_LOW != 0)
    }
}
