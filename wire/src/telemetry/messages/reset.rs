//! Why the node started.

use postcard::experimental::max_size::MaxSize;
use serde::{Deserialize, Serialize};

use crate::telemetry::text::text;
use crate::telemetry::{Body, Severity, Tone, log};

/// Why the node started.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
pub struct Reset {
    /// Since the node started, microseconds.
    pub t_us: u64,
    /// The cause as the chip reports it.
    pub cause: ResetCause,
    /// What the firmware recorded before.
    pub crash: Option<Crash>,
}

/// What reset the chip.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ResetCause {
    /// Power was switched on.
    PowerOn,
    /// The supply voltage dropped.
    BrownOut,
    /// The reset pin, or a debugger.
    Pin,
    /// The firmware requested it.
    Software,
    /// The watchdog.
    Watchdog,
    /// The processor locked up: a fault within a fault.
    Lockup,
    /// Woken from the deepest sleep.
    Wake,
    /// Something else; the chip's own number.
    Other(u32),
}

impl ResetCause {
    /// Its name, without its contents.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::PowerOn => "power-on",
            Self::BrownOut => "brown-out",
            Self::Pin => "pin",
            Self::Software => "software",
            Self::Watchdog => "watchdog",
            Self::Lockup => "lockup",
            Self::Wake => "wake",
            Self::Other(_) => "other",
        }
    }

    /// The chip's own number of a cause that has no name.
    pub fn number(self) -> Option<u32> {
        match self {
            Self::Other(number) => Some(number),
            Self::PowerOn
            | Self::BrownOut
            | Self::Pin
            | Self::Software
            | Self::Watchdog
            | Self::Lockup
            | Self::Wake => None,
        }
    }
}

/// How the firmware ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Crash {
    /// Why.
    pub reason: CrashReason,
    /// The program counter, or for a panic its return address.
    pub program_counter: u32,
    /// For a panic: its line, and a hash (FNV-1a, 32 bits) of its file's name; else zeros.
    pub line: u32,
    /// See `line`.
    pub file: u32,
}

/// Why the firmware ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum CrashReason {
    /// It panicked.
    Panic,
    /// The processor faulted.
    Fault,
    /// The stack overflowed.
    StackOverflow,
    /// A task was blocked, and the watchdog expired on purpose.
    Stalled,
}

impl CrashReason {
    /// `panic`, `fault`, `stack-overflow`, `stalled`.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Panic => "panic",
            Self::Fault => "fault",
            Self::StackOverflow => "stack-overflow",
            Self::Stalled => "stalled",
        }
    }
}

text!(Reset, |this| (this.cause, this.crash);
    (ResetCause::Other(number), None) => ("other ({:08x})", number),
    (cause, None) => ("{}", cause.as_str()),
    (cause, Some(Crash { reason: CrashReason::Panic, program_counter, line, file })) => (
        "{}; crashed before: panic at pc 0x{:08x}, line {} of file {:08x}", cause.as_str(), program_counter, line, file
    ),
    (cause, Some(Crash { reason, program_counter, .. })) =>
        ("{}; crashed before: {} at pc 0x{:08x}", cause.as_str(), reason.as_str(), program_counter),
);

/// Why the node started, as a line of the log.
struct ResetLine(Reset);

text!(ResetLine, |this| this;
    Self(reset) => ("reset: {}", reset),
);

impl Body for Reset {
    const KIND: &'static str = "reset";

    fn severity(&self) -> Severity {
        if self.crash.is_some() { Severity::Error } else { Severity::Info }
    }

    fn tone(&self) -> Tone {
        if self.crash.is_some() { Tone::Error } else { Tone::Warning }
    }

    fn log(&self) {
        log::write(self.severity(), &ResetLine(*self));
    }

    #[cfg(feature = "host")]
    fn json(&self) -> serde_json::Value {
        let crash = |crash: Crash| {
            serde_json::json!({
                "reason": crash.reason.as_str(),
                "program_counter": std::format!("{:08x}", crash.program_counter),
                "line": crash.line,
                "file_hash": std::format!("{:08x}", crash.file),
            })
        };
        serde_json::json!({
            "cause": self.cause.as_str(),
            "cause_number": self.cause.number(),
            "crash": self.crash.map(crash),
        })
    }
}

#[cfg(test)]
mod tests {
    use std::string::ToString;

    use super::*;

    #[test]
    fn a_reset_has_its_cause_and_the_crash_before() {
        let crash = Crash { reason: CrashReason::Panic, program_counter: 0x1_2345, line: 123, file: 0xABC };
        let line = |cause, crash| ResetLine(Reset { t_us: 0, cause, crash }).to_string();
        assert_eq!(
            line(ResetCause::Watchdog, Some(crash)),
            "reset: watchdog; crashed before: panic at pc 0x00012345, line 123 of file 00000abc"
        );
        let stalled = Crash { reason: CrashReason::Stalled, ..crash };
        assert_eq!(
            line(ResetCause::Watchdog, Some(stalled)),
            "reset: watchdog; crashed before: stalled at pc 0x00012345"
        );
        assert_eq!(line(ResetCause::PowerOn, None), "reset: power-on");
        assert_eq!(line(ResetCause::Other(0x42), None), "reset: other (00000042)");
    }
}
