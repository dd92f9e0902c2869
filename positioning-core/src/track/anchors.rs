//! The links in use, to anchors and to beacons: the state of each link, and its observed noise.

use super::gate::Gate;
use super::noise::ObservedNoise;
use super::state::LINKS;
use crate::{MAX_ANCHORS, Real};

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
    /// Its own gate.
    pub(crate) gate: Gate<T>,
    /// Its observed noise.
    pub(crate) shown: ObservedNoise<T>,
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

    /// Removes all links.
    pub(crate) fn clear(&mut self) {
        self.links.clear();
    }

    /// The index of the state for a place in the table.
    pub(crate) fn state(place: usize) -> usize {
        LINKS + place
    }

    /// The place of a source's link, and whether it is new. A new link takes a free place, or that of the link that
    /// was not measured for longest.
    pub(crate) fn place(&mut self, source: Source, now_us: u64) -> (usize, bool) {
        if let Some(place) = self.links.iter().position(|link| link.source == source) {
            return (place, false);
        }
        let fresh = Link { source, measured_us: now_us, gate: Gate::default(), shown: ObservedNoise::nothing() };
        if self.links.push(fresh).is_ok() {
            return (self.links.len() - 1, true);
        }
        let mut oldest = 0;
        let mut since = u64::MAX;
        for (place, link) in self.links.iter().enumerate() {
            if link.measured_us < since {
                (oldest, since) = (place, link.measured_us);
            }
        }
        if let Some(link) = self.links.get_mut(oldest) {
            *link = fresh;
        }
        (oldest, true)
    }

    /// The link at a place.
    pub(crate) fn at(&mut self, place: usize) -> Option<&mut Link<T>> {
        self.links.get_mut(place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_link_that_was_silent_longest_makes_room() {
        let mut links = Links::<f32>::new();
        for anchor in 0..16 {
            assert_eq!(links.place(Source::Anchor(anchor), u64::from(100 - anchor)), (usize::from(anchor), true));
        }
        assert_eq!(links.place(Source::Anchor(7), 200), (7, false));
        // An axis of the same number is a different source.
        assert_eq!(links.place(Source::Beacons(7), 200), (15, true));
        assert_eq!(links.place(Source::Anchor(15), 201), (14, true));
    }
}
