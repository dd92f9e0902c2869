//! The RTC's watchdog. It first raises an interrupt, whose handler records where the processor hangs. Shortly after, it
//! resets the core, even if the interrupt was not served.

use esp_hal::handler;
use esp_hal::interrupt::Priority;
use esp_hal::peripherals::RTC_TIMER;
use esp_hal::rtc_cntl::{Rtc, RwdtStage, RwdtStageAction};
use esp_hal::time::Duration;
use wire::telemetry::{Crash, CrashReason};

use super::crash;

/// The time-out of the watchdog: longer than Bluetooth's start and shorter than a person would wait.
const PATIENCE: Duration = Duration::from_secs(6);
/// From the interrupt to the reset.
const LAST_WORDS: Duration = Duration::from_millis(100);

/// The watchdog. It stops while the chip sleeps.
pub struct Watchdog(Rtc<'static>);

impl Watchdog {
    pub(super) fn start(timer: RTC_TIMER<'static>) -> Self {
        let mut this = Self(Rtc::new(timer));
        this.0.set_interrupt_handler(ran_out);
        let watchdog = &mut this.0.rwdt;
        watchdog.set_timeout(RwdtStage::Stage0, PATIENCE);
        watchdog.set_timeout(RwdtStage::Stage1, LAST_WORDS);
        watchdog.enable();
        // The reset spares the RTC, because the crash record is in its memory.
        watchdog.set_stage_action(RwdtStage::Stage1, RwdtStageAction::ResetCore);
        watchdog.listen();
        this.feed();
        this
    }

    /// Restarts its time-out of 6 s.
    pub fn feed(&mut self) {
        self.0.rwdt.feed();
    }
}

#[handler(priority = Priority::max())]
fn ran_out() {
    // The supervisor may already have recorded which task is silent.
    crash::leave_if_first(Crash { reason: CrashReason::Stalled, program_counter: interrupted_at(), line: 0, file: 0 });
    // The reset follows by itself, and the reset cause is then the watchdog.
    loop {
        core::hint::spin_loop();
    }
}

/// Where the processor was. An interrupt of the highest priority is not interrupted itself, so the register is still
/// valid.
#[cfg(target_arch = "riscv32")]
fn interrupted_at() -> u32 {
    let address: u32;
    // SAFETY: reads a register of the processor.
    unsafe { core::arch::asm!("csrr {0}, mepc", out(reg) address) };
    address
}

/// Unknown: the register depends on the interrupt's level.
#[cfg(target_arch = "xtensa")]
fn interrupted_at() -> u32 {
    0
}

/// Makes the digital part of the chip reset it at a brown-out, because that part remembers the cause. The analog part
/// does not, and its reset looks like a power-on. The bootloader may have made the analog part the faster one.
pub(super) fn reset_on_brown_out() {
    #[cfg(feature = "esp32c3")]
    esp_hal::peripherals::LPWR::regs()
        .brown_out()
        .modify(|_, w| w.brown_out_rst_sel().set_bit().brown_out_rst_ena().set_bit().brown_out_ena().set_bit());
    #[cfg(feature = "esp32c6")]
    esp_hal::peripherals::LP_ANA::regs()
        .bod_mode0_cntl()
        .modify(|_, w| w.bod_mode0_reset_sel().set_bit().bod_mode0_reset_ena().set_bit());
}
