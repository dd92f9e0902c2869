//! Random numbers: one stream per purpose, so that one more draw for one purpose changes nothing elsewhere.
//!
//! The simulation's seed, the purpose and an index (a node, a pair of nodes, a position) determine a stream. Equal
//! seeds give equal streams on every machine.

use rand::{Rng, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_pcg::Pcg64Mcg;

/// A normally distributed number with mean 0 and standard deviation 1.
pub fn gauss(random: &mut (impl Rng + ?Sized)) -> f64 {
    StandardNormal.sample(random)
}

/// The generator behind every stream.
pub type Stream = Pcg64Mcg;

/// The purpose of a stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// The random walk of a node's oscillator.
    Oscillator = 1,
    /// The effects of a node's receiver: noise on time stamps, losses, errors.
    Receiver = 2,
    /// Walls, reflections and blocked paths between two positions.
    Channel = 3,
    /// The fixed properties of a chip: identity, the counter's value at power-up.
    Birth = 4,
    /// Noise in one accumulator.
    Accumulator = 5,
    /// For applications and scenarios.
    Scenario = 6,
    /// The times of a beacon's advertisements.
    Advertiser = 7,
    /// The effects of a Bluetooth scanner: noise on RSSI values, losses.
    Scanner = 8,
    /// RSSI of a beacon by position.
    Shadowing = 9,
    /// The times of the interrupts of Bluetooth or Wi-Fi.
    Interrupts = 10,
    /// The effects of a motion sensor: its orientation, noise.
    MotionSensor = 11,
    /// Errors of ranges that stay with a link, a bearing or a node.
    Lasting = 12,
    /// The error of a node's surveyed position.
    Survey = 13,
    /// What a node draws at its start, for frames with a key.
    Keys = 14,
    /// What an attacker does.
    Attacker = 15,
}

/// The stream of `purpose` number `index` in the simulation seeded with `seed`.
pub fn stream(seed: u64, purpose: Purpose, index: u64) -> Stream {
    Pcg64Mcg::seed_from_u64(mix(mix(seed ^ mix(purpose as u64)) ^ index))
}

/// A well-mixed function of 64 bits (the finaliser of SplitMix64; Steele, Lea and Flood 2014).
pub(crate) fn mix(x: u64) -> u64 {
    let mut z = x.wrapping_add(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::RngCore;

    #[test]
    fn split_mix_gives_the_published_sequence() {
        // Reference output of splitmix64.c (Vigna) for the seed 1234567: the states are 1234567 + k · 0x9E37…7C15.
        assert_eq!(mix(1_234_567), 6_457_827_717_110_365_317);
        assert_eq!(mix(1_234_567u64.wrapping_add(0x9E37_79B9_7F4A_7C15)), 3_203_168_211_198_807_973);
    }

    #[test]
    fn streams_differ_by_purpose_and_index_and_repeat_by_seed() {
        let first = |seed, purpose, index| stream(seed, purpose, index).next_u64();
        assert_eq!(first(1, Purpose::Channel, 5), first(1, Purpose::Channel, 5));
        assert_ne!(first(1, Purpose::Channel, 5), first(1, Purpose::Channel, 6));
        assert_ne!(first(1, Purpose::Channel, 5), first(1, Purpose::Receiver, 5));
        assert_ne!(first(1, Purpose::Channel, 5), first(2, Purpose::Channel, 5));
    }
}
