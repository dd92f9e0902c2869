//! Computes, for a sequence of receptions of one node, the probability that the direct path is blocked. Input: the
//! diagnostics of each reception. Output: the probability.
//!
//! A [`NlosDetector`] adds the features that depend on earlier receptions (the moving means of a link, the range
//! minus the track's distance) and asks its model. Not every reception has an impulse response, because reading one
//! takes time. The last probability of a link therefore holds for a second.
//!
//! Without a model the received powers give the probability ([`POWER_DIFFERENCE_PRIOR`]). They do so also with a
//! model if the features of a reception are not sufficient.

use heapless::Vec;

use super::{Classifier, Feature, Features, MovingMean};
use crate::{POWER_DIFFERENCE_PRIOR, Real};

/// The number of links that are kept, the same as in a round. A further link replaces the one not received for
/// longest.
pub const LINKS: usize = 8;
/// How long a probability holds for receptions without impulse response, microseconds: a walking person moves one
/// metre.
const HOLD_US: u64 = 1_000_000;

/// The prior probability that a link is blocked. Models are calibrated for equal probabilities, which is not right
/// for a tag's links. With one half, direct links have so much uncertainty that a track in a room of few walls errs
/// twice as much.
const PRIOR: f32 = 0.1;
/// The same for a link that has been received for less than a second and whose impulse response has not been read
/// yet. A track is started from its first ranges, which keep their influence for a long time.
const UNSEEN: f32 = 0.5;

/// The moving means of one link.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Means {
    range_m: MovingMean,
    power_dbm: MovingMean,
}

impl Means {
    /// Takes a range, metres, and its received power, dBm, and sets the means of the last five. A value that is not
    /// finite is skipped, and its mean is unknown: a mean always includes this reception.
    pub fn complete(&mut self, features: &mut Features, range_m: f32, power_dbm: f32) {
        features.set_known(Feature::RangeMean, self.range_m.push(range_m).filter(|_| range_m.is_finite()));
        features.set_known(Feature::PowerMean, self.power_dbm.push(power_dbm).filter(|_| power_dbm.is_finite()));
    }
}

/// One reception with its receiver's diagnostics.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reception {
    /// The features of this reception alone: powers, and the impulse response if it was read.
    pub features: Features,
    /// The range, metres; NaN where there is none, as with a difference of arrivals.
    pub range_m: f32,
    /// Received power, dBm; NaN where it is not known.
    pub power_dbm: f32,
    /// The tag's position by the track, and the anchor's position, metres, if both are known.
    pub ends_m: Option<[[f32; 3]; 2]>,
}

impl Reception {
    /// The range minus the distance that the track gives.
    fn residual_m(&self) -> Option<f32> {
        let [tag, anchor] = self.ends_m?;
        let square: f32 = tag.iter().zip(anchor).map(|(a, b)| (a - b) * (a - b)).sum();
        Some(self.range_m - Real::sqrt(square))
    }
}

/// Computes the probability for the receptions of one node.
#[derive(Clone)]
pub struct NlosDetector<'a> {
    model: Option<&'a dyn Classifier>,
    links: Vec<Link, LINKS>,
}

#[derive(Clone, Debug)]
struct Link {
    anchor: u16,
    /// When the link was first received, and last.
    since_us: u64,
    heard_us: u64,
    means: Means,
    /// When the model last gave a probability, and its value.
    judged: Option<(u64, f32)>,
}

impl<'a> NlosDetector<'a> {
    /// A detector with this model; `None`: the powers alone.
    pub const fn new(model: Option<&'a dyn Classifier>) -> Self {
        Self { model, links: Vec::new() }
    }

    /// Whether its model uses the impulse response.
    pub fn wants_response(&self) -> bool {
        self.asks_for(Feature::is_of_response)
    }

    /// Whether its model uses this feature.
    pub fn asks(&self, feature: Feature) -> bool {
        self.asks_for(|asked| asked == feature)
    }

    fn asks_for(&self, which: impl Fn(Feature) -> bool) -> bool {
        let mut asks = false;
        if let Some(model) = self.model {
            model.for_each_feature(&mut |feature| asks |= which(feature));
        }
        asks
    }

    /// The probability that the direct path of this reception from `anchor` is blocked; `None` if it cannot be
    /// estimated. If the time jumps, the earlier data of the link no longer count.
    pub fn blocked(&mut self, now_us: u64, anchor: u16, reception: &Reception) -> Option<f32> {
        let by_powers = POWER_DIFFERENCE_PRIOR.nlos_probability(&reception.features);
        let Some(model) = self.model else { return by_powers };
        let wants_response = self.wants_response();
        let Some(link) = self.link(now_us, anchor) else { return by_powers };
        let mut features = reception.features;
        link.means.complete(&mut features, reception.range_m, reception.power_dbm);
        features.set_known(Feature::TrackResidual, reception.residual_m());
        if let Some(even) = model.nlos_probability(&features) {
            let blocked = even * PRIOR / (even * PRIOR + (1.0 - even) * (1.0 - PRIOR));
            link.judged = Some((now_us, blocked));
            return Some(blocked);
        }
        let recent = |(then_us, _): &(u64, f32)| now_us.abs_diff(*then_us) <= HOLD_US;
        let judged = link.judged.filter(recent).map(|(_, blocked)| blocked);
        let to_come = wants_response && now_us.abs_diff(link.since_us) <= HOLD_US;
        judged.or(if to_come { Some(UNSEEN) } else { by_powers })
    }

    /// The link. If there is no room, it replaces the one not received for longest.
    fn link(&mut self, now_us: u64, anchor: u16) -> Option<&mut Link> {
        let new = Link { anchor, since_us: now_us, heard_us: now_us, means: Means::default(), judged: None };
        let place = match self.links.iter().position(|link| link.anchor == anchor) {
            Some(place) => place,
            None if !self.links.is_full() => {
                // There is room.
                let _ = self.links.push(new);
                self.links.len().saturating_sub(1)
            }
            None => {
                let (place, oldest) = self.links.iter_mut().enumerate().min_by_key(|(_, link)| link.heard_us)?;
                *oldest = new;
                place
            }
        };
        let link = self.links.get_mut(place)?;
        link.heard_us = now_us;
        Some(link)
    }
}

#[cfg(all(test, feature = "serde"))]
mod tests {
    use super::*;
    use crate::nlos::{Input, Inputs, Kind, Logistic, Model, Platt, Skewness};

    fn by_shape() -> Model<'static> {
        let kind = Skewness { feature: Feature::SkewnessNear, los_mean: 1.5, nlos_mean: 0.9, deviation: 0.3 };
        Model { kind: Kind::Skewness(kind), calibration: Platt::NONE }
    }

    /// σ(feature − 4).
    fn by(feature: Feature) -> Model<'static> {
        let inputs = Inputs([Input { feature, mean: 4.0, deviation: 1.0 }].into_iter().collect());
        let kind = Logistic { inputs, weights: [1.0].into_iter().collect(), intercept: 0.0 };
        Model { kind: Kind::Logistic(kind), calibration: Platt::NONE }
    }

    fn reception(skewness: Option<f32>) -> Reception {
        let mut features = Features::default();
        // Equal odds, by powers.
        features.set(Feature::PowerDifference, POWER_DIFFERENCE_PRIOR.middle_db);
        features.set_known(Feature::SkewnessNear, skewness);
        Reception { features, range_m: 5.0, power_dbm: -80.0, ends_m: None }
    }

    fn close(found: Option<f32>, expected: f32) {
        assert!(found.is_some_and(|p| (p - expected).abs() < 1.0e-4), "{found:?} is not {expected}");
    }

    #[test]
    fn without_a_model_powers_tell() {
        close(NlosDetector::new(None).blocked(0, 1, &reception(Some(0.2))), 0.5);
        let unknown = Reception { features: Features::default(), ..reception(None) };
        assert_eq!(NlosDetector::new(None).blocked(0, 1, &unknown), None);
    }

    #[test]
    fn a_judgement_holds_for_a_second_and_for_its_own_link() {
        let model = by_shape();
        let mut judge = NlosDetector::new(Some(&model));
        assert!(judge.wants_response() && judge.asks(Feature::SkewnessNear) && !judge.asks(Feature::Skewness));
        assert!(!NlosDetector::new(None).wants_response());
        close(judge.blocked(0, 1, &reception(None)), 0.5);
        // At γ = 1.35 odds of 1/e (see `skewness`), times one to nine: 1/(1 + 9e).
        close(judge.blocked(10, 1, &reception(Some(1.35))), 0.039_271);
        close(judge.blocked(1_000_010, 1, &reception(None)), 0.039_271);
        close(judge.blocked(1_000_010, 2, &reception(None)), 0.5);
        close(judge.blocked(1_000_011, 1, &reception(None)), 0.5);
        // A time that goes back by more than a second means a reset clock.
        judge.blocked(9_000_000, 1, &reception(Some(1.35)));
        close(judge.blocked(0, 1, &reception(None)), 0.5);
    }

    #[test]
    fn moving_means_and_the_track_are_features() {
        let model = by(Feature::RangeMean);
        let mut judge = NlosDetector::new(Some(&model));
        judge.blocked(0, 1, &Reception { range_m: 3.0, ..reception(None) });
        // The mean of 3 and 7 is 5: odds of e, times one to nine: 1/(1 + 9/e).
        close(judge.blocked(1, 1, &Reception { range_m: 7.0, ..reception(None) }), 0.231_969);
        let model = by(Feature::TrackResidual);
        let mut judge = NlosDetector::new(Some(&model));
        assert!(!judge.wants_response());
        close(judge.blocked(0, 1, &reception(None)), 0.5);
        // 5 m where √(4/9 + 16/9 + 16/9) = 2 m are expected: odds of 1/e, times one to nine.
        let ends_m = Some([[2.0 / 3.0, 0.0, 0.0], [0.0, 4.0 / 3.0, 4.0 / 3.0]]);
        close(judge.blocked(0, 1, &Reception { ends_m, ..reception(None) }), 0.039_271);
    }

    #[test]
    fn the_link_not_heard_for_longest_goes() {
        let model = by_shape();
        let mut judge = NlosDetector::new(Some(&model));
        for anchor in 0..LINKS as u16 {
            judge.blocked(anchor.into(), anchor, &reception(Some(1.35)));
        }
        judge.blocked(100, 0, &reception(None));
        judge.blocked(101, 99, &reception(Some(1.35)));
        close(judge.blocked(102, 0, &reception(None)), 0.039_271);
        close(judge.blocked(103, 1, &reception(None)), 0.5);
    }

    #[test]
    fn no_reception_makes_a_probability_that_is_none() {
        let model = by(Feature::TrackResidual);
        let mut judge = NlosDetector::new(Some(&model));
        for wild in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN, 0.0] {
            for ends_m in [None, Some([[f32::NAN; 3]; 2]), Some([[wild; 3], [1.0; 3]])] {
                let mut wilder = Reception { range_m: wild, power_dbm: wild, ends_m, ..reception(Some(wild)) };
                wilder.features.set(Feature::PowerDifference, wild);
                let found = judge.blocked(u64::MAX, 7, &wilder);
                assert!(found.is_none_or(|p| (0.0..=1.0).contains(&p)), "{wilder:?} makes {found:?}");
            }
        }
    }
}
