//! What a person reads of the event log: the text of a log line, the same through `defmt` on a node and `core::fmt` on a desktop,
//! where the monitor shows messages of telemetry in the same words.
//!
//! Numbers are whole: a log that prints floats prints all their digits.

use core::fmt;

use wire::telemetry::{
    Condition, Counters, Crash, CrashReason, Fix, Hello, MotionSensor, Outcome, Reason, RecordError, Reset, ResetCause,
    RoomEstimate, RoomProbability, RssiModelError, Solver,
};

/// Gives a type its text, once for both: a match whose arms are a format and its arguments.
macro_rules! text {
    ($type:ty, |$this:ident| $subject:expr; $($pattern:pat => ($($text:tt)*),)+) => {
        impl fmt::Display for $type {
            fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
                let $this = self;
                match $subject { $($pattern => write!(out, $($text)*),)+ }
            }
        }

        #[cfg(feature = "defmt")]
        impl defmt::Format for $type {
            fn format(&self, out: defmt::Formatter<'_>) {
                let $this = self;
                match $subject { $($pattern => defmt::write!(out, $($text)*),)+ }
            }
        }
    };
}

/// A length in hundredths of a metre.
pub struct Centimetres(i32);

impl Centimetres {
    /// Of a length in 0.1 mm, rounded.
    fn of(tenth_millimetres: i32) -> Self {
        let half = if tenth_millimetres < 0 { -50 } else { 50 };
        Self(tenth_millimetres.saturating_add(half) / 100)
    }

    fn parts(&self) -> (&'static str, u32, u32) {
        let size = self.0.unsigned_abs();
        (if self.0 < 0 { "-" } else { "" }, size / 100, size % 100)
    }
}

text!(Centimetres, |this| this.parts();
    (sign, metres, hundredths) => ("{}{}.{:02}", sign, metres, hundredths),
);

/// A round's end: the position with its standard deviation (of the distance to the true one: in the plane where the height was
/// given, else in space), or why there is none.
pub enum FixLine {
    /// A position in space.
    Space {
        /// Where.
        position: [Centimetres; 3],
        /// Standard deviation.
        deviation: Centimetres,
        /// Anchors used.
        used: u32,
        /// From the poll to the publication, ms.
        age_ms: u32,
        /// What made it.
        by: By,
    },
    /// A position whose height was given.
    Plane {
        /// Where.
        position: [Centimetres; 3],
        /// Standard deviation.
        deviation: Centimetres,
        /// Anchors used.
        used: u32,
        /// From the poll to the publication, ms.
        age_ms: u32,
        /// What made it.
        by: By,
    },
    /// No position.
    None {
        /// Why.
        reason: Reason,
        /// Anchors that answered.
        answered: u8,
        /// Anchors that were asked.
        asked: u8,
        /// What found none.
        by: By,
    },
}

/// What made a position, where that is known.
pub struct By(Solver);

text!(By, |this| this.0.as_str();
    Some(name) => (", {}", name),
    None => (""),
);

impl FixLine {
    /// The line of a fix, in whose round so many anchors answered.
    pub fn of(fix: &Fix, answered: u8) -> Self {
        let by = By(fix.solver);
        match fix.outcome {
            Outcome::Position { position, deviation, used, .. } => {
                let square: u64 = deviation
                    .iter()
                    .map(|&axis| u64::from(axis).saturating_mul(axis.into()))
                    .fold(0, u64::saturating_add);
                let size = Centimetres::of(i32::try_from(square.isqrt()).unwrap_or(i32::MAX));
                let position = position.map(Centimetres::of);
                let (used, age_ms) = (used.count_ones(), fix.age_us.saturating_add(500) / 1000);
                if deviation[2] == 0 {
                    Self::Plane { position, deviation: size, used, age_ms, by }
                } else {
                    Self::Space { position, deviation: size, used, age_ms, by }
                }
            }
            Outcome::Reason(reason) => Self::None { reason, answered, asked: fix.asked, by },
        }
    }
}

text!(FixLine, |this| this;
    Self::Space { position: [x, y, z], deviation, used, age_ms, by } =>
        ("fix x={} y={} z={} ±{} m, {} anchors, {} ms{}", x, y, z, deviation, used, age_ms, by),
    Self::Plane { position: [x, y, z], deviation, used, age_ms, by } =>
        ("fix x={} y={} z={} (given) ±{} m, {} anchors, {} ms{}", x, y, z, deviation, used, age_ms, by),
    Self::None { reason, answered, asked, by } =>
        ("no fix: {} ({} of {} answered){}", reason.as_str(), answered, asked, by),
);

/// From the line of one round to that of the next, at least, microseconds: nobody reads more, and no interrupt is served while a line is
/// written. Telemetry has every round.
const FIX_LINE_US: u64 = 40_000;

/// Which rounds get a line.
#[derive(Debug, Default)]
pub struct LinePace {
    last_us: Option<u64>,
}

impl LinePace {
    /// None had one yet.
    pub const fn new() -> Self {
        Self { last_us: None }
    }

    /// Whether the round of `t_us`, microseconds, gets one.
    pub fn is_due(&mut self, t_us: u64) -> bool {
        let due = self.last_us.is_none_or(|last_us| t_us.saturating_sub(last_us) >= FIX_LINE_US);
        if due {
            self.last_us = Some(t_us);
        }
        due
    }
}

/// Who is speaking.
pub struct HelloLine(pub Hello);

text!(HelloLine, |this| (this.0.role, this.0.build);
    (role, [a, b, c, d, e, f, g, h]) => (
        "{} {:04x} on {}, EUI {:08x}{:08x}, build {:02x}{:02x}{:02x}{:02x}{:02x}{:02x}{:02x}{:02x}",
        role.as_str(),
        this.0.address,
        this.0.board.name(),
        (this.0.eui >> 32) as u32,
        this.0.eui as u32,
        a, b, c, d, e, f, g, h
    ),
);

/// A change of state.
pub struct StateLine(pub Condition);

text!(StateLine, |this| this.0;
    Condition::NoRecord(RecordError::Missing) =>
        ("no record in flash: nothing is sent; `baliza provision` writes one"),
    Condition::NoRecord(RecordError::Version(version)) =>
        ("the record in flash is of version {}, which this image does not read: nothing is sent", version),
    Condition::NoRecord(RecordError::Corrupt) => ("the record in flash is corrupt: nothing is sent"),
    Condition::NoRecord(RecordError::Invalid) => ("the record in flash cannot be followed: nothing is sent"),
    Condition::WrongRecord => ("the record in flash is for another role or board: nothing is sent"),
    Condition::Searching => ("searching"),
    Condition::Paired(peer) => ("paired with {:04x}", peer),
    Condition::Synchronised(coordinator) => ("synchronised with the network of {:04x}", coordinator),
    Condition::Joined(slots) => ("joined, {} slots a superframe", slots),
    Condition::NetworkFull => ("network full: all places are taken, no slots for this tag"),
    Condition::Coordinating => ("coordinating"),
    Condition::Following(coordinator) => ("following {:04x}", coordinator),
    Condition::RadioFailed(times) => ("radio failed, {} in a row; starting it again", times),
    Condition::ScannerRestarted(times) => ("scanner silent, restarted {} times", times),
    Condition::Advertising => ("advertising"),
    Condition::Unused(levels, RssiModelError::Version(version)) =>
        ("{} in flash: of version {}, which this image does not read; not used", levels.as_str(), version),
    Condition::Unused(levels, RssiModelError::Corrupt) => ("{} in flash: damaged; not used", levels.as_str()),
    Condition::Unused(levels, RssiModelError::Invalid) => ("{} in flash: not for a tag; not used", levels.as_str()),
    Condition::Unused(levels, RssiModelError::OtherBeacons) =>
        ("{} in flash: of beacons that the record does not list; not used", levels.as_str()),
    Condition::BeaconMoved(of) => (
        "beacon {}-{} is not where, or as loud as, it is listed: {} s of levels; not used", of.major, of.minor, of.seconds
    ),
    Condition::BeaconDuplicated(of) => ("two senders are beacon {}-{}: {} s of levels; not used", of.major, of.minor, of.seconds),
    Condition::BeaconRestored(of) => ("beacon {}-{} agrees again, for {} s", of.major, of.minor, of.seconds),
    Condition::MotionSensor(MotionSensor::Ready) => ("motion sensor ready"),
    Condition::MotionSensor(MotionSensor::Silent) => ("motion sensor does not answer: positions alone count"),
    Condition::MotionSensor(MotionSensor::Foreign) => ("not the motion sensor answers: positions alone count"),
    Condition::MotionSensor(MotionSensor::Endless) => ("motion sensor reports movement without end: positions alone count"),
);

/// In which room a tag is.
pub struct RoomLine(pub RoomEstimate);

text!(RoomLine, |this| this.0;
    RoomEstimate::Unknown => ("room unknown"),
    RoomEstimate::Room(RoomProbability { room, probability }) => ("room {} ({} %)", room, percent(probability)),
    RoomEstimate::Between([one, other]) => (
        "room {} ({} %) or {} ({} %)", one.room, percent(one.probability), other.room, percent(other.probability)
    ),
);

fn percent(probability: u8) -> u32 {
    (u32::from(probability) * 100 + 127) / 255
}

/// What was counted, for whoever wants to see it go by.
pub struct CountersLine(pub Counters);

text!(CountersLine, |this| &this.0;
    Counters { sent, received, timeouts, corrupt, late, not_sent, radio_failures, rounds_dropped, telemetry_dropped, .. } => (
        "{} sent, {} received, {} timeouts, {} corrupt, {} late, {} not sent, {} radio failures, {} rounds and {} telemetry frames dropped",
        sent, received, timeouts, corrupt, late, not_sent, radio_failures, rounds_dropped, telemetry_dropped
    ),
);

/// Why the node started.
pub struct ResetLine(pub Reset);

text!(ResetLine, |this| (this.0.cause, this.0.crash);
    (ResetCause::Other(number), None) => ("reset: other ({:08x})", number),
    (cause, None) => ("reset: {}", cause.as_str()),
    (cause, Some(Crash { reason: CrashReason::Panic, program_counter, line, .. })) =>
        ("reset: {}; crashed before: panic at pc 0x{:08x}, line {}", cause.as_str(), program_counter, line),
    (cause, Some(Crash { reason, program_counter, .. })) =>
        ("reset: {}; crashed before: {} at pc 0x{:08x}", cause.as_str(), reason.as_str(), program_counter),
);

#[cfg(test)]
mod tests {
    use super::*;
    use std::string::{String, ToString};
    use wire::telemetry::{Board, Levels, Role};

    fn fix(deviation: [u32; 3]) -> String {
        let outcome = Outcome::Position {
            position: [32_149, -450, 15_000],
            deviation,
            correlation: [0; 3],
            used: 0b11_0111_1000,
            quality: 255,
        };
        FixLine::of(&Fix { t_us: 0, round: 0, age_us: 12_400, asked: 8, outcome, solver: Solver::BWls }, 6).to_string()
    }

    #[test]
    fn a_fix_in_space_and_in_the_plane() {
        // √(300² + 400² + 350²) = 610: 6.1 cm. √(300² + 400²) = 500: 5 cm.
        assert_eq!(fix([300, 400, 350]), "fix x=3.21 y=-0.05 z=1.50 ±0.06 m, 6 anchors, 12 ms, b-wls");
        assert_eq!(fix([300, 400, 0]), "fix x=3.21 y=-0.05 z=1.50 (given) ±0.05 m, 6 anchors, 12 ms, b-wls");
    }

    #[test]
    fn of_many_rounds_some_get_a_line_and_of_few_each() {
        let lines = |every_us: u64| {
            let mut pace = LinePace::new();
            (0..1_000_000).step_by(every_us as usize).filter(|t_us| pace.is_due(*t_us)).count()
        };
        // 400 rounds a second: each 40 ms. 20 rounds a second: all.
        assert_eq!((lines(2_500), lines(50_000)), (25, 20));
    }

    #[test]
    fn lengths_are_rounded_and_never_overflow() {
        let shown = |value| Centimetres::of(value).to_string();
        assert_eq!(
            (shown(149), shown(150), shown(-149), shown(-150)),
            ("0.01".into(), "0.02".into(), "-0.01".into(), "-0.02".into())
        );
        assert_eq!((shown(49), shown(-49)), ("0.00".into(), "0.00".into()));
        // 2 147 483 647 · 0.1 mm, cut at the last.
        assert_eq!((shown(i32::MAX), shown(i32::MIN)), ("214748.36".into(), "-214748.36".into()));
        // The root of three times the square of the longest is longer than a length can be.
        assert!(fix([u32::MAX; 3]).contains("±214748.36 m"));
    }

    #[test]
    fn no_fix_tells_how_many_answered() {
        let outcome = Outcome::Reason(Reason::TooFewAnchors);
        let line = FixLine::of(&Fix { t_us: 0, round: 0, age_us: 0, asked: 4, outcome, solver: Solver::Unknown }, 2);
        assert_eq!(line.to_string(), "no fix: too-few-anchors (2 of 4 answered)");
    }

    #[test]
    fn resets() {
        let crash = Crash { reason: CrashReason::Panic, program_counter: 0x1_2345, line: 123, file: 0 };
        let line = |cause, crash| ResetLine(Reset { t_us: 0, cause, crash }).to_string();
        assert_eq!(
            line(ResetCause::Watchdog, Some(crash)),
            "reset: watchdog; crashed before: panic at pc 0x00012345, line 123"
        );
        let stalled = Crash { reason: CrashReason::Stalled, ..crash };
        assert_eq!(
            line(ResetCause::Watchdog, Some(stalled)),
            "reset: watchdog; crashed before: stalled at pc 0x00012345"
        );
        assert_eq!(line(ResetCause::PowerOn, None), "reset: power-on");
        assert_eq!(line(ResetCause::Other(0x42), None), "reset: other (00000042)");
    }

    #[test]
    fn states_and_counters() {
        let line = StateLine(Condition::NoRecord(RecordError::Version(2))).to_string();
        assert_eq!(line, "the record in flash is of version 2, which this image does not read: nothing is sent");
        assert_eq!(StateLine(Condition::Synchronised(0xA1)).to_string(), "synchronised with the network of 00a1");
        let counters = Counters { sent: 1, received: 2, timeouts: 3, telemetry_dropped: 4, ..Counters::default() };
        let expected = "1 sent, 2 received, 3 timeouts, 0 corrupt, 0 late, 0 not sent, 0 radio failures, 0 rounds and 4 telemetry frames dropped";
        assert_eq!(CountersLine(counters).to_string(), expected);
    }

    #[test]
    fn rooms_and_levels_that_are_not_used() {
        let [one, other] =
            [RoomProbability { room: 3, probability: 242 }, RoomProbability { room: 0, probability: 51 }];
        // 242 and 51 of 255 are 94.9 and 20 %.
        assert_eq!(RoomLine(RoomEstimate::Room(one)).to_string(), "room 3 (95 %)");
        assert_eq!(RoomLine(RoomEstimate::Between([one, other])).to_string(), "room 3 (95 %) or 0 (20 %)");
        assert_eq!(RoomLine(RoomEstimate::Unknown).to_string(), "room unknown");
        let line = StateLine(Condition::Unused(Levels::Map, RssiModelError::Corrupt)).to_string();
        assert_eq!(line, "map of levels in flash: damaged; not used");
    }

    #[test]
    fn who_is_speaking() {
        let hello = Hello {
            t_us: 0,
            eui: 0xDECA_0000_0000_1234,
            address: 0x1234,
            role: Role::Tag,
            board: Board::Dwm1001,
            build: [0xDD, 0x7E, 0x67, 0xA0, 1, 2, 3, 0xFF],
        };
        let expected = "tag 1234 on dwm1001, EUI deca000000001234, build dd7e67a0010203ff";
        assert_eq!(HelloLine(hello).to_string(), expected);
    }
}
