//! Two hypotheses about where the tag is: the track, and a rival where the ranges of a round fit another place.
//!
//! A track can be wrong: it began at a mirror image, somebody carried the tag while the radio was off, or most links
//! changed at once. Then a fresh start explains the round better. Its evidence is the likelihood of the round's ranges,
//! integrated over the place (Laplace's approximation), times the probability that a tag is somewhere else. The
//! evidence of the track is the product of the densities that it predicted. Where neither wins, both are followed, and
//! the position is the likelier place, with a deviation that reaches to the other. The log odds are summed from round
//! to round and slowly forgotten, because the errors of consecutive rounds are not independent, and they never exceed
//! what the lasting errors of links allow.
//!
//! The second of a solver's two places at a start is a rival too, and so is the track's mirror image across the line or
//! plane near which the anchors lie, where the track comes from both of its sides.

use super::round::{Mirror, Round};
use super::track_management::begin;
use super::{Dimensions, Engine, Settings, Start};
use crate::linalg::{Ldl, Matrix, distance_squared, sub};
use crate::measurement::Range;
use crate::track::Filter;
use crate::track::state::{COMMON, POSITION, State};
use crate::track::{fading, seconds};
use crate::{Alternative, Fix, Flag, Real};

/// ln of the odds at which a hypothesis has won.
const SURE: f64 = 4.0;
/// Two thirds of the log odds are forgotten after this time, seconds: ten rounds at 10 Hz.
const FORGOTTEN_S: f64 = 0.95;
/// The log odds are limited to this.
const GREATEST: f64 = 20.0;
/// ln of the probability, per square metre and round, that the tag is somewhere else: once in a thousand rounds,
/// anywhere in a thousand square metres.
const LOG_ELSEWHERE: f64 = -13.8;
/// ln of the density of a range that a new hypothesis explains very well: the round of a good track needs no solver.
const LOG_WELL_EXPLAINED: f64 = 2.2;
/// ln (2π) ⁄ 2.
const HALF_LOG_TURN: f64 = 0.918_938_5;
/// A place within this number of deviations of the track is the track's own.
const SAME: f64 = 2.0;
/// A mirror image within this number of deviations of the track begins a hypothesis of its own: within a third of it, the
/// track is on both sides.
const BOTH_SIDES: f64 = 6.0;

/// A second hypothesis. Its filter has a place of its own, because filters are too large to be moved about.
#[derive(Clone, Debug)]
pub(super) struct Rival<T> {
    pub(super) filter: Filter<T>,
    /// ln of the odds of the track against it, while there is one.
    lead: Option<T>,
    /// The line or plane on both sides of which the track has been since it was last on one side for sure.
    astride: Option<Mirror<T>>,
    /// Whether it began as the track's mirror image.
    is_image: bool,
    /// When the hypotheses were last compared, microseconds.
    compared_us: u64,
}

impl<T: Real> Rival<T> {
    #[inline(always)]
    pub(super) fn none() -> Self {
        Self { filter: Filter::new(), lead: None, astride: None, is_image: false, compared_us: 0 }
    }

    pub(super) fn end(&mut self) {
        self.lead = None;
    }

    /// Its probability, if there is one: the rest is that of the track.
    pub(super) fn share(&self) -> Option<T> {
        Some(T::ONE / (T::ONE + self.lead?.exp()))
    }

    /// Its filter, if there is one.
    pub(super) fn filter(&mut self) -> Option<&mut Filter<T>> {
        self.lead.map(|_| &mut self.filter)
    }
}

impl<T: Real> Engine<T> {
    /// The likelier place of the hypotheses, and the covariance about it, which reaches to the other place.
    pub(super) fn likelier(&self) -> ([T; 3], [[T; 3]; 3]) {
        let place = |state: &State<T>| (state.position(), state.position_covariance());
        let mine = place(&self.filter.state);
        let Some(share) = self.rival.share() else { return mine };
        let other = place(&self.rival.filter.state);
        let ((position, covariance), (other, of_other), share) =
            if share > T::of(0.5) { (other, mine, T::ONE - share) } else { (mine, other, share) };
        let apart = sub(&other, &position);
        let reaching = core::array::from_fn(|r| {
            core::array::from_fn(|c| {
                covariance[r][c] + share * (of_other[r][c] - covariance[r][c] + apart[r] * apart[c])
            })
        });
        (position, reaching)
    }

    /// The other of two places: of a track of two hypotheses, or of the last round where every round is solved by
    /// itself.
    pub fn alternative(&self) -> Option<Alternative<T, 3>> {
        if self.track.is_err() {
            return self.alternative;
        }
        let share = self.rival.share()?;
        let (mine, other) = (self.filter.state.position(), self.rival.filter.state.position());
        let (from, to, share) = if share > T::of(0.5) { (other, mine, T::ONE - share) } else { (mine, other, share) };
        Some(Alternative { apart: sub(&to, &from), share })
    }

    /// The line or plane near which the anchors lie. Where a link that would tell the sides apart insists on being too
    /// short, it is that of the other direct links: the track may be on the wrong side.
    #[inline(never)]
    fn mirror(&mut self) -> Option<Mirror<T>> {
        let all = self.round.mirror(&self.settings.dimensions, &|_| true);
        let short = self.filter.too_short.take();
        let others = |short| {
            let counts = |range: &Range<T>| range.anchor != short && self.filter.links.is_direct(range.anchor);
            let mirror = self.round.mirror(&self.settings.dimensions, &counts)?;
            (!mirror.one_sided).then_some(mirror.of_some())
        };
        let mirror = all.or_else(|| short.and_then(others));
        self.rival.astride = mirror.filter(|_| short.is_some()).or(self.rival.astride);
        mirror
    }

    /// What makes the track's position doubtful.
    pub(super) fn doubt(&self) -> Option<Flag> {
        let unknowns = if self.settings.dimensions.height().is_some() { 2 } else { 3 };
        let [given, direct] = self.filter.measured_and_direct();
        Flag::of(self.rival.lead.is_some(), unknowns, given, direct)
    }

    /// Compares the hypotheses at the end of a round. Returns why a track was started, if the rival has won.
    #[inline(never)]
    pub(super) fn compare(&mut self) -> Option<Start> {
        let mine = core::mem::replace(&mut self.filter.log_evidence, T::ZERO);
        let ranges = core::mem::take(&mut self.round.unjudged);
        let mirror = self.mirror();
        if let Some(mirror) = mirror.as_ref().filter(|mirror| mirror.one_sided) {
            self.keep_side(mirror);
        }
        let since_us = self.now_us.saturating_sub(core::mem::replace(&mut self.rival.compared_us, self.now_us));
        if let Some(lead) = self.rival.lead {
            let other = core::mem::replace(&mut self.rival.filter.log_evidence, T::ZERO);
            let kept = fading(seconds::<T>(since_us) * T::of(1.0 / FORGOTTEN_S));
            let place = self.rival.filter.state.position();
            if self.is_at(place) {
                // Both have come to the same place, and the track becomes as wide as both together.
                let apart = sub(&place, &self.filter.state.position());
                let share = self.rival.share().unwrap_or(T::ZERO);
                let doubt = share * (T::ONE - share);
                (0..3).for_each(|axis| self.filter.state.widen(POSITION + axis, doubt * apart[axis].squared()));
                self.rival.end();
                self.rival.astride = mirror;
                return None;
            }
            if let Some(mirror) = mirror.as_ref().filter(|mirror| self.rival.is_image && !mirror.one_sided)
                && mirror.off(&place) * mirror.off(&self.filter.state.position()) > T::ZERO
            {
                // Both have come to one side, and nothing tells that the tag is there.
                let is_rival = self.rival.share() > Some(T::of(0.5));
                if is_rival {
                    core::mem::swap(&mut self.filter, &mut self.rival.filter);
                }
                self.begin_image(mirror);
                return is_rival.then_some(Start::Contradicted);
            }
            let limit = self.distinction(&place).at_most(self.distinction_of_sides(&place, mirror.as_ref()));
            let lead = (kept * lead + mine - other).at_least(-limit).at_most(limit);
            return self.decide(lead + self.odds_by_area());
        }
        // No hypothesis explains ranges better than this, so that most rounds need no solver.
        let best = T::count(ranges) * T::of(LOG_WELL_EXPLAINED) + T::of(LOG_ELSEWHERE);
        let begins = self.add_mirror_image(mirror);
        if begins || !(mine < best) {
            return None;
        }
        let fix = self.round.solve(&self.settings).ok()?;
        if self.is_at(fix.position) {
            return None;
        }
        begin(&mut self.rival.filter, &fix, &self.round, &self.settings, self.now_us);
        let other = log_evidence(&self.rival.filter, &self.round, &self.settings) + T::of(LOG_ELSEWHERE);
        self.rival.is_image = false;
        // A single round proves nothing: a gateway that mixes up the anchors of one round makes a perfect fix
        // elsewhere. The next round decides; meanwhile the position's deviation reaches to both.
        self.decide((mine - other).at_least(T::ZERO))
    }

    /// The most that the ranges of a round can tell between the track and another place: a quarter of the sum of the
    /// squared differences of their distances, in deviations of a direct link's lasting error, which is half of what
    /// they tell on average. An error that lasts is the same
    /// in each round, so no number of rounds tells more.
    fn distinction(&self, other: &[T; 3]) -> T {
        if !self.round.tdoas.is_empty() {
            return T::of(GREATEST);
        }
        let position = self.filter.state.position();
        let square = self.round.ranges().fold(T::ZERO, |sum, range| {
            let [here, there] = [&position, other].map(|place| distance_squared(place, &range.position_m).sqrt());
            sum + (here - there).squared()
        });
        let variance = self.settings.filter.noise.direct_sigma.at_least(T::of(1.0e-2)).squared();
        (T::of(0.25) * square / variance).at_most(T::of(GREATEST))
    }

    /// ln of the odds of the track against the rival by the area where the tag can be.
    fn odds_by_area(&self) -> T {
        let [mine, other] = [&self.filter, &self.rival.filter].map(|filter| self.settings.outside(&filter.state));
        (T::of(0.5) * (other - mine)).at_least(T::of(-GREATEST)).at_most(T::of(GREATEST))
    }

    /// The most that the ranges can tell between the sides of the anchors' line or plane, where another place is on the
    /// other side: what they tell between the track and its mirror image. Along the line, and in height, the two places
    /// differ by the errors of links, which tell nothing of the side.
    #[inline(never)]
    fn distinction_of_sides(&self, other: &[T; 3], mirror: Option<&Mirror<T>>) -> T {
        let position = self.filter.state.position();
        match mirror {
            Some(mirror) if mirror.off(&position) * mirror.off(other) < T::ZERO => {
                self.distinction(&mirror.image(&position))
            }
            Some(_) | None => T::of(GREATEST),
        }
    }

    /// Where tags are on one side of the anchors' plane, brings back what errors have moved to the other side, if ranges
    /// do not tell the two sides apart.
    #[inline(never)]
    fn keep_side(&mut self, mirror: &Mirror<T>) {
        let position = self.filter.state.position();
        if mirror.off(&position) < T::ZERO && self.distinction(&mirror.image(&position)) < T::of(SURE) {
            mirror.reflect(&mut self.filter.state);
        }
        if let Some(rival) = self.rival.filter()
            && mirror.off(&rival.state.position()) < T::ZERO
        {
            mirror.reflect(&mut rival.state);
        }
    }

    /// Follows the track's mirror image as well, where the track comes from both sides of the line or plane near which
    /// the anchors lie: ranges hardly tell sides, and what the track knew of its side is lost. Returns whether it does.
    #[inline(never)]
    fn add_mirror_image(&mut self, mirror: Option<Mirror<T>>) -> bool {
        let astride = self.rival.astride.take();
        let Some(mirror) = mirror.or(astride.map(Mirror::of_some)).filter(|mirror| !mirror.one_sided) else {
            return false;
        };
        let square = T::of(4.0) * mirror.off(&self.filter.state.position()).squared();
        let spread = self.filter.state.spread();
        // Within two deviations of the line the track is on both sides.
        if square < T::of(SAME * SAME) * spread {
            self.rival.astride = Some(mirror);
            return false;
        }
        let is_outside = self.settings.outside(&self.filter.state) > T::of(SAME * SAME);
        if astride.is_some() || is_outside || square < T::of(BOTH_SIDES * BOTH_SIDES) * spread {
            self.begin_image(&mirror);
        }
        self.rival.lead.is_some()
    }

    /// Follows the mirror image of a new track too, where ranges do not tell the sides apart: of anchors on a plane a
    /// solver takes one side.
    #[inline(never)]
    pub(super) fn start_mirror_image(&mut self) {
        let mirror = self.round.mirror(&self.settings.dimensions, &|_| true).filter(|mirror| !mirror.one_sided);
        if let Some(mirror) = mirror
            && self.distinction(&mirror.image(&self.filter.state.position())) < T::of(SURE)
        {
            self.begin_image(&mirror);
        }
    }

    #[inline(never)]
    fn begin_image(&mut self, mirror: &Mirror<T>) {
        self.rival.filter.copy_from(&self.filter);
        mirror.reflect(&mut self.rival.filter.state);
        (self.rival.lead, self.rival.is_image) = (Some(T::ZERO), true);
        if !mirror.is_of_all {
            self.weigh_image();
        }
    }

    /// Weighs a new mirror image by the ranges that tell the two sides apart. Their links have other errors there.
    #[inline(never)]
    fn weigh_image(&mut self) {
        let [position, image] = [&self.filter, &self.rival.filter].map(|filter| filter.state.position());
        let settings = &self.settings.filter;
        let mut lead = T::ZERO;
        for range in self.round.ranges() {
            let [here, there] = [&position, &image].map(|place| distance_squared(place, &range.position_m).sqrt());
            if (here - there).squared() > settings.noise.direct_sigma.squared() {
                // An error that lasts tells half of what a new one in each round would tell.
                lead += T::of(0.5)
                    * (self.filter.log_density(range, settings) - self.rival.filter.log_density(range, settings));
                self.rival.filter.prepare_range(range, settings);
            }
        }
        self.rival.lead = Some(lead.at_least(T::ZERO)).filter(|lead| *lead < T::of(SURE));
    }

    /// Follows the hypothesis that has won with these log odds of the track, or both. Returns why a track was started,
    /// if the rival has won.
    #[inline(never)]
    fn decide(&mut self, lead: T) -> Option<Start> {
        self.rival.lead = (lead.abs() < T::of(SURE)).then_some(lead);
        (lead <= T::of(-SURE)).then(|| {
            core::mem::swap(&mut self.filter, &mut self.rival.filter);
            Start::Contradicted
        })
    }

    /// Adds the second place of a fix, with its share of the probability, as a rival to the track that was started at
    /// the first one.
    pub(super) fn add_rival(&mut self, other: &Fix<T, 3>, share: T) {
        begin(&mut self.rival.filter, other, &self.round, &self.settings, self.now_us);
        (self.rival.lead, self.rival.is_image) = (Some(((T::ONE - share) / share).ln()), false);
        self.rival.compared_us = self.now_us;
    }

    /// Whether another position is where the track is.
    fn is_at(&self, other: [T; 3]) -> bool {
        distance_squared(&self.filter.state.position(), &other) < T::of(SAME * SAME) * self.filter.state.spread()
    }
}

/// ln of the evidence of a round for a filter that began with it, up to the probability of its place: the likelihood at
/// its state, times the volume of its posterior (Laplace's approximation).
#[inline(never)]
fn log_evidence<T: Real>(filter: &Filter<T>, round: &Round<T>, settings: &Settings<T>) -> T {
    let mut likelihood = T::ZERO;
    for range in round.ranges() {
        likelihood += filter.log_density(range, &settings.filter);
    }
    for tdoa in &round.tdoas {
        likelihood += filter.log_density_of_tdoa(tdoa, &settings.filter);
    }
    let sigma = settings.filter.noise.common_sigma.at_least(T::of(1.0e-3));
    let common = filter.state.mean[COMMON] / sigma;
    let prior = -T::of(0.5) * common.squared() - sigma.ln();
    let volume = match settings.dimensions {
        Dimensions::Plane { .. } => log_volume(filter, [POSITION, POSITION + 1, COMMON]),
        Dimensions::Space { .. } => log_volume(filter, [POSITION, POSITION + 1, POSITION + 2, COMMON]),
    };
    likelihood + prior + volume
}

/// ln of the volume of the posterior of these states, of which the last is the common error, whose prior has the same
/// factor √2π.
fn log_volume<T: Real, const N: usize>(filter: &Filter<T>, states: [usize; N]) -> T {
    let covariance: Matrix<T, N> =
        core::array::from_fn(|r| core::array::from_fn(|c| filter.state.covariance(states[r], states[c])));
    let determinant = Ldl::new(covariance).map_or(T::EPSILON, |factors| factors.determinant());
    T::of(0.5) * determinant.ln() + T::count(N - 1) * T::of(HALF_LOG_TURN)
}
