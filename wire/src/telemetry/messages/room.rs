//! The room estimate of a tag.

use core::fmt;

use postcard::experimental::max_size::MaxSize;
use serde::{Deserialize, Serialize};

use crate::telemetry::Body;
use crate::telemetry::log;
use crate::telemetry::quantised::nearest;
use crate::telemetry::text::text;

/// The room estimate of a tag, by its model of rooms.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Room {
    /// Since the node started, microseconds.
    pub t_us: u64,
    /// The estimate from now on.
    pub is: RoomEstimate,
}

/// The room of a tag. Rooms are numbered as in the model; a smoothed probability is in 1/255.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
pub enum RoomEstimate {
    /// No beacon of the model was received recently.
    Unknown,
    /// In this room.
    Room(RoomProbability),
    /// Between two rooms, the more probable one first.
    Between([RoomProbability; 2]),
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

    /// The rooms of the estimate, the more probable one first.
    pub fn rooms(&self) -> &[RoomProbability] {
        match self {
            Self::Unknown => &[],
            Self::Room(room) => core::slice::from_ref(room),
            Self::Between(rooms) => rooms,
        }
    }
}

/// A room that is likely.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RoomProbability {
    /// Its number in the model, from 0.
    pub room: u8,
    /// 1/255.
    pub probability_255ths: u8,
}

impl RoomProbability {
    /// A room with its probability, 0 to 1. Values outside this range become the nearest limit; NaN becomes 0.
    pub fn new(room: u8, probability: f32) -> Self {
        // The conversion saturates.
        Self { room, probability_255ths: nearest(probability * 255.0) as u8 }
    }

    /// Its probability, 0 to 1.
    pub fn probability(self) -> f64 {
        f64::from(self.probability_255ths) / 255.0
    }

    /// Its probability, per cent.
    pub fn percent(self) -> u32 {
        (u32::from(self.probability_255ths) * 100 + 127) / 255
    }
}

text!(RoomEstimate, |this| this;
    Self::Unknown => ("unknown"),
    Self::Room(likely) => ("{} ({} %)", likely.room, likely.percent()),
    Self::Between([one, other]) =>
        ("{} ({} %) or {} ({} %)", one.room, one.percent(), other.room, other.percent()),
);

/// The room estimate of a tag, as a line of the log.
pub struct RoomLine(pub RoomEstimate);

text!(RoomLine, |this| this;
    Self(is) => ("room {}", is),
);

impl fmt::Display for Room {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.is.fmt(out)
    }
}

impl Body for Room {
    const KIND: &'static str = "room";
    #[cfg(feature = "host")]
    const TABLE: Option<crate::telemetry::Table> = Some(crate::telemetry::Table {
        name: "rooms",
        rows: "rooms",
        counted: "times in which room",
        about: "In which rooms a tag is",
        columns: &["is", "room", "probability", "other_room", "other_probability"],
    });

    fn log(&self) {
        log::write(self.severity(), &RoomLine(self.is));
    }

    #[cfg(feature = "host")]
    fn json(&self) -> serde_json::Value {
        let likely = self.is.rooms().iter();
        serde_json::json!({
            "is": self.is.as_str(),
            "rooms": likely.clone().map(|of| of.room).collect::<std::vec::Vec<_>>(),
            "probabilities": likely.map(|of| crate::telemetry::host::rounded(of.probability(), 1e3)).collect::<std::vec::Vec<_>>(),
        })
    }

    #[cfg(feature = "host")]
    fn fields(&self) -> std::vec::Vec<std::string::String> {
        use std::string::{String, ToString};
        let mut fields = std::vec![self.is.as_str().to_string()];
        fields.extend(
            self.is.rooms().iter().flat_map(|of| [of.room.to_string(), std::format!("{:.3}", of.probability())]),
        );
        fields.resize_with(5, String::new);
        fields
    }
}

#[cfg(test)]
mod tests {
    use std::string::ToString;

    use super::*;

    #[test]
    fn rooms_have_their_probabilities_in_percent() {
        let [one, other] =
            [RoomProbability { room: 3, probability_255ths: 242 }, RoomProbability { room: 0, probability_255ths: 51 }];
        // 242 and 51 of 255 are 94.9 and 20 %.
        assert_eq!(RoomLine(RoomEstimate::Room(one)).to_string(), "room 3 (95 %)");
        assert_eq!(RoomLine(RoomEstimate::Between([one, other])).to_string(), "room 3 (95 %) or 0 (20 %)");
        assert_eq!(RoomLine(RoomEstimate::Unknown).to_string(), "room unknown");
    }
}
