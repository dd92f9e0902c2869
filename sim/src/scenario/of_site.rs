//! A scenario from a site's file: `examples/every-key.toml` has every key of a simulation.

use std::collections::{HashMap, HashSet};

use site::{NodeSimulation, Purpose, Sensor, SimulatedBoard, Site, SiteError};
use wire::config::{Advertiser, Board, Identity, Role};

use super::default_walk::Landmarks;
use super::{Anchor, Attacker, Beacon, Fault, Format, Motion, MotionSensor, Scanner, Scenario, Tag, TagSettings, Walk};
use crate::air::{Material, Wall};
use crate::bluetooth::BluetoothConfig;
use crate::board::BoardProfile;
use crate::lis2dh12::Condition;

/// The address of the first beacon that is listed and is no node.
const FIRST_LISTED_BEACON: u16 = 0x3001;
/// The most frames that an attacker sends for each of the network's: then the air is never free.
const MOST_ATTACKS: f64 = 100.0;
/// The farthest that frames carry a coordinate, metres.
const FARTHEST_M: f64 = 8388.0;
/// What a beacon advertises that is listed and is no node.
const LISTED_ADVERTISER: Advertiser = Advertiser {
    uuid: site::SIMULATED_UUID,
    major: 0,
    minor: 0,
    measured_power_dbm: -59,
    interval_ms: 100,
    tx_power_dbm: 0,
    channels: 0b111,
    rotate_s: 0,
};

impl Scenario {
    /// Parses a site's file, without the files that it names.
    ///
    /// # Errors
    /// Returns the first error in the text, with its line.
    pub fn parse(text: &str) -> Result<Self, SiteError> {
        Self::of_site(&Site::parse(text, Purpose::Simulation)?)
    }

    /// The scenario of a site that was read for a simulation. Tags without a path walk among the anchors. Anchors and
    /// beacons that are only listed are simulated too.
    ///
    /// # Errors
    /// A node has no position, or there is no tag, or neither an anchor nor a beacon.
    pub fn of_site(site: &Site) -> Result<Self, SiteError> {
        let simulation = &site.simulation;
        let board = profile(simulation.board).slowed(simulation.cpu_slowdown);
        let mut scenario = Self {
            seconds: simulation.seconds,
            seed: simulation.seed,
            loss: simulation.loss,
            fidelity: simulation.fidelity,
            air: simulation.air,
            clock_ppm: simulation.clock_ppm,
            board,
            method: simulation.method,
            weigh_nlos: simulation.weigh_nlos,
            networks: std::iter::once(&site.network).chain(&simulation.networks).copied().collect(),
            beacon_key: site.beacon_key,
            walls: simulation.walls.iter().map(wall).collect(),
            bluetooth: bluetooth(&simulation.bluetooth),
            beacons: Vec::new(),
            scanners: Vec::new(),
            anchors: Vec::new(),
            listed_anchors: site.listed_anchors.clone(),
            tags: Vec::new(),
            faults: Vec::new(),
            attackers: Vec::new(),
        };
        let has = |of: fn(&Role) -> bool| site.nodes.iter().any(|node| of(&node.record.role));
        let has_tag = has(|role| matches!(role, Role::Tag(_) | Role::Scanner));
        let is_listed = !site.lists.anchors.is_empty() || !site.lists.beacons.is_empty();
        if !has_tag || !is_listed && !has(|role| !matches!(role, Role::Tag(_) | Role::Scanner)) {
            let missing = if has_tag { "\"anchor\" or \"beacon\"" } else { "\"tag\" or \"scanner\"" };
            return Err(SiteError::whole(format!("a simulation needs at least one [[node]] with role = {missing}")));
        }
        let mut listed = HashSet::new();
        for node in &site.nodes {
            match node.record.role {
                Role::Anchor { .. } => scenario.add_anchor(node, simulation)?,
                Role::Advertiser(advertiser) => scenario.add_beacon(node, advertiser, &mut listed)?,
                Role::Scanner => scenario.scanners.push(Scanner {
                    address: address(node.record.identity),
                    at: position(node)?,
                    path_loss: [node.rssi_1m_dbm, node.path_loss_exponent],
                }),
                Role::Tag(_) => {}
            }
        }
        scenario.add_listed(site, &listed)?;
        let mut landmarks = HashMap::new();
        for node in &site.nodes {
            if let Role::Tag(settings) = node.record.role {
                let network = node.simulation.network;
                let among = landmarks.entry(network).or_insert_with(|| Landmarks::new(&scenario.landmarks_m(network)));
                scenario.add_tag(node, simulation, settings, among);
            }
        }
        scenario.faults = faults(site)?;
        scenario.add_attackers(simulation)?;
        scenario.validate().map_err(|(address, invalid)| {
            let node = site.nodes.iter().find(|node| node.record.identity.address == Some(address));
            node.map_or_else(|| SiteError::whole(invalid.to_string()), |node| node.wrong(&invalid))
        })?;
        Ok(scenario)
    }

    fn add_anchor(&mut self, node: &site::Node, simulation: &site::Simulation) -> Result<(), SiteError> {
        self.anchors.push(Anchor {
            address: address(node.record.identity),
            network: node.simulation.network,
            at: position(node)?,
            gateway: node.simulation.gateway || node.wifi.is_some(),
            wifi: node.wifi.is_some(),
            board: own_board(node, simulation),
            antenna_delay_ticks: node.simulation.true_antenna_delay_ticks,
        });
        Ok(())
    }

    fn add_tag(
        &mut self,
        node: &site::Node,
        simulation: &site::Simulation,
        settings: wire::config::Tag,
        landmarks: &Landmarks,
    ) {
        let NodeSimulation { network, carried_by, vibration_mg, motion_sensor, .. } = node.simulation;
        let NodeSimulation { path_m, speed_m_s, closed, leaves_s, .. } = &node.simulation;
        let NodeSimulation { data_every_s, messages_every_s, .. } = node.simulation;
        let walk = path_m.clone().and_then(|path_m| Walk::new(path_m, *speed_m_s, *closed));
        let walk = walk.unwrap_or_else(|| landmarks.walk(settings.height_m, self.tags.len()));
        self.tags.push(Tag {
            address: address(node.record.identity),
            network,
            settings: TagSettings { record: settings, ..TagSettings::default() },
            blinks: node.record.network.mode == wire::config::Mode::Blink,
            wifi: node.wifi.is_some(),
            walk: walk.leaving_at(*leaves_s),
            board: own_board(node, simulation),
            antenna_delay_ticks: node.simulation.true_antenna_delay_ticks,
            motion: Motion { carrier: carried_by, vibration_mg, sensor: motion(motion_sensor) },
            data_every_s,
            messages_every_s,
        });
    }

    /// The positions among which a tag of a network walks: those of its anchors, or else of the beacons.
    fn landmarks_m(&self, network: usize) -> Vec<[f64; 3]> {
        let anchors: Vec<_> = self.anchors.iter().filter(|a| a.network == network).map(|anchor| anchor.at).collect();
        if anchors.is_empty() { self.beacons.iter().map(|beacon| beacon.at).collect() } else { anchors }
    }

    /// The tags' list has what a calibration would find, unless the file says something else. `listed` has the numbers of
    /// the beacons that tags are told of.
    fn add_beacon(
        &mut self,
        node: &site::Node,
        advertiser: Advertiser,
        listed: &mut HashSet<(u16, u16)>,
    ) -> Result<(), SiteError> {
        let (major, minor) = (advertiser.major, advertiser.minor);
        let rssi_1m_dbm = node.simulation.rssi_1m_dbm.unwrap_or(advertiser.measured_power_dbm.into());
        if node.simulation.listed && !listed.insert((major, minor)) {
            let remedy = "write listed = false in the table simulation of one of them";
            let what = format!("tags are told of two beacons {major}-{minor}: {remedy}");
            return Err(SiteError::at(node.lines.line, what));
        }
        let told = node.lists.beacon(major, minor).filter(|_| node.simulation.listed);
        let beacon = Beacon {
            address: address(node.record.identity),
            at: position(node)?,
            rssi_1m_dbm,
            format: node.simulation.format,
            advertiser,
            listed: told.map(|told| self.calibrated(told, rssi_1m_dbm)),
        };
        check_reach(beacon.at).map_err(|what| SiteError::at(node.lines.of("position_m"), what))?;
        self.beacons.push(beacon);
        Ok(())
    }

    fn calibrated(&self, listed: &wire::config::Beacon, rssi_1m_dbm: f64) -> wire::config::Beacon {
        wire::config::Beacon {
            rssi_1m_dbm: listed.rssi_1m_dbm.or(Some(rssi_1m_dbm as f32)),
            path_loss_exponent: listed.path_loss_exponent.or(Some(self.bluetooth.medium.exponent as f32)),
            ..*listed
        }
    }

    /// Adds the anchors and beacons that tags are told of and that are no nodes of the file: those of other makers.
    fn add_listed(&mut self, site: &Site, nodes: &HashSet<(u16, u16)>) -> Result<(), SiteError> {
        let is_free = |address: u16| site.nodes.iter().all(|node| node.record.identity.address != Some(address));
        for (anchor, line) in &site.lists.anchors {
            if self.anchors.iter().any(|node| node.address == anchor.address) {
                continue;
            }
            if !is_free(anchor.address) {
                let what = format!("address is {}: a node that is no anchor has it", anchor.address);
                return Err(SiteError::at(*line, what));
            }
            let (address, at) = (anchor.address, anchor.position_m.map(f64::from));
            self.anchors.push(Anchor {
                address,
                network: 0,
                at,
                gateway: false,
                wifi: false,
                board: None,
                antenna_delay_ticks: None,
            });
        }
        let mut addresses = (FIRST_LISTED_BEACON..).filter(|address| is_free(*address));
        for (listed, line) in &site.lists.beacons {
            let (major, minor) = (listed.major, listed.minor);
            if nodes.contains(&(major, minor)) {
                continue;
            }
            let advertiser = Advertiser { major, minor, ..LISTED_ADVERTISER };
            let rssi_1m_dbm = listed.rssi_1m_dbm.map_or(advertiser.measured_power_dbm.into(), f64::from);
            let at = listed.position_m.map(f64::from);
            check_reach(at).map_err(|what| SiteError::at(*line, what))?;
            self.beacons.push(Beacon {
                address: addresses.next().unwrap_or_default(),
                at,
                rssi_1m_dbm,
                format: Format::Ibeacon,
                advertiser,
                listed: Some(self.calibrated(listed, rssi_1m_dbm)),
            });
        }
        Ok(())
    }

    fn add_attackers(&mut self, simulation: &site::Simulation) -> Result<(), SiteError> {
        for attacker in &simulation.attackers {
            let Attacker { network, rate, .. } = *attacker;
            if !self.anchors.iter().any(|anchor| anchor.network == network) {
                let what = format!("[[simulation.attacker]]: network is {network}: there is no anchor in it");
                return Err(SiteError::whole(what));
            }
            if rate > MOST_ATTACKS {
                let what = format!("[[simulation.attacker]]: rate is {rate}: it must be at most {MOST_ATTACKS}");
                return Err(SiteError::whole(what));
            }
            self.attackers.push(*attacker);
        }
        Ok(())
    }
}

fn check_reach(position_m: [f64; 3]) -> Result<(), String> {
    match position_m.iter().find(|metres| !(metres.abs() <= FARTHEST_M)) {
        Some(metres) => Err(format!("position_m has {metres}: it must be coordinates within 8388 m")),
        None => Ok(()),
    }
}

/// A node's address. A site that was read for a simulation gives each node one.
fn address(identity: Identity) -> u16 {
    identity.address.unwrap_or_default()
}

fn position(node: &site::Node) -> Result<[f64; 3], SiteError> {
    let what = "position_m is missing: the simulation needs to know where the node is";
    node.position_m.ok_or_else(|| SiteError::at(node.lines.line, what))
}

/// The board of a node that names a board or a slowdown of its own; both replace those of the simulation.
fn own_board(node: &site::Node, simulation: &site::Simulation) -> Option<BoardProfile> {
    let slowdown = node.simulation.cpu_slowdown;
    let differs = node.board.is_some() || slowdown.is_some();
    let board = node.board.map_or(simulation.board, SimulatedBoard::Hardware);
    differs.then(|| profile(board).slowed(slowdown.unwrap_or(simulation.cpu_slowdown)))
}

/// What a board costs. An ESP32 is taken for an ESP32-C3, whose processor is slower.
fn profile(board: SimulatedBoard) -> BoardProfile {
    match board {
        SimulatedBoard::Hardware(Board::Dwm1001) => BoardProfile::DWM1001,
        SimulatedBoard::Hardware(Board::Evk1000) => BoardProfile::EVB1000,
        SimulatedBoard::Hardware(Board::Esp32C3 | Board::Esp32) => BoardProfile::ESP32C3,
        SimulatedBoard::Hardware(Board::Esp32C6) => BoardProfile::ESP32C6,
        SimulatedBoard::Hardware(Board::Simulated) | SimulatedBoard::Instant => BoardProfile::INSTANT,
    }
}

fn motion(sensor: Option<Sensor>) -> MotionSensor {
    MotionSensor::Fitted(match sensor {
        None => return MotionSensor::OfBoard,
        Some(Sensor::None) => return MotionSensor::Absent,
        Some(Sensor::Works) => Condition::Works,
        Some(Sensor::Silent) => Condition::Silent,
        Some(Sensor::Hung) => Condition::Hung,
        Some(Sensor::Foreign) => Condition::Foreign,
        Some(Sensor::StuckHigh) => Condition::Stuck(true),
        Some(Sensor::StuckLow) => Condition::Stuck(false),
    })
}

fn wall(wall: &site::Wall) -> Wall {
    let material = match wall.material {
        site::Material::Drywall => Material::DRYWALL,
        site::Material::Wood => Material::WOOD,
        site::Material::Glass => Material::GLASS,
        site::Material::Brick => Material::BRICK,
        site::Material::Concrete => Material::CONCRETE,
        site::Material::Metal => Material::METAL,
        site::Material::Body => Material::BODY,
    };
    Wall { from: wall.from_m, to: wall.to_m, material }
}

fn bluetooth(table: &site::Bluetooth) -> BluetoothConfig {
    let mut air = BluetoothConfig::default();
    let set = |value: &mut f64, given: Option<f64>| *value = given.unwrap_or(*value);
    set(&mut air.medium.exponent, table.path_loss_exponent);
    set(&mut air.medium.shadowing_db, table.shadowing_db);
    set(&mut air.medium.shadowing_m, table.shadowing_m);
    set(&mut air.medium.fading_db, table.fading_db);
    set(&mut air.sensitivity_dbm, table.sensitivity_dbm);
    set(&mut air.receiver_offset_db, table.receiver_offset_db);
    set(&mut air.loss, table.loss);
    set(&mut air.unknown_rssi, table.unknown_rssi);
    air.unknown_rssi_dbm = table.unknown_rssi_dbm.unwrap_or(air.unknown_rssi_dbm);
    air
}

/// The faults in the order of time.
fn faults(site: &Site) -> Result<Vec<Fault>, SiteError> {
    let faults = site.simulation.faults.iter().map(|(fault, line)| {
        let is_it = |node: &&site::Node| {
            node.name == fault.node || node.record.identity.address.is_some_and(|own| own.to_string() == fault.node)
        };
        match site.nodes.iter().find(is_it) {
            Some(node) => Ok(Fault { at_s: fault.at_s, node: address(node.record.identity), what: fault.what }),
            None => Err(SiteError::at(*line, format!("node is {}: no node has this name or address", fault.node))),
        }
    });
    let mut faults = faults.collect::<Result<Vec<_>, _>>()?;
    faults.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
    Ok(faults)
}

#[cfg(test)]
mod tests {
    use wire::config::{Mode, Network, Phy, Scan, Scheme, Solver};

    use super::*;
    use crate::scenario::{AirModel, Carrier, FaultKind, Fidelity, NETWORK, distance};

    const LEAST: &str = "[[node]]\nrole = \"anchor\"\nposition_m = [0, 0, 2]\n[[node]]\nrole = \"tag\"\n";

    fn error(text: &str) -> SiteError {
        Scenario::parse(text).unwrap_err()
    }

    #[test]
    fn the_example_with_every_key_is_read() {
        let text = include_str!("../../../examples/every-key.toml");
        let scenario = Scenario::parse(text).unwrap();
        assert_eq!((scenario.seconds, scenario.seed, scenario.loss, scenario.fidelity), (30.0, 1, 0.1, Fidelity::Spi));
        assert_eq!((scenario.anchors.len(), scenario.tags.len(), scenario.walls.len()), (3, 1, 1));
        assert_eq!(scenario.beacons.len(), 1);
        assert_eq!(scenario.bluetooth, BluetoothConfig::default());
        assert_eq!(scenario.walls[0].material, Material::BRICK);
        let phy = Phy { code: Some(10), ..NETWORK.phy };
        assert_eq!(scenario.networks, [NETWORK, Network { pan: 0xBA13, phy, ..NETWORK }]);
        assert_eq!((scenario.board, scenario.method), (BoardProfile::DWM1001, None));
        assert_eq!(scenario.anchors[2].board, Some(BoardProfile::ESP32C3.slowed(4.0)));
        assert_eq!([1, 2, 3, 0x1001].map(|address| scenario.has_host(address)), [false, false, true, false]);
        assert_eq!(scenario.tags[0].data_every_s, Some(1.0));
        assert_eq!(scenario.tags[0].messages_every_s, Some(5.0));
        let tag = scenario.tags[0].settings.record;
        let scan = Some(Scan { interval_ms: 1000, window_ms: 1000 });
        assert_eq!((tag.height_m, tag.rate_chz, tag.scan), (Some(1.2), Some(1000), scan));
        assert_eq!(scenario.anchors.iter().map(|a| a.address).collect::<Vec<_>>(), [1, 2, 3]);
        let attacker = Attacker { position_m: [3.0, 2.0, 1.0], network: 0, rate: 1.0, from_s: 5.0 };
        assert_eq!(scenario.attackers, [attacker]);
        assert_eq!(scenario.faults, [Fault { at_s: 10.0, node: 2, what: FaultKind::Off }]);
        // 6 m along the first side at 1 m/s, then 1 m along the second.
        assert!(distance(scenario.tags[0].walk.at(7.0), [7.0, 2.0, 1.2]) < 1e-9);
    }

    #[test]
    fn the_site_that_provision_prints_is_simulated_as_it_is() {
        let scenario = Scenario::parse(site::EXAMPLE).unwrap();
        assert_eq!((scenario.seconds, scenario.clock_ppm, scenario.air), (10.0, 20.0, AirModel::Recorded));
        assert_eq!((scenario.networks[0].pan, scenario.networks.len()), (0xBA11, 1));
        assert_eq!(scenario.anchors.iter().map(|a| a.address).collect::<Vec<_>>(), [0x0101, 0x0102, 0x0103, 0x0104]);
        let tag = &scenario.tags[0];
        assert_eq!(
            (tag.address, tag.settings.record.rate_chz, tag.board),
            (0x0201, Some(1000), Some(BoardProfile::DWM1001))
        );
        // Anchors stand in the corners of 6 m by 4 m: 0.7 of the way from (3, 2) to (0, 0).
        assert!(distance(tag.walk.at(0.0), [0.9, 0.6, 1.2]) < 1e-9, "{:?}", tag.walk);
        assert_eq!((scenario.beacons[0].name(), scenario.beacons[0].at), ("1-1".to_owned(), [3.0, 2.0, 2.4]));
        assert_eq!(scenario.beacons[0].advertiser.uuid[..2], [0xC2, 0xA8]);
    }

    #[test]
    fn little_is_enough() {
        let scenario = Scenario::parse(LEAST).unwrap();
        assert_eq!((scenario.seconds, scenario.clock_ppm, scenario.networks), (10.0, 20.0, vec![NETWORK]));
        let record = wire::config::Tag { scheme: None, ..TagSettings::default().record };
        assert_eq!((scenario.tags[0].address, scenario.tags[0].settings.record), (0x1001, record));
    }

    #[test]
    fn an_attacker_needs_a_network_and_has_a_limit() {
        let attacker = |keys: &str| format!("{LEAST}[[simulation.attacker]]\nposition_m = [1, 1, 1]\n{keys}\n");
        assert_eq!(Scenario::parse(&attacker("rate = 100")).unwrap().attackers.len(), 1);
        assert!(error(&attacker("network = 1")).to_string().contains("network is 1: there is no anchor in it"));
        assert!(error(&attacker("rate = 1e300")).to_string().contains("it must be at most 100"));
    }

    #[test]
    fn errors_name_their_line() {
        let cases = [
            ("", None, "there is no [[node]]"),
            ("[[node]]\nrole = \"tag\"\n", None, "at least one [[node]] with role = \"anchor\" or \"beacon\""),
            (LEAST.split_once("[[node]]\nrole = \"tag\"").unwrap().0, None, "one [[node]] with role = \"tag\""),
            ("[simulation]\nsecond = 3\n", Some(2), "unknown key second; seconds is near it"),
            ("[simulation]\nseconds = -1\n", Some(2), "seconds is -1: it must be a positive number"),
            ("[simulation]\nloss = 1.5\n", Some(2), "loss is 1.5: it must be a probability from 0 to 1"),
            ("[simulation]\nloss = \"x\"\n", Some(2), "loss is \"x\": it must be a number"),
            (
                "[simulation]\nmethod = \"guess\"\n",
                Some(2),
                "method is \"guess\": it must be one of \"track\", \"bounding-box\", ",
            ),
            (
                "[simulation]\nboard = \"dwm1000\"\n",
                Some(2),
                "board is \"dwm1000\": it must be one of \"dwm1001\", \"evk1000\", ",
            ),
            ("[simulation]\ncpu_slowdown = 0\n", Some(2), "cpu_slowdown is 0: it must be a positive number"),
            (
                "[[node]]\nrole = \"anchor\"\nposition_m = [0, 0]\n",
                Some(3),
                "position_m is [0, 0]: it must be three numbers",
            ),
            (
                "[[node]]\nrole = \"anchor\"\nposition_m = [0, 9000, 0]\n",
                Some(3),
                "position_m is 9000: it must be finite",
            ),
            (
                "[[node]]\nrole = \"anchor\"\n[[node]]\nrole = \"tag\"\n",
                Some(1),
                "position_m is missing: the simulation",
            ),
            (
                "[[simulation.wall]]\nfrom_m = [0, 0]\nto_m = [1, 1]\nmaterial = \"paper\"\n",
                Some(4),
                "material is \"paper\": it must be one of \"drywall\", ",
            ),
            (
                "[[simulation.wall]]\nfrom_m = [0, nan]\n",
                Some(2),
                "from_m is [0, nan]: it must be coordinates within 8388 m",
            ),
            ("seed = \n", Some(1), ""),
            ("[simulation]\nseed = 1\n[node]\nrole = \"tag\"\n", Some(3), "two brackets"),
        ];
        for (text, line, message) in cases {
            let found = error(text);
            assert_eq!(found.line, line, "{text:?}: {found}");
            assert!(found.message.contains(message) && !found.message.contains('\n'), "{text:?}: {found}");
        }
    }

    #[test]
    fn what_does_not_fit_together_names_its_line() {
        let cases = [
            ("[node.simulation]\nnetwork = 1\n", 7, "there is no network 1"),
            ("[node.simulation]\npath_m = []\n", 7, "at least one point"),
            ("[node.simulation]\npath_m = [[0, 0, 9e9]]\n", 7, "coordinates within 8388 m"),
            ("[node.simulation]\nrssi_1m_dbm = -60\n", 7, "rssi_1m_dbm is a key of a node whose role is beacon"),
            (
                "[node.simulation]\nmotion_sensor = \"sleepy\"\n",
                7,
                "motion_sensor is \"sleepy\": it must be one of \"works\"",
            ),
            ("anchors_per_round = 9\n", 6, "anchors_per_round is 9: it must be 1 to 8"),
            ("scheme = \"double\"\n", 6, "scheme is \"double\": it must be one of \"single-sided\", \"double-sided\""),
            ("address = 1\n", 4, "the address 0x0001 is the same as anchor-1's in line 1"),
            ("address = 65535\n", 6, "address is 0xFFFF: it must be less than 0xFFFE"),
            (
                "[[simulation.fault]]\nat_s = 1\nnode = 77\nwhat = \"off\"\n",
                6,
                "node is 77: no node has this name or address",
            ),
            ("[[simulation.fault]]\nat_s = 1\nnode = \"gate\"\nwhat = \"off\"\n", 6, "node is gate: no node has this"),
            (
                "[[simulation.fault]]\nat_s = 1\nnode = 1.5\nwhat = \"off\"\n",
                8,
                "node is 1.5: it must be the name of a node",
            ),
            ("[network]\nevk1000_mode = 9\n", 7, "1 to 8, not 9"),
            ("[network]\nevk1000_mode = 5\nchannel = 5\n", 7, "evk1000_mode says it all"),
            ("[network]\nchannel = 6\n", 7, "channel is 6: it must be 1, 2, 3, 4, 5 or 7"),
            ("[network]\nrounds_hz = 6\n", 7, "rounds_hz is for mode"),
            (
                "[network]\nrate_kbps = 110\npreamble_symbols = 128\n",
                8,
                "preamble_symbols is 128: it must be 1024 or more",
            ),
            ("[network]\nmode = \"listening\"\nrounds_hz = 0.1\n", 8, "rounds_hz is 0.1: it must be 0.13 to 1000"),
            ("[network]\npreamble_code = 3\n", 7, "preamble_code is 3"),
            ("[network]\nmode = \"tdoa\"\n", 7, "mode is \"tdoa\": it must be one of \"native\""),
            ("[[anchor]]\naddress = 0x1001\nposition_m = [0, 0, 0]\n", 6, "a node that is no anchor has it"),
        ];
        for (more, line, message) in cases {
            let found = error(&format!("{LEAST}{more}"));
            assert_eq!(found.line, Some(line), "{more:?}: {found}");
            assert!(found.message.contains(message), "{more:?}: {found}");
        }
    }

    #[test]
    fn wrong_beacons_are_named_with_their_line() {
        let cases = [
            ("channels = [37, 40]\n", 8, "channels has 40: it must be a list of 37, 38, 39"),
            ("channels = []\n", 8, "channels is 0: it must be one of 37, 38, 39 at least"),
            ("interval_ms = 10\n", 8, "interval_ms is 10: it must be 20 to 10240"),
            ("address = 1\n", 6, "the address 0x0001 is the same as anchor-1's"),
            ("simulation = { rssi_1m_dbm = 40 }\n", 8, "rssi_1m_dbm is 40: it must be from -127 to 20 dBm"),
            ("simulation = { path_m = [[0, 0, 0]] }\n", 8, "path_m is a key of a node whose role is tag"),
            ("position_m = [0, 0, 1e300]\n", 6, "position_m is inf"),
            ("", 6, "position_m is missing"),
        ];
        for (more, line, message) in cases {
            let found = error(&format!("{LEAST}[[node]]\nrole = \"beacon\"\n{more}"));
            assert!(found.message.contains(message), "{more:?}: {found}");
            assert_eq!(found.line, Some(line), "{more:?}: {found}");
        }
    }

    #[test]
    fn boards_and_their_slowdowns_are_read() {
        let text = "[[node]]\nrole = \"anchor\"\nposition_m = [0, 0, 2]\n\
            [[node]]\nrole = \"anchor\"\nposition_m = [1, 0, 2]\nboard = \"esp32c6\"\n\
            [[node]]\nrole = \"tag\"\nsimulation = { path_m = [[1, 2, 1]], cpu_slowdown = 0.5 }\n\
            [simulation]\nboard = \"evk1000\"\ncpu_slowdown = 2\n";
        let scenario = Scenario::parse(text).unwrap();
        assert_eq!(scenario.board, BoardProfile::EVB1000.slowed(2.0));
        assert_eq!(scenario.anchors[0].board, None);
        assert_eq!(scenario.anchors[1].board, Some(BoardProfile::ESP32C6.slowed(2.0)));
        assert_eq!(scenario.tags[0].board, Some(BoardProfile::EVB1000.slowed(0.5)));
        let mut slower = scenario;
        slower.slow_down(4.0);
        assert_eq!((slower.board.slowdown, slower.anchors[0].board), (8.0, None));
        assert_eq!(slower.anchors[1].board, Some(BoardProfile::ESP32C6.slowed(8.0)));
        assert_eq!(slower.tags[0].board, Some(BoardProfile::EVB1000.slowed(2.0)));
    }

    #[test]
    fn how_tags_are_moved_and_what_their_sensors_are_worth() {
        let text = "[[node]]\nrole = \"anchor\"\nposition_m = [0, 0, 2]\n[[node]]\nrole = \"tag\"\n[node.simulation]\n\
            path_m = [[0, 0, 1], [9, 0, 1]]\nleaves_s = 5\ncarried_by = \"trolley\"\nvibration_mg = 60\n\
            motion_sensor = \"stuck-high\"\n[[node]]\nrole = \"tag\"\nboard = \"esp32c3\"\n";
        let scenario = Scenario::parse(text).unwrap();
        let sensor = MotionSensor::Fitted(Condition::Stuck(true));
        assert_eq!(scenario.tags[0].motion, Motion { carrier: Carrier::Trolley, vibration_mg: 60.0, sensor });
        // At 1 m/s from 5 s on.
        assert!(distance(scenario.tags[0].walk.at(7.0), [2.0, 0.0, 1.0]) < 1e-9);
        assert_eq!(scenario.tags[1].motion, Motion::default());
        let of = |tag: usize| scenario.tags[tag].motion.sensor;
        assert_eq!(of(0).on(&BoardProfile::DWM1001), Some(Condition::Stuck(true)));
        assert_eq!(of(1).on(&BoardProfile::DWM1001.slowed(2.0)), Some(Condition::Works));
        assert_eq!(of(1).on(&BoardProfile::ESP32C3), None);
    }

    #[test]
    fn a_table_stands_for_many_tags() {
        let tags = |keys: &str| {
            let text = format!("{LEAST}[[node]]\nrole = \"tag\"\nrate_hz = 1\n{keys}[[node]]\nrole = \"tag\"\n");
            Scenario::parse(&text).unwrap().tags
        };
        let addresses = |tags: &[Tag]| tags.iter().map(|tag| tag.address).collect::<Vec<_>>();
        let many = tags("simulation = { count = 3 }\n");
        assert_eq!(addresses(&many), [0x1001, 0x1002, 0x1003, 0x1004, 0x1005]);
        let rates: Vec<_> = many.iter().map(|tag| tag.settings.record.rate_chz).collect();
        assert_eq!(rates, [None, Some(100), Some(100), Some(100), None]);
        let hall = Scenario::parse(include_str!("../../../examples/hall.toml")).unwrap();
        assert_eq!((hall.anchors.len(), hall.tags.len()), (16, 250));
        assert!(distance(hall.tags[0].walk.at(0.0), hall.tags[1].walk.at(0.0)) > 0.1, "each walks its own way");
        let named = tags("name = \"cart\"\naddress = 0x100\nsimulation = { count = 2 }\n");
        assert_eq!(addresses(&named), [0x1001, 0x100, 0x101, 0x1004]);
        for (keys, message) in [
            ("simulation = { count = 0 }", "count is 0: it must be from 1 to 4096"),
            ("simulation = { count = 5000 }", "count is 5000: it must be from 1 to 4096"),
            ("address = 0x1001\nsimulation = { count = 2 }", "0x1001"),
        ] {
            let found = error(&format!("{LEAST}[[node]]\nrole = \"tag\"\n{keys}\n"));
            assert!(found.message.contains(message), "{keys}: {found}");
        }
        let found = error("[[node]]\nrole = \"anchor\"\nposition_m = [0, 0, 2]\nsimulation = { count = 2 }\n");
        assert!(found.message.contains("count is a key of a node whose role is tag"), "{found}");
    }

    #[test]
    fn tags_differ_in_what_their_records_say() {
        let text = format!(
            "{LEAST}height_m = 1.0\nsolver = \"b-wls\"\n[[node]]\nrole = \"tag\"\nscheme = \"double-sided\"\nrate_hz = 2.5\n"
        );
        let scenario = Scenario::parse(&text).unwrap();
        let [first, second] = [0, 1].map(|tag: usize| scenario.tag_record(&scenario.tags[tag]).role);
        let (Role::Tag(first), Role::Tag(second)) = (first, second) else { panic!("tags") };
        assert_eq!((first.height_m, first.solver, first.rate_chz), (Some(1.0), Solver::BWls, None));
        assert_eq!(
            (second.solver, second.scheme, second.rate_chz),
            (Solver::Track, Some(Scheme::DoubleSided), Some(250))
        );
        assert_eq!(scenario.height_m(), None);
    }

    #[test]
    fn a_network_to_listen_to() {
        let mode = |more: &str| {
            Scenario::parse(&format!("{LEAST}[network]\nmode = \"listening\"\n{more}")).unwrap().networks[0].mode
        };
        assert_eq!(mode(""), Mode::Listening { rounds_chz: 1000 });
        assert_eq!(mode("rounds_hz = 6.25\n"), Mode::Listening { rounds_chz: 625 });
    }

    #[test]
    fn beacons_and_their_air_are_read() {
        let text = "[[node]]\nrole = \"beacon\"\nposition_m = [1, 2, 3]\n\
            [[node]]\nrole = \"beacon\"\nposition_m = [4, 5, 6]\nminor = 9\nmeasured_power_dbm = -40\nchannels = [37, 39]\n\
            simulation = { rssi_1m_dbm = -40.4 }\n\
            [[node]]\nrole = \"beacon\"\nposition_m = [7, 8, 9]\nsimulation = { listed = false }\n\
            [[node]]\nrole = \"tag\"\nscan_interval_ms = 1000\nscan_window_ms = 100\n\
            [[beacon]]\nmajor = 1\nminor = 9\nposition_m = [0, 0, 0]\n\
            [[beacon]]\nmajor = 7\nminor = 1\nposition_m = [1, 1, 1]\nrssi_1m_dbm = -62.5\npath_loss_exponent = 2.5\n\
            [simulation.bluetooth]\nshadowing_db = 4\n";
        let scenario = Scenario::parse(text).unwrap();
        assert_eq!((scenario.bluetooth.medium.shadowing_db, scenario.bluetooth.medium.exponent), (4.0, 2.0));
        let [first, second, third, listed] = &scenario.beacons[..] else { panic!("{:?}", scenario.beacons) };
        assert_eq!((first.address, first.name(), first.advertiser.channels), (0x2001, "1-1".to_owned(), 0b111));
        assert_eq!((second.name(), second.advertiser.channels), ("1-9".to_owned(), 0b101));
        assert_eq!((second.at, second.rssi_1m_dbm), ([4.0, 5.0, 6.0], -40.4));
        // As a calibration would find, where the file does not say it.
        let told = second.listed.unwrap();
        assert_eq!((told.position_m, told.rssi_1m_dbm, told.path_loss_exponent), ([0.0; 3], Some(-40.4), Some(2.0)));
        assert_eq!(third.listed, None);
        // A beacon of another maker stands where it is listed.
        assert_eq!((listed.name(), listed.at, listed.rssi_1m_dbm), ("7-1".to_owned(), [1.0; 3], -62.5));
        assert_eq!(listed.listed.unwrap().path_loss_exponent, Some(2.5));
        assert_eq!(scenario.tag_record(&scenario.tags[0]).beacons.len(), 3);
    }

    #[test]
    fn listed_anchors_of_other_makers_are_simulated() {
        let text = format!("{LEAST}[[anchor]]\naddress = 0x77\nposition_m = [4, 0, 2]\n");
        let scenario = Scenario::parse(&text).unwrap();
        assert_eq!((scenario.anchors[1].address, scenario.anchors[1].at), (0x77, [4.0, 0.0, 2.0]));
        assert_eq!(scenario.tag_record(&scenario.tags[0]).anchors.len(), 1);
    }

    #[test]
    fn faults_happen_in_the_order_of_time_to_nodes_of_a_name_or_an_address() {
        let faults = "[[simulation.fault]]\nat_s = 5\nnode = 1\nwhat = \"on\"\n\
                      [[simulation.fault]]\nat_s = 2\nnode = \"anchor-1\"\nwhat = \"off\"\n";
        let scenario = Scenario::parse(&format!("{LEAST}{faults}")).unwrap();
        assert_eq!(scenario.faults.iter().map(|f| (f.at_s, f.node)).collect::<Vec<_>>(), [(2.0, 1), (5.0, 1)]);
    }
}
