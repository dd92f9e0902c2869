//! The tracks of a simulation on its floor plan; with beacons, positions by anchors and by beacons are separate
//! tracks.

use sim::scenario::{Record, Scenario, SimulatedEpoch, Source};

use crate::plot::{Dot, Picture, Track};

/// Every position and the tags' true paths, among anchors, beacons and walls.
pub fn picture(scenario: &Scenario, records: &[Record]) -> Picture {
    let epochs = || records.iter().filter_map(|record| Some((record.node, record.epoch()?)));
    let flat = |at: [f64; 3]| [at[0], at[1]];
    let dot = |epoch: &SimulatedEpoch| {
        let (at_m, sigma_m) = (epoch.fix.position_m()?, epoch.fix.deviation_m());
        Some(Dot { at_m: flat(at_m), sigma_m: sigma_m.map(flat) })
    };
    let way = |tag: u16| epochs().filter(|(node, _)| *node == tag).map(|(_, epoch)| flat(epoch.truth_m)).collect();
    let track = |method: &str, source: Option<Source>| {
        let of = |epoch: &&SimulatedEpoch| source.is_none_or(|source| epoch.source() == source);
        let taken = || epochs().map(|(_, epoch)| epoch).filter(of);
        Track {
            method: method.to_owned(),
            dots: taken().filter_map(dot).collect(),
            errors_m: taken().filter_map(SimulatedEpoch::error_m).collect(),
        }
    };
    let tracks = if scenario.beacons.is_empty() {
        vec![track(scenario.tag.method_name(), None)]
    } else {
        let both = [("by anchors", Source::Anchors), ("by beacons", Source::Beacons)];
        both.map(|(name, source)| track(name, Some(source)))
            .into_iter()
            .filter(|track| !track.dots.is_empty())
            .collect()
    };
    Picture {
        walls_m: scenario.walls.iter().map(|wall| [wall.from, wall.to]).collect(),
        anchors: scenario.anchors.iter().map(|anchor| (anchor.address.to_string(), flat(anchor.at))).collect(),
        beacons: scenario.beacons.iter().map(|beacon| (beacon.name(), flat(beacon.at))).collect(),
        truth_m: scenario.tags.iter().map(|tag| way(tag.address)).collect(),
        tracks,
    }
}
