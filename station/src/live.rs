//! The current state.
//!
//! The input is a [`Report`], the output its [`Update`]s. Time comes from the reports and from [`Live::tick`]; there is
//! no clock here.

use std::time::Duration;

use serde::Serialize;
use utoipa::ToSchema;

use crate::Utc;
use crate::model::{Event, Node, Tag, TagPosition, Zone};
use crate::report::Report;

/// What has changed, as listeners get it.
#[derive(Clone, Debug, PartialEq, Serialize, ToSchema)]
#[serde(tag = "type", rename_all = "kebab-case")]
pub enum Update {
    /// A tag has a new position.
    Position(TagPosition),
    /// Something happened.
    Event(Event),
    /// Tags, nodes or zones changed in another way: they are to be read again.
    Changed,
}

/// When something counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// A tag that does not report for this time is silent.
    pub silent_after: Duration,
    /// A position with a greater standard deviation is uncertain, metres.
    pub uncertain_m: f64,
    /// A tag enters a zone at this probability …
    pub enter: f64,
    /// … and leaves it at this one.
    pub leave: f64,
    /// An anchor whose mean residual is greater than this was probably moved, metres.
    pub moved_m: f64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { silent_after: Duration::from_secs(30), uncertain_m: 3.0, enter: 0.8, leave: 0.2, moved_m: 0.5 }
    }
}

/// The current state of all sites.
#[derive(Debug)]
pub struct Live {
    limits: Limits,
}

impl Live {
    /// The state without tags and nodes.
    pub fn new(limits: Limits) -> Self {
        Self { limits }
    }

    /// Replaces the zones of all sites.
    pub fn set_zones(&mut self, zones: Vec<Zone>) {
        let _ = zones;
        todo!()
    }

    /// Applies a report.
    pub fn apply(&mut self, report: &Report) -> Vec<Update> {
        let _ = (report, self.limits);
        todo!()
    }

    /// What changes because time passes: tags become silent.
    pub fn tick(&mut self, now: Utc) -> Vec<Update> {
        let _ = now;
        todo!()
    }

    /// The tags, by site and address.
    pub fn tags(&self) -> Vec<Tag> {
        todo!()
    }

    /// The anchors and beacons, by site and address.
    pub fn nodes(&self) -> Vec<Node> {
        todo!()
    }
}
