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
/// anchors has one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct TagFix {
    /// When the poll was reported, since the anchor started, microseconds.
    pub t_us: u64,
    /// Short address of the tag.
    pub tag: u16,
    /// The round of the poll, as the tag counts it.
    pub round: u16,
    /// How many rounds before that of the poll the position was measured.
    pub rounds_ago: u8,
    /// Anchors that the poll asked.
    pub asked: u8,
    /// The position; which ranges were used is not known.
    pub outcome: Outcome,
    /// Nothing, or that it is suspect: a poll has no room for another place.
    pub doubt: Doubt,
}

impl TagFix {
    /// The message of a position in a poll, which was received at `t_us` and asked this many anchors.
    pub fn new(t_us: u64, tag: u16, round: u16, asked: u8, polled: &PolledPosition) -> Self {
        let doubt = if polled.is_suspect { Doubt::Suspect } else { Doubt::None };
        Self { t_us, tag, round, rounds_ago: polled.rounds_ago, asked, outcome: polled.outcome(), doubt }
    }

    /// The tag's own fix, as far as its poll says it.
    pub fn fix(&self) -> Fix {
        let round = self.round.wrapping_sub(self.rounds_ago.into());
        let Self { t_us, asked, outcome, doubt, .. } = *self;
        Fix { t_us, round, age_us: 0, asked, outcome, solver: Solver::Unknown, doubt }
    }
}

impl fmt::Display for TagFix {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let tag = Address(self.tag);
        let Outcome::Position { position_tenth_mm, deviation_tenth_mm, .. } = self.outcome else {
            return write!(out, "{tag} none");
        };
        let [x, y, z] = position_tenth_mm.map(Centimetres::of_tenth_mm);
        let (deviation, ago) = (deviation_in_space(deviation_tenth_mm), self.rounds_ago);
        write!(out, "{tag} x={x} y={y} z={z} ±{deviation} m, {ago} rounds ago{}", self.doubt)
    }
}

impl Body for TagFix {
    const KIND: &'static str = "tag-fix";
    const LABEL: &'static str = "tag";

    fn tone(&self) -> Tone {
        Tone::Good
    }

    #[cfg(feature = "host")]
    fn json(&self) -> serde_json::Value {
        let mut of_fix = self.fix().json();
        let mut take = |key: &str| of_fix.get_mut(key).map_or(serde_json::Value::Null, serde_json::Value::take);
        serde_json::json!({
            "tag": std::format!("{}", Address(self.tag)),
            "round": take("round"),
            "rounds_ago": self.rounds_ago,
            "asked": take("asked"),
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
}
