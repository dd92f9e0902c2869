//! The position of a tag, as an anchor received it in the tag's poll.

use core::fmt;

use postcard::experimental::max_size::MaxSize;
use serde::{Deserialize, Serialize};

use super::fix::deviation_in_space;
use super::{Doubt, Fix, Outcome, Solver};
use crate::telemetry::text::Centimetres;
use crate::telemetry::{Address, Body, Tone};
use crate::uwb::native::PolledPosition;

/// The position of a tag, as an anchor received it in the tag's poll: a site's tags need no cable where one of its
/// anchors has one. The anchor passes the bytes on; the host reads them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TagFix {
    /// When it is reported, since the reporting anchor started, microseconds.
    pub t_us: u64,
    /// Short address of the tag.
    pub tag: u16,
    /// The round of the poll, as the tag counts it.
    pub round: u16,
    /// Anchors that the poll asked.
    pub asked: u8,
    /// How long before that another anchor received the poll and passed it on, microseconds; 0 of an own reception.
    pub age_us: u32,
    /// The position as the poll carries it.
    pub position: [u8; PolledPosition::BYTES],
}

impl TagFix {
    /// How many rounds before that of the poll the position was measured.
    pub const fn rounds_ago(&self) -> u8 {
        PolledPosition(self.position).rounds_ago()
    }

    /// The tag's own fix, as far as its poll says it: which ranges were used is not known, and of a suspect position
    /// whether another place fits. `None` if the bytes are of no position.
    pub fn fix(&self) -> Option<Fix> {
        let position = PolledPosition(self.position);
        let outcome = position.outcome().ok()?;
        let round = self.round.wrapping_sub(position.rounds_ago().into());
        let doubt = if position.is_suspect() { Doubt::Suspect } else { Doubt::None };
        let Self { t_us, asked, age_us, .. } = *self;
        Some(Fix { t_us, round, age_us, asked, outcome, solver: Solver::Unknown, doubt })
    }
}

impl fmt::Display for TagFix {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let tag = Address(self.tag);
        let Some(Fix { outcome: Outcome::Position { position_tenth_mm, deviation_tenth_mm, .. }, doubt, .. }) =
            self.fix()
        else {
            return write!(out, "{tag} no position");
        };
        let [x, y, z] = position_tenth_mm.map(Centimetres::of_tenth_mm);
        let (deviation, ago) = (deviation_in_space(deviation_tenth_mm), self.rounds_ago());
        write!(out, "{tag} x={x} y={y} z={z} ±{deviation} m, {ago} rounds ago{doubt}")
    }
}

impl Body for TagFix {
    const KIND: &'static str = "tag-fix";
    const LABEL: &'static str = "tag";
    #[cfg(feature = "host")]
    const TABLE: Option<crate::telemetry::Table> = Some(crate::telemetry::Table {
        name: "tag-positions",
        rows: "tag_positions",
        counted: "positions of tags",
        about: "Positions that an anchor received in the polls of tags",
        columns: &[
            "method",
            "x_m",
            "y_m",
            "z_m",
            "sigma_x_m",
            "sigma_y_m",
            "sigma_z_m",
            "flag",
            "tag",
            "round",
            "rounds_ago",
            "age_s",
        ],
    });

    fn tone(&self) -> Tone {
        Tone::Good
    }

    #[cfg(feature = "host")]
    fn json(&self) -> serde_json::Value {
        let mut of_fix = self.fix().map_or(serde_json::Value::Null, |fix| fix.json());
        let mut take = |key: &str| of_fix.get_mut(key).map_or(serde_json::Value::Null, serde_json::Value::take);
        serde_json::json!({
            "tag": std::format!("{}", Address(self.tag)),
            "round": take("round"),
            "rounds_ago": self.rounds_ago(),
            "asked": self.asked,
            "age_s": take("age_s"),
            "x_m": take("x_m"),
            "y_m": take("y_m"),
            "z_m": take("z_m"),
            "sigma_x_m": take("sigma_x_m"),
            "sigma_y_m": take("sigma_y_m"),
            "sigma_z_m": take("sigma_z_m"),
            "covariance_m2": take("covariance_m2"),
            "flag": take("flag"),
        })
    }

    #[cfg(feature = "host")]
    fn fields(&self) -> std::vec::Vec<std::string::String> {
        use std::string::{String, ToString};
        let fix = self.fix();
        let of_fix = fix.map_or_else(Default::default, |fix| fix.fields());
        let field = |column: &&str| match *column {
            "tag" => Address(self.tag).to_string(),
            "round" => fix.map_or_else(String::new, |fix| fix.round.to_string()),
            "rounds_ago" => self.rounds_ago().to_string(),
            "age_s" => fix.map_or_else(String::new, |fix| fix.age_s().to_string()),
            other => {
                let place = Fix::POSITIONS.columns.iter().position(|column| *column == other);
                place.and_then(|place| of_fix.get(place)).cloned().unwrap_or_default()
            }
        };
        Self::TABLE.iter().flat_map(|table| table.columns).map(field).collect()
    }
}

#[cfg(all(test, feature = "host"))]
mod tests {
    use super::*;

    #[test]
    fn a_row_has_the_columns_of_its_table() {
        // The poll of the wire format's examples, three rounds after the position.
        let position = [0xE8, 0x03, 0x00, 0xFF, 0xFF, 0xFF, 0xC4, 0x20, 0x00, 0x69, 0xA0, 0x00, 0x40, 0x00, 0x00, 0x83];
        let told = TagFix { t_us: 1, tag: 0x1001, round: 1, asked: 4, age_us: 250_000, position };
        let columns = TagFix::TABLE.map(|table| table.columns).unwrap_or_default();
        let row =
            ["tag", "1.0000", "-0.0010", "8.3880", "0.1000", "1.0240", "", "suspect", "0x1001", "65534", "3", "0.25"];
        assert_eq!(told.fields(), row);
        assert_eq!(columns.len(), row.len());
        let torn = TagFix { position: [0xFF; 16], ..told };
        assert_eq!(torn.fields().len(), columns.len(), "no position has empty fields");
    }
}
