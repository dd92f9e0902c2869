//! The records by which a scenario's nodes start: what `baliza provision` would write into the flash of such boards.

use ranging::RadioDuration;
use ranging::dw1000::DEFAULT_ANTENNA_DELAY;
use ranging::native::Scheme;
use wire::config::{Calibration, Identity, Invalid, MAX_ANCHORS, Phy, Record, Region, Role, Solver};
use wire::uwb::decaranging::Variant;

use super::beacon::listed;
use super::{Anchor, Beacon, Fidelity, Mode, Network, Scenario, Tag};

/// The chip's own EUI-64 of the node with this short address; a record without an identity has both from it.
pub(super) fn eui(address: u16) -> u64 {
    0xDECA_0000_0000_0000 | u64::from(address)
}

/// Rounds a second as records have them: in 100 s.
fn centihertz(hz: f64) -> u32 {
    (100.0 * hz).round() as u32
}

impl Scenario {
    /// The record of a tag. Native anchors report where they are; a DecaRanging tag has to be told.
    pub fn tag_record(&self, tag: &Tag) -> Record {
        let network = self.network(tag.network);
        let still_rate_chz = match network.mode {
            Mode::Native => self.tag.still_rate_hz.map(centihertz),
            Mode::DecaRanging(_) | Mode::Listening { .. } => None,
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
            solver: self.solver(&network),
            scheme: Some(match self.tag.scheme {
                Scheme::SingleSided => wire::config::Scheme::SingleSided,
                Scheme::DoubleSided => wire::config::Scheme::DoubleSided,
            }),
        });
        let anchors = match network.mode {
            Mode::Native | Mode::Listening { .. } => Default::default(),
            Mode::DecaRanging(_) => {
                let own = self.anchors.iter().filter(|anchor| anchor.network == tag.network).take(MAX_ANCHORS);
                own.map(|anchor| wire::config::Anchor { address: anchor.address, position_m: position(anchor) })
                    .collect()
            }
        };
        let beacons = listed(&self.beacons).collect();
        Record { anchors, beacons, ..self.record(&network, role) }
    }

    /// The record of an anchor.
    pub fn anchor_record(&self, anchor: &Anchor) -> Record {
        self.record(&self.network(anchor.network), Role::Anchor { position_m: Some(position(anchor)) })
    }

    /// The record of a beacon; what it says of UWB is for others.
    pub(super) fn beacon_record(beacon: &Beacon) -> Record {
        record(&Network::default(), Role::Advertiser(beacon.advertiser), None)
    }

    /// Checks that every node can do what its record says.
    ///
    /// # Errors
    /// The address of the first node that cannot, and why.
    pub fn validate(&self) -> Result<(), (u16, Invalid)> {
        let anchors = self.anchors.iter().map(|anchor| (anchor.address, self.anchor_record(anchor)));
        let tags = self.tags.iter().map(|tag| (tag.address, self.tag_record(tag)));
        let mut all = anchors.chain(tags);
        all.try_for_each(|(address, record)| record.validate().map_err(|invalid| (address, invalid)))
    }

    /// What the records of tags in this network name as solver: the scenario's method, where nodes have it.
    pub(super) fn solver(&self, network: &Network) -> Solver {
        match (network.mode, self.tag.method) {
            (Mode::Listening { .. }, _) | (_, None) => Solver::Track,
            (Mode::Native | Mode::DecaRanging(_), Some(method)) => {
                Solver::from_name(method.as_str()).unwrap_or(Solver::Track)
            }
        }
    }

    pub(super) fn network(&self, place: usize) -> Network {
        self.networks.get(place).copied().unwrap_or_default()
    }

    /// Simulated chips are calibrated: they have the default's delay at every pulse frequency, and a radio straight on the air has none.
    fn record(&self, network: &Network, role: Role) -> Record {
        let antenna_delay = match self.level {
            Fidelity::Spi => DEFAULT_ANTENNA_DELAY,
            Fidelity::Air => 0,
        };
        record(network, role, Some(antenna_delay))
    }
}

fn record(network: &Network, role: Role, antenna_delay: Option<u16>) -> Record {
    Record {
        identity: Identity::default(),
        role,
        network: network.into(),
        calibration: Calibration { antenna_delay, ..Calibration::default() },
        pins: None,
        anchors: Default::default(),
        beacons: Default::default(),
        beacon_key: None,
    }
}

fn position(anchor: &Anchor) -> [f32; 3] {
    anchor.at.map(|metres| metres as f32)
}

impl From<&Network> for wire::config::Network {
    fn from(network: &Network) -> Self {
        let phy = network.phy;
        let micros = |duration: RadioDuration| {
            // `from_micros` rounds down.
            let micros = duration.as_micros();
            let exact = RadioDuration::from_micros(micros as u32) == duration;
            u16::try_from(micros + i64::from(!exact)).unwrap_or(u16::MAX)
        };
        Self {
            pan: network.pan,
            mode: match network.mode {
                Mode::Native => wire::config::Mode::Native,
                Mode::DecaRanging(variant) => wire::config::Mode::DecaRanging { fast: variant == Variant::Fast },
                Mode::Listening { period } => {
                    wire::config::Mode::Listening { rounds_chz: centihertz(1e6 / period.as_micros() as f64) }
                }
            },
            phy: Phy {
                channel: phy.channel().number(),
                prf_mhz: phy.prf().mhz(),
                rate_kbps: phy.data_rate().kbps(),
                preamble: phy.preamble_length().symbols(),
                code: Some(phy.preamble_code()),
            },
            turnaround: network.pinned.map(|pinned| wire::config::ReplyDelay {
                answer_us: micros(pinned.answer),
                listen_again_us: micros(pinned.listen_again),
                transmit_us: micros(pinned.transmit),
            }),
            // Simulated frames leave no room, and nobody's rules space them.
            region: Some(Region::Unchecked),
        }
    }
}

#[cfg(test)]
mod tests {
    use ranging::PhyConfig;
    use ranging::native::ReplyDelay;

    use super::*;

    #[test]
    fn the_record_has_the_network_as_the_scenario_has_it() {
        let scenario = Scenario::rooms(200, 1000);
        let modes = (1..=8).filter_map(PhyConfig::evk1000_mode).map(|phy| Network { phy, ..Network::default() });
        for network in scenario.networks.iter().copied().chain(modes) {
            let network = Network { pinned: Some(ReplyDelay::START), ..network };
            let record = scenario.record(&network, Role::Anchor { position_m: None });
            let of_record = ranging::native::Network::try_from(&record).unwrap();
            assert_eq!((of_record.pan, of_record.phy, of_record.pinned), (network.pan, network.phy, network.pinned));
        }
    }

    #[test]
    fn a_rate_that_no_record_can_hold_is_found_out_with_its_node() {
        let mut scenario = Scenario::listening(4, 1);
        assert_eq!(scenario.validate(), Ok(()));
        // A radio's clock cannot tell instants apart that lie farther from each other than 8.6 s.
        scenario.tag.rate_hz = Some(0.1);
        let (address, invalid) = scenario.validate().unwrap_err();
        assert_eq!((address, invalid.field), (0x1001, "tag.rate_hz"));
    }
}
