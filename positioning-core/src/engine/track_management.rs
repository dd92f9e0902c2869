//! Track management at the end of a round: a track is started, checked or given up, or the round is solved by itself.

use super::round::Round;
use super::{Engine, HeightSource, Missing, Mode, Output, Settings, Start, TrackFix, Verdict};
use crate::linalg::distance_squared;
use crate::measurement::Observation as _;
use crate::track::{Blocked, Filter};
use crate::{Fix, MAX_ANCHORS, Real};

/// The factor on the variance of a track's first position, relative to the solver's. The same ranges will enter the
/// track, and must not count twice.
const START_DOUBT: f64 = 9.0;
/// A further deviation of the first position, metres.
const START_SIGMA_M: f64 = 0.3;
/// The multiplied deviation of an axis is limited to about this, metres.
const START_GREATEST_M: f64 = 1.0;

/// The number of sweeps over the links of a new track.
const SWEEPS: usize = 2;

/// A track that is more uncertain than this, metres, all axes together, is vague.
const VAGUE_M: f64 = 1.5;
/// The greatest distance, in joint deviations, at which the track and a position may be the same.
const AGREES: f64 = 4.0;

impl<T: Real> Engine<T> {
    #[inline(never)]
    pub(super) fn end_round(&mut self) -> Output<T> {
        let mut output = match self.settings.mode {
            Mode::Solve => Output { verdict: Verdict::Concluded, fix: self.solved() },
            Mode::Track if self.track.is_err() => self.begin(),
            Mode::Track => self.update_track(),
        };
        if self.track.is_ok()
            && let Ok(fix) = &mut output.fix
        {
            self.flag = self.doubt();
            fix.flag = self.flag;
        }
        // Where single ranges come one by one, those of the last second make a round together.
        if self.settings.mode == Mode::Solve || self.round.is_complete(&self.settings.dimensions) {
            self.round.clear();
        } else {
            self.round.end();
        }
        output
    }

    /// The position of the round by itself.
    fn solved(&mut self) -> Result<TrackFix<T>, Missing> {
        self.alternative = None;
        let fix = self.round.solve(&self.settings).map_err(Missing::SolveError)?;
        let Fix { position, covariance, used, quality, alternative, .. } = fix;
        self.alternative = alternative;
        let flag = fix.flag(self.round.ranges().count());
        Ok(TrackFix { position, velocity: [T::ZERO; 3], covariance, used, quality, age_us: 0, flag })
    }

    /// Starts a track from the round.
    #[inline(never)]
    fn begin(&mut self) -> Output<T> {
        match self.round.solve(&self.settings) {
            Ok(fix) => {
                let start = self.start_track(&fix);
                Output { verdict: Verdict::Started(start), fix: self.fix() }
            }
            Err(reason) => Output { verdict: Verdict::Concluded, fix: Err(Missing::SolveError(reason)) },
        }
    }

    /// Starts a track at a solved position with the round's measurements.
    fn start_track(&mut self, fix: &Fix<T, 3>) -> Start {
        let start = self.forget_former_track();
        let (likelier, other) = fix.places();
        begin(&mut self.filter, &likelier, &self.round, &self.settings, self.now_us);
        self.round.count_all();
        match other {
            Some((other, share)) => self.add_rival(&other, share),
            None => self.start_mirror_image(),
        }
        self.take_height(&likelier);
        self.apply_beacon_position();
        start
    }

    /// Whether the track is too uncertain to linearise ranges about it one by one. This is the case among beacons:
    /// the first range would move the track away from the position where the ranges meet. Such a round is solved
    /// first.
    pub(super) fn is_vague(&self) -> bool {
        self.filter.state.spread() > T::of(VAGUE_M * VAGUE_M)
    }

    /// Whether the round's own position is more certain than the track, and may be the same.
    fn agrees(&self, fix: &Fix<T, 3>) -> bool {
        let (spread, variance) = (self.filter.state.spread(), fix.spread());
        let square = distance_squared(&self.filter.state.position(), &fix.position);
        variance < spread && square <= T::of(AGREES * AGREES) * (spread + variance)
    }

    /// Gives the round's ranges to the track.
    fn check_ranges(&mut self) {
        for index in 0..MAX_ANCHORS {
            if let Some((place, range)) = self.round.given_range(index) {
                self.check_range(&range, place);
            }
        }
    }

    /// Gives the position by beacons to the track, if the round has one.
    fn apply_beacon_position(&mut self) {
        if let (Some(position), Some(_)) = (self.round.by_beacons, self.settings.dimensions.height()) {
            let result = self.apply(&position);
            self.conclude(result, None);
        }
    }

    /// Gives the least blocked of the ignored ranges to the track, if the settings keep some per round.
    fn apply_min_anchors(&mut self) {
        let Blocked::Ignore { threshold, at_least } = self.settings.filter.blocked else { return };
        let more = self.round.least_blocked_beyond(threshold, at_least.into());
        for index in (0..MAX_ANCHORS).filter(|index| more >> index & 1 == 1) {
            if let Some((place, range)) = self.round.given_range(index) {
                self.track_range(&range, place);
            }
        }
    }

    /// Ends a round with a track.
    #[inline(never)]
    fn update_track(&mut self) -> Output<T> {
        if core::mem::take(&mut self.round.waits) {
            if let Ok(fix) = self.round.solve(&self.settings)
                && self.agrees(&fix)
            {
                self.start_track(&fix);
                return Output { verdict: Verdict::Concluded, fix: self.fix() };
            }
            self.check_ranges();
        }
        self.apply_min_anchors();
        self.apply_beacon_position();
        if self.settings.supervised
            && self.round.is_complete(&self.settings.dimensions)
            && let Some(start) = self.compare()
        {
            self.used_us = self.now_us;
            return Output { verdict: Verdict::Started(start), fix: self.fix() };
        }
        if self.height.is_asked()
            && let Ok(fix) = self.round.solve(&self.settings)
        {
            self.take_height(&fix);
        }
        Output { verdict: Verdict::Concluded, fix: self.fix() }
    }

    /// Gives the height of a solved round to the track, where ranges alone do not determine it.
    fn take_height(&mut self, fix: &Fix<T, 3>) {
        if self.settings.dimensions.height().is_none()
            && self.round.ranges().next().is_some()
            && let Some(height) = self.height.of(fix)
        {
            self.apply(&height);
        }
    }

    /// Drops what the engine has learnt along a former track.
    fn forget_former_track(&mut self) -> Start {
        self.height = HeightSource::new();
        self.rival.end();
        self.track = Ok(());
        self.used_us = self.now_us;
        self.next_start
    }
}

/// Begins a filter at a solved position with a round's measurements, and stays within the position's deviation: where
/// the links lead elsewhere, the solver has weighed more possibilities than a filter follows.
#[inline(never)]
pub(super) fn begin<T: Real>(
    filter: &mut Filter<T>,
    fix: &Fix<T, 3>,
    round: &Round<T>,
    settings: &Settings<T>,
    now_us: u64,
) {
    // Where the solver did not know on which side of the anchors the tag is, its covariance reaches to the other side.
    // The track is on this side. An uncertainty of metres would make its first linearisations wrong.
    let greatest = (0..3).fold(T::ZERO, |greatest, axis| greatest.at_least(fix.covariance[axis][axis]));
    let doubt = T::of(START_DOUBT).at_most(T::of(START_GREATEST_M * START_GREATEST_M) / greatest);
    let wide: [[T; 3]; 3] = core::array::from_fn(|r| {
        core::array::from_fn(|c| {
            let on_diagonal = if r == c { T::ONE } else { T::ZERO };
            match settings.start_variance {
                Some(variance) => variance * on_diagonal,
                None => doubt * fix.covariance[r][c] + T::of(START_SIGMA_M * START_SIGMA_M) * on_diagonal,
            }
        })
    });
    begin_with(filter, fix, &wide, round, settings, now_us);
    let square = distance_squared(&filter.state.position(), &fix.position);
    if square > fix.spread() && settings.start_variance.is_none() {
        begin_with(filter, fix, &fix.covariance, round, settings, now_us);
    }
}

/// The same from a position with this covariance.
///
/// The solver knows which links are probably blocked. So the links get their priors by their residuals at the position
/// first. Then the position gets the covariance, which is greater than the solver's, since the same ranges must not
/// count twice. The ranges determine it again, with the errors of their links. Some sweeps over the links make priors
/// and position agree.
#[inline(never)]
fn begin_with<T: Real>(
    filter: &mut Filter<T>,
    fix: &Fix<T, 3>,
    covariance: &[[T; 3]; 3],
    round: &Round<T>,
    settings: &Settings<T>,
    now_us: u64,
) {
    let lasts = settings.filter.noise.lasts();
    filter.start(now_us, fix.position, &fix.covariance, settings.height(), &settings.filter);
    for range in round.ranges().filter(|range| lasts && settings.admits(range.p_nlos)) {
        filter.prepare_range(range, &settings.filter);
    }
    filter.set_position(fix.position, covariance);
    for range in round.ranges().filter(|range| settings.admits(range.p_nlos)) {
        range.update(filter, &settings.filter);
    }
    for _ in 0..if lasts { SWEEPS } else { 0 } {
        for range in round.ranges().filter(|range| settings.admits(range.p_nlos)) {
            filter.refresh_range(range, &settings.filter);
        }
    }
    for tdoa in round.tdoas.iter().filter(|tdoa| settings.admits_difference(tdoa)) {
        tdoa.update(filter, &settings.filter);
    }
    filter.log_evidence = T::ZERO;
}
