//! What regions allow: the channels on which a node may transmit. `docs/use/regulation.md` has the rules with their
//! sources.

use crate::config::validate::{ensure, integer};
use crate::config::{Invalid, Mode, Record, Region, Role};

impl Record {
    /// Whether the node ever transmits on UWB: beacons and scanners use Bluetooth, and some tags only listen.
    pub fn transmits(&self) -> bool {
        match (&self.role, self.network.mode) {
            (Role::Advertiser(_) | Role::Scanner, _) | (Role::Tag(_), Mode::Listening { rounds_chz: _ }) => false,
            (Role::Tag(_), Mode::Native | Mode::Blink | Mode::DecaRanging { fast: _ })
            | (Role::Anchor { position_m: _ }, _) => true,
        }
    }

    /// Checks whether the node may transmit on its channel. Properties that a config record cannot contain, such as the
    /// power at the antenna, are not checked.
    ///
    /// # Errors
    /// If the region forbids the channel.
    pub fn validate_region(&self) -> Result<(), Invalid> {
        let (lawful, must) = match self.network.region {
            None | Some(Region::Us | Region::Unchecked) => return Ok(()),
            // An anchor's duty cycle grows with the number of tags in range, and no protocol keeps an account of it
            // over an hour.
            Some(Region::Eu) => (
                matches!(self.network.phy.channel, 5 | 7),
                "5 or 7 in region \"eu\": on 1 to 4, nodes must keep to 5 % of a second and 0.5 % of an hour, and no mode does",
            ),
            Some(Region::Japan) => (
                false,
                "one that region \"japan\" permits: from 7.25 GHz up, or below 4.8 GHz with DAA; a DW1000 has neither",
            ),
            Some(Region::China) => {
                (false, "one that region \"china\" permits: 7.163 to 8.812 GHz; a DW1000 has none above 7.03 GHz")
            }
        };
        ensure(lawful || !self.transmits(), "network.phy.channel", integer(self.network.phy.channel), must)
    }
}
