//! What an image in QEMU reports in its first second, as text: kept beside its board in
//! `boards/<board>/expected/<image>.log`, so that a change of it shows in the change that makes it.

use std::fmt::Write as _;

use wire::telemetry::Message;

use super::node::Life;

/// The end of the log, seconds.
const UNTIL_S: f64 = 1.0;
/// Of ranges and positions only the first are in it.
const FEW: usize = 6;

/// The lines: hundredths of a second, and what was reported. Counts of instructions and the build are not in it: they
/// change with each compiler.
pub fn text(life: &Life) -> String {
    let mut text = String::new();
    let (mut ranges, mut fixes) = (0, 0);
    for (time, message) in &life.telemetry {
        let t_s = time.as_secs_f64();
        let is_shown = match message {
            Message::Range(_) => {
                ranges += 1;
                ranges <= FEW
            }
            Message::Fix(_) => {
                fixes += 1;
                fixes <= FEW
            }
            Message::Hello(_) | Message::Counters(_) | Message::Supply(_) => false,
            // Every other message is a change that a reader should see.
            _ => true,
        };
        if t_s < UNTIL_S && is_shown {
            // Writing to a string does not fail.
            let _ = writeln!(text, "{t_s:.2} {:5} {message}", message.label());
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use dw1000_sim::TrueTime;
    use wire::telemetry::{Condition, Message, State};

    use super::*;

    #[test]
    fn only_the_first_second_is_in_it() {
        let mut life = Life::new();
        for seconds in [0.123, 0.9, 1.1] {
            let state = State { t_us: 5, is: Condition::Searching };
            life.telemetry.push((TrueTime::from_secs_f64(seconds), Message::State(state)));
        }
        let lines: Vec<String> = text(&life).lines().map(str::to_owned).collect();
        assert_eq!(lines.len(), 2);
        assert!(lines[0].starts_with("0.12 state ") && lines[1].starts_with("0.90 state "), "{lines:?}");
    }
}
