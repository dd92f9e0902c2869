//! Cortex-M: SysTick at the core's clock.

use cortex_m::peripheral::SYST;
use cortex_m::peripheral::syst::SystClkSource;

/// `-icount shift=8`: an instruction takes 2⁸ ns.
const NS_PER_INSTRUCTION: u32 = 1 << 8;
/// The clock of mps2-an386 is 25 MHz.
const NS_PER_TICK: u32 = 40;
/// SysTick has 24 bits: 2.6 million instructions.
const RELOAD: u32 = 0x00FF_FFFF;

pub struct Counter {
    systick: SYST,
    start: u32,
}

impl Counter {
    pub fn start() -> Self {
        let mut systick = cortex_m::Peripherals::take().expect("the instrument is started once").SYST;
        systick.set_clock_source(SystClkSource::Core);
        systick.set_reload(RELOAD);
        systick.clear_current();
        systick.enable_counter();
        Self { systick, start: 0 }
    }

    #[inline(always)]
    pub fn reset(&mut self) {
        self.systick.clear_current();
        // The counter is zero until the next tick reloads it.
        while SYST::get_current() == 0 {}
        self.start = SYST::get_current();
    }

    #[inline(always)]
    pub fn instructions(&mut self) -> u32 {
        let ticks = self.start.wrapping_sub(SYST::get_current());
        assert!(!self.systick.has_wrapped(), "more instructions than SysTick can count");
        (ticks * NS_PER_TICK + NS_PER_INSTRUCTION / 2) / NS_PER_INSTRUCTION
    }
}

/// The present value of the counter, between [`Counter::reset`]s.
#[inline(always)]
pub fn stamp() -> u32 {
    SYST::get_current()
}

/// The counter's steps between two stamps, fewer than SysTick's range.
#[inline(always)]
pub fn steps(from: u32, to: u32) -> u32 {
    from.wrapping_sub(to) & RELOAD
}

/// The instructions in `steps` steps.
pub fn instructions(steps: u32) -> u32 {
    let ns = u64::from(steps) * u64::from(NS_PER_TICK);
    ((ns + u64::from(NS_PER_INSTRUCTION) / 2) / u64::from(NS_PER_INSTRUCTION)) as u32
}

#[inline(always)]
pub fn stack_pointer() -> usize {
    let pointer;
    // SAFETY: reads a register.
    unsafe { core::arch::asm!("mov {}, sp", out(reg) pointer, options(nomem, nostack, preserves_flags)) };
    pointer
}
