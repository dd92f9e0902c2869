//! When a frame arrived at an anchor: what a station computes the positions of blinking tags from.

use core::fmt;

use postcard::experimental::max_size::MaxSize;
use serde::{Deserialize, Serialize};

use crate::telemetry::quantised::from_hundredths;
use crate::telemetry::{Address, Body, Tone};
use radio::RadioInstant;

/// When a frame arrived at an anchor, in the anchor's clock. Blinks and sync frames arrive at many anchors: the sync
/// frames tie the anchors' clocks together, so differences of the blinks' arrivals are differences of distances.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Arrival {
    /// When it is reported, since the anchor started, microseconds.
    pub t_us: u64,
    /// Short address of the sender.
    pub source: u16,
    /// Of a blink: its number, as the tag counts. Of a sync frame: its superframe.
    pub number: u16,
    /// What arrived.
    pub frame: ArrivedFrame,
    /// The arrival of the RMARKER at the antenna, ticks of 15.65 ps, modulo 2^40; of an own sync frame its departure. It
    /// is corrected for the bias by received power.
    pub ticks: u64,
    /// Received power, 0.01 dBm.
    pub rx_power_cdbm: i16,
    /// Power of the first path, 0.01 dBm.
    pub first_path_power_cdbm: i16,
}

/// A frame whose arrival is reported.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ArrivedFrame {
    /// A tag's blink.
    Blink,
    /// The sync frame of another anchor.
    SyncFrame,
    /// The anchor's own sync frame: `ticks` is its departure.
    OwnSyncFrame,
}

impl ArrivedFrame {
    /// Its name in JSON.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Blink => "blink",
            Self::SyncFrame => "sync-frame",
            Self::OwnSyncFrame => "own-sync-frame",
        }
    }
}

impl Arrival {
    /// The instant in the anchor's clock.
    pub const fn instant(&self) -> RadioInstant {
        RadioInstant::from_ticks(self.ticks)
    }

    /// Received power, dBm; `None` if the receiver gave none.
    pub fn rx_power_dbm(&self) -> Option<f64> {
        from_hundredths(self.rx_power_cdbm)
    }

    /// Power of the first path, dBm; `None` if the receiver gave none.
    pub fn first_path_power_dbm(&self) -> Option<f64> {
        from_hundredths(self.first_path_power_cdbm)
    }
}

impl fmt::Display for Arrival {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let what = match self.frame {
            ArrivedFrame::Blink => "blink",
            ArrivedFrame::SyncFrame => "sync frame",
            ArrivedFrame::OwnSyncFrame => "own sync frame",
        };
        write!(out, "{what} {} of {} at {}", self.number, Address(self.source), self.ticks)?;
        if let Some(dbm) = self.rx_power_dbm() {
            write!(out, ", received {dbm:.1} dBm")?;
        }
        Ok(())
    }
}

impl Body for Arrival {
    const KIND: &'static str = "arrival";
    const LABEL: &'static str = "frame";
    #[cfg(feature = "host")]
    const TABLE: Option<crate::telemetry::Table> = Some(crate::telemetry::Table {
        name: "arrivals",
        rows: "arrivals",
        counted: "arrivals of frames",
        about: "When blinks and sync frames arrived at an anchor",
        columns: &["frame", "source", "number", "ticks", "rx_power_dbm", "first_path_power_dbm"],
    });

    fn tone(&self) -> Tone {
        Tone::Quiet
    }

    #[cfg(feature = "host")]
    fn json(&self) -> serde_json::Value {
        serde_json::json!({
            "frame": self.frame.name(),
            "source": std::format!("{}", Address(self.source)),
            "number": self.number,
            "ticks": self.ticks,
            "rx_power_dbm": self.rx_power_dbm(),
            "first_path_power_dbm": self.first_path_power_dbm(),
        })
    }

    #[cfg(feature = "host")]
    fn fields(&self) -> std::vec::Vec<std::string::String> {
        use std::string::{String, ToString};
        let power = |dbm: Option<f64>| dbm.map_or_else(String::new, |dbm| dbm.to_string());
        [
            self.frame.name().to_string(),
            Address(self.source).to_string(),
            self.number.to_string(),
            self.ticks.to_string(),
            power(self.rx_power_dbm()),
            power(self.first_path_power_dbm()),
        ]
        .into()
    }
}
