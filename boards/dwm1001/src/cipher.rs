//! What frames with a key need: the chip's random numbers, and its AES (ECB: 7.2 µs a block).

use embassy_nrf::pac;
use firmware_common::settings::Cipher;

/// Draws a seed. Before the Bluetooth controller, which owns the generator of random numbers from its start on.
#[cold]
#[inline(never)]
pub fn start() -> Cipher {
    let rng = pac::RNG;
    // Bits of equal probability: some 0.1 ms a byte.
    rng.config().write(|w| w.set_dercen(true));
    rng.tasks_start().write_value(1);
    let seed = core::array::from_fn(|_| {
        while rng.events_valrdy().read() == 0 {}
        rng.events_valrdy().write_value(0);
        rng.value().read().value()
    });
    rng.tasks_stop().write_value(1);
    Cipher { seed: u64::from_le_bytes(seed), make_code }
}

/// The controller's library owns the chip's AES.
#[cfg(feature = "ble")]
use wire::uwb::native::software_code as make_code;

/// Makes the code of a frame or an advertisement. One caller may interrupt another.
#[cfg(not(feature = "ble"))]
pub fn make_code(
    key: &[u8; 16],
    nonce: &wire::uwb::native::Nonce,
    parts: [&[u8]; 2],
) -> wire::uwb::native::IntegrityCode {
    use core::sync::atomic::{Ordering, compiler_fence};

    /// What the peripheral reads and writes, at the address that it is given.
    #[repr(C)]
    struct Data {
        key: [u8; 16],
        cleartext: [u8; 16],
        ciphertext: [u8; 16],
    }

    let mut data = Data { key: *key, cleartext: [0; 16], ciphertext: [0; 16] };
    wire::uwb::native::integrity_code(
        &mut |block| {
            data.cleartext = *block;
            // Ranging interrupts the task that advertises, and makes codes too.
            critical_section::with(|_| {
                let ecb = pac::ECB;
                ecb.ecbdataptr().write_value(&raw mut data as u32);
                ecb.events_endecb().write_value(0);
                compiler_fence(Ordering::SeqCst);
                ecb.tasks_startecb().write_value(1);
                while ecb.events_endecb().read() == 0 {}
                compiler_fence(Ordering::SeqCst);
            });
            // SAFETY: the peripheral has written it. The compiler does not know of that.
            *block = unsafe { (&raw const data.ciphertext).read_volatile() };
        },
        nonce,
        parts,
    )
}
