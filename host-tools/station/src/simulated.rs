//! A running simulation as a source: the firmware's own apps, at the pace of the clock on the wall.

use std::collections::HashMap;
use std::thread;
use std::time::{Duration, Instant};

use sim::scenario::{Scenario, Simulation};
use station_core::model::{NodeRole, SiteMap, Zone, ZoneKind};
use station_core::{ReportKind, SourceReport, Utc};
use wire::telemetry::Address;
use wire::uwb::native::Downlink;

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
        let heights = scenario.tags.iter().filter_map(|tag| {
            let height_m = tag.settings.record.height_m?.into();
            Some(ReportKind::Height { tag: Address(tag.address).to_string(), height_m })
        });
        let scanners = scenario.scanners.iter().flat_map(|scanner| {
            let (node, position_m) = (Address(scanner.address).to_string(), Some(scanner.at));
            let [rssi_1m_dbm, path_loss_exponent] = scanner.path_loss;
            let place = ReportKind::Node { node: node.clone(), name: None, role: NodeRole::Receiver, position_m };
            [place, ReportKind::PathLoss { node, rssi_1m_dbm, path_loss_exponent }]
        });
        let nodes = anchors.chain(heights).chain(beacons).chain(scanners).map(|what| SourceReport {
            t,
            site: name.to_owned(),
            what,
        });
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
pub fn simulate(
    scenario: Scenario,
    site: &str,
    send: ReportSender<'_>,
    outgoing: &mut dyn FnMut() -> Option<Downlink>,
) {
    let mut simulation = Simulation::new(scenario);
    // None: nobody reads the node.
    let mut nodes: HashMap<u16, Option<(Timeline, NodeReporter)>> = HashMap::new();
    let (mut begun, mut now_s) = (Instant::now(), 0.0);
    loop {
        now_s += STEP_S;
        core::iter::from_fn(&mut *outgoing).for_each(|message| simulation.tell(message));
        for record in simulation.run_until(now_s) {
            let node = record.node;
            let of = || (Timeline::default(), NodeReporter::of(site, node));
            let is_read = || simulation.scenario().has_host(node).then(of);
            let Some((timeline, reporter)) = nodes.entry(node).or_insert_with(is_read) else { continue };
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

#[cfg(test)]
mod tests {
    use station_core::state::StateLimits;
    use station_core::{LiveState, Update};

    use super::*;

    #[test]
    fn the_station_locates_tags_that_blink_by_what_anchors_report() {
        const SITE: &str = "hall";
        let text = include_str!("../../../examples/blinks.toml").replace("count = 1000", "count = 5");
        let scenario = Scenario::parse(&text).expect("the example");
        let walks: HashMap<String, _> =
            scenario.tags.iter().map(|tag| (Address(tag.address).to_string(), tag.walk.clone())).collect();
        let begin = Utc::clamped(1_000_000_000_000_000);
        let at = |t_s: f64| begin + Duration::from_secs_f64(t_s);
        let mut live = LiveState::new(StateLimits::default());
        let site = SimulatedSite::of(&scenario, SITE, begin);
        site.nodes.iter().for_each(|report| drop(live.apply(report)));
        let mut nodes: HashMap<u16, (Timeline, NodeReporter)> = HashMap::new();
        let mut simulation = Simulation::new(scenario);
        let (mut positions, mut errors_m) = (HashMap::<String, usize>::new(), Vec::new());
        for tenths in 1..=120 {
            let mut updates = Vec::new();
            for record in simulation.run_until(f64::from(tenths) / 10.0) {
                let own = || (Timeline::default(), NodeReporter::of(SITE, record.node));
                let (timeline, reporter) = nodes.entry(record.node).or_insert_with(own);
                for message in record.messages() {
                    let stamp = timeline.place(&message);
                    for report in reporter.reports(stamp, &message, at(record.t_s)) {
                        updates.extend(live.apply(&report));
                    }
                }
            }
            updates.extend(live.tick(at(f64::from(tenths) / 10.0)));
            for update in updates {
                let Update::Position(found) = update else { continue };
                let true_m = walks[&found.tag].at(found.t.since(begin).as_secs_f64());
                errors_m.push((found.x_m - true_m[0]).hypot(found.y_m - true_m[1]));
                assert_eq!(found.z_m, Some(f64::from(1.2_f32)));
                assert!(found.used >= 4, "{found:?}");
                *positions.entry(found.tag).or_default() += 1;
            }
        }
        // From two seconds on, once a second.
        assert!(positions.len() == 5 && positions.values().all(|count| (8..=11).contains(count)), "{positions:?}");
        errors_m.sort_by(f64::total_cmp);
        // The reach of a hall's blinks: half within 0.15 m, nine of ten within 0.35 m. The worst of fifty is chance.
        let part = |part: f64| errors_m[(part * errors_m.len() as f64) as usize];
        assert!(part(0.5) < 0.15 && part(0.9) < 0.35 && part(0.99) < 1.0, "{errors_m:?}");
        assert_eq!(live.refused(), 0);
    }

    #[test]
    fn the_station_shows_the_positions_that_tags_advertise_and_each_once() {
        let scenario = Scenario::parse(include_str!("../../../examples/advertised.toml")).expect("the example");
        let mut live = LiveState::new(StateLimits::default());
        let begin = Utc::clamped(1_000_000_000_000_000);
        SimulatedSite::of(&scenario, "yard", begin).nodes.iter().for_each(|report| drop(live.apply(report)));
        let walks: HashMap<String, _> =
            scenario.tags.iter().map(|tag| (Address(tag.address).to_string(), tag.walk.clone())).collect();
        let mut simulation = Simulation::new(scenario);
        let mut nodes: HashMap<u16, (Timeline, NodeReporter)> = HashMap::new();
        let mut positions: HashMap<String, Vec<f64>> = HashMap::new();
        let mut found: HashMap<String, usize> = HashMap::new();
        for record in simulation.run_until(30.0) {
            if !simulation.scenario().has_host(record.node) {
                *found.entry(Address(record.node).to_string()).or_default() += usize::from(record.epoch().is_some());
                continue;
            }
            let own = || (Timeline::default(), NodeReporter::of("yard", record.node));
            let (timeline, reporter) = nodes.entry(record.node).or_insert_with(own);
            for message in record.messages() {
                let stamp = timeline.place(&message);
                let arrived = begin + Duration::from_secs_f64(record.t_s);
                for update in reporter.reports(stamp, &message, arrived).iter().flat_map(|report| live.apply(report)) {
                    let Update::Position(found) = update else { continue };
                    let true_m = walks[&found.tag].at(found.t.since(begin).as_secs_f64());
                    positions.entry(found.tag).or_default().push((found.x_m - true_m[0]).hypot(found.y_m - true_m[1]));
                }
            }
        }
        assert_eq!(nodes.len(), 2, "scanners alone have a host");
        for tag in ["0x1001", "0x1002"] {
            let (errors_m, found) = (&positions[tag], found[tag]);
            // One in forty is lost, and none counts twice.
            assert!((0.9 * found as f64) as usize <= errors_m.len() && errors_m.len() <= found, "{tag}: {found}");
            let rms_m = (errors_m.iter().map(|m| m * m).sum::<f64>() / errors_m.len() as f64).sqrt();
            assert!(rms_m < 0.3, "{tag}: {rms_m}");
        }
    }

    #[test]
    fn scanners_tell_the_station_of_the_beacons_that_they_receive() {
        let scenario = Scenario::parse(include_str!("../../../examples/scanners.toml")).expect("the example");
        let site = SimulatedSite::of(&scenario, "flat", Utc::default());
        let receivers = site.nodes.iter().filter(|report| {
            matches!(&report.what, ReportKind::Node { role: NodeRole::Receiver, position_m: Some(_), .. })
        });
        assert_eq!(receivers.count(), 4);
        let mut simulation = Simulation::new(scenario);
        let mut nodes: HashMap<u16, NodeReporter> = HashMap::new();
        let mut rssi: HashMap<String, Vec<f64>> = HashMap::new();
        for record in simulation.run_until(10.0) {
            let reporter = nodes.entry(record.node).or_insert_with(|| NodeReporter::of("flat", record.node));
            for message in record.messages() {
                for report in reporter.reports_of(Utc::default(), &message) {
                    let ReportKind::ReceiverSighting { receiver, device, rssi_dbm, rssi_1m_dbm } = report.what else {
                        assert!(matches!(report.what, ReportKind::Node { .. }), "{:?}", report.what);
                        continue;
                    };
                    assert_eq!((&*device, rssi_1m_dbm), ("c2a8ad55-1-1", Some(-59.0)));
                    rssi.entry(receiver).or_default().push(rssi_dbm);
                }
            }
        }
        // Twice a second. The corners are 6.0 m away: -59 dBm - 20 lg 6.0 = -74.6 dBm, with shadowing of 3 dB.
        assert_eq!(rssi.len(), 4);
        for (receiver, rssi) in &rssi {
            let mean = rssi.iter().sum::<f64>() / rssi.len() as f64;
            assert!((18..=20).contains(&rssi.len()), "{receiver}: {}", rssi.len());
            assert!((mean + 74.6).abs() < 9.0, "{receiver}: {mean} dBm");
        }
    }
}
