//! How files and screens spell what the wire has as numbers.

use core::fmt::{self, Display, Formatter};

use positioning_core::SolveError;

use crate::telemetry::{
    Condition, CrashReason, DecodeError, Levels, Message, MotionSensor, Reason, RecordError, ResetCause, Role,
    RoomEstimate, RssiModelError, Solver,
};

impl Message {
    /// Of which kind it is: `hello`, `fix`, `range`, `sighting`, `state`, `counters`, `reset`, `difference`, `room`.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Hello(_) => "hello",
            Self::Fix(_) => "fix",
            Self::Range(_) => "range",
            Self::Sighting(_) => "sighting",
            Self::State(_) => "state",
            Self::Counters(_) => "counters",
            Self::Reset(_) => "reset",
            Self::Difference(_) => "difference",
            Self::Room(_) => "room",
        }
    }
}

impl Role {
    /// `tag`, `anchor`, `beacon`.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Tag => "tag",
            Self::Anchor => "anchor",
            Self::Beacon => "beacon",
        }
    }
}

impl Solver {
    /// Its name, as the record spells it; none where it is not known.
    pub fn as_str(self) -> Option<&'static str> {
        match self {
            Self::Unknown => None,
            Self::Track => Some("track"),
            Self::Robust => Some("robust"),
            Self::BWls => Some("b-wls"),
            Self::BWlsR => Some("b-wls-r"),
            Self::BoundingBox => Some("bounding-box"),
        }
    }
}

impl Reason {
    /// As [`SolveError::as_str`] spells it.
    pub fn as_str(self) -> &'static str {
        SolveError::from(self).as_str()
    }
}

/// How much a condition matters to a person.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Severity {
    /// The node does not work.
    Error,
    /// Something is wrong, and the node goes on without it.
    Warning,
    /// It works.
    Info,
}

impl Condition {
    /// How much it matters.
    pub fn severity(self) -> Severity {
        match self {
            Self::NoRecord(_) | Self::WrongRecord => Severity::Error,
            Self::RadioFailed(_)
            | Self::NetworkFull
            | Self::ScannerRestarted(_)
            | Self::Unused(..)
            | Self::BeaconMoved(_)
            | Self::BeaconDuplicated(_)
            | Self::MotionSensor(MotionSensor::Silent | MotionSensor::Foreign | MotionSensor::Endless) => {
                Severity::Warning
            }
            Self::Searching
            | Self::Paired(_)
            | Self::Synchronised(_)
            | Self::Joined(_)
            | Self::Coordinating
            | Self::Following(_)
            | Self::Advertising
            | Self::BeaconRestored(_)
            | Self::MotionSensor(MotionSensor::Ready) => Severity::Info,
        }
    }

    /// Its name, without what it carries.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::NoRecord(_) => "no-record",
            Self::WrongRecord => "wrong-record",
            Self::Searching => "searching",
            Self::Paired(_) => "paired",
            Self::Synchronised(_) => "synchronised",
            Self::Joined(_) => "joined",
            Self::Coordinating => "coordinating",
            Self::Following(_) => "following",
            Self::RadioFailed(_) => "radio-failed",
            Self::ScannerRestarted(_) => "scanner-restarted",
            Self::Advertising => "advertising",
            Self::Unused(Levels::All, _) => "levels-unused",
            Self::Unused(Levels::Map, _) => "map-unused",
            Self::Unused(Levels::Rooms, _) => "rooms-unused",
            Self::BeaconMoved(_) => "beacon-elsewhere",
            Self::BeaconDuplicated(_) => "beacon-doubled",
            Self::BeaconRestored(_) => "beacon-believed",
            Self::NetworkFull => "network-full",
            Self::MotionSensor(MotionSensor::Ready) => "motion-sensor-ready",
            Self::MotionSensor(MotionSensor::Silent) => "motion-sensor-silent",
            Self::MotionSensor(MotionSensor::Foreign) => "motion-sensor-foreign",
            Self::MotionSensor(MotionSensor::Endless) => "motion-sensor-endless",
        }
    }
}

impl Levels {
    /// What it is.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::All => "models of beacons",
            Self::Map => "map of levels",
            Self::Rooms => "model of rooms",
        }
    }
}

impl RssiModelError {
    /// Its name, without what it carries.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Version(_) => "version",
            Self::Corrupt => "corrupt",
            Self::Invalid => "invalid",
            Self::OtherBeacons => "other-beacons",
        }
    }
}

impl RoomEstimate {
    /// Its name: `unknown`, `room`, `between`.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Unknown => "unknown",
            Self::Room(_) => "room",
            Self::Between(_) => "between",
        }
    }
}

impl RecordError {
    /// Its name, without what it carries.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Missing => "missing",
            Self::Version(_) => "version",
            Self::Corrupt => "corrupt",
            Self::Invalid => "invalid",
        }
    }
}

impl ResetCause {
    /// Its name, without what it carries.
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

impl Display for DecodeError {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooLong => f.write_str("too long to be a frame"),
            Self::Cobs => f.write_str("COBS is violated"),
            Self::Checksum => f.write_str("the checksum is wrong"),
            Self::Schema(schema) => write!(f, "schema {schema}, not {}", crate::telemetry::SCHEMA),
            Self::Unknown => f.write_str("a message of a newer build"),
            Self::Body => f.write_str("the body is not what the schema says"),
        }
    }
}

impl core::error::Error for DecodeError {}
