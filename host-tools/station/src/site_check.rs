//! Asks every half minute whether the ranges of the last minutes fit their site, as `baliza check` asks a recording.
//!
//! Input: the hub's sample of rounds and the places of anchors. Output: findings in the hub's state, from where the API
//! has them, and a line for the user when one appears and when it is gone. The rounds of all tags are fitted together,
//! a hundred of them at most, so that the time of a check does not grow with the tags. What only files can have wrong
//! (columns, times), and what the tag's own record settles (the side of the anchors' plane), is not asked.

use std::collections::{BTreeMap, HashMap};
use std::thread;
use std::time::Duration;

use analysis::Setup;
use analysis::check::{Finding, FindingCode, of_places, of_whole};
use recording::{Anchor, Coordinates, Diagnostics, Epochs, Half, Height, Measured, Recording, Space, drop_repeats};
use station_core::model::{NodeRole, NodeStatus, SiteFinding};
use station_core::state::RecentRound;
use station_core::{Hub, LiveState, Utc};

/// The time between two checks.
const EVERY: Duration = Duration::from_secs(30);
/// Configured heights that differ by less are one, metres.
const ONE_HEIGHT_M: f64 = 0.01;

/// Starts a thread that checks the hub's sites until the hub's end. `note` takes lines for the user.
pub fn watch(hub: Hub, note: impl Fn(&str) + Send + 'static) {
    thread::spawn(move || {
        loop {
            thread::sleep(EVERY);
            if hub.reports().is_closed() {
                return;
            }
            // The state is free while the rounds are fitted.
            let (rounds, nodes) = hub.read(sample);
            let found = findings(&rounds, &nodes);
            hub.change(|live| set(live, found)).iter().for_each(|line| note(line));
        }
    });
}

type Sample = (BTreeMap<String, Vec<RecentRound>>, Vec<NodeStatus>);

fn sample(live: &LiveState) -> Sample {
    (live.recent_rounds(), live.nodes())
}

/// Replaces the findings of the state. Returns a line for each that is new, and for each that is gone.
fn set(live: &mut LiveState, found: Vec<SiteFinding>) -> Vec<String> {
    let is_in = |finding: &&SiteFinding, all: &[SiteFinding]| all.iter().any(|other| finding.is_same(other));
    let new = found.iter().filter(|finding| !is_in(finding, live.findings()));
    let new = new.map(|finding| format!("warning: {}: {}\n", finding.site, finding.message));
    let gone = live.findings().iter().filter(|finding| !is_in(finding, &found));
    let gone = gone.map(|finding| {
        let SiteFinding { site, code, subjects, .. } = finding;
        let of = if subjects.is_empty() { String::new() } else { format!(" of {}", subjects.join(", ")) };
        format!("{site}: {code}{of} is found no longer\n")
    });
    let lines = new.chain(gone).collect();
    live.set_findings(found);
    lines
}

fn findings(rounds: &BTreeMap<String, Vec<RecentRound>>, nodes: &[NodeStatus]) -> Vec<SiteFinding> {
    let of_site = |(site, rounds): (&String, &Vec<RecentRound>)| {
        let nodes = nodes.iter().filter(|node| node.site == *site && node.role == NodeRole::Anchor);
        let placed: Vec<(&NodeStatus, [f64; 3])> = nodes.filter_map(|node| Some((node, node.position_m?))).collect();
        let address = |name: &String| {
            let named = placed.iter().find(|(node, _)| name_of(node) == name);
            named.map_or_else(|| name.clone(), |(node, _)| node.node.clone())
        };
        let to_finding = |Finding { code, message, subjects, evidence }| SiteFinding {
            site: site.clone(),
            since: Utc::default(),
            code: FindingCode::as_str(code).to_owned(),
            message,
            subjects: subjects.iter().map(address).collect(),
            evidence: evidence.into_iter().map(|(name, value)| (name.to_owned(), value)).collect(),
        };
        ask(rounds, &placed).into_iter().map(to_finding).collect::<Vec<_>>()
    };
    rounds.iter().flat_map(of_site).collect()
}

/// What people call an anchor.
fn name_of(node: &NodeStatus) -> &str {
    node.name.as_deref().unwrap_or(&node.node)
}

/// Asks about the rounds of a site, whose anchors have places.
fn ask(rounds: &[RecentRound], placed: &[(&NodeStatus, [f64; 3])]) -> Vec<Finding> {
    let by_address: HashMap<&str, usize> = placed.iter().zip(0..).map(|((node, _), at)| (&*node.node, at)).collect();
    let anchors = placed.iter().map(|(node, [x_m, y_m, z_m])| Anchor {
        name: name_of(node).to_owned(),
        place: Coordinates { x_m: *x_m, y_m: *y_m, z_m: Some(*z_m) },
    });
    // Tags in the plane and tags in space are fitted differently: those count of which there are more rounds.
    let in_plane = 2 * rounds.iter().filter(|round| round.height_m.is_some()).count() > rounds.len();
    let (mut epochs, mut heights_m) = (Epochs::default(), Vec::new());
    for (round, number) in rounds.iter().filter(|round| round.height_m.is_some() == in_plane).zip(0_u32..) {
        let at_height = round.height_m.map(|z_m| Coordinates { x_m: 0.0, y_m: 0.0, z_m: Some(z_m) });
        // Without times, because neighbours are of other tags.
        epochs.push(&number.to_string(), None, at_height);
        for (anchor, range_m) in &round.ranges {
            if let Some(&anchor) = by_address.get(&**anchor) {
                let (range_m, diagnostics) = (*range_m, Diagnostics::default());
                epochs.push_range(&Measured { anchor, range_m, t_s: None, line_of_sight: None, diagnostics });
            }
        }
        heights_m.extend(round.height_m);
    }
    let one_m = heights_m.first().filter(|one| heights_m.iter().all(|other_m| (other_m - **one).abs() < ONE_HEIGHT_M));
    let space = match (in_plane, one_m) {
        (false, _) => Space::Full(Some(Half::Below)),
        (true, Some(height_m)) => Space::Plane(Height::Fixed(*height_m)),
        (true, None) => Space::Plane(Height::FromTruth),
    };
    drop_repeats(&mut epochs);
    let recording = Recording { tag: None, anchors: anchors.collect(), epochs };
    of_places(&recording).into_iter().chain(of_whole(&recording, &Setup::of(space)).findings).collect()
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;
    use std::time::Duration;

    use node_link::decode::Timeline;
    use sim::scenario::{Fidelity, Scenario, Simulation};
    use station_core::state::StateLimits;
    use station_core::{ReportKind, SourceReport};

    use super::*;
    use crate::{NodeReporter, SimulatedSite};

    const SITE: &str = "hall";
    /// The places of these are exchanged.
    const EXCHANGED: [&str; 2] = ["0x0002", "0x0005"];

    /// A station in whose files two anchors may have each other's place, with the simulated room of `serve`. Its time is
    /// that of the simulation.
    struct Fed {
        simulation: Simulation,
        nodes: HashMap<u16, (Timeline, NodeReporter)>,
        live: LiveState,
        places_m: HashMap<String, [f64; 3]>,
        now_s: f64,
    }

    impl Fed {
        fn new(anchors: usize, tags: usize, is_wrong: bool) -> Self {
            let scenario = Scenario { fidelity: Fidelity::Air, ..Scenario::rooms(anchors, tags) };
            let site = SimulatedSite::of(&scenario, SITE, at(0.0));
            let place = |report: &SourceReport| match &report.what {
                ReportKind::Node { node, position_m, .. } => Some((node.clone(), (*position_m)?)),
                _ => None,
            };
            let places_m = site.nodes.iter().filter_map(place).collect();
            let live = LiveState::new(StateLimits::default());
            let mut fed =
                Self { simulation: Simulation::new(scenario), nodes: HashMap::new(), live, places_m, now_s: 0.0 };
            if is_wrong {
                fed.exchange();
            }
            fed
        }

        /// Corrects the site, or makes it wrong.
        fn exchange(&mut self) {
            let [one, other] = EXCHANGED.map(|anchor| self.places_m[anchor]);
            self.places_m.extend([(EXCHANGED[0].to_owned(), other), (EXCHANGED[1].to_owned(), one)]);
        }

        /// What the check says after this time, and the lines for the user.
        fn after(&mut self, seconds: u32) -> (Vec<SiteFinding>, Vec<String>) {
            for _ in 0..seconds {
                self.now_s += 1.0;
                for record in self.simulation.run_until(self.now_s) {
                    let own = || (Timeline::default(), NodeReporter::of(SITE, record.node));
                    let (timeline, reporter) = self.nodes.entry(record.node).or_insert_with(own);
                    for message in record.messages() {
                        for mut report in reporter.reports(timeline.place(&message), &message, at(self.now_s)) {
                            if let ReportKind::Node { node, name, position_m, .. } = &mut report.what
                                && let Some(place_m) = self.places_m.get(node)
                            {
                                *position_m = Some(*place_m);
                                *name = (node == "0x0002").then(|| "north east".to_owned());
                            }
                            self.live.apply(&report);
                        }
                    }
                }
                self.live.tick(at(self.now_s));
            }
            let (rounds, nodes) = sample(&self.live);
            let lines = set(&mut self.live, findings(&rounds, &nodes));
            (self.live.findings().to_vec(), lines)
        }
    }

    fn at(s: f64) -> Utc {
        Utc::clamped(1_000_000_000_000_000) + Duration::from_secs_f64(s)
    }

    #[test]
    fn exchanged_anchors_are_named_within_a_minute_and_once_until_the_site_is_right() {
        let mut fed = Fed::new(6, 5, true);
        let (found, lines) = fed.after(30);
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!((found[0].site.as_str(), found[0].code.as_str()), (SITE, "anchors-exchanged"));
        assert_eq!(found[0].subjects, EXCHANGED);
        assert_eq!(lines.len(), 1);
        let said = "warning: hall: the anchors north east and 0x0005 look exchanged: residuals fall from ";
        assert!(lines[0].starts_with(said), "{lines:?}");
        let (again, lines) = fed.after(30);
        assert_eq!((again.len(), again[0].since), (1, found[0].since));
        assert_eq!(lines, [""; 0]);
        fed.exchange();
        let (found, lines) = fed.after(1);
        assert_eq!(found, []);
        assert_eq!(lines, ["hall: anchors-exchanged of 0x0002, 0x0005 is found no longer\n"]);
    }

    #[test]
    fn of_a_sound_site_nothing_is_said() {
        for (anchors, tags) in [(4, 1), (6, 5)] {
            let mut fed = Fed::new(anchors, tags, false);
            for _ in 0..2 {
                assert_eq!(fed.after(30), (vec![], vec![]), "{anchors} anchors, {tags} tags");
                assert!(fed.live.recent_rounds()[SITE].len() >= 20);
            }
        }
    }
}
