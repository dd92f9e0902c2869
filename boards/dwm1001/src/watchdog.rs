//! The watchdog: once started, only a power cycle or its own reset stops it; a software reset does not.

use embassy_nrf::pac::{WDT, wdt::vals};
use embassy_nrf::{Peri, peripherals};

/// Ticks of the 32 kHz clock until it bites: 6 s, longer than Bluetooth's start and shorter than a person's patience.
const TICKS: u32 = 6 * 32_768;

/// The watchdog. It stands still while a debugger halts the processor, and runs while the processor sleeps.
pub struct Watchdog(());

impl Watchdog {
    pub(super) fn start(_watchdog: Peri<'static, peripherals::WDT>) -> Self {
        let mut this = Self(());
        // After a software reset it still runs, as it was configured then.
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

    /// Keeps it from biting for another 6 s.
    pub fn feed(&mut self) {
        // All registers: another image may have started it with more than one. Those not enabled take no notice.
        for register in 0..8 {
            WDT.rr(register).write(|w| w.set_rr(vals::Rr::Reload));
        }
    }
}
