//! What a node says as lines for a person.

use std::collections::VecDeque;
use std::fmt::Write;
use std::time::Duration;

use defmt_parser::Level;
use telemetry::{Condition, Fix, Message, Outcome};

use super::log::LogLine;
use super::session::{Counts, Said};
use super::words;

/// Between the log's word and telemetry's for the same thing, microseconds.
const SAME_US: u64 = 20_000;
/// Enough to find the other word for it.
const REMEMBERED: usize = 16;

const RED: &str = "\x1b[31m";
const GREEN: &str = "\x1b[32m";
const YELLOW: &str = "\x1b[33m";
const CYAN: &str = "\x1b[36m";
const DIM: &str = "\x1b[2m";
const PLAIN: &str = "";
const RESET: &str = "\x1b[0m";

/// Makes lines.
pub struct Lines {
    colour: bool,
    places: bool,
    hello: Option<telemetry::Hello>,
    shown: VecDeque<Said>,
}

impl Lines {
    /// `colour`: for a terminal; `places`: where in the sources each line of the log is said.
    pub fn new(colour: bool, places: bool) -> Self {
        Self { colour, places, hello: None, shown: VecDeque::new() }
    }

    /// A line with its end; `None` for what was said already: by telemetry what the log has said or the other way round, and a
    /// greeting that is only repeated.
    pub fn line(&mut self, said: &Said) -> Option<String> {
        if let Some(twin) = self.shown.iter().position(|shown| twins(shown, said)) {
            // One word of each for one thing.
            self.shown.remove(twin);
            self.greeted(said);
            return None;
        }
        if !self.greeted(said) {
            return None;
        }
        if self.shown.len() == REMEMBERED {
            self.shown.pop_front();
        }
        self.shown.push_back(said.clone());
        Some(self.render(said))
    }

    /// Whether a greeting says something new; anything else does.
    fn greeted(&mut self, said: &Said) -> bool {
        let Said::Message(Message::Hello(hello)) = said else { return true };
        let same = |before: telemetry::Hello| {
            before.t_us <= hello.t_us && before == telemetry::Hello { t_us: before.t_us, ..*hello }
        };
        let repeated = self.hello.is_some_and(same);
        self.hello = Some(*hello);
        !repeated
    }

    fn render(&self, said: &Said) -> String {
        let (t_us, label, colour, mut text) = match said {
            Said::Log(LogLine { t_us, level, text, .. }) => {
                let (label, colour) = of_level(*level);
                (*t_us, label, colour, text.clone())
            }
            Said::Message(message) => {
                (Some(message.t_us()), words::label(message), colour(message), words::words(message))
            }
            Said::Text(text) => (None, "boot", DIM, text.clone()),
            Said::Unreadable => (None, "log", YELLOW, "[defmt text not decodable]".into()),
        };
        if let (true, Said::Log(LogLine { place: Some(place), .. })) = (self.places, said) {
            // Writing to a string does not fail.
            let _ = write!(text, "  ({}:{})", place.file, place.line);
        }
        let time = t_us.map_or_else(String::new, |t_us| format!("{}.{:06}", t_us / 1_000_000, t_us % 1_000_000));
        // A line of the log may have several lines; those after the first are set in.
        let text = text.trim_end().replace('\n', &format!("\n{:20}", ""));
        if self.colour && colour != PLAIN {
            format!("{DIM}{time:>13}{RESET} {colour}{label:<5}{RESET} {text}\n")
        } else {
            format!("{time:>13} {label:<5} {text}\n")
        }
    }
}

/// One of the log and one of telemetry, for the same thing at the same time.
fn twins(one: &Said, other: &Said) -> bool {
    match (one, other) {
        (Said::Log(log), Said::Message(message)) | (Said::Message(message), Said::Log(log)) => {
            log.t_us.is_some_and(|t_us| t_us.abs_diff(message.t_us()) <= SAME_US)
                && words::says_the_same(&log.text, message)
        }
        _ => false,
    }
}

fn of_level(level: Option<Level>) -> (&'static str, &'static str) {
    match level {
        Some(Level::Trace) => ("TRACE", DIM),
        Some(Level::Debug) => ("DEBUG", DIM),
        Some(Level::Info) => ("INFO", GREEN),
        Some(Level::Warn) => ("WARN", YELLOW),
        Some(Level::Error) => ("ERROR", RED),
        None => ("", PLAIN),
    }
}

fn colour(message: &Message) -> &'static str {
    match message {
        Message::Fix(Fix { outcome: Outcome::Position { .. }, .. }) => GREEN,
        Message::Fix(Fix { outcome: Outcome::Reason(_), .. }) => YELLOW,
        Message::Range(_) | Message::Sighting(_) | Message::Counters(_) => DIM,
        Message::Hello(_) => CYAN,
        Message::Reset(reset) => {
            if reset.crash.is_some() {
                RED
            } else {
                YELLOW
            }
        }
        Message::State(state) => match state.is {
            Condition::NoRecord(_) | Condition::WrongRecord => RED,
            Condition::RadioFailed(_) | Condition::ScannerRestarted(_) => YELLOW,
            Condition::Searching
            | Condition::Paired(_)
            | Condition::Synchronised(_)
            | Condition::Joined(_)
            | Condition::Coordinating
            | Condition::Following(_)
            | Condition::Advertising => CYAN,
        },
    }
}

/// What was counted, in one line.
pub fn summary(counts: &Counts, elapsed: Duration) -> String {
    let Counts {
        fixes,
        no_fixes,
        others,
        log_lines,
        log_malformed,
        log_unreadable,
        restarts,
        lost,
        node_dropped,
        telemetry,
    } = counts;
    let mut text = format!(
        "{:.1} s: {fixes} fixes, {no_fixes} rounds without one, {others} other messages",
        elapsed.as_secs_f64()
    );
    let mut more = |count: u64, what: &str| {
        if count > 0 {
            let _ = write!(text, ", {count} {what}");
        }
    };
    more(*log_lines, "lines of the log");
    more(*log_unreadable, "frames of the log not decodable");
    more(*log_malformed, "malformed frames of the log");
    more(telemetry.malformed(), "malformed telemetry frames");
    more(telemetry.lost_bytes, "bytes of telemetry lost");
    more(telemetry.newer(), "messages of a newer node");
    more(telemetry.foreign_bytes, "bytes of something else");
    more(*node_dropped, "frames dropped by the node");
    more(*restarts, "restarts of the node");
    more(*lost, "lost connections");
    text
}
