//! A range of a round.

use core::fmt;

use postcard::experimental::max_size::MaxSize;
use serde::{Deserialize, Serialize};

use super::reception::{Diagnostics, Reception};
use crate::telemetry::quantised::{deviation_m, metres};
use crate::telemetry::{Address, Body, Tone};

/// A range of a round.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Range {
    /// When it was published, since the node started, microseconds.
    pub t_us: u64,
    /// The round, as in the fix that it belongs to.
    pub round: u16,
    /// Short address of the peer.
    pub peer: u16,
    /// 0.1 mm.
    pub distance_tenth_mm: i32,
    /// Expected standard deviation with line of sight, 0.1 mm.
    pub deviation_tenth_mm: u32,
    /// The position that the anchor reports, 0.1 mm.
    pub position_tenth_mm: Option<[i32; 3]>,
    /// What the receiver measured.
    pub diagnostics: Diagnostics,
}

impl Range {
    /// Metres. Slightly negative values occur at distances below a metre.
    pub fn distance_m(&self) -> f64 {
        metres(self.distance_tenth_mm)
    }

    /// Expected standard deviation with line of sight, metres.
    pub fn deviation_m(&self) -> f64 {
        deviation_m(self.deviation_tenth_mm)
    }

    /// The position that the anchor reports, metres.
    pub fn position_m(&self) -> Option<[f64; 3]> {
        Some(self.position_tenth_mm?.map(metres))
    }

    fn reception(&self) -> Reception {
        Reception { diagnostics: self.diagnostics, position_m: self.position_m() }
    }
}

impl fmt::Display for Range {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (distance_m, deviation_m) = (self.distance_m(), self.deviation_m());
        write!(out, "{} {distance_m:.3} ±{deviation_m:.3} m{}", Address(self.peer), self.reception())
    }
}

impl Body for Range {
    const KIND: &'static str = "range";
    #[cfg(feature = "host")]
    const TABLE: Option<crate::telemetry::Table> = Some(crate::telemetry::Table {
        name: "ranges",
        rows: "ranges",
        counted: "ranges",
        about: "Ranges, as solve reads them",
        columns: super::reception::reception_columns!("anchor", "range_m"),
    });

    fn round(&self) -> Option<u16> {
        Some(self.round)
    }

    fn tone(&self) -> Tone {
        Tone::Quiet
    }

    #[cfg(feature = "host")]
    fn json(&self) -> serde_json::Value {
        use std::string::ToString;
        let own = serde_json::json!({ "round": self.round, "peer": Address(self.peer).to_string(), "range_m": self.distance_m() });
        self.reception().json(own, self.deviation_m())
    }

    #[cfg(feature = "host")]
    fn fields(&self) -> std::vec::Vec<std::string::String> {
        use std::string::ToString;
        let own = [Address(self.peer).to_string(), crate::telemetry::metres(self.distance_m())];
        self.reception().fields(own, self.deviation_m())
    }
}
