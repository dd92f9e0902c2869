//! A difference of arrivals of a received round among anchors.

use core::fmt;

use postcard::experimental::max_size::MaxSize;
use serde::{Deserialize, Serialize};

use super::reception::{Diagnostics, Reception};
use crate::telemetry::quantised::{deviation_m, metres};
use crate::telemetry::{Address, Body, Tone};

/// How much farther an anchor is than the reference anchor, whose poll began the round. The reference itself comes
/// first, with a difference of zero. Its message contains its position, the deviation that all differences of the round
/// share, and what the receiver measured on the poll.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Difference {
    /// When it was published, since the node started, microseconds.
    pub t_us: u64,
    /// The round, as in the fix that it belongs to.
    pub round: u16,
    /// Short address of the reference anchor.
    pub reference: u16,
    /// Short address of the anchor.
    pub peer: u16,
    /// The distance to the anchor minus that to the reference, 0.1 mm.
    pub difference_tenth_mm: i32,
    /// Expected standard deviation with line of sight, without the reference's, 0.1 mm.
    pub deviation_tenth_mm: u32,
    /// The position that the anchor reports, 0.1 mm.
    pub position_tenth_mm: Option<[i32; 3]>,
    /// What the receiver measured.
    pub diagnostics: Diagnostics,
}

impl Difference {
    /// Metres.
    pub fn difference_m(&self) -> f64 {
        metres(self.difference_tenth_mm)
    }

    /// Expected standard deviation with line of sight, without the reference's, metres.
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

impl fmt::Display for Difference {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (peer, reference, deviation_m) = (Address(self.peer), Address(self.reference), self.deviation_m());
        if peer == reference {
            write!(out, "{peer} polls, ±{deviation_m:.3} m{}", self.reception())
        } else {
            let difference_m = self.difference_m();
            write!(out, "{peer} {difference_m:+.3} ±{deviation_m:.3} m from {reference}{}", self.reception())
        }
    }
}

impl Body for Difference {
    const KIND: &'static str = "difference";
    const LABEL: &'static str = "tdoa";
    #[cfg(feature = "host")]
    const TABLE: Option<crate::telemetry::Table> = Some(crate::telemetry::Table {
        name: "differences",
        rows: "differences",
        counted: "differences of arrivals",
        about: "Differences of arrivals, of tags that only listen",
        columns: super::reception::reception_columns!("reference", "anchor", "difference_m"),
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
        let own = serde_json::json!({
            "round": self.round,
            "reference": Address(self.reference).to_string(),
            "peer": Address(self.peer).to_string(),
            "difference_m": self.difference_m(),
        });
        self.reception().json(own, self.deviation_m())
    }

    #[cfg(feature = "host")]
    fn fields(&self) -> std::vec::Vec<std::string::String> {
        use std::string::ToString;
        let [reference, peer] = [self.reference, self.peer].map(|address| Address(address).to_string());
        let own = [reference, peer, crate::telemetry::metres(self.difference_m())];
        self.reception().fields(own, self.deviation_m())
    }
}
