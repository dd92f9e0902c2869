//! How a scenario's air treats ranges, and the surveyed positions of its anchors.

use super::{AirModel, Anchor, Carrier, Scenario, Tag};
use crate::AirConfig;
use crate::random::{Purpose, gauss, stream};

/// Standard deviation of a surveyed coordinate, metres: an assumption, for tape and laser. In recordings it cannot be
/// told from the anchors' antenna delays.
const SURVEY_M: f64 = 0.02;

impl Scenario {
    /// The air's configuration.
    pub fn air_config(&self) -> AirConfig {
        let air = match self.air {
            AirModel::Recorded => AirConfig::recorded(),
            AirModel::Ideal => AirConfig::default(),
        };
        AirConfig { loss: self.loss, walls: self.walls.clone(), ..air }
    }

    /// The position of an anchor according to its survey, metres: what its config record has, and a recording. It is in
    /// whole millimetres, as anchors report it.
    pub fn surveyed_m(&self, anchor: &Anchor) -> [f64; 3] {
        let surveyed_m = match self.air {
            AirModel::Ideal => anchor.at,
            AirModel::Recorded => {
                let mut draws = stream(self.seed, Purpose::Survey, anchor.address.into());
                anchor.at.map(|metres| metres + SURVEY_M * gauss(&mut draws))
            }
        };
        surveyed_m.map(|metres| (metres * 1e3).round() / 1e3)
    }
}

impl Tag {
    /// Whether a person carries it, whose body shadows links.
    pub fn is_worn(&self) -> bool {
        self.motion.carrier == Carrier::Person && self.walk.place().is_none()
    }

    /// Whether its polls carry its last position.
    pub(super) fn tells_position(&self) -> bool {
        self.settings.record.tells.has_position()
    }
}
