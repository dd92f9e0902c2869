//! The time: that of the simulated world's last answer, and the instructions that the firmware has executed since.
//! QEMU's clock advances by the same time for each instruction. Instructions of this board's own code are not counted.
//! Another board has other code in its place, and the world's profile of that board accounts for that code.

use core::cell::Cell;
use core::sync::atomic::{AtomicU32, Ordering};

use critical_section::Mutex;
use qemu_link::Spent;

/// The purpose of the executed instructions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// Ranging.
    Ranging,
    /// Everything else.
    Background,
}

/// Instructions since the last answer, for each [`Level`].
static SPENT: [AtomicU32; 2] = [const { AtomicU32::new(0) }; 2];
/// The present level, as its index in [`SPENT`].
static LEVEL: AtomicU32 = AtomicU32::new(0);
/// The number of nested pauses. There is one from the start on: only [`count`] counts instructions.
static PAUSES: AtomicU32 = AtomicU32::new(1);
/// The counter when counting last began.
static SINCE: AtomicU32 = AtomicU32::new(0);

static ANSWERED_NS: Mutex<Cell<u64>> = Mutex::new(Cell::new(0));
static INSTRUCTION_PS: AtomicU32 = AtomicU32::new(0);

/// Starts the counter.
pub fn start() {
    counter::start();
}

/// Sets the time of an instruction, picoseconds.
pub fn set_instruction_ps(instruction_ps: u32) {
    INSTRUCTION_PS.store(instruction_ps, Ordering::Relaxed);
}

/// Nothing is counted while this exists.
pub struct Pause(());

impl Pause {
    /// Begins a pause. It first counts the instructions up to here.
    #[inline(always)]
    pub fn begin() -> Self {
        let now = counter::now();
        Self::begin_at(now);
        Self(())
    }

    #[inline(never)]
    fn begin_at(now: u32) {
        let pauses = PAUSES.load(Ordering::Relaxed);
        if pauses == 0
            && let Some(spent) = SPENT.get(LEVEL.load(Ordering::Relaxed) as usize)
        {
            let instructions = counter::between(SINCE.load(Ordering::Relaxed), now);
            spent.store(spent.load(Ordering::Relaxed).saturating_add(instructions), Ordering::Relaxed);
        }
        PAUSES.store(pauses + 1, Ordering::Relaxed);
    }
}

impl Drop for Pause {
    #[inline(always)]
    fn drop(&mut self) {
        PAUSES.store(PAUSES.load(Ordering::Relaxed).saturating_sub(1), Ordering::Relaxed);
        SINCE.store(counter::now(), Ordering::Relaxed);
    }
}

/// Counts the instructions that `work` executes.
pub fn count<R>(level: Level, work: impl FnOnce() -> R) -> R {
    let place = match level {
        Level::Ranging => 0,
        Level::Background => 1,
    };
    LEVEL.store(place, Ordering::Relaxed);
    // This interrupts the pause that exists from the start on.
    drop(Pause(()));
    let result = work();
    core::mem::forget(Pause::begin());
    result
}

/// The counts since the last call.
pub fn take_spent() -> Spent {
    let [ranging, background] = [0, 1].map(|level: usize| {
        let spent = &SPENT[level];
        let instructions = spent.load(Ordering::Relaxed);
        spent.store(0, Ordering::Relaxed);
        instructions
    });
    Spent { ranging, background }
}

/// Sets the time of the simulated world.
pub fn set(now_ns: u64) {
    critical_section::with(|token| ANSWERED_NS.borrow(token).set(now_ns));
}

/// The time of the simulated world, nanoseconds.
pub fn now_ns() -> u64 {
    let _pause = Pause::begin();
    let answered = critical_section::with(|token| ANSWERED_NS.borrow(token).get());
    let instructions: u64 = SPENT.iter().map(|spent| u64::from(spent.load(Ordering::Relaxed))).sum();
    answered + instructions * u64::from(INSTRUCTION_PS.load(Ordering::Relaxed)) / 1000
}

/// The time of the simulated world, microseconds.
pub fn uptime_us() -> u64 {
    let _pause = Pause::begin();
    now_ns() / 1000
}

/// SysTick: 24 bits downward.
#[cfg(target_arch = "arm")]
mod counter {
    use cortex_m::peripheral::SYST;
    use cortex_m::peripheral::syst::SystClkSource;

    /// `-icount shift=8`: an instruction takes 2⁸ ns; the clock of mps2-an386 is 25 MHz.
    const NS_PER_INSTRUCTION: u32 = 1 << 8;
    const NS_PER_TICK: u32 = 40;
    const RELOAD: u32 = 0x00FF_FFFF;

    pub fn start() {
        if let Some(peripherals) = cortex_m::Peripherals::take() {
            let mut systick = peripherals.SYST;
            systick.set_clock_source(SystClkSource::Core);
            systick.set_reload(RELOAD);
            systick.clear_current();
            systick.enable_counter();
        }
    }

    #[inline(always)]
    pub fn now() -> u32 {
        SYST::get_current()
    }

    /// The instructions between two stamps, fewer than 2.6 million.
    pub fn between(earlier: u32, later: u32) -> u32 {
        // The counter has a period of one tick less than 2²⁴: an error of one part in 16 million.
        let ticks = earlier.wrapping_sub(later) & RELOAD;
        (ticks * NS_PER_TICK + NS_PER_INSTRUCTION / 2) / NS_PER_INSTRUCTION
    }
}

/// The counter of retired instructions.
#[cfg(target_arch = "riscv32")]
mod counter {
    use riscv::register::minstret;

    pub fn start() {}

    #[inline(always)]
    pub fn now() -> u32 {
        minstret::read() as u32
    }

    pub fn between(earlier: u32, later: u32) -> u32 {
        later.wrapping_sub(earlier)
    }
}
