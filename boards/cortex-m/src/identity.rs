//! Derives an EUI-64 from a chip's own numbers. It is marked as locally administered, because this project has no
//! manufacturer's range.

/// Marks an EUI-64 as locally administered, and as that of one node, not a group: bits 1 and 0 of the first byte (IEEE
/// 802, 8.2.2).
fn local(eui: u64) -> u64 {
    eui & !(1 << 56) | 1 << 57
}

/// From 64 random bits of the chip (nRF52: FICR.DEVICEID).
pub fn of_random(device: u64) -> u64 {
    local(device)
}

/// From a serial number whose bits differ little from chip to chip (STM32: lot, wafer, and coordinates on the wafer):
/// its hash, FNV-1a.
pub fn of_serial(serial: &[u8]) -> u64 {
    local(
        serial
            .iter()
            .fold(0xCBF2_9CE4_8422_2325, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01B3)),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn random_bits_are_marked_local_and_single() {
        assert_eq!(of_random(0), 0x0200_0000_0000_0000);
        assert_eq!(of_random(u64::MAX), 0xFEFF_FFFF_FFFF_FFFF);
    }

    #[test]
    fn a_serial_is_hashed_as_published() {
        // FNV-1a of "foobar" is 0x85944171f73967e8 (Fowler, Noll, Vo: test vectors). 0x85 becomes 0x86.
        assert_eq!(of_serial(b"foobar"), 0x8694_4171_F739_67E8);
    }

    #[test]
    fn neighbours_on_a_wafer_differ_in_the_short_address() {
        assert_ne!(of_serial(&[1, 0, 7, 0]) as u16, of_serial(&[2, 0, 7, 0]) as u16);
    }
}
