//! System tests of beacons: tags that use them for positions, alone and beside anchors, and faults of beacons. The apps
//! of tag and beacon run unchanged. Each advertisement has the bytes that the beacon makes.

mod covers;
mod site_models;
mod troubles;

use sim::scenario::{SimulatedEpoch, Source};
use system_tests::{Run, TAG};

/// A room of 12 m × 8 m with six beacons around, with more keys of its simulation and of its beacons; more text may
/// follow.
fn room(simulation: &str, beacons: &[&str]) -> String {
    const PLACES: [[f64; 2]; 6] = [[0.3, 0.3], [6.0, 0.3], [11.7, 0.3], [11.7, 7.7], [6.0, 7.7], [0.3, 7.7]];
    let mut text = format!("[simulation]\nfidelity = \"air\"\n{simulation}\n");
    for (place, [x, y]) in PLACES.into_iter().enumerate() {
        let more = beacons.get(place).copied().unwrap_or("");
        text += &beacon([x, y], more);
    }
    text
}

/// A beacon, with more keys.
fn beacon([x, y]: [f64; 2], more: &str) -> String {
    format!("[[node]]\nrole = \"beacon\"\nposition_m = [{x}, {y}, 2.2]\n{more}\n")
}

/// A tag that walks round in the room.
const ROUND: &str = "[[node]]\nrole = \"tag\"\nheight_m = 1.2\nscan_interval_ms = 1000\n[node.simulation]\n\
    path_m = [[2, 2, 1.2], [10, 2, 1.2], [10, 6, 1.2], [2, 6, 1.2]]\nspeed_m_s = 0.8\nclosed = true\n";
/// A tag that does not move.
const STANDS: &str =
    "[[node]]\nrole = \"tag\"\nheight_m = 1.2\nscan_interval_ms = 1000\nsimulation = { path_m = [[5, 3, 1.2]] }\n";

/// The epochs by beacons within an interval.
fn by_beacons(run: &Run, from_s: f64, to_s: f64) -> Vec<(f64, &SimulatedEpoch)> {
    let within =
        |(t_s, epoch): &(f64, &SimulatedEpoch)| (from_s..=to_s).contains(t_s) && epoch.source() == Source::Beacons;
    run.epochs(TAG).filter(within).collect()
}

/// Root mean square of the errors, metres, and the mean ratio of their squares to the variance in the tag's covariance.
fn errors(epochs: &[(f64, &SimulatedEpoch)]) -> (f64, f64) {
    let errors: Vec<(f64, f64)> = epochs
        .iter()
        .filter_map(|(_, epoch)| {
            let sigma_m = epoch.fix.deviation_m()?;
            Some((epoch.error_m()?, sigma_m[0].hypot(sigma_m[1])))
        })
        .collect();
    let mean = |of: &dyn Fn(f64, f64) -> f64| errors.iter().map(|(e, s)| of(*e, *s)).sum::<f64>() / errors.len() as f64;
    (mean(&|error, _| error * error).sqrt(), mean(&|error, sigma| (error / sigma).powi(2)))
}
