//! Methods with memory over captures: the tag's own locator, and the particle filter, both window by window.

use positioning_core::ble::beacon_monitor::{HealthChange, Site};
use positioning_core::ble::particles::{self, Likelihood, ON_HOST, ParticleFilter};
use positioning_core::ble::posterior::PosteriorSettings;
use positioning_core::ble::rssi::RssiLikelihood;
use positioning_core::ble::signal::{BeaconList, Kalman, ListedBeacon, Smoothing, Step, rssi};
use positioning_core::locator::{self, Locator};
use positioning_core::{Area, SolveError};

use super::walk_clock::{WalkClock, is_stay, span_s};
use super::{MOST_BEACONS, Solver, loudest};
use recording::beacons::{Capture, Sample};
use recording::{NoPosition, Position};

/// The time of the start of the first capture, microseconds. It is large so that slightly earlier times are not
/// negative.
const BEGIN_US: u64 = 3_600_000_000;
/// The time between two dwells, microseconds. It is long enough that a track ends; the estimates of the receiver's
/// offset and of the beacons are kept.
const BETWEEN_US: u64 = 60_000_000;
/// After this number of windows without an advertisement, the rest of a pause is one window. This limits the work,
/// because a file may have any span of times.
const PAUSE: usize = 20;
/// RSSI values of a walk's scans within this time count together as one scan, seconds: shadowing changes with the
/// position. All scans of a stay are one, which counts as for the posterior.
const SHADOW_S: f32 = 5.0;
/// The growth of the variance of the receiver's offset, dB² per second: in an hour as much as receivers differ, 4 dB.
const DRIFT_DB2_S: f32 = 16.0 / 3600.0;
/// The RSSI at one metre that a beacon reports, where the file does not give it, dBm. This is the usual setting of
/// iBeacons at 0 dBm.
const USUAL_DBM: i8 = -59;
/// The maximum number of advertisements of a beacon in a window. Of a beacon with more, the latest are used.
const INTEGRATED: usize = 14;

const NONE_YET: NoPosition = NoPosition::SolveError(SolveError::TooFewAnchors);

/// Converts the files' times to microseconds.
struct Clock {
    begin_us: u64,
    /// The first time, in the files' time, seconds.
    first_s: Option<f64>,
    /// The latest time, microseconds.
    now_us: u64,
}

impl Clock {
    fn new() -> Self {
        Self { begin_us: BEGIN_US, first_s: None, now_us: BEGIN_US }
    }

    /// Begins a dwell: the next capture has a time of its own.
    fn begin_stay(&mut self) {
        (self.begin_us, self.first_s) = (self.now_us.saturating_add(BETWEEN_US), None);
    }

    fn microseconds(&mut self, t_s: f64) -> u64 {
        let first_s = *self.first_s.get_or_insert(t_s);
        // The conversion saturates: a float that is too large or negative becomes the largest or the least integer.
        let now_us = self.begin_us.saturating_add_signed(((t_s - first_s) * 1.0e6) as i64);
        self.now_us = self.now_us.max(now_us);
        now_us
    }
}

/// The samples of a capture in the order of time.
fn in_time(capture: &Capture) -> Vec<&Sample> {
    let mut samples: Vec<&Sample> = capture.samples.iter().collect();
    samples.sort_by(|a, b| a.t_s.total_cmp(&b.t_s));
    samples
}

/// The beacons as a tag's config record lists them.
pub(super) fn listed(solver: &Solver) -> Vec<ListedBeacon> {
    let beacons = solver.beacons.iter().map(|beacon| {
        let [x, y] = solver.local(beacon.position_m);
        let above_m = solver.above_m(beacon);
        let [rssi_1m_dbm, path_loss_exponent] =
            [beacon.rssi_1m_dbm, beacon.path_loss_exponent].map(|known| known.map(|known| known as f32));
        ListedBeacon { position_m: [x, y, above_m], rssi_1m_dbm, path_loss_exponent }
    });
    beacons.collect()
}

/// The tag's locator, fed with captures.
pub(super) struct Tag<'a> {
    solver: &'a Solver<'a>,
    locator: Box<Locator<'a, MOST_BEACONS>>,
    clock: Clock,
    /// The changes of the beacons' health, in order.
    pub(super) news: Vec<HealthChange>,
}

impl<'a> Tag<'a> {
    /// A locator without any received advertisement.
    pub(super) fn new(solver: &'a Solver<'a>, list: &'a dyn BeaconList) -> Self {
        let walls = solver.attenuating();
        let is_bounded = solver.setup.area_m.is_some() || !walls.is_empty();
        let settings = locator::Settings {
            site: is_bounded.then(|| Site { area: solver.reach(), walls }),
            receiver_db: solver.setup.offset_db as f32,
            window_us: (solver.setup.window_s * 1.0e6) as u64,
            ..locator::Settings::tag(Some(0.0)).with_beacons(list)
        };
        Self { solver, locator: Box::new(Locator::new(settings)), clock: Clock::new(), news: Vec::new() }
    }

    /// Processes a capture. Returns the position of its last window.
    pub(super) fn follow(&mut self, capture: &Capture) -> Result<Position, NoPosition> {
        if capture.is_stay {
            self.clock.begin_stay();
        }
        let mut position = Err(NONE_YET);
        for sample in in_time(capture) {
            let now_us = self.clock.microseconds(sample.t_s);
            self.end_windows(now_us, &mut position);
            if let Some(beacon) = self.solver.beacons.iter().position(|beacon| beacon.name == sample.beacon) {
                self.locator.advertisement(now_us, beacon, sample.rssi_dbm as f32, USUAL_DBM);
            }
        }
        if let Some(end_us) = self.locator.window_end_us() {
            self.end_window(end_us, &mut position);
        }
        position
    }

    /// Ends the windows that end up to `now_us`.
    fn end_windows(&mut self, now_us: u64, position: &mut Result<Position, NoPosition>) {
        for k in 0..=PAUSE {
            let Some(end_us) = self.locator.window_end_us().filter(|end_us| *end_us <= now_us) else { return };
            self.end_window(if k < PAUSE { end_us } else { now_us }, position);
        }
    }

    fn end_window(&mut self, end_us: u64, position: &mut Result<Position, NoPosition>) {
        if let Some(update) = self.locator.end_window(end_us) {
            *position = update.position().map_err(NoPosition::SolveError).map(|found| {
                let ([x, y, _], covariance) = (found.position_m, found.covariance_m2);
                let covariance = [0, 1].map(|row: usize| [covariance[row][0], covariance[row][1]]);
                self.solver.global([x, y], &covariance, found.used.count_ones() as usize)
            });
        }
        self.news.extend(self.locator.take_beacon_news());
    }
}

/// The latest RSSI values of one beacon, smoothed (section 3.4.1.2 of A. Linde Cerezo's thesis, Universitat Oberta de
/// Catalunya, 2024), and averaged over a window (equation 14 of the thesis).
#[derive(Clone, Default)]
struct Smoothed {
    kalman: Kalman<f32>,
    latest: Vec<(u64, f32)>,
    next: usize,
}

impl Smoothed {
    fn receive(&mut self, now_us: u64, rssi_dbm: f32, window_us: u64) {
        let Ok(rssi_dbm) = rssi(rssi_dbm) else { return };
        if now_us.saturating_sub(self.kalman.heard_us()) > window_us.saturating_mul(10) {
            self.kalman = Kalman::default();
        }
        if self.kalman.receive(now_us, rssi_dbm, &Smoothing::default()) == Step::Started {
            (self.latest, self.next) = (Vec::new(), 0);
        }
        let heard = (now_us, self.kalman.rssi().unwrap_or(rssi_dbm));
        match self.latest.get_mut(self.next) {
            Some(oldest) => *oldest = heard,
            None => self.latest.push(heard),
        }
        self.next = (self.next + 1) % INTEGRATED;
    }

    fn mean(&self, now_us: u64, window_us: u64) -> Option<f32> {
        let since_us = now_us.saturating_sub(window_us);
        let within: Vec<f32> = self
            .latest
            .iter()
            .filter(|(at_us, _)| (since_us..=now_us).contains(at_us))
            .map(|(_, rssi)| *rssi)
            .collect();
        (!within.is_empty()).then(|| within.iter().sum::<f32>() / within.len() as f32)
    }
}

/// The particle filter, fed with captures. Each particle has its own estimate of the receiver's offset.
pub(super) struct Particles<'a> {
    solver: &'a Solver<'a>,
    beacons: Vec<Smoothed>,
    filter: Box<ParticleFilter<f32, ON_HOST>>,
    /// The mean of the offset with which particles start, dB.
    offset_db: f32,
    /// The variance of the offset of a particle, dB², and of that of all particles.
    variances_db2: [f32; 2],
    walk: WalkClock,
    /// The time in which RSSI values count as one scan, seconds.
    shadow_s: f32,
    /// When the last walk or stay ended, and the last window of this one.
    begin_us: u64,
    window_end_us: Option<u64>,
}

impl<'a> Particles<'a> {
    /// A filter without any received advertisement.
    pub(super) fn new(solver: &'a Solver<'a>) -> Self {
        Self {
            solver,
            beacons: vec![Smoothed::default(); solver.beacons.len()],
            filter: Box::new(ParticleFilter::new(particles::Settings::walking(), solver.setup.seed)),
            offset_db: 0.0,
            variances_db2: [(solver.setup.offset_db as f32).powi(2); 2],
            walk: WalkClock::default(),
            shadow_s: SHADOW_S,
            begin_us: BEGIN_US,
            window_end_us: None,
        }
    }

    /// Processes a capture, window by window, without the windows that received nothing. Returns the last position: of
    /// a stay, whose particles do not move, it is the position by all its windows.
    pub(super) fn follow(&mut self, capture: &Capture) -> Result<Position, NoPosition> {
        let (end_us, goes_on) = self.walk.next(capture);
        if !goes_on {
            self.start(capture);
        }
        let samples = in_time(capture);
        let (Some(first), Some(last)) = (samples.first(), samples.last()) else { return Err(NONE_YET) };
        let (first_s, last_s, window_s) = (first.t_s, last.t_s, self.solver.setup.window_s);
        let window_us = (window_s * 1.0e6) as u64;
        // The conversion saturates: a negative float becomes 0.
        let end_us = self.begin_us.saturating_add(end_us);
        let clock = |t_s: f64| end_us.saturating_sub(((last_s - t_s) * 1.0e6) as u64);
        let window = |sample: &Sample| ((sample.t_s - first_s) / window_s).floor();
        let mut position = Err(NONE_YET);
        for samples in samples.chunk_by(|a, b| window(a) == window(b)) {
            for sample in samples {
                let now_us = clock(sample.t_s);
                if let Some(beacon) = self.solver.beacons.iter().position(|beacon| beacon.name == sample.beacon) {
                    self.beacons[beacon].receive(now_us, sample.rssi_dbm as f32, window_us);
                }
            }
            let end_s = samples.last().map_or(last_s, |sample| first_s + (window(sample) + 1.0) * window_s);
            let now_us = clock(end_s.min(last_s));
            let scan: Vec<Option<f32>> = self.beacons.iter().map(|beacon| beacon.mean(now_us, window_us)).collect();
            position = self.step(now_us, &scan);
        }
        position
    }

    /// Begins a walk or a stay at an unknown position: the receiver's offset is kept.
    fn start(&mut self, capture: &Capture) {
        self.begin_us = self.window_end_us.map_or(BEGIN_US, |end_us| end_us.saturating_add(BETWEEN_US));
        self.window_end_us = None;
        let settings = if is_stay(capture) {
            let lasting_s = span_s(capture).map_or(0.0, |(first_s, last_s)| last_s - first_s);
            self.shadow_s = lasting_s as f32 / PosteriorSettings::<f32>::default().trust;
            particles::Settings::staying()
        } else {
            self.shadow_s = SHADOW_S;
            particles::Settings::walking()
        };
        *self.filter = ParticleFilter::new(settings, self.solver.setup.seed);
        self.filter.start_in(&self.solver.reach());
        self.filter.set_offset(self.offset_db);
        self.variances_db2[0] = self.variances_db2[1];
        self.beacons.fill(Smoothed::default());
    }

    fn step(&mut self, now_us: u64, scan: &[Option<f32>]) -> Result<Position, NoPosition> {
        let mut heard = self.solver.heard(scan);
        loudest(&mut heard);
        if heard.is_empty() {
            return Err(NONE_YET);
        }
        let window_us = (self.solver.setup.window_s * 1.0e6) as u64;
        let before_us = self.window_end_us.unwrap_or(now_us.saturating_sub(window_us));
        self.window_end_us = Some(now_us);
        let passed_s = now_us.saturating_sub(before_us) as f32 * 1.0e-6;
        let [variance, _] = self.variances_db2;
        let variance = if variance > 0.0 { variance + DRIFT_DB2_S * passed_s } else { 0.0 };
        let trust = (passed_s / self.shadow_s).min(1.0);
        let rssis = RssiLikelihood::of(&heard, variance.sqrt(), trust).through(self.solver.attenuating());
        let likelihood = Within { reach: self.solver.reach(), rssis: &rssis };
        let estimate = self.filter.step(now_us, &self.solver.walls, &likelihood);
        let estimate = estimate.ok_or(NoPosition::SolveError(SolveError::Diverged))?;
        let [offset_db, among] = estimate.offset;
        self.offset_db = offset_db;
        let left = if trust > 0.0 { rssis.offset_variance() } else { variance };
        self.variances_db2 = [left, left + among];
        Ok(self.solver.global(estimate.position, &estimate.covariance, heard.len()))
    }
}

/// The likelihood of positions in an area.
struct Within<'a> {
    reach: Area<f32, 2>,
    rssis: &'a RssiLikelihood<'a, f32>,
}

impl Likelihood<f32> for Within<'_> {
    fn ln_at(&self, at: [f32; 2]) -> f32 {
        self.update(at, &mut 0.0)
    }

    fn update(&self, at: [f32; 2], offset: &mut f32) -> f32 {
        let within = (0..2).all(|axis| (self.reach.min[axis]..=self.reach.max[axis]).contains(&at[axis]));
        if within { self.rssis.update(at, offset) } else { f32::NAN }
    }
}
