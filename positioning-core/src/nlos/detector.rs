//! What a node makes of its receptions one after the other: in flow what each told, out flows the probability that its
//! direct path is blocked.
//!
//! A [`NlosDetector`] adds what only time gives (the moving means of a link, the range against the track) and asks its model. Not
//! every reception has an impulse response, for reading one takes time: what the last one said of a link holds for a
//! second. Without a model the powers are asked ([`POWER_DIFFERENCE_PRIOR`]); also beside one that
//! a reception does not tell enough, and then as the small part of a blocked link's variance that their doubt amounts to.

use heapless::Vec;

use super::{Classifier, Feature, Features, MovingMean};
use crate::{Noise, POWER_DIFFERENCE_PRIOR, Real};

/// Links that are kept in mind, as many as a round has; of others the one not heard for longest goes.
pub const LINKS: usize = 8;
/// How long a judgement stands in for receptions without impulse response, microseconds: someone who walks goes a metre.
const HOLD_US: u64 = 1_000_000;

/// How likely a link is to be blocked before anything is known of it. Models are calibrated for one as likely as the other, which a
/// tag's links are not: with one half, direct links are doubted so much that a track in a room of few walls errs twice as far.
const PRIOR: f32 = 0.1;
/// And of a link heard for less than a second whose impulse response is yet to be read: a track is started from its first ranges, and
/// believes them for long.
const UNSEEN: f32 = 0.5;

/// The moving means of one link.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Means {
    range_m: MovingMean,
    power_dbm: MovingMean,
}

impl Means {
    /// Takes a range, metres, and its received power, dBm, and sets the means of the last five. What is not finite is passed
    /// over, and its mean is not known: a mean is that of this reception.
    pub fn complete(&mut self, features: &mut Features, range_m: f32, power_dbm: f32) {
        features.set_known(Feature::RangeMean, self.range_m.push(range_m).filter(|_| range_m.is_finite()));
        features.set_known(Feature::PowerMean, self.power_dbm.push(power_dbm).filter(|_| power_dbm.is_finite()));
    }
}

/// One reception as its receiver knows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reception {
    /// What it told by itself: powers, and the impulse response where that was read.
    pub features: Features,
    /// The range, metres; NaN where there is none, as with a difference of arrivals.
    pub range_m: f32,
    /// Received power, dBm; NaN where it is not known.
    pub power_dbm: f32,
    /// Where the track has the tag, and where the anchor stands, metres, where both are known.
    pub ends_m: Option<[[f32; 3]; 2]>,
}

impl Reception {
    /// The range less the distance that the track gives.
    fn residual_m(&self) -> Option<f32> {
        let [tag, anchor] = self.ends_m?;
        let square: f32 = tag.iter().zip(anchor).map(|(a, b)| (a - b) * (a - b)).sum();
        Some(self.range_m - Real::sqrt(square))
    }
}

/// Judges the receptions of one node.
#[derive(Clone)]
pub struct NlosDetector<'a> {
    model: Option<&'a dyn Classifier>,
    links: Vec<Link, LINKS>,
}

#[derive(Clone, Debug)]
struct Link {
    anchor: u16,
    /// When it was first heard, and last.
    since_us: u64,
    heard_us: u64,
    means: Means,
    /// When the model last said something, and what.
    judged: Option<(u64, f32)>,
}

impl<'a> NlosDetector<'a> {
    /// One that asks this model; `None`: the powers alone.
    pub const fn new(model: Option<&'a dyn Classifier>) -> Self {
        Self { model, links: Vec::new() }
    }

    /// Whether its model asks for the impulse response.
    pub fn wants_response(&self) -> bool {
        self.asks_for(Feature::is_of_response)
    }

    /// Whether its model asks for this feature.
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

    /// The probability that the direct path of this reception from `anchor` is blocked; `None` where nothing tells. Time may
    /// jump: then what is known of the link counts no more.
    pub fn blocked(&mut self, now_us: u64, anchor: u16, reception: &Reception) -> Option<f32> {
        let by_powers = POWER_DIFFERENCE_PRIOR.nlos_probability(&reception.features);
        let Some(model) = self.model else { return by_powers };
        // That a range may be off by a decimetre is so much of the variance of a blocked one.
        let [doubt, blocked] =
            [Noise::by_powers(), Noise::by_model()].map(|noise: Noise<f32>| noise.blocked_link_sigma);
        let by_powers = by_powers.map(|p| p * (doubt / blocked) * (doubt / blocked));
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

    /// The link, which takes the place of the one not heard for longest where there is none left.
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
        // Even odds, by powers.
        features.set(Feature::PowerDifference, POWER_DIFFERENCE_PRIOR.middle_db);
        features.set_known(Feature::SkewnessNear, skewness);
        Reception { features, range_m: 5.0, power_dbm: -80.0, ends_m: None }
    }

    /// Even odds of what powers doubt, as a part of what a blocked link adds: with 0.1 m and 0.2 m 0.5/4.
    fn part() -> f32 {
        let [doubt, blocked] = [Noise::<f32>::by_powers(), Noise::by_model()].map(|noise| noise.blocked_link_sigma);
        0.5 * (doubt / blocked).powi(2)
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
        close(judge.blocked(1_000_011, 1, &reception(None)), part());
        // Time that goes back by more than a second has begun anew.
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
        close(judge.blocked(0, 1, &reception(None)), part());
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
