//! The watchdog. Once started, only a power cycle or its own reset stops it. A software reset does not.

use embassy_nrf::pac::{WDT, wdt::vals};
use embassy_nrf::{Peri, peripherals};

/// The watchdog's time-out in ticks of the 32 kHz clock: 6 s, longer than Bluetooth's start and shorter than a person
/// would wait.
const TICKS: u32 = 6 * 32_768;

/// The watchdog. It stops while a debugger halts the processor, and runs while the processor sleeps.
pub struct Watchdog(());

impl Watchdog {
    pub(super) fn start(_watchdog: Peri<'static, peripherals::WDT>) -> Self {
        let mut this = Self(());
        // After a software reset it still runs, with its configuration from before.
        if !WDT.runstatus().read().runstatus() {
            WDT.config().write(|w| {
                w.set_sleep(vals::Sleep::Run);
                w.set_halt(vals::Halt::Pause);
            });
            WDT.crv().write_value(TICKS);
            WDT.rren().write(|w| w.set_rr(0, true));
            WDT.tasks_start().write_value(1);
        }
        this.feed();
        this
    }

    /// Restarts its time-out of 6 s.
    pub fn feed(&mut self) {
        // All reload registers: another image may have started it with more than one. Reloads of disabled registers
        // have no effect.
        for register in 0..8 {
            WDT.rr(register).write(|w| w.set_rr(vals::Rr::Reload));
        }
    }
}
