//! The tracks of a simulation on its floor plan; with beacons, positions by anchors and by beacons are separate
//! tracks.

use sim::scenario::{Record, Scenario, SimulatedEpoch, Source};
use wire::telemetry::Address;

use pictures::{Dot, Errors, Picture, PictureBuilder};

/// Every position and the tags' true paths, among anchors, beacons and walls. `source` names the scenario.
pub fn picture(source: String, scenario: &Scenario, records: &[Record]) -> Picture {
    let flat = |at: [f64; 3]| [at[0], at[1]];
    let mut builder = PictureBuilder::new(Picture {
        source,
        walls_m: scenario.walls.iter().map(|wall| [wall.from, wall.to]).collect(),
        anchors: scenario.anchors.iter().map(|anchor| (Address(anchor.address).to_string(), flat(anchor.at))).collect(),
        beacons: scenario.beacons.iter().map(|beacon| (beacon.name(), flat(beacon.at))).collect(),
        errors: if scenario.tags.iter().all(|tag| tag.settings.record.height_m.is_some()) {
            Errors::Horizontal
        } else {
            Errors::Spatial
        },
        ..Picture::default()
    });
    // The tags' order, and so their colours, is that of the scenario.
    let epochs = |tag: u16| {
        let of_tag = records.iter().filter(move |record| record.node == tag);
        of_tag.filter_map(|record| Some((record.t_s, record.epoch()?)))
    };
    for tag in scenario.tags.iter().map(|tag| tag.address) {
        let name = Address(tag).to_string();
        for (t_s, epoch) in epochs(tag) {
            builder.truth(&name, flat(epoch.truth_m), false);
            builder.time(t_s);
        }
    }
    let sources: &[_] = if scenario.beacons.is_empty() {
        &[(None, None)]
    } else {
        &[(Some("by anchors"), Some(Source::Anchors)), (Some("by beacons"), Some(Source::Beacons))]
    };
    for (name, source) in sources {
        for tag in &scenario.tags {
            let (method, tag) = (name.unwrap_or(scenario.method_name(tag)), tag.address);
            let taken = epochs(tag).filter(|(_, epoch)| source.is_none_or(|source| epoch.source() == source));
            for (_, epoch) in taken.filter(|(_, epoch)| epoch.fix.position_m().is_some()) {
                builder.position(method, &Address(tag).to_string(), dot(epoch), epoch.error_m());
            }
        }
    }
    builder.finish()
}

fn dot(epoch: &SimulatedEpoch) -> Option<Dot> {
    let [x, y, _] = epoch.fix.position_m()?;
    let [truth_x, truth_y, _] = epoch.truth_m;
    let covariance_m2 = epoch.fix.covariance_m2().map(|[[xx, xy, _], [_, yy, _], _]| [xx, xy, yy]);
    Some(Dot { at_m: [x, y], truth_m: Some([truth_x, truth_y]), covariance_m2 })
}
