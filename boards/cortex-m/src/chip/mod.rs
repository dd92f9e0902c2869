//! The parts that need the processor.

pub mod crash;
pub mod critical;
mod memory;
pub mod spi;

use core::mem::MaybeUninit;

// Microseconds since the start, as in telemetry.
defmt::timestamp!("{=u64:us}", uptime_us());

/// Microseconds since the node started.
pub fn uptime_us() -> u64 {
    embassy_time::Instant::now().as_micros()
}

/// Resets the processor.
pub fn restart() -> ! {
    cortex_m::peripheral::SCB::sys_reset()
}

/// A pattern in memory that no reset clears, and that fades without power.
#[unsafe(link_section = ".uninit.pattern")]
static mut PATTERN: MaybeUninit<[u32; 4]> = MaybeUninit::uninit();
const PRESENT: [u32; 4] = [0x5AC3_0FF1, 0xA53C_F00E, 0x1DEA_D9B2, 0xE215_264D];

/// Whether the RAM kept its content over the reset. Valid for one call: each further call returns true.
pub fn ram_survived() -> bool {
    let pattern = &raw mut PATTERN;
    // SAFETY: only this function uses the pattern, once at the start of the program, before there are tasks. Any
    // content of memory is a valid integer. Volatile accesses keep the compiler from assuming the content.
    unsafe {
        let survived = pattern.cast::<[u32; 4]>().read_volatile() == PRESENT;
        pattern.cast::<[u32; 4]>().write_volatile(PRESENT);
        survived
    }
}
