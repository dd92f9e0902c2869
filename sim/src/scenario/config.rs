//! The config records of a scenario's nodes: what `baliza provision` would write into the flash of such boards.

use baliza_dw1000::driver::DEFAULT_ANTENNA_DELAY;
use wire::config::{Calibration, Identity, Invalid, MAX_ANCHORS, MAX_BEACONS, Mode, Network, Record, Role, Solver};

use super::beacon::listed;
use super::{Anchor, Beacon, Fidelity, NETWORK, Scanner, Scenario, Tag};

/// The EUI-64 in the chip of the node with this short address. A record without an identity takes both from the chip.
pub(super) fn eui(address: u16) -> u64 {
    0xDECA_0000_0000_0000 | u64::from(address)
}

impl Scenario {
    /// The config record of a tag. Native anchors report their positions; a DecaRanging tag must have them in its
    /// record.
    pub fn tag_record(&self, tag: &Tag) -> Record {
        let network = self.network(tag.network);
        let network = Network { mode: if tag.blinks { Mode::Blink } else { network.mode }, ..network };
        let settings = tag.settings.record;
        let still_rate_chz = match network.mode {
            Mode::Native | Mode::Blink => settings.still_rate_chz,
            Mode::DecaRanging { .. } | Mode::Listening { .. } => None,
        };
        let solver = self.solver(tag, network.mode);
        let role = Role::Tag(wire::config::Tag { still_rate_chz, solver, ..settings });
        let told = self.listed_anchors.iter().copied().filter(|_| tag.network == 0);
        let is_told = |anchor: &&Anchor| told.clone().any(|listed| listed.address == anchor.address);
        let nodes: &[Anchor] = match network.mode {
            Mode::Native | Mode::Blink | Mode::Listening { .. } => &[],
            Mode::DecaRanging { .. } => &self.anchors,
        };
        let own = nodes.iter().filter(|anchor| anchor.network == tag.network && !is_told(anchor));
        let own = own.map(|anchor| wire::config::Anchor { address: anchor.address, position_m: self.position(anchor) });
        let anchors = told.clone().chain(own).take(MAX_ANCHORS).collect();
        let beacons = listed(&self.beacons).take(MAX_BEACONS).collect();
        Record { anchors, beacons, beacon_key: self.beacon_key, ..self.record(network, role) }
    }

    /// The config record of an anchor.
    pub fn anchor_record(&self, anchor: &Anchor) -> Record {
        self.record(self.network(anchor.network), Role::Anchor { position_m: Some(self.position(anchor)) })
    }

    /// The config record of a beacon. Its UWB settings are not used.
    pub(super) fn beacon_record(beacon: &Beacon, beacon_key: Option<[u8; 16]>) -> Record {
        Record { beacon_key, ..record(NETWORK, Role::Advertiser(beacon.advertiser), None) }
    }

    /// The config record of a scanner, which knows every beacon. Its UWB settings are not used.
    pub(super) fn scanner_record(&self, scanner: &Scanner) -> Record {
        let identity = Identity { address: Some(scanner.address), ..Identity::default() };
        let network = Network { key: None, ..self.network(0) };
        Record { identity, beacon_key: self.beacon_key, ..record(network, Role::Scanner, None) }
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

    /// The solver in the record of a tag in such a network: the scenario's method, if nodes have it.
    fn solver(&self, tag: &Tag, mode: Mode) -> Solver {
        match (mode, self.method) {
            (Mode::Listening { .. }, _) => Solver::Track,
            (Mode::Native | Mode::Blink | Mode::DecaRanging { .. }, None) => tag.settings.record.solver,
            (Mode::Native | Mode::Blink | Mode::DecaRanging { .. }, Some(method)) => {
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

fn record(network: Network, role: Role, antenna_delay: Option<u16>) -> Record {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_that_no_record_can_hold_is_found_out_with_its_node() {
        let mut scenario = Scenario::listening(4, 1);
        assert_eq!(scenario.validate(), Ok(()));
        // A radio's clock cannot distinguish instants that are more than 8.6 s apart.
        scenario.change_tags(|tag| tag.rate_chz = Some(10));
        let (address, invalid) = scenario.validate().unwrap_err();
        assert_eq!((address, invalid.field), (0x1001, "tag.rate_hz"));
    }
}
