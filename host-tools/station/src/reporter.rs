//! From the messages of one node to reports of the station.

use std::collections::{HashMap, VecDeque};
use std::time::Duration;

use station_core::model::{Doubt, NodeRole, RangeMeasurement};
use station_core::{ReportKind, SolvedFrom, SourceReport, Utc};
use wire::telemetry::{self, Address, BeaconId, Fix, Message, Range, TagData, TagFix};
use wire::uwb::native::PolledPosition;

use super::NodeClock;
use node_link::decode::Stamp;

/// Converts the messages of one node, in their order.
#[derive(Clone, Debug)]
pub struct NodeReporter {
    site: String,
    clock: NodeClock,
    /// The node's address. It is unknown until the node says `Hello`, which it does every two seconds.
    address: Option<u16>,
    /// It is unknown until then as well.
    role: Option<telemetry::Role>,
    /// The tags whose polls it receives, by address.
    polls: HashMap<u16, ReceivedPolls>,
}

/// The polls of a tag that an anchor received.
#[derive(Clone, Debug, Default)]
struct ReceivedPolls {
    /// The last rounds and when their polls came, in the order of reports: those that other anchors passed on come later.
    rounds: VecDeque<(u16, Utc)>,
    /// The rounds of the last positions and when they were measured.
    located: VecDeque<(u16, Utc)>,
}

/// Positions of one round are two if they were measured this far apart: the tag has started again.
const RESTARTED: Duration = Duration::from_secs(1);

impl ReceivedPolls {
    /// Takes the poll of a round, received at `t`, with a position of the round `measured`. Returns when the position was
    /// measured, as far as the poll of its round was received, or nothing if an earlier poll has brought it.
    fn take(&mut self, round: u16, measured: u16, t: Utc) -> Option<Utc> {
        keep(&mut self.rounds, (round, t));
        let of_round = self.rounds.iter().rev().find(|(round, _)| *round == measured);
        let measured_at = of_round.map_or(t, |(_, t)| *t);
        let is_known = |&(known, at): &(u16, Utc)| {
            known == measured && at.since(measured_at).max(measured_at.since(at)) < RESTARTED
        };
        if self.located.back().is_some_and(|(last, _)| *last == measured) || self.located.iter().any(is_known) {
            return None;
        }
        keep(&mut self.located, (measured, measured_at));
        Some(measured_at)
    }
}

/// Adds a round to the last ones.
fn keep(rounds: &mut VecDeque<(u16, Utc)>, of_round: (u16, Utc)) {
    if rounds.len() > PolledPosition::OLDEST.into() {
        rounds.pop_front();
    }
    rounds.push_back(of_round);
}

impl NodeReporter {
    /// A node of a site.
    pub fn new(site: impl Into<String>) -> Self {
        Self { site: site.into(), clock: NodeClock::default(), address: None, role: None, polls: HashMap::new() }
    }

    /// A node whose address is known.
    pub fn of(site: impl Into<String>, address: u16) -> Self {
        Self { address: Some(address), ..Self::new(site) }
    }

    /// The reports that a message makes, which arrived at `arrived`. The messages before the node's first `Hello` make
    /// none, because nobody knows whose they are.
    pub fn reports(&mut self, stamp: Stamp, message: &Message, arrived: Utc) -> Vec<SourceReport> {
        let t = self.clock.utc(stamp.t_s, arrived);
        self.reports_of(t, message)
    }

    /// The reports that a message of the time `t` makes.
    pub fn reports_of(&mut self, t: Utc, message: &Message) -> Vec<SourceReport> {
        if let Message::Hello(hello) = message {
            self.address = Some(hello.address);
            self.role = Some(hello.role);
        }
        let Some(address) = self.address else { return Vec::new() };
        let t = received(t, message);
        if let Message::TagFix(told) = message {
            let Some(fix) = told.fix() else { return Vec::new() };
            let Some(t) = self.polls.entry(told.tag).or_default().take(told.round, fix.round, t) else {
                return Vec::new();
            };
            let what = fix_report(Address(told.tag).to_string(), &fix);
            return vec![SourceReport { t, site: self.site.clone(), what }];
        }
        let tag = Address(address).to_string();
        let whats = match message {
            Message::Hello(hello) => {
                let role = match hello.role {
                    telemetry::Role::Anchor => NodeRole::Anchor,
                    telemetry::Role::Tag => NodeRole::Tag,
                    telemetry::Role::Beacon => NodeRole::Beacon,
                    telemetry::Role::Scanner => NodeRole::Receiver,
                };
                vec![ReportKind::Node { node: tag, name: None, role, position_m: None }]
            }
            Message::Fix(fix) => vec![fix_report(tag, fix)],
            Message::Range(range) => range_reports(tag, range),
            Message::Sighting(sighting) => {
                let BeaconId { network, major, minor } = sighting.beacon;
                // The station calls beacons as the site's file does, whatever UUID they advertise.
                let beacon = format!("{major}-{minor}");
                let rssi_dbm = sighting.rssi_dbm.into();
                match self.role {
                    // Nobody knows yet whether it is at a known place, or moves.
                    None => Vec::new(),
                    Some(telemetry::Role::Scanner) => {
                        let rssi_1m_dbm = Some(sighting.measured_power_dbm.into());
                        // What it receives moves, and may be of anybody. A rotating identifier has no UUID.
                        let device = if network == 0 { beacon } else { sighting.beacon.to_string() };
                        vec![ReportKind::ReceiverSighting { receiver: tag, device, rssi_dbm, rssi_1m_dbm }]
                    }
                    Some(telemetry::Role::Tag | telemetry::Role::Anchor | telemetry::Role::Beacon) => {
                        vec![ReportKind::Sighting { tag, beacon, rssi_dbm }]
                    }
                }
            }
            Message::TagData(told) => {
                let (tag, data) = (Address(told.tag).to_string(), told.data().to_vec());
                vec![ReportKind::Data { tag, number: told.number, data }]
            }
            Message::TagAnswer(told) => {
                vec![ReportKind::Answer { tag: told.tag, number: told.number, answer: told.answer() }]
            }
            Message::Arrival(arrival) => vec![ReportKind::Arrival { anchor: address, arrival: *arrival }],
            Message::Supply(supply) => vec![ReportKind::Supply { node: tag, supply_v: supply.supply_v() }],
            // Anchors count nothing that they refuse, and must not become tags.
            Message::Counters(counters) if self.role == Some(telemetry::Role::Tag) => {
                vec![ReportKind::Refusals { tag, frames: counters.refused }]
            }
            // The station keeps nothing of the others.
            _ => Vec::new(),
        };
        whats.into_iter().map(|what| SourceReport { t, site: self.site.clone(), what }).collect()
    }
}

/// When what a message of the time `t` says was received: another anchor may have passed it on.
fn received(t: Utc, message: &Message) -> Utc {
    let age_us = match message {
        Message::TagFix(TagFix { age_us, .. }) | Message::TagData(TagData { age_us, .. }) => *age_us,
        _ => 0,
    };
    t - Duration::from_micros(age_us.into())
}

fn fix_report(tag: String, fix: &Fix) -> ReportKind {
    let round = Some(fix.round);
    let (Some([x, y, z]), Some([sigma_x, sigma_y, sigma_z]), Some([[_, cov_xy_m2, _], ..])) =
        (fix.position_m(), fix.deviation_m(), fix.covariance_m2())
    else {
        let reason = fix.reason().map_or("unknown", |reason| reason.as_str()).to_owned();
        return ReportKind::NoPosition { tag, round, reason };
    };
    ReportKind::Position {
        tag,
        round,
        position_m: [x, y],
        z_m: Some(z),
        sigma_m: [sigma_x, sigma_y],
        // A configured height has no deviation.
        sigma_z_m: (sigma_z > 0.0).then_some(sigma_z),
        cov_xy_m2,
        used: u8::try_from(fix.used().map_or(0, u16::count_ones)).unwrap_or(u8::MAX),
        // No anchor was asked: it is from beacons.
        solved_from: if fix.asked == 0 { SolvedFrom::Rssi } else { SolvedFrom::Ranges },
        doubt: match fix.doubt {
            telemetry::Doubt::None => None,
            telemetry::Doubt::Suspect => Some(Doubt::Suspect),
            two_places @ telemetry::Doubt::Ambiguous(_) => {
                two_places.alternative_m().map(|alternative_m| Doubt::Ambiguous { alternative_m })
            }
        },
    }
}

/// The range, and before it the position that the anchor reports.
fn range_reports(tag: String, range: &Range) -> Vec<ReportKind> {
    let anchor = Address(range.peer).to_string();
    let known = range.position_m().map(|position_m| ReportKind::Node {
        node: anchor.clone(),
        name: None,
        role: NodeRole::Anchor,
        position_m: Some(position_m),
    });
    let diagnostics = &range.diagnostics;
    let range = ReportKind::Range {
        tag,
        round: Some(range.round),
        anchor,
        range: RangeMeasurement {
            range_m: range.distance_m(),
            rx_power_dbm: diagnostics.rx_power_dbm(),
            first_path_power_dbm: diagnostics.first_path_power_dbm(),
            clock_offset_ppm: diagnostics.clock_offset_ppm(),
        },
    };
    known.into_iter().chain([range]).collect()
}

#[cfg(test)]
mod tests {
    use wire::uwb::native::UserData;

    use wire::telemetry::{Outcome, Sighting, Solver};

    use super::*;

    #[test]
    fn a_tag_names_a_beacon_as_the_sites_file_and_a_scanner_names_what_moves() {
        let beacon = BeaconId { network: 0xC2A8_AD55, major: 1, minor: 7 };
        let sighting = Sighting { t_us: 450_000, beacon, rssi_dbm: -67, measured_power_dbm: -59 };
        let stamp = Stamp { t_s: 0.45, epoch: 0 };
        let whats = |role: Option<telemetry::Role>, beacon| {
            let mut node = NodeReporter::of("hall", 0x1001);
            if let Some(role) = role {
                node.reports(stamp, &hello(0x1001, role), Utc::now());
            }
            let reports = node.reports(stamp, &Sighting { beacon, ..sighting }.into(), Utc::now());
            reports.into_iter().map(|report| report.what).collect::<Vec<_>>()
        };
        let (tag, name) = ("0x1001".to_owned(), "1-7".to_owned());
        let expected = ReportKind::Sighting { tag: tag.clone(), beacon: name.clone(), rssi_dbm: -67.0 };
        assert_eq!(whats(Some(telemetry::Role::Tag), beacon), [expected]);
        assert_eq!(whats(None, beacon), [], "it may be a scanner");
        let received = |device: &str| {
            let (receiver, device) = (tag.clone(), device.to_owned());
            ReportKind::ReceiverSighting { receiver, device, rssi_dbm: -67.0, rssi_1m_dbm: Some(-59.0) }
        };
        let scanner = Some(telemetry::Role::Scanner);
        assert_eq!(whats(scanner, beacon), [received("c2a8ad55-1-7")]);
        assert_eq!(whats(scanner, BeaconId { network: 0, ..beacon }), [received("1-7")]);
    }

    fn hello(address: u16, role: telemetry::Role) -> Message {
        let board = telemetry::Board::Dwm1001;
        telemetry::Hello { t_us: 1, eui: 7, address, role, board, build: [0; 8], keyed: false }.into()
    }

    #[test]
    fn tags_say_what_they_refused_and_anchors_do_not() {
        let refused = |role| {
            let counters = telemetry::Counters { t_us: 2, refused: 12, ..telemetry::Counters::default() };
            let mut node = NodeReporter::new("hall");
            let mut reports = |message| node.reports(Stamp { t_s: 0.0, epoch: 0 }, &message, Utc::now());
            reports(hello(0x1001, role));
            reports(counters.into()).into_iter().map(|report| report.what).collect::<Vec<_>>()
        };
        let expected = ReportKind::Refusals { tag: "0x1001".to_owned(), frames: 12 };
        assert_eq!(refused(telemetry::Role::Tag), [expected]);
        assert_eq!(refused(telemetry::Role::Anchor), []);
    }

    #[test]
    fn an_anchor_tells_the_positions_of_tags_when_they_were_measured() {
        let mut node = NodeReporter::new("hall");
        let begin = Utc::now();
        node.reports(Stamp { t_s: 0.0, epoch: 0 }, &hello(0x0101, telemetry::Role::Anchor), begin);
        let position = PolledPosition::new([1.0, 2.0, 0.5], [[0.01, 0.0, 0.0]; 3], false).unwrap();
        // A poll each 100 ms. The first one's position is of a round whose poll was not received, and 7 brings that of 5
        // again.
        let mut told_at = |tenths: u16, ago: u16, round: u16, rounds_ago| {
            let PolledPosition(position) = position.of_rounds_ago(rounds_ago);
            let (t_us, age_us) = (u64::from(tenths) * 100_000, u32::from(ago) * 100_000);
            let message = telemetry::TagFix { t_us, tag: 0x1001, round, asked: 4, age_us, position }.into();
            let stamp = Stamp { t_s: f64::from(tenths) / 10.0, epoch: 0 };
            let reports = node.reports(stamp, &message, begin + Duration::from_millis(u64::from(tenths) * 100));
            let times = reports.iter().map(|report| (report.t.since(begin).as_millis() + 50) / 100);
            let tags = reports.iter().map(|report| match &report.what {
                ReportKind::Position { tag, round, .. } => (tag.clone(), *round),
                other => panic!("{other:?}"),
            });
            times.zip(tags).collect::<Vec<_>>()
        };
        let tag = |round| ("0x1001".to_owned(), Some(round));
        assert_eq!(told_at(5, 0, 5, 1), [(5, tag(4))]);
        assert_eq!(told_at(6, 0, 6, 1), [(5, tag(5))]);
        assert_eq!(told_at(7, 0, 7, 2), []);
        assert_eq!(told_at(9, 0, 9, 2), [(7, tag(7))]);
        // Other anchors pass on the poll of 8, and that of 6 again, and one of 10 comes before theirs.
        assert_eq!(told_at(11, 0, 11, 1), [(11, tag(10))]);
        assert_eq!(told_at(12, 4, 8, 2), [(6, tag(6))]);
        assert_eq!(told_at(13, 7, 6, 1), []);
        // The tag starts again: the same numbers are other rounds.
        assert_eq!(told_at(14, 0, 14, 1), [(14, tag(13))]);
        assert_eq!(told_at(36, 0, 6, 1), []);
        assert_eq!(told_at(37, 0, 7, 1), [(36, tag(6))]);
    }

    #[test]
    fn an_anchor_tells_data_of_the_tags_that_sent_them() {
        let mut node = NodeReporter::of("hall", 0x0101);
        let data = UserData::new(7, b"open").unwrap();
        let message = telemetry::TagData::new(2, 0, 0x1001, &data).into();
        let reports = node.reports(Stamp { t_s: 0.0, epoch: 0 }, &message, Utc::now());
        let whats: Vec<_> = reports.into_iter().map(|report| report.what).collect();
        assert_eq!(whats, [ReportKind::Data { tag: "0x1001".to_owned(), number: 7, data: b"open".to_vec() }]);
    }

    fn fix(asked: u8, doubt: telemetry::Doubt) -> Fix {
        let outcome = Outcome::Position {
            position_tenth_mm: [10_000, 20_000, 0],
            deviation_tenth_mm: [1_000; 3],
            correlation_127ths: [0; 3],
            used: 0b11,
            quality_255ths: 255,
        };
        Fix { t_us: 1, round: 1, age_us: 0, asked, outcome, solver: Solver::Track, doubt }
    }

    #[test]
    fn a_position_without_asked_anchors_is_by_rssi() {
        for (asked, expected) in [(0, SolvedFrom::Rssi), (1, SolvedFrom::Ranges), (4, SolvedFrom::Ranges)] {
            let fix = fix(asked, telemetry::Doubt::None);
            let ReportKind::Position { solved_from, position_m, .. } = fix_report("0x1001".to_owned(), &fix) else {
                panic!("a position")
            };
            assert_eq!((solved_from, position_m), (expected, [1.0, 2.0]));
        }
    }

    #[test]
    fn a_fix_keeps_its_doubt() {
        let two_places = Doubt::Ambiguous { alternative_m: [-1.5, 2.0, 0.3] };
        for (of_wire, expected) in [
            (telemetry::Doubt::None, None),
            (telemetry::Doubt::Suspect, Some(Doubt::Suspect)),
            (telemetry::Doubt::Ambiguous([-15_000, 20_000, 3_000]), Some(two_places)),
        ] {
            let ReportKind::Position { doubt, .. } = fix_report("0x1001".to_owned(), &fix(4, of_wire)) else {
                panic!("a position")
            };
            assert_eq!(doubt, expected);
        }
    }
}
