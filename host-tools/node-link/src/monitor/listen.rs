//! The main loop: from a source through a session to a listener, until a limit that the user has set, or Ctrl-C.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::Result;
use wire::telemetry::Message;

use super::session::{Item, NodeOutput, Session, SessionCounts};
use super::source::{Event, Source};

/// The limits at which listening ends, besides the end of the source.
#[derive(Clone, Copy, Debug, Default)]
pub struct Limits {
    /// The maximum time.
    pub time: Option<Duration>,
    /// The maximum number of positions.
    pub fixes: Option<u64>,
}

/// The receiver of the node's output.
pub trait Listener {
    /// Takes the node's output, in the order of its arrival. `false` ends the listening.
    ///
    /// # Errors
    /// The output cannot be written.
    fn output(&mut self, output: &NodeOutput) -> Result<bool>;

    /// The bytes that the node is to get now. They come again until the node had room for them.
    fn outgoing(&mut self, elapsed: Duration) -> Option<Vec<u8>> {
        let _ = elapsed;
        None
    }

    /// The node got the bytes.
    fn sent(&mut self) {}

    /// Takes a message for the user, which is not part of the data: after all output before it.
    fn note(&mut self, note: &str);

    /// Takes the current status, several times a second, and may write out held data. `false` ends the listening.
    ///
    /// # Errors
    /// The output cannot be written.
    fn status(&mut self, session: &Session, elapsed: Duration) -> Result<bool>;
}

/// The maximum wait for a source, so that waiting log lines are not late.
const PATIENCE: Duration = Duration::from_millis(50);

/// Listens to a source.
///
/// # Errors
/// The source or the listener returns an error. All data received before is passed to the listener first.
pub fn listen(
    source: &mut dyn Source,
    session: &mut Session,
    listener: &mut dyn Listener,
    limits: Limits,
    stop: &AtomicBool,
) -> Result<SessionCounts> {
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
        if listener.outgoing(begun.elapsed()).is_some_and(|bytes| source.send(&bytes)) {
            listener.sent();
        }
        match event {
            Some(event) => session.accept(begun.elapsed(), event)?,
            None => session.tick()?,
        }
        while let Some(note) = session.note() {
            listener.note(&note);
        }
        while let Some(item) = session.next(begun.elapsed()) {
            let output = match item {
                Item::Node(output) => output,
                Item::Note(note) => {
                    listener.note(&note);
                    continue;
                }
            };
            fixes += u64::from(is_position(&output));
            if !listener.output(&output)? || limits.fixes.is_some_and(|most| fixes >= most) {
                return Ok(session.counts());
            }
        }
        // The notes about the end of the wait for the node's build.
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

fn is_position(output: &NodeOutput) -> bool {
    matches!(output, NodeOutput::Message(_, Message::Fix(fix)) if fix.position_m().is_some())
}
