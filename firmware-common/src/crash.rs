//! The crash record. It lies in memory that a reset does not clear, and the next start reads it.
//!
//! The panic handler, the fault handler or the supervisor writes a [`wire::telemetry::Crash`]. After the reset it is
//! taken once, if its magic number and its checksum are right. Otherwise the memory holds whatever it held at power-on.
#![allow(unsafe_code, reason = "reads memory that nobody has initialised")]

use core::mem::MaybeUninit;
use core::panic::PanicInfo;
use core::ptr;

use wire::telemetry::{Crash, CrashReason};

const MAGIC: u32 = 0xBA71_2ADE;

/// The crash record in memory. The board places one, uninitialised, in memory that a reset does not change (`.uninit`,
/// persistent RAM).
#[derive(Clone, Copy)]
#[repr(C)]
pub struct Remains {
    magic: u32,
    reason: u32,
    program_counter: u32,
    line: u32,
    file: u32,
    check: u32,
}

impl Remains {
    fn checksum(&self) -> u32 {
        let words = [self.magic, self.reason, self.program_counter, self.line, self.file];
        words.iter().fold(0x811C_9DC5, |hash, word| fnv(hash, &word.to_le_bytes()))
    }
}

/// Writes a crash for the next start.
pub fn leave(place: &mut MaybeUninit<Remains>, crash: Crash) {
    let Crash { reason, program_counter, line, file } = crash;
    let reason = match reason {
        CrashReason::Panic => 0,
        CrashReason::Fault => 1,
        CrashReason::StackOverflow => 2,
        CrashReason::Stalled => 3,
    };
    let mut remains = Remains { magic: MAGIC, reason, program_counter, line, file, check: 0 };
    remains.check = remains.checksum();
    // SAFETY: the place is borrowed mutably. The write is volatile, because this run of the program does not read it
    // again.
    unsafe { ptr::write_volatile(place.as_mut_ptr(), remains) };
}

/// Takes the crash of the run before, if there is one.
pub fn take(place: &mut MaybeUninit<Remains>) -> Option<Crash> {
    // SAFETY: it consists of integers, and any content of memory is a valid integer. The read is volatile, so that the
    // compiler does not treat the content as undefined.
    let remains = unsafe { ptr::read_volatile(place.as_ptr()) };
    if remains.magic != MAGIC || remains.check != remains.checksum() {
        return None;
    }
    // SAFETY: as in `leave`.
    unsafe { ptr::write_volatile(place.as_mut_ptr(), Remains { magic: 0, ..remains }) };
    let reason = match remains.reason {
        0 => CrashReason::Panic,
        1 => CrashReason::Fault,
        2 => CrashReason::StackOverflow,
        3 => CrashReason::Stalled,
        _ => return None,
    };
    let Remains { program_counter, line, file, .. } = remains;
    Some(Crash { reason, program_counter, line, file })
}

/// The crash report of a panic. `return_address` is the address that the panic handler returns to if the board knows
/// it, else 0.
pub fn of_panic(panic: &PanicInfo<'_>, return_address: u32) -> Crash {
    let (line, file) = panic.location().map_or((0, 0), |at| (at.line(), file_hash(at.file())));
    Crash { reason: CrashReason::Panic, program_counter: return_address, line, file }
}

/// The hash of a source file's path in a crash report: FNV-1a, 32 bits.
pub fn file_hash(path: &str) -> u32 {
    fnv(0x811C_9DC5, path.as_bytes())
}

fn fnv(hash: u32, bytes: &[u8]) -> u32 {
    bytes.iter().fold(hash, |hash, byte| (hash ^ u32::from(*byte)).wrapping_mul(0x0100_0193))
}

#[cfg(test)]
mod tests {
    use super::*;

    const CRASH: Crash = Crash { reason: CrashReason::Stalled, program_counter: 0x0001_2345, line: 7, file: 9 };

    /// Flips one bit of a place.
    fn flip(place: &mut MaybeUninit<Remains>, byte: usize, bit: u8) {
        // SAFETY: the byte is within the place, which has been written.
        unsafe { *place.as_mut_ptr().cast::<u8>().add(byte) ^= 1 << bit };
    }

    #[test]
    fn what_is_left_is_taken_once() {
        let mut place = MaybeUninit::zeroed();
        assert_eq!(take(&mut place), None);
        for reason in [CrashReason::Panic, CrashReason::Fault, CrashReason::StackOverflow, CrashReason::Stalled] {
            leave(&mut place, Crash { reason, ..CRASH });
            assert_eq!(take(&mut place), Some(Crash { reason, ..CRASH }));
            assert_eq!(take(&mut place), None);
        }
    }

    #[test]
    fn a_flipped_bit_makes_it_nothing() {
        for byte in 0..size_of::<Remains>() {
            for bit in 0..8 {
                let mut place = MaybeUninit::zeroed();
                leave(&mut place, CRASH);
                flip(&mut place, byte, bit);
                assert_eq!(take(&mut place), None, "byte {byte}, bit {bit}");
            }
        }
    }

    #[test]
    fn files_are_hashed_by_fnv_1a() {
        // The reference vectors of FNV (Noll): "" and "foobar".
        assert_eq!((file_hash(""), file_hash("foobar")), (0x811C_9DC5, 0xBF9C_F968));
    }
}
