//! The motion sensor of a tag: it is set up once, and what it reports goes to the engine, which wakes the tag.
//!
//! It runs beside the engine, below ranging, and asks nothing of the sensor while that is quiet: whoever implements [`MotionSensor`] waits for
//! a pin. A sensor that does not answer is reported once, and the tag goes by its positions.

use embassy_futures::select::{Either, select};
use embassy_sync::blocking_mutex::raw::RawMutex;
use embedded_hal_async::delay::DelayNs;
use wire::telemetry::MotionSensor as State;

use crate::{Sink, TaskChannels};

#[cfg(feature = "lis2dh12")]
pub mod lis2dh12;

/// A sensor that is not set up after so long does not answer, milliseconds: its bus may be stuck.
const PATIENCE_MS: u32 = 1_000;
/// From one report to the next, milliseconds: a movement that goes on costs no more.
const PAUSE_MS: u32 = 500;

/// What tells that a tag moves.
#[allow(async_fn_in_trait, reason = "nodes run on one core; no future crosses a thread")]
pub trait MotionSensor {
    /// Sets the sensor up.
    ///
    /// # Errors
    /// It is not to be had.
    async fn start(&mut self) -> Result<(), MotionSensorError>;

    /// Done when the tag is accelerated; at once while that goes on.
    async fn moved(&mut self);
}

/// Why there is no sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum MotionSensorError {
    /// It does not answer.
    Silent,
    /// Something else does.
    Foreign,
}

/// Sets the sensor up, and hands its reports to the engine for ever. Ends where there is no sensor.
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
    // The engine learns that there is one.
    channels.tell_movement();
    loop {
        sensor.moved().await;
        channels.tell_movement();
        delay.delay_ms(PAUSE_MS).await;
    }
}
