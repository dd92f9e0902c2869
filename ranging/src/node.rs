//! The loop of a node: a protocol and a radio drive each other, for ever.
//!
//! Actions go to the radio, events back to the protocol, reports to a [`Listener`]. An error of the radio ends nothing:
//! the loop starts the radio again, after a pause that grows from failure to failure, and the protocol starts again.

use core::convert::Infallible;
use core::future::pending;

use embassy_futures::select::{Either, select};
use embedded_hal_async::delay::DelayNs;
use wire::uwb::native::{Downlink, UserData};

use crate::exchange::{Action, Event, Guidance, Protocol, Report};
use crate::radio::{MAX_FRAME, Sensors};
use crate::{Pace, Radio, RadioDuration, RadioInstant, ReceiveError, Restart, Start, TransmitError};

/// The first pause after a failure, and the longest one, milliseconds: a chip that works again is used within a second.
const SHORTEST_PAUSE_MS: u32 = 1;
const LONGEST_PAUSE_MS: u32 = 250;
/// In a wait this long, microseconds, the node may have computed what was measured before it.
const LONG_WAIT_US: u32 = 10_000;

/// Receives the reports of a node. The exchange waits meanwhile: a slow listener makes it miss its slots.
#[allow(async_fn_in_trait, reason = "nodes run on one core; no future crosses a thread")]
pub trait Listener {
    /// Takes a round of ranging, or a change of a link. `present` is the radio's time, which gives the age of a round.
    /// Returns the guidance for the protocol's next step.
    async fn report(&mut self, report: Report<'_>, present: RadioInstant) -> Guidance;

    /// Before a report is handed over, the listener may use the radio, to read what it still holds of the last frame.
    /// Returns whether it used the radio, which takes time. An error is the radio's own.
    ///
    /// # Errors
    /// If the radio fails.
    async fn look<R: Radio>(&mut self, radio: &mut R, report: &Report<'_>) -> Result<bool, R::Error> {
        let _ = (radio, report);
        Ok(false)
    }

    /// Sees at each step the result of the last action, and the next action before it is done. Its uses are counting,
    /// signs of life, and code that waits for a quiet radio. `now` is the step's time.
    fn observe(&mut self, now: RadioInstant, event: &Event<'_>, action: &Action<'_>) {
        let _ = (now, event, action);
    }

    /// Takes the radio's temperature and supply, whenever it has measured them.
    fn sensed(&mut self, sensors: &Sensors) {
        let _ = sensors;
    }

    /// The protocol has refused this many frames since the start: more than before.
    fn refused(&mut self, frames: u32) {
        let _ = frames;
    }

    /// Whether a host reads what this node reports.
    fn has_host(&self) -> bool {
        false
    }

    /// The next message of the host to a tag.
    fn message(&mut self) -> Option<Downlink> {
        None
    }

    /// The present guidance, after a wait in which the node may have computed the last round. `None`: that of the last
    /// report is the newest.
    fn guidance(&mut self) -> Option<Guidance> {
        None
    }

    /// Completes when the protocol is to get new guidance before its current wait is over. Returns the guidance.
    async fn roused(&mut self) -> Guidance {
        pending().await
    }

    /// Data of the user for a tag's next poll, asked for after [`Listener::report`] and [`Listener::guidance`]. The last
    /// poll carried those with the [`UserData::id`] `carried`.
    fn data(&mut self, carried: Option<(bool, u8)>) -> Option<UserData> {
        let _ = carried;
        None
    }

    /// The radio failed, for the `failures`-th time since it last worked. The loop starts it again.
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

/// Starts the radio and runs the node until the radio fails.
async fn attempt<R: Restart>(
    radio: &mut R,
    delay: &mut impl DelayNs,
    machine: &mut impl Protocol,
    listener: &mut impl Listener,
    failures: &mut u32,
) -> Result<Infallible, R::Error> {
    radio.restart().await?;
    machine.calibrate(&radio.stamp_model());
    let mut buffer = [0; MAX_FRAME];
    let (mut now, mut event, mut refused) = (radio.now().await?, Event::Started, machine.refused_frames());
    loop {
        count_refused(&mut refused, machine, listener);
        attend_host(machine, listener);
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
                carry(machine, listener);
                event = Event::Reported;
                continue;
            }
            Action::Compensate => {
                if let Some(sensors) = radio.compensate().await? {
                    machine.calibrate(&radio.stamp_model());
                    machine.sense(sensors);
                    listener.sensed(&sensors);
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
        // The listener gives this guidance only once: an error of the radio must not lose it.
        if let Some(guidance) = roused {
            machine.rouse(guidance);
        } else if micros >= LONG_WAIT_US
            && let Some(guidance) = listener.guidance()
        {
            machine.guide(guidance);
            carry(machine, listener);
        }
        event = if slept? { Event::Started } else { Event::Woken };
        now = radio.now().await?;
        *failures = 0;
    }
}

/// Passes on whether a host is there, and what it tells tags.
fn attend_host(machine: &mut impl Protocol, listener: &mut impl Listener) {
    machine.set_host(listener.has_host());
    if let Some(message) = listener.message() {
        machine.send_down(message);
    }
}

/// Passes on how many frames the protocol has refused, if they are more than `before`.
fn count_refused(before: &mut u32, machine: &impl Protocol, listener: &mut impl Listener) {
    let refused = machine.refused_frames();
    if core::mem::replace(before, refused) != refused {
        listener.refused(refused);
    }
}

/// Passes data of a tag's user on.
fn carry(machine: &mut impl Protocol, listener: &mut impl Listener) {
    let carried = machine.carried();
    machine.carry(listener.data(carried));
}

/// The rest of an action that only lets time pass.
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

/// Switches the radio off. Returns the microseconds left of a wait of `duration` since `from`.
async fn left_of<R: Radio>(radio: &mut R, from: RadioInstant, duration: RadioDuration) -> Result<u32, R::Error> {
    radio.idle().await?;
    let passed = radio.now().await?.since(from);
    Ok(micros(RadioDuration::from_ticks(duration.ticks().saturating_sub(passed.ticks()))))
}

/// Rounded up to a microsecond. Otherwise a protocol would be woken too early again and again.
fn micros(wait: RadioDuration) -> u32 {
    u32::try_from(wait.as_micros()).map_or(0, |micros| micros.saturating_add(1))
}
