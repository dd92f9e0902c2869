//! Driver for the DW1000: async over an SPI device, an interrupt pin, a reset line and a delay.
//!
//! [`Dw1000::init`] resets the chip, loads its first-path detector and writes the [`Config`]; then the driver is a
//! [`Radio`]. Register facts are from the DW1000 user manual, version 2.12. The comments name its sections.
//!
//! # What goes over the bus
//!
//! | operation | transactions | bytes beside the frame's |
//! |---|---|---|
//! | send now, same length as before | 5 | 13 |
//! | send at an instant, same length as before | 7 | 25 |
//! | …with another length than before | +1 | +3 |
//! | …with a receiver that was listening: at an instant | +1 | +2 |
//! | …and now | +2 | +8 |
//! | switch the receiver on, same wait as before | 1 | 3 |
//! | …with another wait in the chip's timer | +1 | +3 |
//! | …between a wait the timer can hold (67 ms) and a longer one | +1 | +3 |
//! | …at an instant | +3 | +15 |
//! | receive a frame | 6 | 38 |
//! | …and keep listening | 7 | 41 |
//! | …one frame in sixteen of these | +1 | +6 |
//! | …give its buffer back, in the next operation | +2 | +6 |
//! | the end of a window, by the chip's timer | 4 | 17 |
//! | …by the delay | 6 | 22 |
//! | switch a receiver off that listens | 2 | 7 |
//! | stop after a failure | 5 | 17 |
//! | read its impulse response, 152 samples, once the receiver is off | 9 | 638 |
//! | measure temperature and supply, once it is off: 1 ms | 7 | 19 |
//! | …and write the antenna delays that follow, where they changed | +2 | +8 |
//!
//! Every transaction is one operation on one buffer. For a transmission at an instant, these transactions must be
//! finished in time, up to the command: the frame, the instant, the command. If the receiver was listening, it is
//! stopped before them. The buffer of the frame that is answered is released after the command. A frame's two check
//! bytes are neither written nor read. Only [`Dw1000::init`] and [`Dw1000::configure`] write the configuration. The
//! tests count all of this.
//!
//! # One frame after another
//!
//! Both receive buffers of the chip are in use. The driver re-enables the receiver itself, because the chip's own
//! re-enabling can spoil the next timestamp (Decawave's software avoids it, too). After a frame the driver reads the
//! status and the six bytes that are not double-buffered (carrier integrator, unsaturated preamble count), and switches
//! the receiver on: three transactions, 16 bytes, 16 µs at 8 MHz. Only then does it read the frame, the timestamp and
//! the quality, which each buffer has for itself. The next operation releases the buffer. With one buffer, all of this
//! must be read before the receiver is on. On simulated chips with the DWM1001's bus, frames of 27 bytes from several
//! senders are received with their whole preambles if they are at least 250 µs apart; with one buffer, at least 330 µs.
//!
//! The chip's overrun, which corrupts frames already received, cannot happen: the receiver stops after each frame, and
//! the host switches it on again only when it has released the buffer of the frame before. After each frame the driver
//! checks that host and chip point at different buffers; if not, the frame counts as corrupt. Both point at the same
//! buffer again before the next reception: after every stop, and during a transmission that interrupted a reception.
//!
//! # Every wait ends
//!
//! The chip times a window if its timer can hold it, and the delay times it in any case. If a transmission does not
//! report its end, the driver reads the chip's status. After an operation that failed, or whose future was dropped, the
//! driver marks the chip's state as unknown: the next operation first stops the chip's transceiver and resets its
//! receiver.
//!
//! # What a node takes
//!
//! [`Radio::pace`] reports when the chip had received the command of a transmission at an instant, by the chip's own
//! clock. The driver reads this clock after the command: the node waits for the frame to leave anyway. To measure when
//! the receiver was on again after a frame takes a transaction, which may delay the next frame. So the driver measures
//! it once in sixteen frames.
//!
//! # Without an executor
//!
//! A future of this driver runs to its end under any `block_on`, if its pins and delays use polling:
//!
//! ```
//! use core::{convert::Infallible, future::poll_fn, task::Poll};
//! use embedded_hal::digital::{ErrorType, InputPin};
//! use embedded_hal_async::digital::Wait;
//! use baliza_dw1000::driver::{ClockedSpi, Dw1000, Error, ResetLine};
//! use radio::{Config, PhyConfig, Radio, RadioInstant};
//!
//! /// An interrupt pin without interrupts.
//! struct Polled<P>(P);
//!
//! impl<P: InputPin<Error = Infallible>> ErrorType for Polled<P> {
//!     type Error = Infallible;
//! }
//!
//! impl<P: InputPin<Error = Infallible>> Wait for Polled<P> {
//!     async fn wait_for_high(&mut self) -> Result<(), Infallible> {
//!         poll_fn(|context| match self.0.is_high() {
//!             Ok(true) => Poll::Ready(Ok(())),
//!             Ok(false) => {
//!                 context.waker().wake_by_ref();
//!                 Poll::Pending
//!             }
//!             Err(never) => match never {},
//!         })
//!         .await
//!     }
//! #   async fn wait_for_low(&mut self) -> Result<(), Infallible> { Ok(()) }
//! #   async fn wait_for_rising_edge(&mut self) -> Result<(), Infallible> { Ok(()) }
//! #   async fn wait_for_falling_edge(&mut self) -> Result<(), Infallible> { Ok(()) }
//! #   async fn wait_for_any_edge(&mut self) -> Result<(), Infallible> { Ok(()) }
//!     // … and the other waits, which the driver does not use.
//! }
//!
//! fn clock_of<S, P, R, D>(spi: S, irq: P, reset: R, delay: D) -> Result<RadioInstant, Error<S::Error>>
//! where
//!     S: ClockedSpi,
//!     P: InputPin<Error = Infallible>,
//!     R: ResetLine,
//!     D: embedded_hal_async::delay::DelayNs,
//! {
//!     let mut radio = Dw1000::new(spi, Polled(irq), reset, delay, Config::new(PhyConfig::FAST));
//!     embassy_futures::block_on(async {
//!         radio.init().await?;
//!         radio.now().await
//!     })
//! }
//! ```

mod accumulator;
mod bus;
mod configuration;
mod diagnostics;
mod receive;
mod register;
mod sensors;
mod sleep;
mod startup;
mod transmit;
mod tuning;

#[cfg(test)]
mod tests;

use embedded_hal_async::{delay::DelayNs, digital::Wait};

pub use bus::{ClockedSpi, ResetLine, SpiClock, Traffic, fastest_clock};
pub use configuration::{DEFAULT_ANTENNA_DELAY, default_antenna_delay};
pub use sleep::{Wake, WakeBy};

use bus::Bus;
use radio::{
    Capabilities, Config, MAX_FRAME, Pace, Radio, RadioDuration, RadioInstant, RangeBias, ReceiveError, ResponseWindow,
    Restart, RxFrame, Sample, Sensors, Start, TransmitError,
};

use crate::bias;
use register::{self as reg, status};

/// An error of the bus or the chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Error<E> {
    /// The SPI bus.
    Bus(E),
    /// The interrupt pin.
    InterruptPin,
    /// This value was read in place of a DW1000's identifier: all ones or zeros if no chip answered.
    WrongChip(u32),
    /// The chip's clock PLL did not lock.
    PllNotLocked,
    /// The chip was not initialised, or sleeps.
    NotReady,
}

impl<E> From<E> for Error<E> {
    fn from(error: E) -> Self {
        Self::Bus(error)
    }
}

/// What a board gives to the driver.
pub struct Parts<S, I, R, D> {
    /// The SPI bus with the chip's select line.
    pub bus: S,
    /// The interrupt line: high while the chip has an event to report.
    pub interrupt: I,
    /// The reset line, RSTn.
    pub reset: R,
    /// The delay that the driver waits with.
    pub delay: D,
}

impl<S: ClockedSpi, I: Wait, R: ResetLine, D: DelayNs> Parts<S, I, R, D> {
    /// The driver.
    pub fn radio(self, config: Config) -> Dw1000<S, I, R, D> {
        Dw1000::new(self.bus, self.interrupt, self.reset, self.delay, config)
    }
}

/// The state of the chip's transceiver, as far as the driver knows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Transceiver {
    /// Not initialised, or asleep.
    NotReady,
    /// An operation failed or was dropped before its end.
    Unknown,
    /// Idle.
    Off,
    /// The receiver is on.
    Listening,
}

/// The state of the receiver after an interrupted reception.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Receiver {
    /// Ready for the next frame.
    Sound,
    /// It had an error or a timeout: it must be reset before the next frame.
    Spoilt,
}

/// A DW1000 on an SPI device, with its interrupt pin, reset line and a delay.
pub struct Dw1000<S, I, R, D> {
    bus: Bus<S>,
    irq: I,
    reset: R,
    delay: D,
    config: Config,
    transceiver: Transceiver,
    /// The frame length in TX_FCTRL: it is written only when it changes.
    tx_length: u8,
    /// RX_FWTO, and whether SYS_CFG enables it: written only when they change.
    rx_timer: u16,
    rx_timer_on: bool,
    /// What the chip's maker measured on it.
    factory: startup::Factory,
    /// The difference of the antenna delays from the calibrated ones, ticks, caused by temperature and supply.
    delay_drift: i16,
    /// Whether the host still holds the last frame's buffer.
    holds_buffer: bool,
    /// What the last operation measured of the node.
    pace: Pace,
    /// Frames after which the receiver was switched on again: one of [`receive::PACE_EVERY`] is timed.
    kept_listening: u8,
    /// The last measured time of waking, microseconds.
    waking_us: u32,
}

impl<S, I, R, D> Dw1000<S, I, R, D>
where
    S: ClockedSpi,
    I: Wait,
    R: ResetLine,
    D: DelayNs,
{
    /// A driver for a chip in an unknown state. Call [`init`](Self::init) next.
    pub fn new(spi: S, irq: I, reset: R, delay: D, config: Config) -> Self {
        Self {
            bus: Bus::new(spi),
            irq,
            reset,
            delay,
            config,
            transceiver: Transceiver::NotReady,
            tx_length: 0,
            rx_timer: 0,
            rx_timer_on: false,
            factory: startup::Factory::default(),
            delay_drift: 0,
            holds_buffer: false,
            pace: Pace::default(),
            kept_listening: 0,
            waking_us: sleep::WAKING_US,
        }
    }

    /// The configuration.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Transactions and bytes since the driver was created.
    pub fn traffic(&self) -> Traffic {
        self.bus.traffic
    }

    /// Returns the bus, the reset line and the rest.
    pub fn release(self) -> (S, I, R, D) {
        (self.bus.spi, self.irq, self.reset, self.delay)
    }

    /// Stops a transceiver that is on or in an unknown state.
    async fn ensure_off(&mut self) -> Result<(), Error<S::Error>> {
        match self.transceiver {
            Transceiver::NotReady => Err(Error::NotReady),
            Transceiver::Unknown => self.stop().await,
            Transceiver::Listening => {
                self.cut_reception().await?;
                self.give_buffer_back().await?;
                let flags = self.status().await?;
                match self.clear_reception(flags).await? {
                    Receiver::Sound => self.transceiver = Transceiver::Off,
                    Receiver::Spoilt => self.stop().await?,
                }
                Ok(())
            }
            Transceiver::Off => self.give_buffer_back().await,
        }
    }

    /// Switches transmitter and receiver off, clears all flags and resets the receiver. Without the reset, the next
    /// timestamp after an error or timeout may be wrong (4.1.6). Sets host and chip to the same receive buffer (4.3.2).
    async fn stop(&mut self) -> Result<(), Error<S::Error>> {
        self.transceiver = Transceiver::Unknown;
        self.bus.write(reg::SYS_CTRL, &[reg::sys_ctrl::TRXOFF]).await?;
        self.give_buffer_back().await?;
        self.reset_receiver().await?;
        let [pointers] = self.bus.read(reg::SYS_STATUS.plus(3)).await?;
        if receive::buffers_differ(u32::from(pointers) << 24) {
            self.change_buffer().await?;
        }
        self.transceiver = Transceiver::Off;
        Ok(())
    }

    /// Clears all five bytes of the status and resets the receiver, which is off.
    async fn reset_receiver(&mut self) -> Result<(), Error<S::Error>> {
        self.bus
            .write_each(&[
                // HPDWARN and TXPUTE would make the next start at an instant appear late.
                (reg::SYS_STATUS, &[0xFF; 5]),
                (reg::PMSC_CTRL0.plus(3), &[startup::RESET_RECEIVER]),
                (reg::PMSC_CTRL0.plus(3), &[startup::RESET_NOTHING]),
            ])
            .await
    }

    /// Switches a listening receiver off. Flags of its last reception must be cleared by
    /// [`clear_reception`](Self::clear_reception) before it is on again; a transmission may come first.
    async fn cut_reception(&mut self) -> Result<(), Error<S::Error>> {
        self.transceiver = Transceiver::Unknown;
        self.bus.write(reg::SYS_CTRL, &[reg::sys_ctrl::TRXOFF]).await
    }

    /// Clears the flags of an interrupted reception, usually none. A received frame that was not read is dropped, so
    /// that host and chip are at the same receive buffer again (4.3.2). A receiver with an error must be reset (4.1.6).
    /// This function does not reset it, because a transmission may be in progress.
    async fn clear_reception(&mut self, flags: u32) -> Result<Receiver, Error<S::Error>> {
        if flags & (status::RECEPTIONS | status::LDEDONE) != 0 {
            // Not the transmitter's flags, which are in the first byte.
            self.bus.write(reg::SYS_STATUS.plus(1), &[0xFF; 3]).await?;
        }
        if receive::buffers_differ(flags) {
            self.change_buffer().await?;
        }
        let spoilt = flags & (status::RX_ERRORS | status::RX_TIMEOUTS) != 0;
        Ok(if spoilt { Receiver::Spoilt } else { Receiver::Sound })
    }

    /// The host changes to the other receive buffer.
    async fn change_buffer(&mut self) -> Result<(), Error<S::Error>> {
        self.bus.write(reg::SYS_CTRL.plus(3), &[reg::sys_ctrl::HRBPT]).await
    }

    async fn status(&mut self) -> Result<u32, Error<S::Error>> {
        Ok(u32::from_le_bytes(self.bus.read(reg::SYS_STATUS).await?))
    }

    async fn clock(&mut self) -> Result<RadioInstant, Error<S::Error>> {
        if self.transceiver == Transceiver::NotReady {
            return Err(Error::NotReady);
        }
        Ok(RadioInstant::from_le_bytes(self.bus.read(reg::SYS_TIME).await?))
    }
}

/// The microseconds of a duration, rounded up; 0 if it is negative.
fn micros(span: RadioDuration) -> u32 {
    let ticks = u64::try_from(span.ticks()).unwrap_or(0);
    // 63 897.6 ticks a microsecond.
    u32::try_from(ticks.saturating_mul(10).div_ceil(638_976)).unwrap_or(u32::MAX)
}

impl<S, I, R, D> Radio for Dw1000<S, I, R, D>
where
    S: ClockedSpi,
    I: Wait,
    R: ResetLine,
    D: DelayNs,
    S::Error: core::fmt::Debug,
{
    type Error = Error<S::Error>;

    const CAPABILITIES: Capabilities = crate::CAPABILITIES;

    async fn now(&mut self) -> Result<RadioInstant, Self::Error> {
        self.clock().await
    }

    fn antenna_delay(&self) -> RadioDuration {
        let [delay, _] = self.antenna_delays();
        RadioDuration::from_ticks(delay.into())
    }

    fn range_bias(&self) -> RangeBias {
        bias::of(&self.config.phy)
    }

    async fn transmit(
        &mut self,
        frame: &[u8],
        start: Start,
        listen: bool,
    ) -> Result<RadioInstant, TransmitError<Self::Error>> {
        self.send(frame, start, listen).await
    }

    async fn receive<'b>(
        &mut self,
        buffer: &'b mut [u8; MAX_FRAME],
        start: Start,
        window: RadioDuration,
        keep_listening: bool,
    ) -> Result<RxFrame<'b>, ReceiveError<Self::Error>> {
        self.hear(buffer, start, window, keep_listening).await
    }

    async fn idle(&mut self) -> Result<(), Self::Error> {
        self.ensure_off().await
    }

    fn pace(&self) -> Pace {
        self.pace
    }

    async fn compensate(&mut self) -> Result<Option<Sensors>, Self::Error> {
        self.compensate_delays().await.map(Some)
    }

    async fn impulse_response(
        &mut self,
        window: ResponseWindow,
        take: impl FnMut(Sample),
    ) -> Result<Option<u16>, Self::Error> {
        match self.transceiver {
            Transceiver::Off => self.read_accumulator(window, take).await.map(Some),
            Transceiver::Unknown | Transceiver::Listening => Ok(None),
            Transceiver::NotReady => Err(Error::NotReady),
        }
    }
}

impl<S, I, R, D> Restart for Dw1000<S, I, R, D>
where
    S: ClockedSpi,
    I: Wait,
    R: ResetLine,
    D: DelayNs,
    S::Error: core::fmt::Debug,
{
    async fn restart(&mut self) -> Result<(), Self::Error> {
        self.init().await
    }

    async fn sleep(&mut self, micros: u32, roused: impl Future<Output = ()>) -> Result<bool, Self::Error> {
        self.sleep_for(micros, roused).await
    }
}
