//! The keys of a scenario's `[[tag]]` about its motion sensor.

use serde::Deserialize;

use crate::lis2dh12::Condition;
use crate::scenario::{Carrier, MotionSensor};

/// `carried_by`.
#[derive(Clone, Copy, Default, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum CarrierName {
    #[default]
    Person,
    Trolley,
}

impl From<CarrierName> for Carrier {
    fn from(name: CarrierName) -> Self {
        match name {
            CarrierName::Person => Self::Person,
            CarrierName::Trolley => Self::Trolley,
        }
    }
}

/// `motion_sensor`.
#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum SensorName {
    Works,
    None,
    Silent,
    Hung,
    Foreign,
    StuckHigh,
    StuckLow,
}

impl From<Option<SensorName>> for MotionSensor {
    fn from(name: Option<SensorName>) -> Self {
        Self::Fitted(match name {
            None => return Self::OfBoard,
            Some(SensorName::None) => return Self::Absent,
            Some(SensorName::Works) => Condition::Works,
            Some(SensorName::Silent) => Condition::Silent,
            Some(SensorName::Hung) => Condition::Hung,
            Some(SensorName::Foreign) => Condition::Foreign,
            Some(SensorName::StuckHigh) => Condition::Stuck(true),
            Some(SensorName::StuckLow) => Condition::Stuck(false),
        })
    }
}
