//! A look at the engine's hypotheses between two steps, for programs that go back through a whole recording. Nodes do
//! not call it, so no image contains it.

use super::Engine;
use crate::Real;
use crate::link_error::Gaussian;
use crate::track::state::LINKS;
use crate::track::{Filter, Noise, Source, seconds};

/// A hypothesis about the tag: mean and covariance of position (three states), velocity (three), the error common to
/// all ranges, and the error of each link.
#[derive(Clone, Copy, Debug)]
pub struct Hypothesis<'a, T> {
    filter: &'a Filter<T>,
    noise: &'a Noise<T>,
}

/// The error of a link to an anchor, which returns to its prior with time and with distance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkState<T> {
    /// The index of its state.
    pub state: usize,
    /// The anchor's address.
    pub anchor: u16,
    /// When it was last measured, microseconds. Until it is measured again, its state is that of this time.
    pub measured_us: u64,
    /// The part of it that will be left if it is measured at the time of the hypothesis.
    pub kept: T,
    /// Mean, metres, and variance, m², of its prior.
    pub prior: [T; 2],
}

impl<T: Real> Hypothesis<'_, T> {
    /// Its time, microseconds.
    pub fn t_us(&self) -> u64 {
        self.filter.now_us
    }

    /// The means of its states: metres, and metres per second.
    pub fn means(&self) -> &[T] {
        self.filter.state.mean.get(..self.filter.state.lasting()).unwrap_or(&[])
    }

    /// The covariance of two of its states.
    pub fn covariance(&self, one: usize, other: usize) -> T {
        self.filter.state.covariance(one, other)
    }

    /// The errors of its links to anchors.
    pub fn links(&self) -> impl Iterator<Item = LinkState<T>> {
        (LINKS..).zip(self.filter.links.iter()).filter_map(|(state, link)| {
            let Source::Anchor(anchor) = link.source else { return None };
            let (Gaussian { mean, variance }, measured_us) = (link.site, link.measured_us);
            let age = seconds(self.filter.now_us.saturating_sub(measured_us));
            let kept = self.filter.state.kept(age, [self.noise.link_seconds, self.noise.link_metres]);
            Some(LinkState { state, anchor, measured_us, kept, prior: [mean, variance] })
        })
    }
}

impl<T: Real> Engine<T> {
    /// Predicts the track to a time, microseconds, as the next measurement of that time would do first.
    pub fn advance(&mut self, now_us: u64) {
        self.watch_clock(now_us);
    }

    /// The track, if there is one, and the second hypothesis with its probability, if there are two.
    pub fn hypotheses(&self) -> [Option<(Hypothesis<'_, T>, T)>; 2] {
        let hypothesis = |filter| Hypothesis { filter, noise: &self.settings.filter.noise };
        let other = self.rival.share().filter(|_| self.track.is_ok());
        let track = self.track.is_ok().then(|| (hypothesis(&self.filter), T::ONE - other.unwrap_or(T::ZERO)));
        [track, other.map(|share| (hypothesis(&self.rival.filter), share))]
    }
}

#[cfg(test)]
mod tests {
    use super::Engine;
    use crate::engine::{Dimensions, Measurement, Range, Settings};

    #[test]
    fn a_track_at_rest_shows_its_links_as_the_next_range_will_find_them() {
        let mut engine = Engine::<f64>::new(Settings::track(Dimensions::Plane { height: 1.0 }));
        assert!(engine.hypotheses().iter().all(Option::is_none));
        for (anchor, [x, y]) in (1..).zip([[0.0, 0.0], [8.0, 0.0], [8.0, 6.0], [0.0, 6.0]]) {
            let (position_m, distance_m) = ([x, y, 1.0], libm::hypot(x - 3.0, y - 2.0));
            let range = Range { anchor, position_m, distance_m, deviation_m: 0.03, p_nlos: None, excess_m: None };
            engine.step(1_000_000, &Measurement::Range(range));
        }
        engine.step(1_000_000, &Measurement::RoundEnd);
        engine.advance(2_000_000);
        let [track, rival] = engine.hypotheses();
        let (track, share) = track.expect("a track");
        assert!(rival.is_none() && share == 1.0 && track.t_us() == 2_000_000);
        // Position, velocity, the common error and four links.
        assert_eq!(track.means().len(), 3 + 3 + 1 + 4);
        assert!((track.means()[0] - 3.0).abs() < 0.05 && (track.means()[1] - 2.0).abs() < 0.05, "{:?}", track.means());
        // A second at rest: (1 + 1 ⁄ 8)⁻⁸ = 0.38974.
        assert!(track.links().all(|link| link.measured_us == 1_000_000 && (link.kept - 0.389_74).abs() < 1e-4));
        assert!(track.links().map(|link| (link.state, link.anchor)).eq([(7, 1), (8, 2), (9, 3), (10, 4)]));
    }
}
