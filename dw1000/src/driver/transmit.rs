//! Sending a frame: buffer, length, time, start; then the interrupt (DW1000 user manual, 3).

use core::pin::pin;

use embassy_futures::select::{Either, select};
use embedded_hal_async::{delay::DelayNs, digital::Wait};

use super::bus::{ClockedSpi, ResetLine};
use super::register::{self as reg, status, sys_ctrl};
use super::{Dw1000, Error, Receiver, Transceiver, configuration, micros};
use radio::{MAX_FRAME, Pace, Radio, RadioDuration, RadioInstant, Start, TransmitError};

/// The check bytes that the chip adds.
const CHECK_BYTES: u8 = 2;
/// How long after a frame's last pulse the driver checks the chip for the missing interrupt.
const PATIENCE_US: u32 = 5_000;

impl<S, I, R, D> Dw1000<S, I, R, D>
where
    S: ClockedSpi,
    S::Error: core::fmt::Debug,
    I: Wait,
    R: ResetLine,
    D: DelayNs,
{
    pub(super) async fn send(
        &mut self,
        frame: &[u8],
        start: Start,
        listen: bool,
    ) -> Result<RadioInstant, TransmitError<Error<S::Error>>> {
        let length = match u8::try_from(frame.len()) {
            Ok(length) if frame.len() <= MAX_FRAME => length + CHECK_BYTES,
            _ => return Err(TransmitError::TooLong),
        };
        self.pace = Pace::default();
        // A listening receiver must only be switched off before the start. For a receiver that is off, nothing is
        // needed.
        let listened = self.transceiver == Transceiver::Listening;
        match self.transceiver {
            Transceiver::Listening => self.cut_reception().await?,
            Transceiver::Off => {}
            Transceiver::NotReady | Transceiver::Unknown => self.ensure_off().await?,
        }
        self.transceiver = Transceiver::Unknown;
        self.load(frame, length).await?;
        if listen {
            // The receiver that follows has no window yet.
            self.set_rx_timer(None).await?;
        }
        let receiver = self.start_transmitter(start, listen, listened).await?;
        self.await_sent(start, length).await?;
        // Only the transmitter's flags, because the receiver may already have set its own.
        self.bus.write(reg::SYS_STATUS, &[0xF8]).await?;
        let departed = match start {
            Start::Now => RadioInstant::from_le_bytes(self.bus.read(reg::TX_TIME).await?),
            Start::At(at) => self.departure(at),
        };
        match (receiver, listen) {
            (Receiver::Sound, true) => self.transceiver = Transceiver::Listening,
            (Receiver::Sound, false) => self.transceiver = Transceiver::Off,
            (Receiver::Spoilt, true) => {
                self.stop().await?;
                self.enable_receiver().await?;
            }
            (Receiver::Spoilt, false) => self.stop().await?,
        }
        Ok(departed)
    }

    async fn load(&mut self, frame: &[u8], length: u8) -> Result<(), Error<S::Error>> {
        self.bus.write(reg::TX_BUFFER, frame).await?;
        if length != self.tx_length {
            let [low, high, ..] = configuration::tx_fctrl(&self.config, length).to_le_bytes();
            self.bus.write(reg::TX_FCTRL, &[low, high]).await?;
            self.tx_length = length;
        }
        Ok(())
    }

    /// Starts the transmitter, releases the last frame's buffer, and clears the flags that came after that frame if the
    /// receiver `listened`. There is time for this after the command, and the next reception has not begun.
    async fn start_transmitter(
        &mut self,
        start: Start,
        listen: bool,
        listened: bool,
    ) -> Result<Receiver, TransmitError<Error<S::Error>>> {
        let listen = if listen { sys_ctrl::WAIT4RESP } else { 0 };
        match start {
            Start::Now => {
                self.bus.write(reg::SYS_CTRL, &[sys_ctrl::TXSTRT | listen]).await?;
                self.give_buffer_back().await?;
                if !listened {
                    return Ok(Receiver::Sound);
                }
            }
            Start::At(at) => {
                self.bus.write(reg::DX_TIME, &at.to_le_bytes()).await?;
                let command = sys_ctrl::TXSTRT | sys_ctrl::TXDLYS | listen;
                self.bus.write(reg::SYS_CTRL, &[command]).await?;
                self.pace.armed = Some(self.clock().await?);
                self.give_buffer_back().await?;
            }
        }
        let [flags @ .., byte_4] = self.bus.read::<5>(reg::SYS_STATUS).await?;
        let flags = u32::from_le_bytes(flags);
        let late = flags & status::HPDWARN != 0 || byte_4 & status::TXPUTE_IN_BYTE_4 != 0;
        if late && matches!(start, Start::At(_)) {
            self.stop().await?;
            return Err(TransmitError::Late);
        }
        Ok(if listened { self.clear_reception(flags).await? } else { Receiver::Sound })
    }

    /// Waits for the interrupt. If it does not come, reads the chip's status, and waits on while the start is in the
    /// future.
    async fn await_sent(&mut self, start: Start, length: u8) -> Result<(), TransmitError<Error<S::Error>>> {
        let airtime = self.config.phy.airtime(u16::from(length));
        loop {
            if self.sent_within(micros(airtime).saturating_add(PATIENCE_US)).await? {
                return Ok(());
            }
            if !self.lies_ahead(start, airtime).await? {
                self.stop().await?;
                return Err(TransmitError::NoConfirmation);
            }
        }
    }

    async fn sent_within(&mut self, microseconds: u32) -> Result<bool, Error<S::Error>> {
        let mut patience = pin!(self.delay.delay_us(microseconds));
        loop {
            let interrupted = match select(patience.as_mut(), self.irq.wait_for_high()).await {
                Either::First(()) => false,
                Either::Second(Ok(())) => true,
                Either::Second(Err(_)) => return Err(Error::InterruptPin),
            };
            let [flags] = self.bus.read(reg::SYS_STATUS).await?;
            let sent = u32::from(flags) & status::TXFRS != 0;
            if sent || !interrupted {
                return Ok(sent);
            }
            // Another event raised the line: it does not matter while a frame leaves.
            self.bus.write(reg::SYS_STATUS.plus(1), &[0xFF; 3]).await?;
        }
    }

    async fn lies_ahead(&mut self, start: Start, airtime: RadioDuration) -> Result<bool, Error<S::Error>> {
        match start {
            Start::Now => Ok(false),
            Start::At(at) => {
                let end = at.plus(airtime).plus(RadioDuration::from_micros(PATIENCE_US));
                Ok(end.since(self.clock().await?).ticks() > 0)
            }
        }
    }
}

impl<E> From<Error<E>> for TransmitError<Error<E>> {
    fn from(error: Error<E>) -> Self {
        Self::Radio(error)
    }
}
