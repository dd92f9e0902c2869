//! What a node needs of a radio: to send a frame at an instant, and to receive a frame with its instant.
//!
//! Frames have no check bytes here: the radio adds and checks both. Instants are those of the RMARKER (the first pulse
//! of the PHY header) at the antenna, in the radio's own clock, including the antenna delay.

use crate::{Capabilities, RadioDuration, RadioInstant, RangeBias, StampModel};

/// The longest frame of IEEE 802.15.4, without its check bytes.
pub const MAX_FRAME: usize = 125;

/// When a transmission or a reception starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Start {
    /// At once.
    Now,
    /// At this instant the RMARKER leaves, or the receiver is on. See [`Radio::departure`] for the resulting instant of
    /// a transmission.
    At(RadioInstant),
}

/// A radio that timestamps frames.
#[allow(async_fn_in_trait, reason = "nodes run on one core; no future crosses a thread")]
pub trait Radio {
    /// An error of the bus or the chip.
    type Error: core::fmt::Debug;

    /// What the radio can do.
    const CAPABILITIES: Capabilities;

    /// The radio's clock.
    ///
    /// # Errors
    /// If the bus or the chip fails.
    async fn now(&mut self) -> Result<RadioInstant, Self::Error>;

    /// The instant at which a frame's RMARKER will be at the antenna when it is sent with `Start::At(at)`: snapped to
    /// the radio's step, plus the antenna delay. A frame that contains its own departure contains this instant.
    fn departure(&self, at: RadioInstant) -> RadioInstant {
        at.snapped(Self::CAPABILITIES.delayed_step).plus(self.antenna_delay())
    }

    /// The delay from the snapped instant to the antenna, which [`departure`](Self::departure) adds. If the module's
    /// maker measured it, it may be known only once the radio has started.
    fn antenna_delay(&self) -> RadioDuration;

    /// The bias of distances that are measured with this radio, in its configuration.
    fn range_bias(&self) -> RangeBias;

    /// What a protocol must know to state departures and to correct distances.
    fn stamp_model(&self) -> StampModel {
        StampModel {
            delayed_step: Self::CAPABILITIES.delayed_step,
            antenna_delay: self.antenna_delay(),
            range_bias: self.range_bias(),
        }
    }

    /// Sends `frame` and returns its departure once it has left. With `listen`, the chip itself switches the receiver
    /// on as soon as the frame has left. The next [`receive`](Self::receive) with [`Start::Now`] then also returns a
    /// frame that came in between.
    ///
    /// # Errors
    /// If the frame was not sent, or this is not known; [`TransmitError`] has the reason.
    async fn transmit(
        &mut self,
        frame: &[u8],
        start: Start,
        listen: bool,
    ) -> Result<RadioInstant, TransmitError<Self::Error>>;

    /// Receives one frame that passes the filter. Gives up when `window` has passed since `start` (for [`Start::Now`],
    /// since the receiver is on). With `keep_listening` the receiver is on again before this function returns the
    /// frame, so that the next response of a round is not missed; else it is off.
    ///
    /// # Errors
    /// If no frame was received; [`ReceiveError`] has the reason.
    async fn receive<'b>(
        &mut self,
        buffer: &'b mut [u8; MAX_FRAME],
        start: Start,
        window: RadioDuration,
        keep_listening: bool,
    ) -> Result<RxFrame<'b>, ReceiveError<Self::Error>>;

    /// Switches transmitter and receiver off.
    ///
    /// # Errors
    /// If the bus or the chip fails.
    async fn idle(&mut self) -> Result<(), Self::Error>;

    /// What the radio measured of its own node's pace in the last operation: nothing if it does not measure.
    fn pace(&self) -> Pace {
        Pace::default()
    }

    /// Measures the radio's temperature and supply, if it can, and corrects its antenna delays accordingly. This takes
    /// about a millisecond. Transmitter and receiver are off afterwards.
    ///
    /// # Errors
    /// If the bus or the chip fails.
    async fn compensate(&mut self) -> Result<Option<Sensors>, Self::Error> {
        Ok(None)
    }

    /// Passes the channel impulse response of the last frame to `take`, sample by sample, as far as `window` reaches.
    /// Returns the index of the first sample. `None`: there is none, because the receiver stayed on after the frame and
    /// accumulates a new one, or because the radio does not provide it.
    ///
    /// # Errors
    /// If the bus or the chip fails.
    async fn impulse_response(
        &mut self,
        window: ResponseWindow,
        take: impl FnMut(Sample),
    ) -> Result<Option<u16>, Self::Error> {
        let _ = (window, take);
        Ok(None)
    }
}

/// How quickly a node handled its radio in the last operation, in the radio's own clock. From this a node learns how
/// early it must decide, and how much time its peers must give it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Pace {
    /// When the command for the last transmission at an instant ([`Start::At`]) had reached the radio, even if it was
    /// too late.
    pub armed: Option<RadioInstant>,
    /// When the receiver was on again after the last frame that was received with `keep_listening`. It is measured now
    /// and then, because measuring takes time.
    pub listening: Option<RadioInstant>,
    /// When the node had processed the last frame and could have taken another. The loop of the node sets it, not the
    /// radio.
    pub ready: Option<RadioInstant>,
}

/// The readings of a radio's own sensors, on which its distances depend.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Sensors {
    /// Temperature of the chip, °C.
    pub temperature_celsius: f32,
    /// Supply voltage, V.
    pub voltage: f32,
    /// Temperature and voltage as the radio's converter reads them.
    pub raw: [u8; 2],
}

/// The requested samples of an impulse response. Near the ends of the accumulator the window is moved inside.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ResponseWindow {
    /// Index of the first path, from the frame's diagnostics, samples.
    pub first_path_index: f32,
    /// Samples before that of the first path.
    pub before: u16,
    /// Samples in all.
    pub count: u16,
}

/// One complex sample of the accumulator; samples are 1.0016 ns apart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Sample {
    /// Real part.
    pub i: i16,
    /// Imaginary part.
    pub q: i16,
}

/// For radios in a `static`: an async function that took the radio by value would copy it into its future.
impl<R: Radio> Radio for &mut R {
    type Error = R::Error;

    const CAPABILITIES: Capabilities = R::CAPABILITIES;

    async fn now(&mut self) -> Result<RadioInstant, Self::Error> {
        (**self).now().await
    }

    fn antenna_delay(&self) -> RadioDuration {
        (**self).antenna_delay()
    }

    fn range_bias(&self) -> RangeBias {
        (**self).range_bias()
    }

    async fn transmit(
        &mut self,
        frame: &[u8],
        start: Start,
        listen: bool,
    ) -> Result<RadioInstant, TransmitError<Self::Error>> {
        (**self).transmit(frame, start, listen).await
    }

    async fn receive<'b>(
        &mut self,
        buffer: &'b mut [u8; MAX_FRAME],
        start: Start,
        window: RadioDuration,
        keep_listening: bool,
    ) -> Result<RxFrame<'b>, ReceiveError<Self::Error>> {
        (**self).receive(buffer, start, window, keep_listening).await
    }

    async fn idle(&mut self) -> Result<(), Self::Error> {
        (**self).idle().await
    }

    fn pace(&self) -> Pace {
        (**self).pace()
    }

    async fn compensate(&mut self) -> Result<Option<Sensors>, Self::Error> {
        (**self).compensate().await
    }

    async fn impulse_response(
        &mut self,
        window: ResponseWindow,
        take: impl FnMut(Sample),
    ) -> Result<Option<u16>, Self::Error> {
        (**self).impulse_response(window, take).await
    }
}

/// A received frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RxFrame<'b> {
    /// The bytes, without the check bytes.
    pub bytes: &'b [u8],
    /// The instant at which its RMARKER was at the antenna.
    pub rx_time: RadioInstant,
    /// What the receiver measured on it.
    pub diagnostics: Diagnostics,
}

/// What the receiver measured on one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Diagnostics {
    /// Received power, dBm (DW1000 user manual, 4.7.2); NaN if unknown.
    pub rx_power_dbm: f32,
    /// Power of the first path, dBm (4.7.1); NaN if unknown.
    pub first_path_power_dbm: f32,
    /// Index of the first path in the accumulator, samples of 1.0016 ns.
    pub first_path_index: f32,
    /// FP_AMPL1, 2 and 3: magnitudes of the accumulator three, two and one samples after the first path's.
    pub first_path_amplitudes: [u16; 3],
    /// Sum of the squared magnitudes of the accumulator, the chip's unit (2¹⁷).
    pub cir_power: u16,
    /// Number of accumulated preamble symbols.
    pub preamble_count: u16,
    /// Standard deviation of the accumulator's noise.
    pub noise_deviation: u16,
    /// The rate of the sender's clock relative to the receiver's, parts per million, positive if it is faster: from the
    /// carrier integrator.
    pub clock_offset_ppm: f32,
}

/// Why a frame was not sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum TransmitError<E> {
    /// The start was in the past, or too near for the chip to be ready: nothing was sent.
    Late,
    /// The frame has more than [`MAX_FRAME`] bytes.
    TooLong,
    /// The chip did not report the end of the transmission in time; it was reset to idle.
    NoConfirmation,
    /// An error of bus or chip.
    Radio(E),
}

/// Why no frame was received.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ReceiveError<E> {
    /// The window passed.
    Timeout,
    /// The start was in the past: the receiver was not switched on.
    Late,
    /// A frame was received whose check bytes, Reed-Solomon code or header were wrong, or whose start was lost.
    Corrupt,
    /// An error of bus or chip.
    Radio(E),
}

/// A radio that can be started again and again from any state.
#[allow(async_fn_in_trait, reason = "nodes run on one core; no future crosses a thread")]
pub trait Restart: Radio {
    /// Resets the chip and configures it; its clock restarts.
    ///
    /// # Errors
    /// If the bus or the chip fails.
    async fn restart(&mut self) -> Result<(), Self::Error>;

    /// Sleeps for `micros` microseconds, or until `roused` is done, if the radio can, may and gains by it; then its
    /// clock has restarted. Returns false if nothing was done and no time has passed.
    ///
    /// # Errors
    /// If the bus or the chip fails.
    async fn sleep(&mut self, micros: u32, roused: impl Future<Output = ()>) -> Result<bool, Self::Error> {
        let _ = (micros, roused);
        Ok(false)
    }
}

impl<R: Restart> Restart for &mut R {
    async fn restart(&mut self) -> Result<(), Self::Error> {
        (**self).restart().await
    }

    async fn sleep(&mut self, micros: u32, roused: impl Future<Output = ()>) -> Result<bool, Self::Error> {
        (**self).sleep(micros, roused).await
    }
}
