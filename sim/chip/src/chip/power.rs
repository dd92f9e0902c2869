//! Supply, reset, clocks, sleep, one-time memory, temperature.

use super::bits::status;
use super::registers::{Memory, file};
use super::transmit::Enable;
use super::{Activity, CRYSTAL_START_US, Chip, LDE_LOAD_US, Line, PLL_LOCK_US, Trx, What};
use crate::time::{PS_PER_US, TrueTime};
use crate::world::World;

/// The maximum SPI clock on the crystal's clock, and the maximum at all, Hz.
const SLOW_SPI_HZ: u32 = 3_000_000;
const FAST_SPI_HZ: u32 = 20_000_000;
/// Chip select low for this long wakes a sleeping chip.
const WAKE_SELECT_US: u64 = 500;
/// Sleep counter: one count of SLEEP_TIM is 4096 periods of the low-power oscillator, which has about 9.5 kHz.
const SLEEP_COUNT_US: u64 = 431_000;
/// The codes of the converters at 3.3 V and 23 °C, as the one-time memory has them.
const CALIBRATED_SUPPLY: u8 = 0x80;
const CALIBRATED_TEMPERATURE: u8 = 0x88;
/// Trim code and its pull, parts per million (user manual, figure 29; the middle is 17).
const TRIM: [(f64, f64); 5] = [(0.0, 30.0), (5.0, 20.0), (17.0, 0.0), (30.0, -18.0), (31.0, -19.4)];

/// State of supply and clocks.
#[derive(Clone)]
pub(super) struct Power {
    state: State,
    lde: Lde,
    /// The registers that SAVE copied into the always-on memory.
    kept: Option<Box<Memory>>,
    /// The results of the last conversion: supply and temperature codes.
    converted: [u8; 2],
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    Off,
    /// RSTn low.
    Reset,
    /// The crystal starts.
    Starting,
    /// On the crystal's clock.
    Crystal,
    /// On the PLL's clock.
    Pll,
    /// SOFTRESET is 0: only PMSC_CTRL0 can be written.
    Held,
    Asleep,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Lde {
    Absent,
    Loading(TrueTime),
    Loaded,
}

impl Power {
    pub(super) fn off() -> Self {
        Self { state: State::Off, lde: Lde::Absent, kept: None, converted: [0; 2] }
    }

    /// Whether the registers can be accessed.
    pub(super) fn answers(&self) -> bool {
        matches!(self.state, State::Crystal | State::Pll | State::Held)
    }

    /// Whether SOFTRESET holds the chip.
    pub(super) fn is_held(&self) -> bool {
        self.state == State::Held
    }

    /// The chip's activity, if neither transmitter nor receiver determines it.
    pub(super) fn activity(&self, sleep_counter: bool) -> Option<Activity> {
        match self.state {
            State::Off => Some(Activity::Off),
            State::Reset | State::Crystal | State::Held => Some(Activity::Init),
            State::Starting => Some(Activity::WakeUp),
            State::Asleep if sleep_counter => Some(Activity::Sleep),
            State::Asleep => Some(Activity::DeepSleep),
            State::Pll => None,
        }
    }
}

impl Chip {
    /// Whether the chip follows a transaction at this SPI clock.
    pub(super) fn follows_spi(&self, hz: u32) -> bool {
        hz <= if self.on_pll() { FAST_SPI_HZ } else { SLOW_SPI_HZ }
    }

    /// Whether the digital part runs from the PLL, which transmitter, receiver and fast SPI need.
    pub(super) fn on_pll(&self) -> bool {
        self.power.state == State::Pll && self.memory.u8(file::PMSC, 0) & 3 != 1
    }

    pub(super) fn lde_ready(&self, now: TrueTime) -> bool {
        let runs = self.memory.u32(file::PMSC, 4) & (1 << 17) != 0;
        runs && match self.power.lde {
            Lde::Absent => false,
            Lde::Loading(since) => now.ps_since(since) >= LDE_LOAD_US * PS_PER_US,
            Lde::Loaded => true,
        }
    }

    /// Switches the supply on (the chip starts) or off.
    pub(crate) fn set_supply(&mut self, world: &World, on: bool) {
        match (on, self.power.state) {
            (true, State::Off) => self.start(world),
            (true, _) => {}
            (false, _) => {
                self.stop(world);
                self.power = Power::off();
            }
        }
        self.settle(world);
    }

    /// Pulls RSTn low, or releases it.
    pub(crate) fn set_reset(&mut self, world: &World, low: bool) {
        match (low, self.power.state) {
            (_, State::Off) => {}
            (true, _) => {
                self.stop(world);
                self.power = Power { state: State::Reset, ..Power::off() };
            }
            (false, State::Reset) => self.start(world),
            (false, _) => {}
        }
        self.settle(world);
    }

    fn start(&mut self, world: &World) {
        self.power.state = State::Starting;
        self.restart_counter(world.now());
        self.schedule_in(world, CRYSTAL_START_US, What::CrystalRuns);
    }

    /// Stops everything that runs, and resets the registers to their defaults.
    fn stop(&mut self, world: &World) {
        self.idle(world);
        self.cancel(Line::Power);
        self.default_registers();
    }

    pub(super) fn default_registers(&mut self) {
        self.memory.restore_defaults();
        let programmed = u64::from(self.one_time_word(0x001)) << 32 | u64::from(self.one_time_word(0x000));
        let eui = if programmed == 0 { 0xFFFF_FFFF_0000_0000 } else { programmed };
        self.memory.write(file::EUI, 0, &eui.to_le_bytes());
        self.status = 0;
        self.sets.iter_mut().for_each(|s| s.clear());
        (self.host, self.ic) = (0, 0);
        self.response = None;
        self.receiver = super::Receiver::default();
    }

    pub(super) fn crystal_runs(&mut self, world: &World) {
        self.power.state = State::Crystal;
        self.status |= status::SLP2INIT;
        self.trim(world.now());
        self.schedule_in(world, PLL_LOCK_US, What::PllLocks);
    }

    pub(super) fn pll_locks(&mut self, world: &World) {
        self.power.state = State::Pll;
        self.status |= status::CPLOCK;
        // ONW_RX. After a reset it is not set.
        if self.memory.u16(file::AON, 0) & (1 << 1) != 0 {
            self.enable_receiver(world, Enable::Now);
        }
    }

    /// PMSC_CTRL0 was written: clock selection and soft reset.
    pub(super) fn clocks_written(&mut self, world: &World) {
        let control = self.memory.u32(file::PMSC, 0);
        if control & 3 != 1
            && let Lde::Loading(since) = self.power.lde
        {
            // If the crystal's clock ended too early, the microcode is incomplete.
            let whole = world.now().ps_since(since) >= LDE_LOAD_US * PS_PER_US;
            self.power.lde = if whole { Lde::Loaded } else { Lde::Absent };
        }
        match (control >> 28, self.power.state) {
            (0xF, State::Held) => {
                self.restart_counter(world.now());
                self.crystal_runs(world);
            }
            (0xF, _) => {}
            (0x0, _) => {
                self.stop(world);
                self.power.lde = Lde::Absent;
                self.power.state = State::Held;
                self.memory.write(file::PMSC, 3, &[0]);
            }
            (_, State::Held) => {}
            // If only bit 28 is low, the receiver is reset.
            (0xE, _) => {
                self.receiver.stale = false;
                if matches!(self.trx, Trx::Rx | Trx::RxWait) {
                    self.idle(world);
                }
            }
            _ => self.idle(world),
        }
    }

    /// OTP_CTRL was written: reads a word, or loads the LDE's microcode.
    pub(super) fn one_time_memory(&mut self, world: &World) {
        let control = self.memory.u16(file::OTP_IF, 0x06);
        if control & 0b11 == 0b11 {
            let word = self.one_time_word(self.memory.u16(file::OTP_IF, 0x04) & 0x7FF);
            self.memory.write(file::OTP_IF, 0x0A, &word.to_le_bytes());
        }
        if control & (1 << 15) != 0 && self.memory.u8(file::PMSC, 0) & 3 == 1 {
            self.power.lde = Lde::Loading(world.now());
        }
    }

    fn one_time_word(&self, address: u16) -> u32 {
        if let Some((_, word)) = self.config.otp.iter().find(|(at, _)| *at == address) {
            return *word;
        }
        match address {
            0x000 => self.config.eui as u32,
            0x001 => (self.config.eui >> 32) as u32,
            // LDOTUNE, which is calibrated in production.
            0x004 => 0x8888_8888,
            0x005 => 0x28,
            0x006 => self.config.part,
            0x007 => self.node,
            0x008 => u32::from(CALIBRATED_SUPPLY),
            0x009 => u32::from(CALIBRATED_TEMPERATURE),
            0x01E => u32::from(self.config.trim & 0x1F),
            _ => 0,
        }
    }

    /// TC_SARC was written: converts supply and temperature, if the converters' biases are on (0x28:12 = 0x0F).
    pub(super) fn convert(&mut self) {
        if self.memory.u8(file::TX_CAL, 0) & 1 != 0 && self.memory.u8(file::RF_CONF, 0x12) & 0x0F == 0x0F {
            let code = |steps: f64, zero: u8| (steps.round() + f64::from(zero)).clamp(0.0, 255.0) as u8;
            // User manual, 6.4: (code − OTP)/173 + 3.3 V and (code − OTP) · 1.14 + 23 °C.
            let (at_3v3, at_23c) = (self.one_time_word(0x008) as u8, self.one_time_word(0x009) as u8);
            let supply = code((self.config.supply_v - 3.3) * 173.0, at_3v3);
            let temperature = code((self.config.temperature_c - 23.0) / 1.14, at_23c);
            self.power.converted = [supply, temperature];
            self.memory.write(file::TX_CAL, 0x03, &self.power.converted);
        }
    }

    /// FS_XTALT was written.
    pub(super) fn trim(&mut self, now: TrueTime) {
        let code = f64::from(self.memory.u8(file::FS_CTRL, 0x0E) & 0x1F);
        let above = TRIM.iter().position(|t| code <= t.0).unwrap_or(TRIM.len() - 1).max(1);
        let (a, b) = (TRIM[above - 1], TRIM[above]);
        self.clock.trim(now, a.1 + (b.1 - a.1) * (code - a.0) / (b.0 - a.0));
    }

    /// AON_CTRL was written: SAVE copies the registers and, with SLEEP_EN, puts the chip to sleep.
    pub(super) fn always_on(&mut self, world: &World) {
        if self.memory.u8(file::AON, 0x02) & (1 << 1) != 0 {
            self.memory.write(file::AON, 0x02, &[0]);
            self.power.kept = Some(Box::new(self.memory.clone()));
            if self.memory.u8(file::AON, 0x06) & 1 != 0 {
                self.sleep(world);
            }
        }
    }

    /// Whether the chip's own counter ends the sleep. The counter then runs.
    pub(super) fn sleeps_with_counter(&self) -> bool {
        self.memory.u32(file::AON, 0x06) & (1 << 3) != 0 && self.memory.u16(file::AON, 0x0A) & 1 != 0
    }

    /// Puts the chip to sleep, also after ATXSLP or ARXSLP.
    pub(super) fn sleep(&mut self, world: &World) {
        self.idle(world);
        self.cancel(Line::Power);
        self.power.state = State::Asleep;
        let counts = u64::from(self.memory.u32(file::AON, 0x06) >> 16);
        if self.sleeps_with_counter() {
            self.schedule_in(world, counts * SLEEP_COUNT_US, What::SleepEnds);
        }
    }

    /// Chip select was low for `picoseconds`.
    pub(super) fn selected(&mut self, world: &World, picoseconds: u64) {
        let by_spi = self.power.kept.as_ref().is_some_and(|k| k.u8(file::AON, 0x06) & (1 << 2) != 0);
        if self.power.state == State::Asleep && by_spi && picoseconds >= WAKE_SELECT_US * PS_PER_US {
            self.wake(world);
        }
    }

    pub(super) fn wake(&mut self, world: &World) {
        self.cancel(Line::Power);
        let kept = self.power.kept.clone();
        self.default_registers();
        self.power.lde = Lde::Absent;
        if let Some(kept) = kept {
            let on_wake = kept.u16(file::AON, 0);
            // ONW_LDC: everything is restored except the transmit buffer and the transmit antenna delay. The low byte
            // of that delay gets the high byte of LDE_RXANTD (user manual, 7.2.26).
            if on_wake & (1 << 6) != 0 {
                self.memory = *kept;
                self.memory.write(file::TX_BUFFER, 0, &[0; 1024]);
                let spilt = self.memory.u8(file::LDE_IF, 0x1805);
                self.memory.write(file::TX_ANTD, 0, &[spilt, 0]);
            }
            if on_wake & (1 << 11) != 0 {
                self.power.lde = Lde::Loaded;
            }
        }
        // SLEEP_EN is cleared and must be set again for the next sleep.
        let control = self.memory.u8(file::AON, 0x06) & !1;
        self.memory.write(file::AON, 0x06, &[control]);
        self.start(world);
    }
}
