//! FusionSettings of the fusion.

use positioning_core::{Area, Real};

/// Which values are used.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sources {
    /// Powers alone.
    Power,
    /// Delays alone.
    Delay,
    /// Both.
    Both,
}

/// Errors of received powers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PowerErrors<T> {
    /// Deviation of a single value about its mean at a position, before it is estimated from values, dB.
    pub noise: T,
    /// Deviation of the bias: the error of the channel's parameters and the shadowing at the position, dB.
    pub bias: T,
    /// Distance after which the bias is independent, metres.
    pub way: T,
    /// Time after which the bias is independent, seconds.
    pub time: T,
}

/// Errors of delays.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DelayErrors<T> {
    /// Deviation of a single value, before it is estimated from values, metres.
    pub noise: T,
    /// Deviation of the link's error after the affine model, metres.
    pub bias: T,
    /// Share of links without line of sight, before it is estimated from a link's values, 0 to 1.
    pub blocked: T,
    /// Mean of the positive bias of such a link, metres.
    pub excess: T,
    /// Deviation of it, metres.
    pub spread: T,
    /// Distance after which the bias of a blocked link is independent, metres.
    pub way: T,
    /// Time after which it is independent, seconds.
    pub time: T,
    /// Mean time that a link stays blocked, or direct, seconds.
    pub lasting: T,
    /// Time over which each link's own share of blocked time is averaged, seconds.
    pub learning: T,
}

/// FusionSettings of the fusion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FusionSettings<T> {
    /// Which values are used.
    pub sources: Sources,
    /// The tag's height where only x and y are estimated, metres.
    pub height: T,
    /// Where the tag can be.
    pub area: Option<Area<T, 3>>,
    /// Errors of powers.
    pub power: PowerErrors<T>,
    /// Errors of delays.
    pub delay: DelayErrors<T>,
    /// Greatest distance from which a node is received, metres.
    pub reach: T,
    /// Root of the density of the tag's acceleration, m/s² in √Hz.
    pub acceleration: T,
    /// Deviation of the unknown velocity at the start, metres a second and axis.
    pub speed: T,
    /// Values older than this are not used to estimate the noise of values, microseconds.
    pub recent_us: u64,
    /// After this time without a value the position is lost, microseconds.
    pub gap_us: u64,
    /// Seed of the random numbers that draw positions.
    pub seed: u64,
}

impl<T: Real> DelayErrors<T> {
    /// Ranges by UWB in a building.
    pub fn indoors() -> Self {
        Self {
            noise: T::of(0.1),
            bias: T::of(0.03),
            blocked: T::of(0.3),
            excess: T::of(2.0),
            spread: T::of(2.5),
            way: T::of(4.0),
            time: T::of(60.0),
            lasting: T::of(100.0),
            learning: T::of(40.0),
        }
    }
}

impl<T: Real> FusionSettings<T> {
    /// A person with a tag at a known height, metres, in a building.
    pub fn indoors(height: T) -> Self {
        Self {
            sources: Sources::Both,
            height,
            area: None,
            power: PowerErrors { noise: T::of(3.0), bias: T::of(5.0), way: T::of(2.0), time: T::of(30.0) },
            delay: DelayErrors::indoors(),
            reach: T::of(40.0),
            acceleration: T::of(0.6),
            speed: T::of(0.7),
            recent_us: 2_000_000,
            gap_us: 10_000_000,
            seed: 1,
        }
    }

    /// Deviation of a single value, dB or metres.
    pub(super) fn noise(&self, power: bool) -> T {
        if power { self.power.noise } else { self.delay.noise }
    }

    /// Deviation of the bias on a direct link, dB or metres.
    pub(super) fn bias(&self, power: bool) -> T {
        if power { self.power.bias } else { self.delay.bias }
    }
}
