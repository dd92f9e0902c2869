//! The RSSI of an advertisement at a receiver: `RSSI = RSSI₁ − 10 n lg d − Σ aᵢ + shadowing + fading + noise`, dBm (A.
//! Linde, *Desarrollo de un sistema de posicionamiento en interiores mediante Bluetooth Low Energy*, 2024, equations 1
//! and 2).
//!
//! Shadowing is a field of the position and is the same on all channels. Fading (multipath) is another field for each
//! channel and changes within centimetres. A tag that does not move therefore has a different, constant RSSI on each
//! channel. Noise is drawn for each reception.

use super::field::Field;
use crate::air::Wall;
use crate::random::{Purpose, Stream, gauss, stream};

/// The model's minimum distance of a tag from a beacon, metres.
const NEAREST_M: f64 = 0.1;
/// The correlation length of the fading, metres: at this distance the correlation is 1/e. The wavelength is 0.12 m.
const FADING_M: f64 = 0.06;

/// An advertising channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Channel {
    /// 2402 MHz.
    Ch37,
    /// 2426 MHz.
    Ch38,
    /// 2480 MHz.
    Ch39,
}

impl Channel {
    /// All channels in the order in which an event uses them.
    pub const ALL: [Self; 3] = [Self::Ch37, Self::Ch38, Self::Ch39];

    /// The standard deviation of the RSSI on this channel while nothing moves, dB (Linde, table 3.1).
    pub fn noise_db(self) -> f64 {
        match self {
            Self::Ch37 => 1.61,
            Self::Ch38 => 1.87,
            Self::Ch39 => 2.27,
        }
    }
}

/// The propagation of advertisements between beacons and tags.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Medium {
    /// The exponent n of the path loss.
    pub exponent: f64,
    /// Standard deviation of the shadowing, dB.
    pub shadowing_db: f64,
    /// Correlation length of the shadowing, metres: at this distance the correlation is 1/e.
    pub shadowing_m: f64,
    /// Standard deviation of the fading of each channel, dB.
    pub fading_db: f64,
}

impl Default for Medium {
    /// Indoors. The fading is what remains of the deviations in table 3.1: all channels together deviate by 4.41 dB,
    /// each channel by 1.61, 1.87, 2.27 dB, and √(4.41² − (1.61² + 1.87² + 2.27²) ⁄ 3) = 3.96.
    fn default() -> Self {
        Self { exponent: 2.0, shadowing_db: 3.0, shadowing_m: 2.0, fading_db: 3.96 }
    }
}

/// The path from one beacon to any position of a tag.
#[derive(Clone, Debug)]
pub(super) struct Link {
    medium: Medium,
    shadowing: Field,
    fading: [Field; 3],
}

impl Link {
    /// Draws the fields of the beacon with this number.
    pub(super) fn draw(medium: Medium, seed: u64, beacon: u64) -> Self {
        let draws = &mut stream(seed, Purpose::Shadowing, beacon);
        Self {
            medium,
            shadowing: Field::draw(medium.shadowing_db, medium.shadowing_m, draws),
            fading: std::array::from_fn(|_| Field::draw(medium.fading_db, FADING_M, draws)),
        }
    }

    /// The RSSI on a channel without noise, dBm.
    pub(super) fn rssi_dbm(
        &self,
        walls: &[Wall],
        (from, rssi_1m_dbm): ([f64; 3], f64),
        to: [f64; 3],
        channel: Channel,
    ) -> f64 {
        let distance_m = crate::scenario::distance(from, to).max(NEAREST_M);
        let in_between: f64 =
            walls.iter().filter(|wall| wall.crosses(from, to)).map(|wall| wall.material.attenuation_db).sum();
        let [fading_37, fading_38, fading_39] = &self.fading;
        let fading = match channel {
            Channel::Ch37 => fading_37,
            Channel::Ch38 => fading_38,
            Channel::Ch39 => fading_39,
        };
        rssi_1m_dbm - 10.0 * self.medium.exponent * distance_m.log10() - in_between
            + self.shadowing.at(to)
            + fading.at(to)
    }
}

/// Noise of one reception, dB.
pub(super) fn noise_db(channel: Channel, draws: &mut Stream) -> f64 {
    channel.noise_db() * gauss(draws)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::air::Material;

    const BARE: Medium = Medium { exponent: 2.0, shadowing_db: 0.0, shadowing_m: 2.0, fading_db: 0.0 };

    #[test]
    fn the_level_falls_with_distance_and_walls() {
        let link = Link::draw(BARE, 1, 0);
        let rssi = |walls: &[Wall], to| link.rssi_dbm(walls, ([0.0; 3], -59.0), to, Channel::Ch38);
        assert!((rssi(&[], [1.0, 0.0, 0.0]) + 59.0).abs() < 1e-9);
        // 10 · 2 · lg 10 = 20 dB. A brick wall is 9 dB, a drywall 3 dB, and a wall beside the path counts nothing.
        let wall = |x: f64, material| Wall { from: [x, -1.0], to: [x, 1.0], material };
        let walls = [wall(2.0, Material::BRICK), wall(3.0, Material::DRYWALL), wall(11.0, Material::METAL)];
        assert!((rssi(&walls, [6.0, 0.0, 8.0]) + 59.0 + 20.0 + 12.0).abs() < 1e-9);
        assert!((rssi(&[], [0.0; 3]) + 59.0 - 20.0).abs() < 1e-9, "at 0.1 m");
    }

    #[test]
    fn a_tag_that_stands_sees_what_the_table_has() {
        // The RSSI values of each channel at one position deviate as in table 3.1. Over many positions, the values of
        // all channels together deviate by 4.41 dB.
        let mut draws = stream(3, Purpose::Scanner, 0);
        let mut all = Vec::new();
        for beacon in 0..600 {
            let link = Link::draw(Medium { fading_db: Medium::default().fading_db, ..BARE }, 3, beacon);
            for channel in Channel::ALL {
                let rssi = link.rssi_dbm(&[], ([0.0; 3], -59.0), [1.0, 0.0, 0.0], channel);
                all.extend((0..10).map(|_| rssi + noise_db(channel, &mut draws)));
            }
        }
        let mean = all.iter().sum::<f64>() / all.len() as f64;
        let sigma = (all.iter().map(|rssi| (rssi - mean).powi(2)).sum::<f64>() / all.len() as f64).sqrt();
        // 1800 independent draws of fading: 4.41 ⁄ √3600 = 0.07 (1σ).
        assert!((sigma - 4.41).abs() < 0.25, "{sigma} dB");
    }
}
