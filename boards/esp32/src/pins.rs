//! How fast the bus can be where a DW1000 is wired. Default pins, and those that a record may name, are in `wire::config::Board`'s table.

use wire::config::Pins;

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

    /// The default of an ESP32-C3.
    const OWN: Pins = Pins { sck: 6, mosi: 7, miso: 2, cs: 10, irq: 4, reset: 3 };

    #[test]
    fn other_pins_than_the_peripherals_own_are_clocked_more_slowly() {
        assert_eq!(fast_mhz(&OWN, &OWN), 20);
        assert_eq!(fast_mhz(&Pins { cs: 5, irq: 1, reset: 0, ..OWN }, &OWN), 20);
        assert_eq!(fast_mhz(&Pins { miso: 5, ..OWN }, &OWN), 10);
    }
}
