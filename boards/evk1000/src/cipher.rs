//! What frames with a key need. The STM32F105 has neither AES nor a generator of random numbers.

use embassy_stm32::pac;
use firmware_common::settings::Cipher;
use wire::uwb::native::software_code;

/// The channel of the temperature sensor.
const SENSOR: u8 = 16;
/// Readings of it. Their last bits are noise: the sensor needs 17 µs to charge the converter, and gets 0.1 µs.
const READINGS: usize = 256;
/// A conversion takes 14 cycles of 12 MHz; this many looks take much longer.
const LOOKS: usize = 10_000;

/// Makes a seed of the noise of the converter (RM0008, 11), which is off again afterwards.
#[cold]
#[inline(never)]
pub fn start() -> Cipher {
    pac::RCC.cfgr().modify(|w| w.set_adcpre(pac::rcc::vals::Adcpre::DIV6));
    pac::RCC.apb2enr().modify(|w| w.set_adc1en(true));
    let adc = pac::ADC1;
    let on = |w: &mut pac::adc::regs::Cr2| {
        w.set_adon(true);
        w.set_tsvrefe(true);
    };
    adc.cr2().write(on);
    // Its start takes a microsecond, that of the sensor ten.
    cortex_m::asm::delay(72 * 20);
    adc.sqr3().write(|w| w.set_sq(0, SENSOR));
    // FNV-1a.
    let mut seed = 0xCBF2_9CE4_8422_2325_u64;
    for _ in 0..READINGS {
        // Written once more, the bit starts a conversion.
        adc.cr2().write(on);
        let is_done = (0..LOOKS).any(|_| adc.sr().read().eoc());
        let reading = if is_done { adc.dr().read().data() } else { 0 };
        seed = (seed ^ u64::from(reading)).wrapping_mul(0x0000_0100_0000_01B3);
    }
    adc.cr2().write(|_| ());
    pac::RCC.apb2enr().modify(|w| w.set_adc1en(false));
    Cipher { seed, make_code: software_code }
}
