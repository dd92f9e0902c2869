//! How the fusion is to work.

use positioning_core::{Area, Real};

/// Which values count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sources {
    /// Powers alone.
    Power,
    /// Delays alone.
    Delay,
    /// Both.
    Both,
}

/// How received powers err.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PowerErrors<T> {
    /// Deviation of a single value about its mean at a place, before values say otherwise, dB.
    pub noise: T,
    /// Deviation of the bias: the error of the channel's parameters and the shadowing of the place, dB.
    pub bias: T,
    /// After this way the bias is another one, metres.
    pub way: T,
    /// After this time the bias is another one, seconds.
    pub time: T,
}

/// How delays err.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DelayErrors<T> {
    /// Deviation of a single value, before values say otherwise, metres.
    pub noise: T,
    /// Deviation of what the affine model leaves of the link's error, metres.
    pub bias: T,
    /// Share of links without line of sight, before a link's values say otherwise, 0 to 1.
    pub blocked: T,
    /// Mean of the positive bias of such a link, metres.
    pub excess: T,
    /// Deviation of it, metres.
    pub spread: T,
    /// After this way the bias of a blocked link is another one, metres.
    pub way: T,
    /// After this time too, seconds.
    pub time: T,
    /// A link stays blocked, or direct, about so long, seconds.
    pub lasting: T,
    /// Each link's own share of blocked time is that of about so long, seconds.
    pub learning: T,
}

/// How the fusion is to work.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings<T> {
    /// Which values count.
    pub sources: Sources,
    /// The tag's height where x and y are sought, metres.
    pub height: T,
    /// Where the tag can be at all.
    pub area: Option<Area<T, 3>>,
    /// How powers err.
    pub power: PowerErrors<T>,
    /// How delays err.
    pub delay: DelayErrors<T>,
    /// No node is heard from farther, metres.
    pub reach: T,
    /// Root of the density of the tag's acceleration, m/s² in √Hz.
    pub acceleration: T,
    /// Deviation of the unknown velocity at the start, metres a second and axis.
    pub speed: T,
    /// Values older than this tell nothing of how values err now, microseconds.
    pub recent_us: u64,
    /// After so long without a value the position is lost, microseconds.
    pub gap_us: u64,
    /// Seed of the random numbers that places are drawn by.
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

impl<T: Real> Settings<T> {
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
