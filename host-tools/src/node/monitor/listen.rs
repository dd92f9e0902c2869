//! The loop: from a source through a session to whoever listens, until an end that the user has set, or Ctrl-C.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use wire::telemetry::Message;

use super::session::{Counts, Said, Session};
use super::source::{Event, Source};

/// When listening ends, beside the source's own end.
#[derive(Clone, Copy, Debug, Default)]
pub struct Limits {
    /// After so long.
    pub time: Option<Duration>,
    /// After so many positions.
    pub fixes: Option<u64>,
}

/// Whoever listens.
pub trait Listener {
    /// What the node says, in the order of its arrival. `false`: enough.
    ///
    /// # Errors
    /// It cannot be written.
    fn said(&mut self, said: &Said) -> Result<bool>;

    /// A sentence beside the data.
    fn note(&mut self, note: &str);

    /// How it stands, several times a second; time to let go of what is held back. `false`: enough.
    ///
    /// # Errors
    /// It cannot be written.
    fn status(&mut self, session: &Session, elapsed: Duration) -> Result<bool>;
}

/// A source is asked for no longer than this, so that a log that waits is not late.
const PATIENCE: Duration = Duration::from_millis(50);

/// Listens.
///
/// # Errors
/// The source's and the listener's; what had come is said before.
pub fn listen(
    source: &mut dyn Source,
    session: &mut Session,
    listener: &mut dyn Listener,
    limits: Limits,
    stop: &AtomicBool,
) -> Result<Counts> {
    let begun = Instant::now();
    let mut fixes = 0;
    let mut failed = None;
    loop {
        let over = limits.time.is_some_and(|time| begun.elapsed() >= time) || stop.load(Ordering::Relaxed);
        let event = if over {
            Some(Event::End)
        } else {
            source.next(PATIENCE).unwrap_or_else(|error| {
                failed = Some(error);
                Some(Event::End)
            })
        };
        let ended = event == Some(Event::End);
        if let Some(event) = event {
            session.accept(begun.elapsed(), event).context("cannot write the recording")?;
        }
        while let Some(note) = session.note() {
            listener.note(&note);
        }
        while let Some(said) = session.next(begun.elapsed()) {
            fixes += u64::from(is_position(&said));
            if !listener.said(&said)? || limits.fixes.is_some_and(|most| fixes >= most) {
                return Ok(session.counts());
            }
        }
        // What ended the wait for the node's build.
        while let Some(note) = session.note() {
            listener.note(&note);
        }
        if !listener.status(session, begun.elapsed())? {
            return Ok(session.counts());
        }
        match (ended, failed) {
            (true, Some(error)) => return Err(error),
            (true, None) => return Ok(session.counts()),
            (false, _) => failed = None,
        }
    }
}

fn is_position(said: &Said) -> bool {
    matches!(said, Said::Message(_, Message::Fix(fix)) if fix.position_m().is_some())
}
