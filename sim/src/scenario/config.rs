//! The config records of a scenario's nodes: what `baliza provision` would write into the flash of such boards.

use baliza_dw1000::driver::DEFAULT_ANTENNA_DELAY;
use ranging::PhyConfig;
use ranging::native::Scheme;
use wire::config::{Calibration, Identity, Invalid, MAX_ANCHORS, Mode, Network, Phy, Record, Region, Role, Solver};

use super::beacon::listed;
use super::{Anchor, Beacon, Fidelity, Scenario, Tag};

/// The network of a scenario that does not define one. Simulated frames stay in the simulation, so no radio regulations
/// apply.
pub const NETWORK: Network = Network {
    pan: 0xBA12,
    mode: Mode::Native,
    phy: Phy { channel: 5, prf_mhz: 64, rate_kbps: 6810, preamble: 128, code: None },
    turnaround: None,
    region: Some(Region::Unchecked),
};

/// Tags listen to anchors that range among each other once in each superframe, ten times a second.
pub const LISTENING: Mode = Mode::Listening { rounds_chz: 1000 };

/// The EUI-64 in the chip of the node with this short address. A record without an identity takes both from the chip.
pub(super) fn eui(address: u16) -> u64 {
    0xDECA_0000_0000_0000 | u64::from(address)
}

/// Rounds per second in the unit of config records: rounds in 100 s.
pub(super) fn centihertz(hz: f64) -> u32 {
    (100.0 * hz).round() as u32
}

impl Scenario {
    /// The config record of a tag. Native anchors report their positions; a DecaRanging tag must have them in its
    /// record.
    pub fn tag_record(&self, tag: &Tag) -> Record {
        let network = self.network(tag.network);
        let still_rate_chz = match network.mode {
            Mode::Native => self.tag.still_rate_hz.map(centihertz),
            Mode::DecaRanging { .. } | Mode::Listening { .. } => None,
        };
        let role = Role::Tag(wire::config::Tag {
            height_m: self.tag.height_m,
            rate_chz: self.tag.rate_hz.map(centihertz),
            still_rate_chz,
            sleep: self.tag.sleep,
            anchors_per_round: self.tag.anchors_per_round,
            tell_distances: false,
            scan: (!self.beacons.is_empty()).then_some(self.bluetooth.scan),
            report_ranges: true,
            solver: self.solver(network.mode),
            scheme: Some(match self.tag.scheme {
                Scheme::SingleSided => wire::config::Scheme::SingleSided,
                Scheme::DoubleSided => wire::config::Scheme::DoubleSided,
            }),
        });
        let anchors = match network.mode {
            Mode::Native | Mode::Listening { .. } => Default::default(),
            Mode::DecaRanging { .. } => {
                let own = self.anchors.iter().filter(|anchor| anchor.network == tag.network).take(MAX_ANCHORS);
                own.map(|anchor| wire::config::Anchor { address: anchor.address, position_m: self.position(anchor) })
                    .collect()
            }
        };
        let beacons = listed(&self.beacons).collect();
        Record { anchors, beacons, ..self.record(network, role) }
    }

    /// The config record of an anchor.
    pub fn anchor_record(&self, anchor: &Anchor) -> Record {
        self.record(self.network(anchor.network), Role::Anchor { position_m: Some(self.position(anchor)) })
    }

    /// The config record of a beacon. Its UWB settings are not used.
    pub(super) fn beacon_record(beacon: &Beacon) -> Record {
        record(NETWORK, Role::Advertiser(beacon.advertiser), None)
    }

    /// Checks that every node can follow its record.
    ///
    /// # Errors
    /// Returns the address of the first node that cannot, and the reason.
    pub fn validate(&self) -> Result<(), (u16, Invalid)> {
        let anchors = self.anchors.iter().map(|anchor| (anchor.address, self.anchor_record(anchor)));
        let tags = self.tags.iter().map(|tag| (tag.address, self.tag_record(tag)));
        let mut all = anchors.chain(tags);
        all.try_for_each(|(address, record)| record.validate().map_err(|invalid| (address, invalid)))
    }

    /// The solver in the records of tags in this network: the scenario's method, if nodes have it.
    fn solver(&self, mode: Mode) -> Solver {
        match (mode, self.tag.method) {
            (Mode::Listening { .. }, _) | (_, None) => Solver::Track,
            (Mode::Native | Mode::DecaRanging { .. }, Some(method)) => {
                Solver::from_name(method.as_str()).unwrap_or(Solver::Track)
            }
        }
    }

    /// An anchor's position as records have it.
    fn position(&self, anchor: &Anchor) -> [f32; 3] {
        self.surveyed_m(anchor).map(|metres| metres as f32)
    }

    fn network(&self, place: usize) -> Network {
        self.networks.get(place).copied().unwrap_or(NETWORK)
    }

    /// Simulated chips are calibrated: they have the default's antenna delay at every pulse frequency. A radio directly
    /// on the air has none.
    fn record(&self, network: Network, role: Role) -> Record {
        let antenna_delay = match self.fidelity {
            Fidelity::Spi => DEFAULT_ANTENNA_DELAY,
            Fidelity::Air => 0,
        };
        record(network, role, Some(antenna_delay))
    }
}

pub(super) fn record(network: Network, role: Role, antenna_delay: Option<u16>) -> Record {
    Record {
        identity: Identity::default(),
        role,
        network,
        calibration: Calibration { antenna_delay, ..Calibration::default() },
        pins: None,
        anchors: Default::default(),
        beacons: Default::default(),
        beacon_key: None,
    }
}

/// The PHY settings, as a config record has them.
pub(super) fn phy(config: &PhyConfig) -> Phy {
    Phy {
        channel: config.channel().number(),
        prf_mhz: config.prf().mhz(),
        rate_kbps: config.data_rate().kbps(),
        preamble: config.preamble_length().symbols(),
        code: Some(config.preamble_code()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_have_the_modes_of_the_evk1000() {
        for mode in 1..=8 {
            let config = PhyConfig::evk1000_mode(mode).unwrap();
            let network = Network { phy: phy(&config), ..NETWORK };
            assert_eq!(record(network, Role::Anchor { position_m: None }, None).phy(), Ok(config));
        }
    }

    #[test]
    fn a_rate_that_no_record_can_hold_is_found_out_with_its_node() {
        let mut scenario = Scenario::listening(4, 1);
        assert_eq!(scenario.validate(), Ok(()));
        // A radio's clock cannot distinguish instants that are more than 8.6 s apart.
        scenario.tag.rate_hz = Some(0.1);
        let (address, invalid) = scenario.validate().unwrap_err();
        assert_eq!((address, invalid.field), (0x1001, "tag.rate_hz"));
    }
}
