//! The motion sensor of a tag. It is set up once. Its reports go to the engine, which wakes the tag.
//!
//! Its task runs beside the engine, below ranging, and does not poll a quiet sensor: an implementation of
//! [`MotionSensor`] waits for a pin. A sensor that does not answer is reported once, and the tag then uses its
//! positions alone.

use embassy_futures::select::{Either, select};
use embassy_sync::blocking_mutex::raw::RawMutex;
use embedded_hal_async::delay::DelayNs;
use wire::telemetry::MotionSensor as State;

use crate::{Sink, TaskChannels};

#[cfg(feature = "lis2dh12")]
pub mod lis2dh12;

/// A sensor that is not set up after this time counts as silent, milliseconds: its bus may be stuck.
const PATIENCE_MS: u32 = 1_000;
/// From one report to the next, milliseconds. A movement that goes on causes no more reports than this.
const PAUSE_MS: u32 = 500;

/// A sensor that reports movements of the tag.
#[allow(async_fn_in_trait, reason = "nodes run on one core; no future crosses a thread")]
pub trait MotionSensor {
    /// Sets the sensor up.
    ///
    /// # Errors
    /// The sensor does not answer, or another device answers.
    async fn start(&mut self) -> Result<(), MotionSensorError>;

    /// Returns when the tag is accelerated. It returns at once while the acceleration lasts.
    async fn moved(&mut self);
}

/// Why there is no sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum MotionSensorError {
    /// The sensor does not answer.
    Silent,
    /// Another device answers.
    Foreign,
}

/// Sets the sensor up, and passes its reports to the engine for ever. Returns if there is no sensor.
pub async fn run<M: RawMutex>(
    channels: &TaskChannels<M>,
    mut sensor: impl MotionSensor,
    mut delay: impl DelayNs,
    sink: &impl Sink,
) {
    let state = match select(sensor.start(), delay.delay_ms(PATIENCE_MS)).await {
        Either::First(Ok(())) => State::Ready,
        Either::First(Err(MotionSensorError::Foreign)) => State::Foreign,
        Either::First(Err(MotionSensorError::Silent)) | Either::Second(()) => State::Silent,
    };
    sink.motion_sensor(state);
    if state != State::Ready {
        return;
    }
    // This tells the engine that there is a sensor.
    channels.tell_movement();
    loop {
        sensor.moved().await;
        channels.tell_movement();
        delay.delay_ms(PAUSE_MS).await;
    }
}
