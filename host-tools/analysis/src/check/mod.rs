//! What a recording says against itself or its site, before its positions are believed: units, times, values that stand
//! for none, geometry, and anchors that the ranges contradict.
//!
//! Input: a recording, and how it is to be solved. Output: [`Finding`]s, each with a code, a sentence that ends with a
//! remedy, and numbers. None of them is an error, because each may be meant.

mod contradiction;
mod joint_fit;
mod layout;
mod row_times;
mod row_values;
mod whole;

use std::collections::BTreeMap;

use recording::{Recording, Space};
use serde::{Serialize, Serializer};

pub use layout::{coplanar, of_places, on_a_line, one_place};
pub use whole::{Whole, of_whole};

/// What is odd about a recording.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// What it is, for programs.
    pub code: FindingCode,
    /// What it is, with numbers and a remedy, for people.
    pub message: String,
    /// The anchors that it is about.
    pub subjects: Vec<String>,
    /// The numbers, by names that end with their units.
    pub evidence: BTreeMap<&'static str, f64>,
}

/// What is odd, for programs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FindingCode {
    /// Two anchors have each other's place.
    AnchorsExchanged,
    /// An anchor is not where the file has it.
    AnchorMoved,
    /// The ranges of one anchor are too short.
    AnchorDelay,
    /// Anchors are at one place.
    AnchorsCoincide,
    /// All ranges are wrong by one length.
    AllRangesLong,
    /// The ranges of one anchor are too long everywhere.
    LinkBlocked,
    /// Lengths are in this unit.
    UnitFeet,
    /// Lengths are in this unit.
    UnitNanoseconds,
    /// Lengths are in this unit.
    UnitCentimetres,
    /// Lengths are in this unit.
    UnitMillimetres,
    /// Lengths are in this unit.
    UnitInches,
    /// The clock was put back.
    TimeBackwards,
    /// The clock stands still.
    TimeEqual,
    /// Times are not in seconds.
    TimeUnit,
    /// The rows of an epoch are not of one time.
    TimeApart,
    /// The given height is not that of the tag.
    HeightWrong,
    /// A height is needed.
    HeightMissing,
    /// A value stands for none.
    ZeroForNone,
    /// Ranges are negative.
    RangesNegative,
    /// An anchor has several ranges at one time.
    RangesRepeated,
    /// Positions have mirror images.
    AmbiguousGeometry,
    /// The tag is not in the given area.
    AreaExcludes,
    /// Ranges contradict the anchors, and nothing alone explains it.
    Contradiction,
}

impl FindingCode {
    /// The code as in JSON.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::AnchorsExchanged => "anchors-exchanged",
            Self::AnchorMoved => "anchor-moved",
            Self::AnchorDelay => "anchor-delay",
            Self::AnchorsCoincide => "anchors-coincide",
            Self::AllRangesLong => "all-ranges-long",
            Self::LinkBlocked => "link-blocked",
            Self::UnitFeet => "unit-feet",
            Self::UnitNanoseconds => "unit-nanoseconds",
            Self::UnitCentimetres => "unit-centimetres",
            Self::UnitMillimetres => "unit-millimetres",
            Self::UnitInches => "unit-inches",
            Self::TimeBackwards => "time-backwards",
            Self::TimeEqual => "time-equal",
            Self::TimeUnit => "time-unit",
            Self::TimeApart => "time-apart",
            Self::HeightWrong => "height-wrong",
            Self::HeightMissing => "height-missing",
            Self::ZeroForNone => "zero-for-none",
            Self::RangesNegative => "ranges-negative",
            Self::RangesRepeated => "ranges-repeated",
            Self::AmbiguousGeometry => "ambiguous-geometry",
            Self::AreaExcludes => "area-excludes",
            Self::Contradiction => "contradiction",
        }
    }
}

impl Serialize for FindingCode {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.as_str())
    }
}

impl Finding {
    fn new(code: FindingCode, message: String) -> Self {
        Self { code, message, subjects: Vec::new(), evidence: BTreeMap::new() }
    }

    fn about(mut self, subjects: impl IntoIterator<Item = String>) -> Self {
        self.subjects.extend(subjects);
        self
    }

    fn with(mut self, name: &'static str, value: f64) -> Self {
        self.evidence.insert(name, value);
        self
    }
}

/// What the rows of a recording say, which is to be solved in this space. `repeats` is the number of ranges that
/// [`recording::drop_repeats`] dropped.
pub fn of_rows(recording: &Recording, space: Space, repeats: usize) -> Vec<Finding> {
    let layout = layout::questions(recording, space);
    let values = row_values::questions(recording, repeats);
    layout.into_iter().chain(values).chain(row_times::questions(&recording.epochs)).collect()
}
