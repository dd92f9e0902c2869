//! Receiving a frame: window, receiver on, interrupt, and the registers of one reception (DW1000 user manual, 4).

use core::pin::pin;

use embassy_futures::select::{Either, select};
use embedded_hal_async::{delay::DelayNs, digital::Wait};

use super::bus::{ClockedSpi, ResetLine};
use super::diagnostics::RawDiagnostics;
use super::register::{self as reg, status, sys_cfg, sys_ctrl};
use super::{Dw1000, Error, Transceiver, configuration, micros};
use radio::{MAX_FRAME, Pace, RadioDuration, RadioInstant, ReceiveError, RxFrame, Start};

/// Ticks in a step of the chip's frame wait timer: 512 chips, 1.026 µs (7.2.14).
const TIMER_STEP_TICKS: u64 = 512 * 128;
/// The delay ends a wait this much later than the chip's timer, because the chip's interrupt needs time.
const TIMER_MARGIN_US: u32 = 200;
/// The driver measures when the receiver is on again after one of this number of frames: this costs a transaction of
/// six bytes.
pub(super) const PACE_EVERY: u8 = 16;
/// How often the driver checks, every 10 µs, whether the first-path detector is done. The detector takes less than 100
/// µs.
const DETECTOR_PATIENCE: usize = 20;

/// Whether host and chip point at different receive buffers, as they do from a frame's end until it has been read.
pub(super) const fn buffers_differ(flags: u32) -> bool {
    (flags & status::HSRBP == 0) != (flags & status::ICRBP == 0)
}

/// The event that the status shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Event {
    Frame,
    Lost,
    Rejected,
    TimedOut,
    Nothing,
}

fn event(flags: u32) -> Event {
    if flags & (status::LDEERR | status::RXOVRR) != 0 {
        Event::Lost
    } else if flags & status::RXFCG != 0 {
        Event::Frame
    } else if flags & status::RX_ERRORS != 0 {
        Event::Lost
    } else if flags & status::RX_TIMEOUTS != 0 {
        Event::TimedOut
    } else if flags & status::AFFREJ != 0 {
        Event::Rejected
    } else {
        Event::Nothing
    }
}

impl<S, I, R, D> Dw1000<S, I, R, D>
where
    S: ClockedSpi,
    I: Wait,
    R: ResetLine,
    D: DelayNs,
{
    pub(super) async fn hear<'b>(
        &mut self,
        buffer: &'b mut [u8; MAX_FRAME],
        start: Start,
        window: RadioDuration,
        keep_listening: bool,
    ) -> Result<RxFrame<'b>, ReceiveError<Error<S::Error>>> {
        self.pace = Pace::default();
        let already_on = self.transceiver == Transceiver::Listening && start == Start::Now;
        let patience_us = if already_on {
            self.give_buffer_back().await?;
            micros(window)
        } else {
            self.ensure_off().await?;
            self.transceiver = Transceiver::Unknown;
            self.set_rx_timer(Some(window)).await?;
            let lead = self.start_receiver(start).await?;
            let margin = if self.rx_timer_on { TIMER_MARGIN_US } else { 0 };
            micros(window).saturating_add(micros(lead)).saturating_add(margin)
        };
        self.transceiver = Transceiver::Unknown;

        let flags = match self.await_event(patience_us).await? {
            (Event::Frame, flags) => self.await_first_path(flags).await?,
            (Event::Lost, flags) => flags | status::LDEERR,
            (Event::TimedOut, flags) if !buffers_differ(flags) => {
                // The chip has switched its receiver off, so no other frame can have come since.
                self.reset_receiver().await?;
                self.transceiver = Transceiver::Off;
                return Err(ReceiveError::Timeout);
            }
            (Event::TimedOut | Event::Rejected | Event::Nothing, _) => {
                self.stop().await?;
                return Err(ReceiveError::Timeout);
            }
        };
        // If a frame did not move the chip to its other buffer, the host would read the wrong buffer.
        if flags & status::LDEERR != 0 || !buffers_differ(flags) {
            self.stop().await?;
            if keep_listening {
                self.enable_receiver().await?;
            }
            return Err(ReceiveError::Corrupt);
        }
        self.take_frame(buffer, keep_listening).await
    }

    /// Switches the receiver on, now or at an instant. Returns the time until then.
    async fn start_receiver(&mut self, start: Start) -> Result<RadioDuration, ReceiveError<Error<S::Error>>> {
        match start {
            Start::Now => {
                self.enable_receiver().await?;
                Ok(RadioDuration::ZERO)
            }
            Start::At(at) => {
                self.bus.write(reg::DX_TIME, &at.to_le_bytes()).await?;
                let command = sys_ctrl::RXENAB | sys_ctrl::RXDLYE;
                self.bus.write(reg::SYS_CTRL.plus(1), &[command]).await?;
                let [byte_3] = self.bus.read(reg::SYS_STATUS.plus(3)).await?;
                if u32::from(byte_3) << 24 & status::HPDWARN != 0 {
                    self.stop().await?;
                    return Err(ReceiveError::Late);
                }
                Ok(at.since(self.clock().await?))
            }
        }
    }

    pub(super) async fn enable_receiver(&mut self) -> Result<(), Error<S::Error>> {
        self.bus.write(reg::SYS_CTRL.plus(1), &[sys_ctrl::RXENAB]).await?;
        self.transceiver = Transceiver::Listening;
        Ok(())
    }

    /// Sets the chip's own timer to a window. Switches it off for no window and for one that it cannot hold.
    pub(super) async fn set_rx_timer(&mut self, window: Option<RadioDuration>) -> Result<(), Error<S::Error>> {
        let steps =
            |window: RadioDuration| u64::try_from(window.ticks()).unwrap_or(0).max(1).div_ceil(TIMER_STEP_TICKS);
        let timer = window.and_then(|window| u16::try_from(steps(window)).ok());
        if let Some(timer) = timer.filter(|&timer| timer != self.rx_timer) {
            self.bus.write(reg::RX_FWTO, &timer.to_le_bytes()).await?;
            self.rx_timer = timer;
        }
        if timer.is_some() != self.rx_timer_on {
            let enable = if timer.is_some() { sys_cfg::RXWTOE } else { 0 };
            let [.., byte_3] = (configuration::sys_cfg(&self.config) | enable).to_le_bytes();
            self.bus.write(reg::SYS_CFG.plus(3), &[byte_3]).await?;
            self.rx_timer_on = timer.is_some();
        }
        Ok(())
    }

    /// Waits for an event or until `patience_us` have passed. Frames that the filter rejects do not count. At the end
    /// the status is read even if no interrupt came.
    async fn await_event(&mut self, patience_us: u32) -> Result<(Event, u32), Error<S::Error>> {
        let mut patience = pin!(self.delay.delay_us(patience_us));
        loop {
            let interrupted = match select(patience.as_mut(), self.irq.wait_for_high()).await {
                Either::First(()) => false,
                Either::Second(Ok(())) => true,
                Either::Second(Err(_)) => return Err(Error::InterruptPin),
            };
            let flags = u32::from_le_bytes(self.bus.read(reg::SYS_STATUS).await?);
            match event(flags) {
                happened @ (Event::Frame | Event::Lost | Event::TimedOut) => return Ok((happened, flags)),
                quiet @ (Event::Rejected | Event::Nothing) if !interrupted => return Ok((quiet, flags)),
                Event::Rejected => {
                    // The chip may have stopped listening; it has not changed to its other buffer.
                    self.bus
                        .write_each(&[
                            (reg::SYS_CTRL, &[sys_ctrl::TRXOFF]),
                            (reg::SYS_STATUS, &[0xFF; 5]),
                            (reg::SYS_CTRL.plus(1), &[sys_ctrl::RXENAB]),
                        ])
                        .await?;
                }
                // An old flag.
                Event::Nothing => self.bus.write(reg::SYS_STATUS, &flags.to_le_bytes()).await?,
            }
        }
    }

    /// The status after the first-path detector is done, which gives the timestamp and the amplitudes. With LDEERR if
    /// the detector does not finish.
    async fn await_first_path(&mut self, mut flags: u32) -> Result<u32, Error<S::Error>> {
        for _ in 0..DETECTOR_PATIENCE {
            if flags & (status::LDEDONE | status::LDEERR) != 0 {
                return Ok(flags);
            }
            self.delay.delay_us(10).await;
            flags = self.status().await?;
        }
        Ok(flags | status::LDEERR)
    }

    /// Reads the frame in the host's buffer. First the data that is not double-buffered, then the receiver is switched
    /// on, then the rest is read.
    async fn take_frame<'b>(
        &mut self,
        buffer: &'b mut [u8; MAX_FRAME],
        keep_listening: bool,
    ) -> Result<RxFrame<'b>, ReceiveError<Error<S::Error>>> {
        let carrier = self.bus.read(reg::DRX_CAR_INT).await?;
        if keep_listening {
            self.bus.write(reg::SYS_CTRL.plus(1), &[sys_ctrl::RXENAB]).await?;
            if self.kept_listening.is_multiple_of(PACE_EVERY) {
                self.pace.listening = Some(self.clock().await?);
            }
            self.kept_listening = self.kept_listening.wrapping_add(1);
        }

        let frame_info = u32::from_le_bytes(self.bus.read(reg::RX_FINFO).await?);
        // Seven bits of length, including the check bytes.
        let length = ((frame_info & 0x7F) as usize).checked_sub(2);
        let bytes = match length.and_then(|length| buffer.get_mut(..length)) {
            Some(bytes) => bytes,
            None => {
                // The next frame may be in the other buffer, whose flags must be cleared too.
                self.holds_buffer = true;
                self.stop().await?;
                return Err(ReceiveError::Corrupt);
            }
        };
        bytes.copy_from_slice(self.bus.read_slice(reg::RX_BUFFER, bytes.len()).await?);
        let [t0, t1, t2, t3, t4, first_path @ ..]: [u8; 9] = self.bus.read(reg::RX_TIME).await?;
        let quality = self.bus.read(reg::RX_FQUAL).await?;
        self.holds_buffer = true;
        self.transceiver = if keep_listening { Transceiver::Listening } else { Transceiver::Off };
        Ok(RxFrame {
            bytes,
            rx_time: RadioInstant::from_le_bytes([t0, t1, t2, t3, t4]),
            diagnostics: RawDiagnostics { frame_info, first_path, quality, carrier }.evaluate(&self.config),
        })
    }

    /// Releases the buffer of the last frame, if that has not been done. Clears its flags only, because the next frame
    /// may already be in the other buffer. Then the chip may fill the buffer again.
    pub(super) async fn give_buffer_back(&mut self) -> Result<(), Error<S::Error>> {
        if self.holds_buffer {
            self.bus.write(reg::SYS_STATUS.plus(1), &[status::RECEIVED_IN_BYTE_1]).await?;
            self.change_buffer().await?;
            self.holds_buffer = false;
        }
        Ok(())
    }
}

impl<E> From<Error<E>> for ReceiveError<Error<E>> {
    fn from(error: Error<E>) -> Self {
        Self::Radio(error)
    }
}
