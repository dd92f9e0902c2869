//! Driver for the DW1000: async over an SPI device, an interrupt pin, a reset line and a delay.
//!
//! [`Dw1000::init`] resets the chip, loads its first-path detector and writes the [`Config`]; then the driver is a
//! [`Radio`]. Register facts are the DW1000 user manual's, version 2.12, whose sections are named where they are used.
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
//! Every transaction is one operation on one buffer. Of a transmission at an instant, all up to the command must be done in time:
//! the frame, the instant, the command; with a receiver that was listening, its end before them. The buffer of the frame that is
//! answered goes back after the command. A frame's two check bytes are
//! neither written nor read. The configuration is written by [`Dw1000::init`] and
//! [`Dw1000::configure`] only. The tests count all of this.
//!
//! # One frame after another
//!
//! Both receive buffers of the chip are in use, and the driver re-enables the receiver itself, because the chip's own
//! re-enabling can spoil the next time stamp (and Decawave's software avoids it). Upon a frame the driver reads the
//! status and the six bytes that are not double-buffered (carrier integrator, unsaturated preamble count), and switches
//! the receiver on: three transactions, 16 bytes, 16 µs at 8 MHz. Only then it reads the frame, the time stamp and the
//! quality, of which each buffer has its own, and the next operation gives the buffer back. With one buffer all must be read before. On
//! simulated chips with the DWM1001's bus, frames of 27 bytes from several senders are heard with their whole preambles
//! from 250 µs after one another on; with one buffer, from 330 µs on.
//!
//! The chip's overrun, which corrupts frames already received, cannot happen: the receiver stops after each frame, and
//! the host switches it on again only when it has given the buffer of the frame before back. Host and chip are checked
//! to point at different buffers upon each frame (if not, the frame counts as corrupt), and they are together again before the
//! next reception: after every stop, and while a transmission that cut a reception off is under way.
//!
//! # Every wait ends
//!
//! Windows are timed by the chip where its timer can hold them, and by the delay in any case; a transmission that
//! reports nothing is looked up in the chip. An operation that failed, or whose future was dropped, leaves the driver
//! knowing that it does not know: the next one first stops the chip's transceiver and resets its receiver.
//!
//! # What a node takes
//!
//! [`Radio::pace`] tells when the command of a transmission at an instant was in, by the chip's own clock, which is read once it
//! is: the node waits for the frame to leave anyway. When the receiver was on again after a frame costs a transaction that the
//! next frame may be short of, and is measured once in sixteen frames.
//!
//! # Without an executor
//!
//! A future of this driver runs to its end under any `block_on` over pins and delays that poll:
//!
//! ```
//! use core::{convert::Infallible, future::poll_fn, task::Poll};
//! use embedded_hal::digital::{ErrorType, InputPin};
//! use embedded_hal_async::digital::Wait;
//! use baliza_dw1000::driver::{ClockedSpi, Config, Dw1000, Error, ResetLine};
//! use baliza_dw1000::{PhyConfig, Radio, RadioInstant};
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

pub use bus::{ClockedSpi, ResetLine, SpiClock, Traffic};
pub use configuration::{Config, DEFAULT_ANTENNA_DELAY, FrameFilter, TxPower, default_antenna_delay};
pub use sleep::{Wake, WakeBy};

use crate::radio::{MAX_FRAME, Pace, ResponseWindow, Sample, Sensors};
use crate::{Radio, RadioDuration, RadioInstant, ReceiveError, Restart, RxFrame, Start, TransmitError};
use bus::Bus;
use register::{self as reg, status};

/// What bus or chip failed with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Error<E> {
    /// The SPI bus.
    Bus(E),
    /// The interrupt pin.
    InterruptPin,
    /// This answered in place of a DW1000: all ones or zeros if nothing did.
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

/// What the chip's transceiver does, as far as the driver knows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Transceiver {
    /// Not initialised, or asleep.
    NotReady,
    /// An operation failed or was abandoned in the middle.
    Unknown,
    /// Idle.
    Off,
    /// The receiver is on.
    Listening,
}

/// What has become of the receiver after a reception that was cut off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Receiver {
    /// Fit for the next frame.
    Sound,
    /// It met an error or a timeout: to be reset before the next frame.
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
    /// The frame length in TX_FCTRL, so that it is written when it changes only.
    tx_length: u8,
    /// RX_FWTO, and whether SYS_CFG has it enabled: likewise.
    rx_timer: u16,
    rx_timer_on: bool,
    /// What the chip's maker measured on it.
    factory: startup::Factory,
    /// By how much the antenna delays differ from those calibrated, ticks: what temperature and supply make of them.
    delay_drift: i16,
    /// Whether the last frame's buffer is still the host's.
    holds_buffer: bool,
    /// What the last operation measured of the node.
    pace: Pace,
    /// Frames after which the receiver was switched on again: one of [`receive::PACE_EVERY`] is timed.
    kept_listening: u8,
    /// What waking takes, as seen last, microseconds.
    waking_us: u32,
}

impl<S, I, R, D> Dw1000<S, I, R, D>
where
    S: ClockedSpi,
    I: Wait,
    R: ResetLine,
    D: DelayNs,
{
    /// A driver of a chip that nothing is known of yet; [`init`](Self::init) comes next.
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

    /// Transactions and bytes since the driver was made.
    pub fn traffic(&self) -> Traffic {
        self.bus.traffic
    }

    /// The bus, reset line and the rest, given back.
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

    /// Switches transmitter and receiver off, forgets what happened and resets the receiver, without which the next
    /// time stamp after an error or timeout may be wrong (4.1.6); puts host and chip at the same receive buffer
    /// (4.3.2).
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
                // HPDWARN and TXPUTE would make the next start at an instant look late.
                (reg::SYS_STATUS, &[0xFF; 5]),
                (reg::PMSC_CTRL0.plus(3), &[startup::RESET_RECEIVER]),
                (reg::PMSC_CTRL0.plus(3), &[startup::RESET_NOTHING]),
            ])
            .await
    }

    /// Switches a receiver off that listens. What it heard last is to be cleared before it is on again, by
    /// [`clear_reception`](Self::clear_reception); a transmission may come first.
    async fn cut_reception(&mut self) -> Result<(), Error<S::Error>> {
        self.transceiver = Transceiver::Unknown;
        self.bus.write(reg::SYS_CTRL, &[reg::sys_ctrl::TRXOFF]).await
    }

    /// Clears what a reception left that was cut off: usually nothing. A frame that was received unseen is given up, so that host
    /// and chip are at the same receive buffer again (4.3.2). A receiver that met an error is to be reset (4.1.6), which is not
    /// done here: a transmission may be under way.
    async fn clear_reception(&mut self, flags: u32) -> Result<Receiver, Error<S::Error>> {
        if flags & (status::RECEPTIONS | status::LDEDONE) != 0 {
            // Not the transmitter's, which are in the first byte.
            self.bus.write(reg::SYS_STATUS.plus(1), &[0xFF; 3]).await?;
        }
        if receive::buffers_differ(flags) {
            self.change_buffer().await?;
        }
        let spoilt = flags & (status::RX_ERRORS | status::RX_TIMEOUTS) != 0;
        Ok(if spoilt { Receiver::Spoilt } else { Receiver::Sound })
    }

    /// The host goes on to the other receive buffer.
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

/// The microseconds of a span, rounded up; none if it is negative.
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

    async fn now(&mut self) -> Result<RadioInstant, Self::Error> {
        self.clock().await
    }

    fn departure(&self, at: RadioInstant) -> RadioInstant {
        let [delay, _] = self.antenna_delays();
        at.snapped().plus(RadioDuration::from_ticks(delay.into()))
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
