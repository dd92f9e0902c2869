//! A running simulation as a source: the firmware's own apps, at the pace of the clock on the wall.

use std::collections::HashMap;
use std::thread;
use std::time::{Duration, Instant};

use sim::scenario::{Scenario, Simulation};
use station_core::model::{NodeRole, SiteMap, Zone, ZoneKind};
use station_core::{ReportKind, SourceReport, Utc};
use wire::telemetry::Address;

use super::NodeReporter;
use super::sources::ReportSender;
use node_link::decode::{Stamp, Timeline};

/// The time between two steps, seconds.
const STEP_S: f64 = 0.05;
/// How far the simulation may be behind the clock before it gives the lost time up, seconds.
const BEHIND_S: f64 = 1.0;
/// The margin of the simulated rooms around their anchors, metres.
const MARGIN_M: f64 = 0.2;

/// What the station knows of a simulated site.
#[derive(Clone, Debug)]
pub struct SimulatedSite {
    /// The site, with its walls.
    pub site: SiteMap,
    /// A room for each network: the rectangle around its anchors.
    pub zones: Vec<Zone>,
    /// The anchors and beacons.
    pub nodes: Vec<SourceReport>,
}

impl SimulatedSite {
    /// The site of a scenario, by this name.
    pub fn of(scenario: &Scenario, name: &str, t: Utc) -> Self {
        let walls_m = scenario.walls.iter().map(|wall| [wall.from, wall.to]).collect();
        let site = SiteMap { walls_m, ..SiteMap::new(name) };
        let rooms = (0..scenario.networks.len()).filter_map(|network| room(scenario, network));
        let zones = rooms.zip(1..).map(|(corners_m, number)| Zone {
            site: name.to_owned(),
            name: format!("room {number}"),
            kind: ZoneKind::Room,
            corners_m,
            alarm: false,
        });
        let anchors = scenario.anchors.iter().map(|anchor| ReportKind::Node {
            node: Address(anchor.address).to_string(),
            name: None,
            role: NodeRole::Anchor,
            position_m: Some(scenario.surveyed_m(anchor)),
        });
        let beacons = scenario.beacons.iter().filter_map(|beacon| Some((beacon.name(), beacon.listed?)));
        let beacons = beacons.flat_map(|(node, listed)| {
            let position_m = Some(listed.position_m.map(f64::from));
            let place = ReportKind::Node { node: node.clone(), name: None, role: NodeRole::Beacon, position_m };
            let [rssi_1m_dbm, path_loss_exponent] =
                [listed.rssi_1m_dbm, listed.path_loss_exponent].map(|value| value.map(f64::from));
            [place, ReportKind::PathLoss { node, rssi_1m_dbm, path_loss_exponent }]
        });
        let nodes = anchors.chain(beacons).map(|what| SourceReport { t, site: name.to_owned(), what });
        Self { site, zones: zones.collect(), nodes: nodes.collect() }
    }
}

/// The rectangle around the anchors of a network; none where they lie on one line.
fn room(scenario: &Scenario, network: usize) -> Option<Vec<[f64; 2]>> {
    let anchors = scenario.anchors.iter().filter(|anchor| anchor.network == network);
    let [mut low, mut high] = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
    for anchor in anchors {
        for axis in 0..2 {
            low[axis] = low[axis].min(anchor.at[axis] - MARGIN_M);
            high[axis] = high[axis].max(anchor.at[axis] + MARGIN_M);
        }
    }
    let is_area = (0..2).all(|axis| high[axis] - low[axis] > 2.0 * MARGIN_M);
    is_area.then(|| vec![low, [high[0], low[1]], high, [low[0], high[1]]])
}

/// Runs a scenario until the station ends; its time is that of the wall's clock. Only nodes with a cable are read.
pub fn simulate(scenario: Scenario, site: &str, send: ReportSender<'_>) {
    let mut simulation = Simulation::new(scenario);
    let mut nodes: HashMap<u16, (Timeline, NodeReporter)> = HashMap::new();
    let (mut begun, mut now_s) = (Instant::now(), 0.0);
    loop {
        now_s += STEP_S;
        for record in simulation.run_until(now_s) {
            let node = record.node;
            if !simulation.scenario().has_cable(node) {
                continue;
            }
            let (timeline, reporter) =
                nodes.entry(node).or_insert_with(|| (Timeline::default(), NodeReporter::of(site, node)));
            for message in record.messages() {
                let stamp: Stamp = timeline.place(&message);
                if !reporter.reports(stamp, &message, Utc::now()).into_iter().all(&mut *send) {
                    return;
                }
            }
        }
        let ahead_s = now_s - begun.elapsed().as_secs_f64();
        if ahead_s > 0.0 {
            thread::sleep(Duration::from_secs_f64(ahead_s));
        } else if ahead_s < -BEHIND_S {
            // A processor that is too slow: the simulation goes on slower.
            begun += Duration::from_secs_f64(-ahead_s);
        }
    }
}
