//! The loop of a node: a machine and a radio drive each other, for ever.
//!
//! Actions go to the radio, events back to the machine, reports to a [`Listener`]. An error of the radio ends nothing:
//! the radio is brought up again, after a pause that grows from failure to failure, and the machine begins anew.

use core::convert::Infallible;
use core::future::pending;

use embassy_futures::select::{Either, select};
use embedded_hal_async::delay::DelayNs;

use crate::exchange::{Action, Event, Guidance, Protocol, Report};
use crate::radio::MAX_FRAME;
use crate::{Pace, Radio, RadioDuration, RadioInstant, ReceiveError, Restart, Start, TransmitError};

/// The first pause after a failure, and what it grows to, milliseconds: a chip that is back is used again within a
/// second.
const SHORTEST_PAUSE_MS: u32 = 1;
const LONGEST_PAUSE_MS: u32 = 250;

/// Who takes what a node finds out. The exchange waits meanwhile: a listener that takes long makes it miss its slots.
#[allow(async_fn_in_trait, reason = "nodes run on one core; no future crosses a thread")]
pub trait Listener {
    /// A round of ranging, or a change of a link, with the radio's present, so that the age of a round can be told. Answers with
    /// what the machine is to know before its next step.
    async fn report(&mut self, report: Report<'_>, present: RadioInstant) -> Guidance;

    /// Before a report is handed over, the radio is the listener's: what it still holds of the last frame can be read. Answers whether
    /// it was, which takes time. An error is the radio's own.
    async fn look<R: Radio>(&mut self, radio: &mut R, report: &Report<'_>) -> Result<bool, R::Error> {
        let _ = (radio, report);
        Ok(false)
    }

    /// Sees, at each step, what became of the last action, and the next one before it is done: for counting, signs of life, and
    /// whoever waits for the radio to be quiet. `now` is the step's.
    fn observe(&mut self, now: RadioInstant, event: &Event<'_>, action: &Action<'_>) {
        let _ = (now, event, action);
    }

    /// Done when the machine is to know something before the wait is over that it is in: that.
    async fn roused(&mut self) -> Guidance {
        pending().await
    }

    /// The radio failed, for the `failures`-th time since it last worked; it is brought up again.
    async fn radio_failed(&mut self, error: &impl core::fmt::Debug, failures: u32);
}

/// Runs a node.
pub async fn run<R: Restart>(
    radio: &mut R,
    delay: &mut impl DelayNs,
    machine: &mut impl Protocol,
    listener: &mut impl Listener,
) -> Infallible {
    let mut failures = 0;
    loop {
        let error = match attempt(radio, delay, machine, listener, &mut failures).await {
            Err(error) => error,
            Ok(never) => return never,
        };
        failures += 1;
        listener.radio_failed(&error, failures).await;
        let pause = SHORTEST_PAUSE_MS.checked_shl(failures - 1).unwrap_or(LONGEST_PAUSE_MS);
        delay.delay_ms(pause.clamp(SHORTEST_PAUSE_MS, LONGEST_PAUSE_MS)).await;
    }
}

/// Brings the radio up and runs the node until the radio fails.
async fn attempt<R: Restart>(
    radio: &mut R,
    delay: &mut impl DelayNs,
    machine: &mut impl Protocol,
    listener: &mut impl Listener,
    failures: &mut u32,
) -> Result<Infallible, R::Error> {
    radio.restart().await?;
    machine.calibrate(radio.antenna_delay());
    let mut buffer = [0; MAX_FRAME];
    let (mut now, mut event) = (radio.now().await?, Event::Started);
    loop {
        let action = machine.step(now, event);
        listener.observe(now, &event, &action);
        let wait = match action {
            Action::WaitUntil(instant) => Wait { from: now, duration: instant.since(now), may_sleep: false },
            Action::Sleep { from, duration } => Wait { from, duration, may_sleep: true },
            Action::Report(report) => {
                now = radio.now().await?;
                let pace = Pace { ready: Some(now), ..Pace::default() };
                if listener.look(radio, &report).await? {
                    now = radio.now().await?;
                }
                let guidance = listener.report(report, now).await;
                machine.pace(pace);
                machine.guide(guidance);
                event = Event::Reported;
                continue;
            }
            Action::Compensate => {
                if let Some(sensors) = radio.compensate().await? {
                    machine.calibrate(radio.antenna_delay());
                    machine.sense(sensors);
                }
                (now, event) = (radio.now().await?, Event::Woken);
                continue;
            }
            Action::Transmit { frame, start, listen } => {
                (now, event) = transmit(radio, frame, start, listen).await?;
                machine.pace(radio.pace());
                *failures = 0;
                continue;
            }
            Action::Receive { start, window, keep_listening } => {
                (now, event) = receive(radio, &mut buffer, start, window, keep_listening).await?;
                machine.pace(radio.pace());
                *failures = 0;
                continue;
            }
        };
        let micros = left_of(radio, wait.from, wait.duration).await?;
        let mut roused = None;
        let slept = if wait.may_sleep {
            radio.sleep(micros, async { roused = Some(listener.roused().await) }).await
        } else {
            Ok(false)
        };
        if let Ok(false) = slept
            && let Either::Second(guidance) = select(delay.delay_us(micros), listener.roused()).await
        {
            roused = Some(guidance);
        }
        // Who rouses does it once: an error of the radio may not lose why.
        if let Some(guidance) = roused {
            machine.rouse(guidance);
        }
        event = if slept? { Event::Started } else { Event::Woken };
        now = radio.now().await?;
        // The radio did something, and did it well.
        *failures = 0;
    }
}

/// What is left to do of an action that only lets time pass.
struct Wait {
    from: RadioInstant,
    duration: RadioDuration,
    may_sleep: bool,
}

/// [`Action::Transmit`].
async fn transmit<'b, R: Radio>(
    radio: &mut R,
    frame: &[u8],
    start: Start,
    listen: bool,
) -> Result<(RadioInstant, Event<'b>), R::Error> {
    let event = match radio.transmit(frame, start, listen).await {
        Ok(departure) => return Ok((departure, Event::Sent(departure))),
        Err(TransmitError::Late) => Event::Late,
        Err(TransmitError::TooLong | TransmitError::NoConfirmation) => Event::NotSent,
        Err(TransmitError::Radio(error)) => return Err(error),
    };
    Ok((radio.now().await?, event))
}

/// [`Action::Receive`].
async fn receive<'b, R: Radio>(
    radio: &mut R,
    buffer: &'b mut [u8; MAX_FRAME],
    start: Start,
    window: RadioDuration,
    keep_listening: bool,
) -> Result<(RadioInstant, Event<'b>), R::Error> {
    let event = match radio.receive(buffer, start, window, keep_listening).await {
        Ok(frame) => return Ok((frame.rx_time, Event::Received(frame))),
        Err(ReceiveError::Timeout) => Event::Timeout,
        Err(ReceiveError::Late) => Event::Late,
        Err(ReceiveError::Corrupt) => Event::Corrupt,
        Err(ReceiveError::Radio(error)) => return Err(error),
    };
    Ok((radio.now().await?, event))
}

/// Switches the radio off, and answers how many microseconds are left of a wait of `duration` since `from`.
async fn left_of<R: Radio>(radio: &mut R, from: RadioInstant, duration: RadioDuration) -> Result<u32, R::Error> {
    radio.idle().await?;
    let passed = radio.now().await?.since(from);
    Ok(micros(RadioDuration::from_ticks(duration.ticks().saturating_sub(passed.ticks()))))
}

/// A microsecond begun is waited for, or a machine would be woken before its time again and again.
fn micros(wait: RadioDuration) -> u32 {
    u32::try_from(wait.as_micros()).map_or(0, |micros| micros.saturating_add(1))
}
