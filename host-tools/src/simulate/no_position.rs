//! Why a simulation made no position at all, in a sentence.

use std::collections::{BTreeMap, BTreeSet};

use sim::scenario::{Record, Scenario, What, distance};
use wire::telemetry::{Condition, Message, State};

/// What is counted while a simulation runs.
#[derive(Debug, Default)]
pub struct Attempts {
    ranges: usize,
    reasons: BTreeMap<&'static str, usize>,
    /// Tags that a full network refused, and have no position since.
    refused: BTreeSet<u16>,
}

impl Attempts {
    /// Counts a record.
    pub fn take(&mut self, record: &Record) {
        match &record.what {
            What::Message(Message::Range(_)) => self.ranges += 1,
            What::Message(Message::State(State { is: Condition::NetworkFull, .. })) => {
                self.refused.insert(record.node);
            }
            What::Epoch(epoch) => {
                if epoch.fix.reason().is_none() {
                    self.refused.remove(&record.node);
                }
                if let Some(reason) = epoch.fix.reason() {
                    *self.reasons.entry(reason.as_str()).or_default() += 1;
                }
            }
            What::Message(_) | What::Fault(_) => {}
        }
    }

    /// The tags that a full network refused until the end, in a sentence; `None` where there are none.
    pub fn refused(&self) -> Option<String> {
        let count = self.refused.len();
        (count > 0).then(|| {
            format!(
                "{count} of the tags had no place, for the reason network-full: a network has 16 places for tags \
                 that range more than once a superframe, and leases for slower ones, which they share in turns of 60 \
                 rounds; add networks, or tags that only listen (--mode tdoa)"
            )
        })
    }

    /// The likely cause of no position, and what to do.
    pub fn why_none(&self, scenario: &Scenario) -> String {
        let least = if scenario.tags.iter().all(|tag| tag.settings.record.height_m.is_some()) { 3 } else { 4 };
        let in_network = |network: usize| scenario.anchors.iter().filter(|anchor| anchor.network == network).count();
        let most = scenario.tags.iter().map(|tag| in_network(tag.network)).max().unwrap_or(0);
        if scenario.anchors.is_empty() {
            return "no tag has a position by beacons: do tags hear three of them, and are they listed?".to_owned();
        }
        if most < least {
            let more = if least == 4 { " (3 where the height is known)" } else { "" };
            return format!("a tag has {most} anchors in its network, and a position needs {least}{more}: add anchors");
        }
        if self.ranges == 0 {
            let to_anchor = |at| scenario.anchors.iter().map(move |anchor| distance(anchor.at, at));
            let nearest_m =
                scenario.tags.iter().flat_map(|tag| to_anchor(tag.walk.at(0.0))).fold(f64::INFINITY, f64::min);
            return format!(
                "no anchor answered any tag; the nearest is {nearest_m:.0} m away at the beginning: put anchors in reach, some \
                 tens of metres, or simulate for longer"
            );
        }
        match self.reasons.iter().max_by_key(|(_, count)| **count) {
            Some((reason, count)) => format!(
                "{count} rounds ended without one, most for the reason {reason}: put {least} anchors or more in reach of each tag"
            ),
            None => "no round has ended yet: simulate for longer".to_owned(),
        }
    }
}
