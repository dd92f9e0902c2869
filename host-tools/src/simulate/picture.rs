//! The tracks of a simulation on its floor plan.

use sim::scenario::{Record, Scenario, What};

use crate::plot::{Dot, Picture, Track};

/// Every position and the tags' true ways, among anchors and walls.
pub fn picture(scenario: &Scenario, records: &[Record]) -> Picture {
    let epochs = || {
        records.iter().filter_map(|record| match &record.what {
            What::Epoch(epoch) => Some((record.node, epoch)),
            What::Link(_) | What::RadioFailed(_) | What::Fault(_) => None,
        })
    };
    let flat = |at: [f64; 3]| [at[0], at[1]];
    let dot = |position: &firmware_tag::Position| {
        let (at, sigma) = (position.position_m.map(f64::from), position.deviation_m().map(f64::from));
        Dot { at_m: flat(at), sigma_m: Some(flat(sigma)) }
    };
    let way = |tag: u16| epochs().filter(|(node, _)| *node == tag).map(|(_, epoch)| flat(epoch.truth_m)).collect();
    Picture {
        walls_m: scenario.walls.iter().map(|wall| [wall.from, wall.to]).collect(),
        anchors: scenario.anchors.iter().map(|anchor| (anchor.address.to_string(), flat(anchor.at))).collect(),
        truth_m: scenario.tags.iter().map(|tag| way(tag.address)).collect(),
        tracks: vec![Track {
            method: scenario.tag.method_name().to_owned(),
            dots: epochs().filter_map(|(_, epoch)| epoch.outcome.as_ref().ok().map(dot)).collect(),
            errors_m: epochs().filter_map(|(_, epoch)| epoch.error_m()).collect(),
        }],
    }
}
