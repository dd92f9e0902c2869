//! The links in use, to anchors and to beacons: the state of each link, and its observed noise.

use super::filter::FilterSettings;
use super::gate::Gate;
use super::noise::ObservedNoise;
use super::state::LINKS;
use crate::link_error::Gaussian;
use crate::{MAX_ANCHORS, Real};

/// A link that was not measured for this time makes room, microseconds.
const SILENT_US: u64 = 2_000_000;
/// An anchor replaces the farthest one if its distance is less than this part of the other's: with the nearest sixteen
/// alone, two anchors at equal distances would take turns.
const MUCH_NEARER: f64 = 0.8;

/// The far end of a link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Source {
    /// An anchor, by its address: the link's error is in metres.
    Anchor(u16),
    /// All beacons together, by the number of an axis: the error of positions by them, metres.
    Beacons(u8),
}

/// One link.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Link<T> {
    /// The far end.
    pub(crate) source: Source,
    /// The time of its last measurement, microseconds.
    pub(crate) measured_us: u64,
    /// The time from the measurement before to the last one, seconds.
    pub(crate) age_s: T,
    /// The measured distance of an anchor, metres; 0 for beacons.
    pub(crate) distance_m: T,
    /// Its own gate.
    pub(crate) gate: Gate<T>,
    /// The Gaussian that stands for the prior of its error.
    pub(crate) site: Gaussian<T>,
    /// The probability that it is blocked.
    pub(crate) blocked: T,
    /// Its observed noise.
    pub(crate) shown: ObservedNoise<T>,
}

impl<T: Real> Link<T> {
    /// Whether it is rather direct than blocked, and its ranges are not refused.
    pub(crate) fn is_direct(&self) -> bool {
        self.blocked < T::of(0.5) && !self.gate.refuses()
    }

    /// The variance of the noise of its next measurement, m²; `own` is that in line of sight, `blocked` the probability
    /// that the link is blocked.
    pub(crate) fn white(&self, own: T, blocked: T, settings: &FilterSettings<T>) -> T {
        let variance = || self.shown.variance(settings.noise.noise_variance(own, blocked));
        settings.blocked.variance(blocked).unwrap_or_else(variance)
    }
}

/// The table of links.
#[derive(Clone, Debug)]
pub(crate) struct Links<T> {
    links: heapless::Vec<Link<T>, MAX_ANCHORS>,
}

impl<T: Real> Links<T> {
    /// An empty table.
    pub(crate) fn new() -> Self {
        Self { links: heapless::Vec::new() }
    }

    /// Becomes a copy of another table.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.links.clear();
        // Both have the same capacity.
        let _ = self.links.extend_from_slice(&other.links);
    }

    /// Removes all links.
    pub(crate) fn clear(&mut self) {
        self.links.clear();
    }

    /// The index of the state for a place in the table.
    pub(crate) fn state(place: usize) -> usize {
        LINKS + place
    }

    /// The place of a source's link, and whether it is new. A new link takes a free place, or that of a link that has
    /// not been measured for a while, or that of the farthest anchor if it is much nearer itself: the nearest anchors
    /// say most about the position, and are blocked least. `None`: there is no place for it.
    pub(crate) fn place(&mut self, source: Source, distance_m: T, now_us: u64) -> Option<(usize, bool)> {
        if let Some(place) = self.links.iter().position(|link| link.source == source) {
            return Some((place, false));
        }
        let fresh = Link {
            source,
            measured_us: now_us,
            age_s: T::ZERO,
            distance_m,
            gate: Gate::default(),
            site: Gaussian { mean: T::ZERO, variance: T::ZERO },
            blocked: T::ZERO,
            shown: ObservedNoise::nothing(),
        };
        if self.links.push(fresh).is_ok() {
            return Some((self.links.len() - 1, true));
        }
        let is_silent = |link: &Link<T>| now_us.saturating_sub(link.measured_us) > SILENT_US;
        let farther = |one: &Link<T>, other: &Link<T>| match (is_silent(one), is_silent(other)) {
            (true, true) => one.measured_us < other.measured_us,
            (false, false) => one.distance_m > other.distance_m,
            (silent, _) => silent,
        };
        let mut worst = 0;
        for place in 1..self.links.len() {
            if let (Some(one), Some(other)) = (self.links.get(place), self.links.get(worst))
                && farther(one, other)
            {
                worst = place;
            }
        }
        let link = self.links.get_mut(worst)?;
        if is_silent(link) || distance_m < T::of(MUCH_NEARER) * link.distance_m {
            *link = fresh;
            return Some((worst, true));
        }
        None
    }

    /// All links.
    pub(crate) fn iter(&self) -> impl Iterator<Item = &Link<T>> {
        self.links.iter()
    }

    /// Whether the link to an anchor is known, and direct.
    pub(crate) fn is_direct(&self, anchor: u16) -> bool {
        self.iter().any(|link| link.source == Source::Anchor(anchor) && link.is_direct())
    }

    /// The link at a place.
    pub(crate) fn at(&mut self, place: usize) -> Option<&mut Link<T>> {
        self.links.get_mut(place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn full() -> Links<f32> {
        let mut links = Links::<f32>::new();
        for anchor in 0..16 {
            let place = links.place(Source::Anchor(anchor), 10.0 + f32::from(anchor), 100 + u64::from(anchor));
            assert_eq!(place, Some((usize::from(anchor), true)));
        }
        links
    }

    #[test]
    fn the_sixteen_nearest_anchors_stay_whatever_the_order_of_ranges() {
        let mut links = full();
        for turn in 0..10 {
            // Four anchors farther than all others, and one hardly nearer than the farthest, find no place.
            for (anchor, distance_m) in [(20, 30.0), (21, 31.0), (22, 40.0), (23, 26.0), (24, 24.0)] {
                assert_eq!(links.place(Source::Anchor(anchor), distance_m, 200 + turn), None);
            }
            for anchor in 0..16 {
                assert!(links.place(Source::Anchor(anchor), 10.0, 200 + turn).is_some_and(|(_, fresh)| !fresh));
            }
        }
        // A much nearer one takes the place of the farthest.
        assert_eq!(links.place(Source::Anchor(30), 9.0, 300), Some((15, true)));
    }

    #[test]
    fn a_silent_link_makes_room_for_any_other() {
        let mut links = full();
        let now_us = 106 + SILENT_US;
        assert_eq!(links.place(Source::Anchor(40), 100.0, now_us), Some((0, true)));
        // An axis of the same number is a different source.
        assert_eq!(links.place(Source::Beacons(7), 0.0, now_us), Some((1, true)));
    }
}
