//! A character display of two lines of sixteen, with a controller like the ST7036, on a bus that only writes.
//!
//! Text → commands and characters: bytes with the register line low are commands, bytes with the line high are
//! characters (ST7036 data sheet, 8). Only lines that have changed are written. The display is not cleared before, so
//! that it does not flicker.

use embedded_hal::digital::OutputPin;
use embedded_hal::spi::SpiBus;
use embedded_hal_async::delay::DelayNs;

/// The characters of a line.
pub const WIDTH: usize = 16;

/// The text of both lines.
pub type Text = [[u8; WIDTH]; 2];

/// An empty display.
pub const EMPTY: Text = [[b' '; WIDTH]; 2];

/// The start sequence: 8-bit interface with two lines and instruction table 1, bias, contrast, booster, follower; table
/// 0, display on, clear, cursor moves right. The values are the board maker's.
const START: [u8; 9] = [0x39, 0x14, 0x55, 0x6D, 0x78, 0x38, 0x0C, 0x01, 0x06];
/// The commands for the cursor's home position and for a clear display. Each takes the controller 1.08 ms. Every other
/// command takes 27 µs, which is a byte on the bus.
const HOME: u8 = 0x02;
const CLEAR: u8 = 0x01;
const SLOW_MS: u32 = 2;
/// The command for the address of the next character. The second line begins at 0x40.
const ADDRESS: u8 = 0x80;
const LINES: [u8; 2] = [0x00, 0x40];
/// From power-on to the first command.
const POWER_MS: u32 = 40;

/// Why the text is not shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Error<S, P> {
    /// The bus failed.
    Bus(S),
    /// A pin failed.
    Pin(P),
}

/// The display.
pub struct Lcd<S, P> {
    spi: S,
    /// The select line: low while bytes are for the display.
    select: P,
    /// The register line: high for characters, low for commands.
    register: P,
    /// The text on the display.
    shown: Text,
}

impl<S: SpiBus, P: OutputPin> Lcd<S, P> {
    /// A display in an unknown state. [`start`](Self::start) must be called next. `spi` has mode 3 and at most 300 kHz,
    /// so that a byte takes as long as a command. `select` is high.
    pub fn new(spi: S, select: P, register: P) -> Self {
        Self { spi, select, register, shown: EMPTY }
    }

    /// Sets the controller up and clears the display.
    ///
    /// # Errors
    /// The bus or a pin fails.
    pub async fn start(&mut self, delay: &mut impl DelayNs) -> Result<(), Error<S::Error, P::Error>> {
        delay.delay_ms(POWER_MS).await;
        self.write(false, &START)?;
        delay.delay_ms(SLOW_MS).await;
        for command in [HOME, CLEAR] {
            self.write(false, &[command])?;
            delay.delay_ms(SLOW_MS).await;
        }
        self.shown = EMPTY;
        Ok(())
    }

    /// Shows a text.
    ///
    /// # Errors
    /// The bus or a pin fails.
    pub fn show(&mut self, text: &Text) -> Result<(), Error<S::Error, P::Error>> {
        for (i, (line, address)) in text.iter().zip(LINES).enumerate() {
            if self.shown.get(i) != Some(line) {
                self.write(false, &[ADDRESS | address])?;
                self.write(true, line)?;
            }
        }
        self.shown = *text;
        Ok(())
    }

    fn write(&mut self, characters: bool, bytes: &[u8]) -> Result<(), Error<S::Error, P::Error>> {
        self.register.set_state(characters.into()).map_err(Error::Pin)?;
        self.select.set_low().map_err(Error::Pin)?;
        // The flush ensures that the last byte has been sent before the display is deselected.
        let written = self.spi.write(bytes).and_then(|()| self.spi.flush()).map_err(Error::Bus);
        self.select.set_high().map_err(Error::Pin)?;
        written
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::cell::RefCell;
    use core::convert::Infallible;
    use embedded_hal::digital;
    use embedded_hal::spi;
    use std::vec::Vec;

    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    enum Seen {
        Register(bool),
        Select(bool),
        Byte(u8),
        Wait(u32),
    }
    use Seen::{Byte, Register, Select, Wait};

    type Log = RefCell<Vec<Seen>>;

    struct Wire<'l>(&'l Log);
    struct Pin<'l>(&'l Log, fn(bool) -> Seen);
    struct Clock<'l>(&'l Log);

    impl spi::ErrorType for Wire<'_> {
        type Error = Infallible;
    }

    impl SpiBus for Wire<'_> {
        fn read(&mut self, _: &mut [u8]) -> Result<(), Infallible> {
            unreachable!("the bus only writes")
        }
        fn write(&mut self, words: &[u8]) -> Result<(), Infallible> {
            self.0.borrow_mut().extend(words.iter().map(|byte| Byte(*byte)));
            Ok(())
        }
        fn transfer(&mut self, _: &mut [u8], _: &[u8]) -> Result<(), Infallible> {
            unreachable!("the bus only writes")
        }
        fn transfer_in_place(&mut self, _: &mut [u8]) -> Result<(), Infallible> {
            unreachable!("the bus only writes")
        }
        fn flush(&mut self) -> Result<(), Infallible> {
            Ok(())
        }
    }

    impl digital::ErrorType for Pin<'_> {
        type Error = Infallible;
    }

    impl OutputPin for Pin<'_> {
        fn set_low(&mut self) -> Result<(), Infallible> {
            self.0.borrow_mut().push(self.1(false));
            Ok(())
        }
        fn set_high(&mut self) -> Result<(), Infallible> {
            self.0.borrow_mut().push(self.1(true));
            Ok(())
        }
    }

    impl DelayNs for Clock<'_> {
        async fn delay_ns(&mut self, ns: u32) {
            self.0.borrow_mut().push(Wait(ns / 1_000_000));
        }
        async fn delay_ms(&mut self, ms: u32) {
            self.0.borrow_mut().push(Wait(ms));
        }
    }

    fn display(log: &Log) -> Lcd<Wire<'_>, Pin<'_>> {
        Lcd::new(Wire(log), Pin(log, Select), Pin(log, Register))
    }

    /// A transaction as it is seen on the wires.
    fn transaction(characters: bool, bytes: &[u8]) -> Vec<Seen> {
        let mut seen = Vec::from([Register(characters), Select(false)]);
        seen.extend(bytes.iter().map(|byte| Byte(*byte)));
        seen.push(Select(true));
        seen
    }

    #[test]
    fn the_start_is_the_board_makers() {
        let log = Log::default();
        embassy_futures::block_on(display(&log).start(&mut Clock(&log))).unwrap();
        let mut expected = Vec::from([Wait(40)]);
        expected.extend(transaction(false, &[0x39, 0x14, 0x55, 0x6D, 0x78, 0x38, 0x0C, 0x01, 0x06]));
        expected.push(Wait(2));
        expected.extend(transaction(false, &[0x02]));
        expected.push(Wait(2));
        expected.extend(transaction(false, &[0x01]));
        expected.push(Wait(2));
        assert_eq!(log.into_inner(), expected);
    }

    #[test]
    fn lines_go_to_their_addresses() {
        let log = Log::default();
        display(&log).show(&[*b"LAST:   12.34 m ", *b"AVG8:   12.30 m "]).unwrap();
        let mut expected = transaction(false, &[0x80]);
        expected.extend(transaction(true, b"LAST:   12.34 m "));
        expected.extend(transaction(false, &[0xC0]));
        expected.extend(transaction(true, b"AVG8:   12.30 m "));
        assert_eq!(log.into_inner(), expected);
    }

    #[test]
    fn only_what_has_changed_is_written() {
        let log = Log::default();
        let mut lcd = display(&log);
        lcd.show(&[*b"    AWAITING    ", *b"      POLL      "]).unwrap();
        log.borrow_mut().clear();
        lcd.show(&[*b"    AWAITING    ", *b"    RESPONSE    "]).unwrap();
        let mut expected = transaction(false, &[0xC0]);
        expected.extend(transaction(true, b"    RESPONSE    "));
        assert_eq!(*log.borrow(), expected);
        log.borrow_mut().clear();
        lcd.show(&[*b"    AWAITING    ", *b"    RESPONSE    "]).unwrap();
        assert_eq!(*log.borrow(), []);
    }
}
