//! The clock of the SPI bus for a wiring of the DW1000. The table of `wire::config::Board` has the default pins, and
//! the pins that a record may name.

use wire::config::Pins;

/// The fast clock of the bus, MHz. It is 20 MHz, the DW1000's maximum, if SCK, MOSI and MISO are the SPI peripheral's
/// own pins, as they are by default. Other pins go through the chip's crossbar, which may delay an incoming bit by 25
/// ns. At 20 MHz there are 25 ns from one edge to the next, and the DW1000 needs 12 of them (data sheet, SPI timing):
/// no time would be left. At 10 MHz there are 50 ns.
pub fn fast_mhz(pins: &Pins, default: &Pins) -> u32 {
    let data = |pins: &Pins| (pins.sck, pins.mosi, pins.miso);
    if data(pins) == data(default) { 20 } else { 10 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The default pins of an ESP32-C3.
    const OWN: Pins = Pins { sck: 6, mosi: 7, miso: 2, cs: 10, irq: 4, reset: 3 };

    #[test]
    fn other_pins_than_the_peripherals_own_are_clocked_more_slowly() {
        assert_eq!(fast_mhz(&OWN, &OWN), 20);
        assert_eq!(fast_mhz(&Pins { cs: 5, irq: 1, reset: 0, ..OWN }, &OWN), 20);
        assert_eq!(fast_mhz(&Pins { miso: 5, ..OWN }, &OWN), 10);
    }
}
