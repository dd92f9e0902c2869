//! The chip's supply current: the time that it spent in each state, and the charge.
//!
//! The time between a start command and the first preamble symbol, or until the receiver is on, counts as idle.

use super::Chip;
use crate::air::{Prf, Rate};
use crate::time::TrueTime;

/// The chip's activity, as far as its current depends on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Activity {
    /// No supply.
    Off,
    /// Asleep; only the always-on memory is supplied.
    DeepSleep,
    /// Asleep with the sleep counter's oscillator running.
    Sleep,
    /// Its crystal is starting.
    WakeUp,
    /// On the crystal's clock, or held in reset.
    Init,
    /// On the PLL's clock, transmitter and receiver off.
    Idle,
    /// Sending preamble and delimiter.
    TransmitPreamble(Prf),
    /// Sending PHY header and payload.
    TransmitData(Rate),
    /// Searching for a preamble, or following one until its delimiter.
    ReceivePreamble,
    /// Receiving PHY header and payload.
    ReceiveData(Rate),
}

/// Supply currents at 3.3 V, milliamperes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Currents {
    /// In [`Activity::DeepSleep`].
    pub deep_sleep_ma: f64,
    /// In [`Activity::Sleep`].
    pub sleep_ma: f64,
    /// In [`Activity::WakeUp`].
    pub wake_up_ma: f64,
    /// In [`Activity::Init`].
    pub init_ma: f64,
    /// In [`Activity::Idle`].
    pub idle_ma: f64,
    /// In [`Activity::TransmitPreamble`], PRF 16 MHz.
    pub transmit_preamble_16_ma: f64,
    /// In [`Activity::TransmitPreamble`], PRF 64 MHz.
    pub transmit_preamble_64_ma: f64,
    /// In [`Activity::TransmitData`], 110 and 850 kbit/s.
    pub transmit_data_slow_ma: f64,
    /// In [`Activity::TransmitData`], 6.8 Mbit/s.
    pub transmit_data_fast_ma: f64,
    /// In [`Activity::ReceivePreamble`].
    pub receive_preamble_ma: f64,
    /// In [`Activity::ReceiveData`], 110 and 850 kbit/s.
    pub receive_data_slow_ma: f64,
    /// In [`Activity::ReceiveData`], 6.8 Mbit/s.
    pub receive_data_fast_ma: f64,
}

impl Currents {
    /// Typical figures. They are not equally reliable:
    ///
    /// | state | mA | from |
    /// |---|---:|---|
    /// | deep sleep, sleep | 0.00005, 0.001 | data sheet, first page |
    /// | idle | 18 | data sheet 2.17, page 30, as the energy accounting of `contiki-uwb` quotes it |
    /// | channel 2, PRF 64, 128 symbols, 6.8 Mbit/s: sending preamble, data | 83, 52 | same |
    /// | …receiving: preamble (searching, following), data | 113, 118 | same |
    /// | on the crystal | 4 | the data sheet's table of supply currents, from memory |
    /// | crystal starting | 3 | assumed: less than on the crystal |
    /// | sending a preamble at PRF 16; data at 110 and 850 kbit/s | 68, 35 | same page of the data sheet, from memory |
    /// | receiving data at 110 and 850 kbit/s | 59 | same |
    ///
    /// Other channels and TX_POWER settings change the figures by some 10 % (the data sheet's extremes are 35 and 85 mA
    /// for sending, 57 and 126 mA for receiving); that is not modelled. With measured currents of a board, set
    /// [`ChipConfig::currents`](super::ChipConfig::currents).
    pub const TYPICAL: Self = Self {
        deep_sleep_ma: 50e-6,
        sleep_ma: 1e-3,
        wake_up_ma: 3.0,
        init_ma: 4.0,
        idle_ma: 18.0,
        transmit_preamble_16_ma: 68.0,
        transmit_preamble_64_ma: 83.0,
        transmit_data_slow_ma: 35.0,
        transmit_data_fast_ma: 52.0,
        receive_preamble_ma: 113.0,
        receive_data_slow_ma: 59.0,
        receive_data_fast_ma: 118.0,
    };

    /// The current of an activity, milliamperes.
    pub const fn of(&self, activity: Activity) -> f64 {
        match activity {
            Activity::Off => 0.0,
            Activity::DeepSleep => self.deep_sleep_ma,
            Activity::Sleep => self.sleep_ma,
            Activity::WakeUp => self.wake_up_ma,
            Activity::Init => self.init_ma,
            Activity::Idle => self.idle_ma,
            Activity::TransmitPreamble(Prf::Mhz16) => self.transmit_preamble_16_ma,
            Activity::TransmitPreamble(Prf::Mhz64) => self.transmit_preamble_64_ma,
            Activity::TransmitData(Rate::Kbps110 | Rate::Kbps850) => self.transmit_data_slow_ma,
            Activity::TransmitData(Rate::Kbps6800) => self.transmit_data_fast_ma,
            Activity::ReceivePreamble => self.receive_preamble_ma,
            Activity::ReceiveData(Rate::Kbps110 | Rate::Kbps850) => self.receive_data_slow_ma,
            Activity::ReceiveData(Rate::Kbps6800) => self.receive_data_fast_ma,
        }
    }
}

/// The charge that a chip has drawn since it was added to its world, and the seconds it spent in each state.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Consumption {
    /// Charge, microcoulombs: milliamperes times milliseconds.
    pub charge_uc: f64,
    /// The part of it for sending.
    pub transmit_uc: f64,
    /// The part of it for receiving and for searching for a preamble.
    pub receive_uc: f64,
    /// Without supply.
    pub off_s: f64,
    /// In deep sleep.
    pub deep_sleep_s: f64,
    /// Asleep with its sleep counter running.
    pub sleep_s: f64,
    /// While its crystal starts.
    pub wake_up_s: f64,
    /// On the crystal's clock, or in reset.
    pub init_s: f64,
    /// Idle on the PLL's clock.
    pub idle_s: f64,
    /// Sending preamble and delimiter.
    pub transmit_preamble_s: f64,
    /// Sending PHY header and payload.
    pub transmit_data_s: f64,
    /// Searching for a preamble or following one.
    pub receive_preamble_s: f64,
    /// Receiving PHY header and payload.
    pub receive_data_s: f64,
}

impl Consumption {
    fn add(&mut self, activity: Activity, currents: &Currents, seconds: f64) {
        let charge_uc = currents.of(activity) * seconds * 1e3;
        self.charge_uc += charge_uc;
        match activity {
            Activity::TransmitPreamble(_) | Activity::TransmitData(_) => self.transmit_uc += charge_uc,
            Activity::ReceivePreamble | Activity::ReceiveData(_) => self.receive_uc += charge_uc,
            Activity::Off
            | Activity::DeepSleep
            | Activity::Sleep
            | Activity::WakeUp
            | Activity::Init
            | Activity::Idle => {}
        }
        *match activity {
            Activity::Off => &mut self.off_s,
            Activity::DeepSleep => &mut self.deep_sleep_s,
            Activity::Sleep => &mut self.sleep_s,
            Activity::WakeUp => &mut self.wake_up_s,
            Activity::Init => &mut self.init_s,
            Activity::Idle => &mut self.idle_s,
            Activity::TransmitPreamble(_) => &mut self.transmit_preamble_s,
            Activity::TransmitData(_) => &mut self.transmit_data_s,
            Activity::ReceivePreamble => &mut self.receive_preamble_s,
            Activity::ReceiveData(_) => &mut self.receive_data_s,
        } += seconds;
    }
}

/// The charge drawn until the present activity began.
#[derive(Clone, Debug)]
pub(super) struct Ledger {
    past: Consumption,
    activity: Activity,
    since: TrueTime,
}

impl Ledger {
    /// The ledger of a chip without supply.
    pub(super) fn new(now: TrueTime) -> Self {
        Self { past: Consumption::default(), activity: Activity::Off, since: now }
    }

    fn at(&self, now: TrueTime, currents: &Currents) -> Consumption {
        let mut sum = self.past;
        sum.add(self.activity, currents, now.ps_since(self.since) as f64 * 1e-12);
        sum
    }
}

impl Chip {
    /// The charge drawn until `now`, which must be the present.
    pub fn consumption(&self, now: TrueTime) -> Consumption {
        self.ledger.at(now, &self.config.currents)
    }

    /// Closes the account of the last activity if the activity has changed.
    pub(super) fn account(&mut self, now: TrueTime) {
        let activity = self.activity();
        if activity != self.ledger.activity {
            self.ledger = Ledger { past: self.ledger.at(now, &self.config.currents), activity, since: now };
        }
    }
}
