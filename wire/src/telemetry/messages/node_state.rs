//! A change of the node's state.

use core::fmt;

use postcard::experimental::max_size::MaxSize;
use serde::{Deserialize, Serialize};

use crate::telemetry::text::text;
use crate::telemetry::{Address, Body, Severity, log};

/// A change of the node's state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct State {
    /// Since the node started, microseconds.
    pub t_us: u64,
    /// The condition from now on.
    pub is: Condition,
}

/// A condition of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
pub enum Condition {
    /// There is no valid config record in flash: the node does not transmit.
    NoRecord(RecordError),
    /// The config record is for another role or board than this image: the node does not transmit.
    WrongRecord,
    /// Looking for peers.
    Searching,
    /// DecaRanging: paired with this peer.
    Paired(u16),
    /// Native: synchronised with the network that this anchor coordinates.
    Synchronised(u16),
    /// Native: a member with this many slots a superframe.
    Joined(u8),
    /// Native: this anchor coordinates.
    Coordinating,
    /// Native: this anchor follows that coordinator.
    Following(u16),
    /// The radio failed for the n-th time in a row, and is started again.
    RadioFailed(u32),
    /// The Bluetooth scanner was silent and was restarted, for the n-th time.
    ScannerRestarted(u32),
    /// Advertises.
    Advertising,
    /// The models of the beacons' RSSI at the site are not used: all of them, or a part.
    Unused(SiteModelPart, RssiModelError),
    /// A listed beacon's RSSI values contradict its configured position: it is not used for positions.
    BeaconMoved(BeaconEvidence),
    /// A listed beacon's RSSI values are those of two senders: it is not used for positions.
    BeaconDuplicated(BeaconEvidence),
    /// A listed beacon that was excluded agrees with its configuration again.
    BeaconRestored(BeaconEvidence),
    /// Native: the tag gets no slots, because all places of the network are taken.
    NetworkFull,
    /// The state of a tag's motion sensor.
    MotionSensor(MotionSensor),
    /// Native: the network's list has the tag no more; it requests slots again.
    Unlisted,
}

impl Condition {
    /// Its severity.
    pub fn severity(self) -> Severity {
        match self {
            Self::NoRecord(_) | Self::WrongRecord => Severity::Error,
            Self::RadioFailed(_)
            | Self::NetworkFull
            | Self::Unlisted
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

    /// Whether the node is in this condition from now on. A condition of a beacon or a sensor does not change that of
    /// the node.
    pub fn is_of_node(self) -> bool {
        match self {
            Self::BeaconMoved(_) | Self::BeaconDuplicated(_) | Self::BeaconRestored(_) | Self::MotionSensor(_) => false,
            Self::NoRecord(_)
            | Self::WrongRecord
            | Self::Searching
            | Self::Paired(_)
            | Self::Synchronised(_)
            | Self::Joined(_)
            | Self::Coordinating
            | Self::Following(_)
            | Self::RadioFailed(_)
            | Self::ScannerRestarted(_)
            | Self::Advertising
            | Self::Unused(..)
            | Self::NetworkFull
            | Self::Unlisted => true,
        }
    }

    /// Its name, without its contents.
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
            Self::Unused(SiteModelPart::All, _) => "levels-unused",
            Self::Unused(SiteModelPart::Map, _) => "map-unused",
            Self::Unused(SiteModelPart::Rooms, _) => "rooms-unused",
            Self::BeaconMoved(_) => "beacon-elsewhere",
            Self::BeaconDuplicated(_) => "beacon-doubled",
            Self::BeaconRestored(_) => "beacon-believed",
            Self::NetworkFull => "network-full",
            Self::Unlisted => "unlisted",
            Self::MotionSensor(MotionSensor::Ready) => "motion-sensor-ready",
            Self::MotionSensor(MotionSensor::Silent) => "motion-sensor-silent",
            Self::MotionSensor(MotionSensor::Foreign) => "motion-sensor-foreign",
            Self::MotionSensor(MotionSensor::Endless) => "motion-sensor-endless",
        }
    }
}

text!(Condition, |this| this;
    Self::NoRecord(RecordError::Missing) =>
        ("no record in flash: nothing is sent; `baliza provision` writes one"),
    Self::NoRecord(RecordError::Version(version)) =>
        ("the record in flash is of version {}, which this image does not read: nothing is sent", version),
    Self::NoRecord(RecordError::Corrupt) => ("the record in flash is corrupt: nothing is sent"),
    Self::NoRecord(RecordError::Invalid) => ("the record in flash cannot be followed: nothing is sent"),
    Self::WrongRecord => ("the record in flash is for another role or board: nothing is sent"),
    Self::Searching => ("searching"),
    Self::Paired(peer) => ("paired with {}", Address(*peer)),
    Self::Synchronised(coordinator) => ("synchronised with the network of {}", Address(*coordinator)),
    Self::Joined(slots) => ("joined, {} slots a superframe", slots),
    Self::NetworkFull => ("network full: all places are taken, no slots for this tag"),
    Self::Unlisted => ("unlisted: the network gives this tag no slots any more; it requests them again"),
    Self::Coordinating => ("coordinating"),
    Self::Following(coordinator) => ("following {}", Address(*coordinator)),
    Self::RadioFailed(times) => ("radio failed, {} in a row; starting it again", times),
    Self::ScannerRestarted(times) => ("scanner silent, restarted {} times", times),
    Self::Advertising => ("advertising"),
    Self::Unused(levels, RssiModelError::Version(version)) =>
        ("{} in flash: of version {}, which this image does not read; not used", levels.as_str(), version),
    Self::Unused(levels, RssiModelError::Corrupt) => ("{} in flash: damaged; not used", levels.as_str()),
    Self::Unused(levels, RssiModelError::Invalid) => ("{} in flash: not for a tag; not used", levels.as_str()),
    Self::Unused(levels, RssiModelError::OtherBeacons) =>
        ("{} in flash: of beacons that the record does not list; not used", levels.as_str()),
    Self::BeaconMoved(of) => (
        "beacon {}-{} is not where, or as loud as, it is listed: {} s of levels; not used", of.major, of.minor, of.seconds
    ),
    Self::BeaconDuplicated(of) => ("two senders are beacon {}-{}: {} s of levels; not used", of.major, of.minor, of.seconds),
    Self::BeaconRestored(of) => ("beacon {}-{} agrees again, for {} s", of.major, of.minor, of.seconds),
    Self::MotionSensor(MotionSensor::Ready) => ("motion sensor ready"),
    Self::MotionSensor(MotionSensor::Silent) => ("motion sensor does not answer: positions alone count"),
    Self::MotionSensor(MotionSensor::Foreign) => ("not the motion sensor answers: positions alone count"),
    Self::MotionSensor(MotionSensor::Endless) => ("motion sensor reports movement without end: positions alone count"),
);

impl fmt::Display for State {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.is.fmt(out)
    }
}

impl Body for State {
    const KIND: &'static str = "state";

    fn severity(&self) -> Severity {
        self.is.severity()
    }

    fn log(&self) {
        log::write(self.severity(), &self.is);
    }

    #[cfg(feature = "host")]
    fn json(&self) -> serde_json::Value {
        let (mut peer, mut slots, mut times, mut record_fault, mut record_version) = (None, None, None, None, None);
        let (mut levels_fault, mut levels_version) = (None, None);
        let (mut beacon, mut for_s) = (None, None);
        match self.is {
            Condition::NoRecord(fault) => {
                record_fault = Some(fault.as_str());
                record_version = match fault {
                    RecordError::Version(version) => Some(version),
                    RecordError::Missing | RecordError::Corrupt | RecordError::Invalid => None,
                };
            }
            Condition::Paired(of) | Condition::Synchronised(of) | Condition::Following(of) => {
                peer = Some(std::string::ToString::to_string(&Address(of)));
            }
            Condition::Joined(of) => slots = Some(of),
            Condition::RadioFailed(of) | Condition::ScannerRestarted(of) => times = Some(of),
            Condition::Unused(_, fault) => {
                levels_fault = Some(fault.as_str());
                levels_version = match fault {
                    RssiModelError::Version(version) => Some(version),
                    RssiModelError::Corrupt | RssiModelError::Invalid | RssiModelError::OtherBeacons => None,
                };
            }
            Condition::BeaconMoved(of) | Condition::BeaconDuplicated(of) | Condition::BeaconRestored(of) => {
                beacon = Some(std::format!("{}-{}", of.major, of.minor));
                for_s = Some(of.seconds);
            }
            Condition::WrongRecord
            | Condition::Searching
            | Condition::NetworkFull
            | Condition::Unlisted
            | Condition::MotionSensor(_)
            | Condition::Coordinating
            | Condition::Advertising => {}
        }
        serde_json::json!({
            "state": self.is.as_str(),
            "peer": peer,
            "slots": slots,
            "times": times,
            "record_fault": record_fault,
            "record_version": record_version,
            "levels_fault": levels_fault,
            "levels_version": levels_version,
            "beacon": beacon,
            "for_s": for_s,
        })
    }
}

/// The state of a tag's motion sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum MotionSensor {
    /// It is set up, and its reports of movement are used.
    Ready,
    /// It does not answer: only positions show whether the tag moves.
    Silent,
    /// Another chip answers at its address: only positions show whether the tag moves.
    Foreign,
    /// It has reported movement for minutes although the positions do not change: only positions show whether the tag
    /// moves, until the sensor reports no movement for some seconds.
    Endless,
}

/// A tag's models of the beacons' RSSI at the site.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum SiteModelPart {
    /// All models.
    All,
    /// The map of fingerprints.
    Map,
    /// The model of rooms.
    Rooms,
}

impl SiteModelPart {
    /// The name of the model.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::All => "models of beacons",
            Self::Map => "map of levels",
            Self::Rooms => "model of rooms",
        }
    }
}

/// Why it is not used.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum RssiModelError {
    /// It is of this version, which the image does not read.
    Version(u8),
    /// A checksum is wrong, or it is cut short.
    Corrupt,
    /// It is whole, but a tag cannot use it.
    Invalid,
    /// It is for beacons that the config record does not list.
    OtherBeacons,
}

impl RssiModelError {
    /// Its name, without its contents.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Version(_) => "version",
            Self::Corrupt => "corrupt",
            Self::Invalid => "invalid",
            Self::OtherBeacons => "other-beacons",
        }
    }
}

/// A listed beacon whose classification has changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct BeaconEvidence {
    /// Major number.
    pub major: u16,
    /// Minor number.
    pub minor: u16,
    /// For how long its RSSI values have shown this, seconds.
    pub seconds: u16,
}

/// What is wrong with the config record in flash.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum RecordError {
    /// Both pages are erased.
    Missing,
    /// It is of this version, which the image does not read.
    Version(u8),
    /// Its checksum is wrong, or it is cut short.
    Corrupt,
    /// It is whole, but a value in it is invalid.
    Invalid,
}

impl RecordError {
    /// Its name, without its contents.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Missing => "missing",
            Self::Version(_) => "version",
            Self::Corrupt => "corrupt",
            Self::Invalid => "invalid",
        }
    }
}

#[cfg(test)]
mod tests {
    use std::string::ToString;

    use super::*;

    #[test]
    fn a_condition_is_a_sentence() {
        let line = Condition::NoRecord(RecordError::Version(2)).to_string();
        assert_eq!(line, "the record in flash is of version 2, which this image does not read: nothing is sent");
        assert_eq!(Condition::Synchronised(0xA1).to_string(), "synchronised with the network of 0x00A1");
        let line = Condition::Unused(SiteModelPart::Map, RssiModelError::Corrupt).to_string();
        assert_eq!(line, "map of levels in flash: damaged; not used");
    }
}
