//! Why a chip was reset. Input: its register of reset causes. Output: a [`ResetCause`].
//!
//! Neither chip's flags distinguish a brown-out from a power-on: both set the same flag, or none. The RAM distinguishes
//! them, because it fades within seconds without power. `ram_survived` means that a pattern written there was still
//! there.

use wire::telemetry::ResetCause;

/// The cause by the first flag that is set, in the order of `flags`.
fn first(register: u32, flags: &[(u32, ResetCause)]) -> Option<ResetCause> {
    flags.iter().find(|(bit, _)| register & (1 << bit) != 0).map(|(_, cause)| *cause)
}

fn power(ram_survived: bool) -> ResetCause {
    if ram_survived { ResetCause::BrownOut } else { ResetCause::PowerOn }
}

/// RESETREAS of an nRF52832 (product specification, 18.8). The firmware clears it at each start.
pub fn nrf52(resetreas: u32, ram_survived: bool) -> ResetCause {
    const FLAGS: [(u32, ResetCause); 8] = [
        (1, ResetCause::Watchdog),
        (3, ResetCause::Lockup),
        (2, ResetCause::Software),
        (0, ResetCause::Pin),
        // Woken from System OFF: by a pin, the comparator, the debugger, or an NFC field.
        (16, ResetCause::Wake),
        (17, ResetCause::Wake),
        (18, ResetCause::Wake),
        (19, ResetCause::Wake),
    ];
    match (first(resetreas, &FLAGS), resetreas) {
        (Some(cause), _) => cause,
        (None, 0) => power(ram_survived),
        (None, other) => ResetCause::Other(other),
    }
}

/// RCC_CSR of an STM32F105 (reference manual RM0008, 8.3.10). Every reset pulls the pin, so the pin's flag counts only
/// if no other is set.
pub fn stm32f1(csr: u32, ram_survived: bool) -> ResetCause {
    /// The bits from LPWRRSTF to PINRSTF.
    const CAUSES: u32 = 0x3F << 26;
    let flags = [
        (29, ResetCause::Watchdog),
        (30, ResetCause::Watchdog),
        (28, ResetCause::Software),
        (27, power(ram_survived)),
        (31, ResetCause::Other(csr & CAUSES)),
        (26, ResetCause::Pin),
    ];
    first(csr, &flags).unwrap_or(ResetCause::Other(csr & CAUSES))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nrf52_has_no_flag_for_power() {
        assert_eq!(nrf52(0, false), ResetCause::PowerOn);
        assert_eq!(nrf52(0, true), ResetCause::BrownOut);
    }

    #[test]
    fn nrf52_flags_are_told() {
        assert_eq!(nrf52(0x0000_0001, true), ResetCause::Pin);
        assert_eq!(nrf52(0x0000_0002, true), ResetCause::Watchdog);
        assert_eq!(nrf52(0x0000_0004, true), ResetCause::Software);
        assert_eq!(nrf52(0x0000_0008, true), ResetCause::Lockup);
        assert_eq!(nrf52(0x0001_0000, true), ResetCause::Wake);
        assert_eq!(nrf52(0x0008_0000, false), ResetCause::Wake);
        assert_eq!(nrf52(0x0010_0000, false), ResetCause::Other(0x0010_0000));
    }

    #[test]
    fn nrf52_watchdog_goes_before_the_pin() {
        assert_eq!(nrf52(0x0000_0003, true), ResetCause::Watchdog);
    }

    #[test]
    fn stm32f1_tells_the_pin_only_when_it_is_alone() {
        // PINRSTF alone, then with PORRSTF as after power-on, SFTRSTF, IWDGRSTF. LSI's bits below do not matter.
        assert_eq!(stm32f1(0x0400_0003, false), ResetCause::Pin);
        assert_eq!(stm32f1(0x0C00_0000, false), ResetCause::PowerOn);
        assert_eq!(stm32f1(0x0C00_0000, true), ResetCause::BrownOut);
        assert_eq!(stm32f1(0x1400_0000, true), ResetCause::Software);
        assert_eq!(stm32f1(0x2400_0003, true), ResetCause::Watchdog);
        assert_eq!(stm32f1(0x4400_0000, true), ResetCause::Watchdog);
    }

    #[test]
    fn stm32f1_low_power_reset_is_something_else() {
        assert_eq!(stm32f1(0x8400_0003, true), ResetCause::Other(0x8400_0000));
        assert_eq!(stm32f1(0, true), ResetCause::Other(0));
    }
}
