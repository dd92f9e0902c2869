//! A node's output as lines of text for a person.

use std::fmt::Write;
use std::time::Duration;

use defmt_parser::Level;
use wire::telemetry::{Message, Tone};

use super::log_frames::LogLine;
use super::session::{NodeOutput, SessionCounts};
use crate::provision::SiteNames;

const RED: &str = "\x1b[31m";
const GREEN: &str = "\x1b[32m";
const YELLOW: &str = "\x1b[33m";
const CYAN: &str = "\x1b[36m";
const DIM: &str = "\x1b[2m";
const PLAIN: &str = "";
const RESET: &str = "\x1b[0m";

/// Formats lines.
pub struct Lines {
    colour: bool,
    places: bool,
    hello: Option<wire::telemetry::Hello>,
    names: SiteNames,
}

impl Lines {
    /// `colour`: with colours for a terminal. `places`: with the source location of each line of the log.
    pub fn new(colour: bool, places: bool) -> Self {
        Self { colour, places, hello: None, names: SiteNames::default() }
    }

    /// The same, with the names of a site.
    pub fn named(self, names: SiteNames) -> Self {
        Self { names, ..self }
    }

    /// A line with its end; `None` for a line of the log that telemetry also has, and for a repeated `Hello`.
    pub fn line(&mut self, output: &NodeOutput) -> Option<String> {
        let is_shown = match output {
            NodeOutput::Log(line) => !line.is_in_telemetry,
            NodeOutput::Message(_, message) => self.greeted(message),
            NodeOutput::Text(_) | NodeOutput::Unreadable => true,
        };
        is_shown.then(|| self.render(output))
    }

    /// Whether a message is new: a `Hello` that differs from the last one, or any other message.
    fn greeted(&mut self, message: &Message) -> bool {
        let Message::Hello(hello) = message else { return true };
        let same = |before: wire::telemetry::Hello| {
            before.t_us <= hello.t_us && before == wire::telemetry::Hello { t_us: before.t_us, ..*hello }
        };
        let repeated = self.hello.is_some_and(same);
        self.hello = Some(*hello);
        !repeated
    }

    fn render(&self, output: &NodeOutput) -> String {
        let (t_us, label, colour, mut text) = match output {
            NodeOutput::Log(LogLine { t_us, level, text, .. }) => {
                let (label, colour) = of_level(*level);
                (*t_us, label, colour, text.clone())
            }
            NodeOutput::Message(_, message) => {
                let text = self.names.text(message, self.hello.map(|hello| hello.address));
                (Some(message.t_us()), message.label(), of_tone(message.tone()), text)
            }
            NodeOutput::Text(text) => (None, "boot", DIM, text.clone()),
            NodeOutput::Unreadable => (None, "log", YELLOW, "[defmt text not decodable]".into()),
        };
        if let (true, NodeOutput::Log(LogLine { place: Some(place), .. })) = (self.places, output) {
            // Writing to a string does not fail.
            let _ = write!(text, "  ({}:{})", place.file, place.line);
        }
        let time = t_us.map_or_else(String::new, |t_us| format!("{}.{:06}", t_us / 1_000_000, t_us % 1_000_000));
        // An entry of the log may have several lines. The lines after the first are indented.
        let text = text.trim_end().replace('\n', &format!("\n{:20}", ""));
        if self.colour && colour != PLAIN {
            format!("{DIM}{time:>13}{RESET} {colour}{label:<5}{RESET} {text}\n")
        } else {
            format!("{time:>13} {label:<5} {text}\n")
        }
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

fn of_tone(tone: Tone) -> &'static str {
    match tone {
        Tone::Good => GREEN,
        Tone::Normal => CYAN,
        Tone::Quiet => DIM,
        Tone::Warning => YELLOW,
        Tone::Error => RED,
    }
}

/// The counts, in one line.
pub fn summary(counts: &SessionCounts, elapsed: Duration) -> String {
    let SessionCounts {
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

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use defmt_parser::Level;
    use wire::telemetry::{
        BeaconId, Condition, Counters, Crash, CrashReason, Diagnostics, Difference, Doubt, Fix, Message, Outcome,
        Range, RecordError, Reset, ResetCause, Sighting, SolveError, Solver, State,
    };

    use super::super::elf::SourceLocation;
    use super::super::log_frames::LogLine;
    use super::super::session::{NodeOutput, SessionCounts};
    use super::super::testing::{BUILD, fix, hello};
    use super::{Lines, summary};
    use crate::decode::Stamp;

    fn line(output: &NodeOutput) -> String {
        Lines::new(false, true).line(output).expect("a line")
    }

    fn shown(message: Message) -> String {
        line(&of(message))
    }

    fn of(message: Message) -> NodeOutput {
        NodeOutput::Message(Stamp { t_s: 0.0, epoch: 0 }, message)
    }

    #[test]
    fn every_message_is_one_line() {
        assert_eq!(
            shown(hello(1_500_000, BUILD)),
            "     1.500000 hello tag 0x1234 on dwm1001, EUI deca000000001234, build 1a2b3c4d5e6f7081\n"
        );
        // √(0.03² + 0.04²) = 0.05 m.
        assert_eq!(
            shown(fix(12_345_678, 3.21)),
            "    12.345678 fix   x=3.21 y=4.05 z=1.50 (given) ±0.05 m, 6 anchors, 12 ms, b-wls\n"
        );
        let outcome = Outcome::Reason(SolveError::TooFewAnchors);
        let none = Message::Fix(Fix {
            t_us: 1,
            round: 1,
            age_us: 0,
            asked: 4,
            outcome,
            solver: Solver::Track,
            doubt: Doubt::None,
        });
        assert_eq!(shown(none), "     0.000001 fix   none: too-few-anchors, 4 asked\n");
        let diagnostics = Diagnostics {
            rx_power_cdbm: -7950,
            first_path_power_cdbm: -8125,
            first_path_index_64ths: 0,
            first_path_amplitudes: [0; 3],
            cir_power: 0,
            preamble_count: 0,
            noise_deviation: 0,
            clock_offset_cppm: i16::MIN,
        };
        let range = |position_tenth_mm| {
            let (t_us, round, peer, distance_tenth_mm, deviation_tenth_mm) = (0, 1, 0xA1, 51_234, 300);
            shown(Message::Range(Range {
                t_us,
                round,
                peer,
                distance_tenth_mm,
                deviation_tenth_mm,
                position_tenth_mm,
                diagnostics,
            }))
        };
        assert_eq!(
            range(Some([10_000, 20_000, -5000])),
            "     0.000000 range 0x00A1 5.123 ±0.030 m, received -79.5 dBm, first path -81.2 dBm, at 1.00 2.00 -0.50\n"
        );
        assert!(!range(None).contains(" at "));
        let difference = |peer, difference_tenth_mm| {
            let (reference, deviation_tenth_mm, position_tenth_mm) = (0xA1, 300, None);
            shown(Message::Difference(Difference {
                t_us: 0,
                round: 1,
                reference,
                peer,
                difference_tenth_mm,
                deviation_tenth_mm,
                position_tenth_mm,
                diagnostics,
            }))
        };
        assert_eq!(
            difference(0xB2, -12_345),
            "     0.000000 tdoa  0x00B2 -1.234 ±0.030 m from 0x00A1, received -79.5 dBm, first path -81.2 dBm\n"
        );
        assert!(difference(0xA1, 0).starts_with("     0.000000 tdoa  0x00A1 polls, ±0.030 m, received"));
        let beacon = BeaconId { network: 0xFDA5_0693, major: 1, minor: 7 };
        assert_eq!(
            shown(Message::Sighting(Sighting { t_us: 0, beacon, rssi_dbm: -71, measured_power_dbm: -59 })),
            "     0.000000 ble   fda50693-1-7 -71 dBm (-59 dBm at 1 m)\n"
        );
        let state = |is| shown(Message::State(State { t_us: 0, is }));
        assert_eq!(
            state(Condition::Synchronised(0xA1)),
            "     0.000000 state synchronised with the network of 0x00A1\n"
        );
        assert_eq!(
            state(Condition::NoRecord(RecordError::Missing)),
            "     0.000000 state no record in flash: nothing is sent; `baliza provision` writes one\n"
        );
        let counters = Counters { sent: 1, received: 2, timeouts: 3, telemetry_dropped: 4, ..Counters::default() };
        assert_eq!(
            shown(Message::Counters(counters)),
            "     0.000000 count 1 sent, 2 received, 3 timeouts, 0 corrupt, 0 late, 0 not sent, 0 radio failures; 0 sightings; \
             dropped: 0 rounds, 0 sightings, 4 telemetry frames; 0 refused\n"
        );
        let crash = Crash { reason: CrashReason::Panic, program_counter: 0x1234, line: 56, file: 0xABC };
        assert_eq!(
            shown(Message::Reset(Reset { t_us: 0, cause: ResetCause::Watchdog, crash: Some(crash) })),
            "     0.000000 reset watchdog; crashed before: panic at pc 0x00001234, line 56 of file 00000abc\n"
        );
        assert_eq!(
            shown(Message::Reset(Reset { t_us: 0, cause: ResetCause::Other(0x42), crash: None })),
            "     0.000000 reset other (00000042)\n"
        );
    }

    #[test]
    fn lines_of_the_log_have_their_level_and_place() {
        let place = SourceLocation { file: "firmware-tag/src/lib.rs".into(), line: 12 };
        let output = NodeOutput::Log(LogLine {
            t_us: Some(2),
            level: Some(Level::Warn),
            text: "a\nb".into(),
            place: Some(place),
            is_in_telemetry: false,
        });
        assert_eq!(line(&output), "     0.000002 WARN  a\n                    b  (firmware-tag/src/lib.rs:12)\n");
        assert_eq!(
            Lines::new(false, false).line(&output).as_deref(),
            Some("     0.000002 WARN  a\n                    b\n")
        );
        let bare = NodeOutput::Log(LogLine {
            t_us: None,
            level: None,
            text: "bare".into(),
            place: None,
            is_in_telemetry: false,
        });
        assert_eq!(line(&bare), "                    bare\n");
        assert_eq!(line(&NodeOutput::Text("ESP-ROM:x".into())), "              boot  ESP-ROM:x\n");
        assert_eq!(line(&NodeOutput::Unreadable), "              log   [defmt text not decodable]\n");
    }

    #[test]
    fn a_terminal_gets_colours_and_nobody_else() {
        let output = of(fix(1, 3.21));
        let coloured = Lines::new(true, false).line(&output).expect("a line");
        assert!(coloured.starts_with("\x1b[2m     0.000001\x1b[0m \x1b[32mfix  \x1b[0m x=3.21"), "{coloured:?}");
        assert!(!line(&output).contains('\x1b'));
    }

    #[test]
    fn a_line_of_the_log_that_telemetry_has_is_not_shown() {
        let log = |is_in_telemetry| {
            NodeOutput::Log(LogLine {
                t_us: Some(5),
                level: None,
                text: "fix x=3.21".into(),
                place: None,
                is_in_telemetry,
            })
        };
        assert_eq!([true, false].map(|twin| Lines::new(false, false).line(&log(twin)).is_some()), [false, true]);
    }

    #[test]
    fn a_repeated_hello_is_shown_only_if_it_differs() {
        let mut lines = Lines::new(false, false);
        let mut shows = |t_us, build| lines.line(&of(hello(t_us, build))).is_some();
        assert!(shows(1, BUILD) && !shows(2_000_001, BUILD));
        assert!(shows(4_000_001, [9; 8]));
        // After a restart.
        assert!(!shows(6_000_001, [9; 8]) && shows(1, [9; 8]));
    }

    #[test]
    fn the_summary_names_only_what_went_wrong() {
        let good = SessionCounts { fixes: 10, no_fixes: 1, others: 30, log_lines: 5, ..SessionCounts::default() };
        assert_eq!(
            summary(&good, Duration::from_millis(1500)),
            "1.5 s: 10 fixes, 1 rounds without one, 30 other messages, 5 lines of the log"
        );
        let telemetry =
            wire::telemetry::Counts { checksum: 2, cobs: 1, lost_bytes: 70, ..wire::telemetry::Counts::default() };
        let bad = SessionCounts { log_malformed: 3, node_dropped: 4, restarts: 1, lost: 2, telemetry, ..good };
        let said = summary(&bad, Duration::ZERO);
        for part in [
            "3 malformed frames of the log",
            "3 malformed telemetry frames",
            "70 bytes of telemetry lost",
            "4 frames dropped by the node",
            "1 restarts of the node",
            "2 lost connections",
        ] {
            assert!(said.contains(part), "{said}");
        }
    }
}
