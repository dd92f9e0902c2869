//! What frames with a key need: random numbers, and the chip's AES.

use esp_hal::aes::Aes;
use esp_hal::peripherals::{ADC1, AES, RNG};
use esp_hal::rng::{Rng, Trng, TrngSource};
use firmware_common::settings::Cipher;
use wire::uwb::native::{IntegrityCode, Nonce, integrity_code};

/// Draws a seed from the noise of the converter, which is off again afterwards.
pub fn start(rng: RNG<'_>, adc: ADC1<'_>) -> Cipher {
    let source = TrngSource::new(rng, adc);
    let mut seed = [0; 8];
    // `Trng` only checks that a source is on.
    match Trng::try_new() {
        Ok(numbers) => numbers.read(&mut seed),
        Err(_) => Rng::new().read(&mut seed),
    }
    drop(source);
    Cipher { seed: u64::from_le_bytes(seed), make_code }
}

fn make_code(key: &[u8; 16], nonce: &Nonce, parts: [&[u8]; 2]) -> IntegrityCode {
    // SAFETY: only this function uses it, in one thread.
    let mut aes = Aes::new(unsafe { AES::steal() });
    integrity_code(&mut |block| aes.encrypt(block, *key), nonce, parts)
}
