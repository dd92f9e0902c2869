//! The least error of a position (Cramér–Rao bound) from RSSI values or ranges with independent Gaussian noise.
//!
//! A station at the distance d in the direction u adds u uᵀ ⁄ s² to the information. s is the deviation of a range,
//! or of a distance computed from an RSSI: d σ ln 10 ⁄ (10 n). Close to a beacon that is too little: the tag is
//! within d of the beacon, whatever the direction, so that an RSSI also gives 1 ⁄ d² across u. The prior knowledge
//! that the tag is within the area is information too. Without it, positions that receive one station would have no
//! finite error to compare.

use positioning_core::ble::path_loss::{PathLoss, Wall};

/// Nearer than this an RSSI gives no more information, because path loss fails there, metres.
const NEAREST_M: f64 = 0.5;

/// Information of two coordinates, xx, xy, yy, 1 ⁄ m².
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Information([f64; 3]);

/// What stations measure.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Noise {
    /// RSSI values of beacons.
    Level {
        /// Weaker beacons are not received, dBm.
        sensitivity_dbm: f64,
    },
    /// Ranges to anchors.
    Range {
        /// Deviation in line of sight, metres.
        deviation_m: f64,
        /// Each wall between adds this to the deviation, metres, because the excess of a blocked range is unknown.
        wall_m: f64,
        /// Farther anchors are not received, metres.
        reach_m: f64,
    },
}

/// A station: a beacon or an anchor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Station {
    /// Its position, metres.
    pub at_m: [f64; 2],
    /// Its path loss.
    pub path_loss: PathLoss<f64>,
}

impl Station {
    /// Its information on a tag at a position; `None` where the tag does not receive it.
    pub fn information(&self, tag_m: [f64; 2], walls: &[Wall<f64>], noise: Noise) -> Option<Information> {
        let away: [f64; 2] = std::array::from_fn(|axis| tag_m[axis] - self.at_m[axis]);
        let distance = away[0].hypot(away[1]);
        let (along, across) = match noise {
            Noise::Level { sensitivity_dbm } => {
                if self.rssi(tag_m, walls) < sensitivity_dbm {
                    return None;
                }
                let near = distance.max(NEAREST_M);
                ((near * self.path_loss.relative_deviation()).powi(-2), near.powi(-2))
            }
            Noise::Range { deviation_m, wall_m, reach_m } => {
                if distance > reach_m {
                    return None;
                }
                let between = walls.iter().filter(|wall| wall.is_crossed(self.at_m, tag_m)).count() as f64;
                (deviation_m.hypot(wall_m * between).powi(-2), 0.0)
            }
        };
        let [x, y] = if distance > 0.0 { away.map(|axis| axis / distance) } else { [1.0, 0.0] };
        Some(Information([along * x * x + across * y * y, (along - across) * x * y, along * y * y + across * x * x]))
    }

    /// Its RSSI at a position, dBm.
    pub fn rssi(&self, tag_m: [f64; 2], walls: &[Wall<f64>]) -> f64 {
        let distance = (tag_m[0] - self.at_m[0]).hypot(tag_m[1] - self.at_m[1]);
        let attenuation = positioning_core::ble::path_loss::attenuation(walls, self.at_m, tag_m);
        self.path_loss.level_through(distance, attenuation)
    }
}

impl Information {
    /// The information that a tag is within a rectangle of those sides, metres: the variances of a uniform
    /// distribution.
    pub fn of_area(sides_m: [f64; 2]) -> Self {
        let [x, y] = sides_m.map(|side| 12.0 / (side * side).max(1e-6));
        Self([x, 0.0, y])
    }

    /// The sum of both.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self(std::array::from_fn(|index| self.0[index] + other.0[index]))
    }

    /// The least root mean square error, metres: √ trace of the inverse.
    pub fn error_m(self) -> f64 {
        let [xx, xy, yy] = self.0;
        ((xx + yy) / (xx * yy - xy * xy)).sqrt()
    }

    /// Magnification of the error of ranges with a deviation of one metre (horizontal dilution of precision).
    pub fn dilution(self, deviation_m: f64) -> f64 {
        self.error_m() / deviation_m
    }
}

#[cfg(test)]
mod tests {
    use positioning_core::ble::path_loss::{PathLoss, Wall};

    use super::{Information, Noise, Station};

    fn station(at_m: [f64; 2]) -> Station {
        Station { at_m, path_loss: PathLoss { level_1m: -60.0, exponent: 2.0, deviation: 4.0 } }
    }

    const RANGE: Noise = Noise::Range { deviation_m: 0.1, wall_m: 0.3, reach_m: 20.0 };

    fn together(stations: &[Station], tag_m: [f64; 2], walls: &[Wall<f64>], noise: Noise) -> Information {
        let told = stations.iter().filter_map(|station| station.information(tag_m, walls, noise));
        told.fold(Information::default(), Information::and)
    }

    #[test]
    fn ranges_from_the_corners_of_a_square_have_the_textbooks_dilution() {
        // From the middle of a square the information is 4 · ½ ⁄ σ² in both directions: HDOP = √(2 · ½) = 1.
        let corners = [[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]].map(station);
        let information = together(&corners, [5.0, 5.0], &[], RANGE);
        assert!((information.dilution(0.1) - 1.0).abs() < 1e-9 && (information.error_m() - 0.1).abs() < 1e-9);
        // Three anchors at 120°: 3 · ½: HDOP = √(2 · ⅔) = 1.154701.
        let ring = [0.0_f64, 120.0, 240.0]
            .map(|degrees| degrees.to_radians().sin_cos())
            .map(|(y, x)| station([4.0 * x, 4.0 * y]));
        assert!((together(&ring, [0.0; 2], &[], RANGE).dilution(0.1) - 1.154_701).abs() < 1e-6);
        // Behind one wall σ is √(0.1² + 0.3²) = 0.316228.
        let wall = Wall { ends: [[4.0, -9.0], [4.0, 9.0]], attenuation: 5.0 };
        let pair = [station([0.0, 0.0]), station([5.0, 5.0])];
        let [blocked, clear] = [&[wall][..], &[]].map(|walls| together(&pair, [5.0, 0.0], walls, RANGE).error_m());
        assert!((blocked - 0.316_228_f64.hypot(0.1)).abs() < 1e-6 && (clear - 0.1_f64.hypot(0.1)).abs() < 1e-9);
        assert!(station([0.0; 2]).information([21.0, 0.0], &[], RANGE).is_none());
    }

    #[test]
    fn a_levels_error_grows_with_the_distance_and_ends_where_nothing_is_heard() {
        // σ ln 10 ⁄ (10 n) = 4 · 2.302585 ⁄ 20 = 0.460517: at 5 m ±2.302585 m along one axis and ±5 m along the other,
        // from two sides: 0.188611 + 0.04 = 0.228611 along both, √(2 ⁄ 0.228611) = 2.957783.
        let noise = Noise::Level { sensitivity_dbm: -80.0 };
        let pair = [station([0.0, 5.0]), station([5.0, 0.0])];
        let error = together(&pair, [5.0, 5.0], &[], noise).error_m();
        assert!((error - 2.957_783).abs() < 1e-5, "{error}");
        // −60 − 20 log₁₀ 10 = −80 is received at 10 m, but not beyond, nor through a wall.
        assert!(pair[0].information([10.0, 5.0], &[], noise).is_some());
        assert!(pair[0].information([10.1, 5.0], &[], noise).is_none());
        let wall = Wall { ends: [[4.0, 0.0], [4.0, 9.0]], attenuation: 3.0 };
        assert!(pair[0].information([9.0, 5.0], &[wall], noise).is_none());
    }

    #[test]
    fn without_stations_the_error_is_that_of_the_area() {
        // √(12²/12 + 6²/12) = √15.
        assert!((Information::of_area([12.0, 6.0]).error_m() - 15.0_f64.sqrt()).abs() < 1e-9);
    }
}
