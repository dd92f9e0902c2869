//! Where a DW1000 is wired unless the record says otherwise, and how fast the bus can be there. Which pins a record may name is
//! in `wire::config::Board::has_pin`.
//!
//! The defaults leave out what the chip reads at reset ("strapping" pins), because the DW1000 or its reset line could make the
//! chip start into its loader. One exception: the ESP32-C3's own pin for MISO is GPIO2, which must not be low at reset; its
//! modules and boards pull it up, and the DW1000 leaves it alone while not selected.

use wire::config::Pins;

/// GPIO2, 6, 7 and 10 are SPI2's own. Strapping: 2, 8, 9.
pub const ESP32_C3: Pins = Pins { sck: 6, mosi: 7, miso: 2, cs: 10, irq: 4, reset: 3 };
/// GPIO2, 6 and 7 are SPI2's own. Strapping: 4, 5, 8, 9, 15.
pub const ESP32_C6: Pins = Pins { sck: 6, mosi: 7, miso: 2, cs: 18, irq: 19, reset: 3 };
/// GPIO18, 19 and 23 are SPI3's own; so are boards wired that carry both chips. Strapping: 0, 2, 5, 12, 15. From 34 on the pins
/// have no pull resistors and cannot drive.
pub const ESP32: Pins = Pins { sck: 18, mosi: 23, miso: 19, cs: 4, irq: 34, reset: 27 };

/// The fast clock of the bus, MHz: the 20 of the DW1000 where SCK, MOSI and MISO are the SPI peripheral's own pins, as they are by
/// default. Others go through the chip's crossbar, which an incoming bit may take 25 ns to cross: of the 25 ns from one edge to the
/// next at 20 MHz, 12 are the DW1000's (data sheet, SPI timing), and nothing would be left; at 10 MHz there are 50.
pub fn fast_mhz(pins: &Pins, default: &Pins) -> u32 {
    let data = |pins: &Pins| (pins.sck, pins.mosi, pins.miso);
    if data(pins) == data(default) { 20 } else { 10 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use wire::config::Board;

    const DEFAULTS: [(Board, Pins, &[u8]); 3] = [
        (Board::Esp32C3, ESP32_C3, &[8, 9]),
        (Board::Esp32C6, ESP32_C6, &[4, 5, 8, 9, 15]),
        (Board::Esp32, ESP32, &[0, 2, 5, 12, 15]),
    ];

    #[test]
    fn defaults_are_what_a_record_may_name() {
        for (board, pins, _) in DEFAULTS {
            for (name, pin, driven) in pins.named() {
                assert!(board.has_pin(pin, driven), "{board:?} {name}");
            }
        }
    }

    #[test]
    fn defaults_disturb_no_reset_and_share_no_pin() {
        for (board, pins, strapping) in DEFAULTS {
            let mut taken: std::vec::Vec<u8> = pins.named().map(|(_, pin, _)| pin).into();
            assert!(!taken.iter().any(|pin| strapping.contains(pin)), "{board:?}");
            taken.sort_unstable();
            taken.dedup();
            assert_eq!(taken.len(), 6, "{board:?}");
        }
    }

    #[test]
    fn other_pins_than_the_peripherals_own_are_clocked_more_slowly() {
        assert_eq!(fast_mhz(&ESP32_C3, &ESP32_C3), 20);
        assert_eq!(fast_mhz(&Pins { cs: 5, irq: 1, reset: 0, ..ESP32_C3 }, &ESP32_C3), 20);
        assert_eq!(fast_mhz(&Pins { miso: 5, ..ESP32_C3 }, &ESP32_C3), 10);
    }
}
