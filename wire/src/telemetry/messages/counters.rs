//! Counts since the start.

use postcard::experimental::max_size::MaxSize;
use serde::{Deserialize, Serialize};

use super::or_default;
use crate::telemetry::text::text;
use crate::telemetry::{Body, Severity};

/// Counts since the start; all wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
pub struct Counters {
    /// Since the node started, microseconds.
    pub t_us: u64,
    /// UWB frames sent.
    pub sent: u32,
    /// UWB frames received whole.
    pub received: u32,
    /// Windows that passed without a frame.
    pub timeouts: u32,
    /// Frames received with errors.
    pub corrupt: u32,
    /// Transmissions or receptions whose start lay in the past.
    pub late: u32,
    /// Frames that did not leave.
    pub not_sent: u32,
    /// Failures of the radio or its bus.
    pub radio_failures: u32,
    /// Rounds that the engine had no time for.
    pub rounds_dropped: u32,
    /// Telemetry frames dropped because the channel was full.
    pub telemetry_dropped: u32,
    /// Advertisements received.
    pub sightings: u32,
    /// Advertisements dropped because they were not processed in time.
    pub sightings_dropped: u32,
    /// UWB frames received whole and refused by a tag, because they contradict what it knows of the network. More than a
    /// few are a sign of forged frames. 0 in frames of older nodes, which do not have it.
    #[serde(deserialize_with = "or_default")]
    pub refused: u32,
}

text!(Counters, |this| this;
    Self {
        t_us: _, sent, received, timeouts, corrupt, late, not_sent, radio_failures, rounds_dropped, telemetry_dropped, sightings,
        sightings_dropped, refused,
    } => (
        "{} sent, {} received, {} timeouts, {} corrupt, {} late, {} not sent, {} radio failures; {} sightings; \
         dropped: {} rounds, {} sightings, {} telemetry frames; {} refused",
        sent, received, timeouts, corrupt, late, not_sent, radio_failures, sightings, rounds_dropped, sightings_dropped,
        telemetry_dropped, refused
    ),
);

impl Body for Counters {
    const KIND: &'static str = "counters";
    const LABEL: &'static str = "count";

    fn severity(&self) -> Severity {
        Severity::Debug
    }

    #[cfg(feature = "host")]
    fn json(&self) -> serde_json::Value {
        serde_json::json!({
            "sent": self.sent,
            "received": self.received,
            "timeouts": self.timeouts,
            "corrupt": self.corrupt,
            "late": self.late,
            "not_sent": self.not_sent,
            "radio_failures": self.radio_failures,
            "rounds_dropped": self.rounds_dropped,
            "telemetry_dropped": self.telemetry_dropped,
            "sightings": self.sightings,
            "sightings_dropped": self.sightings_dropped,
            "refused": self.refused,
        })
    }
}

#[cfg(test)]
mod tests {
    use std::string::ToString;

    use super::*;

    #[test]
    fn all_counts_are_in_the_line() {
        let counters =
            Counters { sent: 1, received: 2, timeouts: 3, telemetry_dropped: 4, refused: 5, ..Counters::default() };
        let expected = "1 sent, 2 received, 3 timeouts, 0 corrupt, 0 late, 0 not sent, 0 radio failures; 0 sightings; \
                        dropped: 0 rounds, 0 sightings, 4 telemetry frames; 5 refused";
        assert_eq!(counters.to_string(), expected);
    }
}
