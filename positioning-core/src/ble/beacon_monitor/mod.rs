//! What a tag learns about the listed beacons around it while it runs: the offset of its receiver's RSSI, and whether
//! each beacon is at its listed position. The tag, its simulation and the replays locate themselves with this
//! monitor.
//!
//! Input: the RSSI values of a window, and the tag's position where anchors give one. Output: the position by the
//! RSSI values ([`posterior`]), in the engine's form, and from time to time a [`HealthChange`] of a beacon.
//!
//! A beacon is tested against the position without it. One beacon is tested per window, since each test needs a
//! lattice of its own. An excluded beacon makes no position until it agrees again.

mod history;

pub use history::BeaconHealth;

use heapless::Vec;

use super::offset::ReceiverOffset;
use super::path_loss::Wall;
use super::posterior::{Posterior, PosteriorSettings, posterior, too_loud};
use super::rssi::{BeaconRssi, RssiObservation};
use crate::measurement::BeaconPosition;
use crate::{Area, MAX_ANCHORS, Real, SolveError};
use history::History;

/// The shortest time between the starts of two passes of tests, microseconds.
const PASS_US: u64 = 3_000_000;
/// After the tag has moved this far, metres, the shadows are different …
const SHADOW_M: f32 = 2.0;
/// … and after this time, seconds, because people move.
const SHADOW_S: f32 = 60.0;
/// How far outside the box around the known positions a tag can be, metres.
const MARGIN_M: f32 = 0.5;
/// A beacon is tested against others only if at least this number of others give the position.
const JUDGES: usize = 3;
/// The weight of a test against other beacons, relative to a test against anchors: the path losses of the other
/// beacons are not exact either. With this weight, no beacon is excluded in two recordings with calibrated beacons.
/// With a weight of 1, two of thirteen would be.
const PEERS: f32 = 0.5;

/// The region where a tag can be.
#[derive(Clone, Copy, Debug)]
pub struct Site<'a> {
    /// The box around it.
    pub area: Area<f32, 2>,
    /// The walls that attenuate signals.
    pub walls: &'a [Wall<f32>],
}

impl Site<'_> {
    /// The box around these positions, for a site of which nothing else is known: beacons hang on the walls of the
    /// area that they cover.
    pub fn around(places: impl Iterator<Item = [f32; 2]>) -> Option<Self> {
        let of_one = |place| Area { min: place, max: place };
        let boxed = places.fold(None, |area: Option<Area<f32, 2>>, place| {
            Some(area.map_or(of_one(place), |area| both(&area, &of_one(place))))
        })?;
        let area = Area { min: boxed.min.map(|least| least - MARGIN_M), max: boxed.max.map(|most| most + MARGIN_M) };
        Some(Self { area, walls: &[] })
    }
}

/// The smallest box around two boxes.
fn both(one: &Area<f32, 2>, other: &Area<f32, 2>) -> Area<f32, 2> {
    Area {
        min: core::array::from_fn(|axis| one.min[axis].at_most(other.min[axis])),
        max: core::array::from_fn(|axis| one.max[axis].at_least(other.max[axis])),
    }
}

/// A position that was found without beacons.
#[derive(Clone, Copy, Debug)]
pub struct Known {
    /// The position, metres.
    pub position_m: [f32; 2],
    /// The variance per axis, m².
    pub variance_m2: f32,
}

impl Known {
    /// A box of the same variance.
    fn area(&self) -> Area<f32, 2> {
        let half = Real::sqrt(3.0 * self.variance_m2);
        Area { min: self.position_m.map(|middle| middle - half), max: self.position_m.map(|middle| middle + half) }
    }
}

/// The tag's position by the RSSI values.
#[derive(Clone, Copy, Debug)]
pub struct Located {
    /// The position, in the form that the engine takes.
    pub position: BeaconPosition<f32>,
    /// The RSSI values that made the position: bit i is the window's i-th RSSI.
    pub used: u16,
}

/// A change of a beacon's state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct HealthChange {
    /// The beacon's index in the list.
    pub beacon: usize,
    /// The new state.
    pub health: BeaconHealth,
    /// For how long the beacon's RSSI values have supported the new state, seconds.
    pub seconds: u32,
}

/// What is known of up to `N` listed beacons.
#[derive(Clone, Debug)]
pub struct BeaconMonitor<const N: usize> {
    state: State,
    histories: [History<f32>; N],
}

/// What is known of all beacons together.
#[derive(Clone, Debug)]
struct State {
    receiver: ReceiverOffset<f32>,
    pass: Pass,
    /// The weight of the positions at which the receiver's offset has not yet been learnt.
    due: f32,
    /// The box around all positions that anchors have given the tag. The tag can be there again.
    been: Option<Area<f32, 2>>,
    news: Option<HealthChange>,
}

/// One pass of tests through all beacons.
#[derive(Clone, Copy, Debug)]
struct Pass {
    began_us: u64,
    /// The tag's position at the start of the pass, metres.
    at_m: Option<[f32; 2]>,
    /// The share of the received RSSI values that is new since the last pass, by distance moved and by time.
    weight: f32,
    /// The share that is new by distance moved alone: the fading of the channels changes only with the position.
    moved: f32,
    /// The next beacon to be tested is the one with this index or, if it is not received, the next one after it.
    next: u16,
}

impl<const N: usize> BeaconMonitor<N> {
    /// Assumes that all beacons are at their listed positions, and that the receiver's offset from the calibration's
    /// receiver has the standard deviation `deviation_db`. With 0 there is no offset.
    pub fn new(deviation_db: f32) -> Self {
        let state = State {
            receiver: ReceiverOffset::new(deviation_db),
            pass: Pass { began_us: 0, at_m: None, weight: 1.0, moved: 1.0, next: 0 },
            due: 1.0,
            been: None,
            news: None,
        };
        Self { state, histories: [History::default(); N] }
    }

    /// The receiver's offset.
    pub fn receiver(&self) -> &ReceiverOffset<f32> {
        &self.state.receiver
    }

    /// The state of a beacon; [`BeaconHealth::Agrees`] for one that is not listed.
    pub fn health(&self, beacon: usize) -> BeaconHealth {
        standing(&self.histories, beacon)
    }

    /// The latest change of a beacon's state since the last call.
    pub fn take_news(&mut self) -> Option<HealthChange> {
        self.state.news.take()
    }

    /// The position by the RSSI values of a window, of which the first [`MAX_ANCHORS`] count. `known` is the tag's
    /// position by anchors.
    ///
    /// # Errors
    /// As [`posterior`]; [`SolveError::TooFewAnchors`] also where all received beacons are excluded.
    pub fn locate(
        &mut self,
        now_us: u64,
        window: &[BeaconRssi],
        site: &Site<'_>,
        known: Option<&Known>,
    ) -> Result<Located, SolveError> {
        // Not generic: compiled in this crate, so that it has the optimisation level of this crate and not that of
        // the image.
        self.state.locate(&mut self.histories, now_us, window, site, known)
    }
}

fn standing(histories: &[History<f32>], beacon: usize) -> BeaconHealth {
    histories.get(beacon).map_or(BeaconHealth::Agrees, |record| record.health)
}

impl State {
    #[inline(never)]
    fn locate(
        &mut self,
        histories: &mut [History<f32>],
        now_us: u64,
        window: &[BeaconRssi],
        site: &Site<'_>,
        known: Option<&Known>,
    ) -> Result<Located, SolveError> {
        let belief = PosteriorSettings { offset_deviation: self.receiver.deviation(), ..PosteriorSettings::default() };
        let mut heard: Vec<RssiObservation<f32, 2>, MAX_ANCHORS> = Vec::new();
        let (mut lasting, mut all, mut used) = (0.0, 0.0, 0_u16);
        for (index, rssi, one) in self.believed(histories, window) {
            let stays = rssi.observation.path_loss.deviation.squared();
            lasting += stays;
            all += stays + rssi.noise_db.squared();
            used |= 1 << index;
            // There is room for all.
            let _ = heard.push(one);
        }
        if let Some(Known { position_m, .. }) = known {
            let here = Area { min: *position_m, max: *position_m };
            self.been = Some(self.been.map_or(here, |been| both(&been, &here)));
        }
        let site = &Site { area: self.been.map_or(site.area, |been| both(&been, &site.area)), ..*site };
        let found = posterior(&heard, &site.area, site.walls, &belief);
        let at_m = known.map(|known| known.position_m).or(found.as_ref().ok().map(|found| found.fix.position));
        if let Some(at_m) = at_m {
            self.begin_pass(now_us, at_m);
        }
        self.rate_next(histories, now_us, window, site, known, &belief);
        if self.due >= 1.0 && self.receiver.deviation() > 0.0 {
            let there = known.map(|known| posterior(&heard, &known.area(), site.walls, &belief));
            if let Ok(Posterior { offset, offset_variance, .. }) = there.unwrap_or(found) {
                self.receiver.learn(offset, offset_variance);
                self.due = 0.0;
            }
        }
        let fix = found?.fix;
        let [[xx, xy], [_, yy]] = fix.covariance;
        let lasting = (lasting / all.at_least(f32::EPSILON)).at_most(1.0);
        let position = BeaconPosition { position_m: fix.position, covariance_m2: [xx, xy, yy], lasting };
        Ok(Located { position, used })
    }

    /// The RSSI values that make positions, with their index in the window, and as [`corrected`](Self::corrected)
    /// gives them: the sane RSSI values of the beacons that agree.
    fn believed<'l>(
        &'l self,
        histories: &'l [History<f32>],
        window: &'l [BeaconRssi],
    ) -> impl Iterator<Item = (usize, &'l BeaconRssi, RssiObservation<f32, 2>)> {
        let agrees = |(_, rssi): &(usize, &BeaconRssi)| standing(histories, rssi.beacon.into()) == BeaconHealth::Agrees;
        let counted = window.iter().enumerate().take(MAX_ANCHORS).filter(agrees);
        counted.map(|(index, rssi)| (index, rssi, self.corrected(rssi))).filter(|(_, _, one)| one.is_sane())
    }

    /// An RSSI as the calibration's receiver would measure it, with its whole deviation.
    #[inline(never)]
    fn corrected(&self, rssi: &BeaconRssi) -> RssiObservation<f32, 2> {
        let mut heard = rssi.observation;
        heard.rssi_dbm = self.receiver.correct(heard.rssi_dbm);
        heard.path_loss.deviation = Real::sqrt(heard.path_loss.deviation.squared() + rssi.noise_db.squared());
        heard
    }

    /// Begins the next pass, if enough time has gone by since the last one began.
    fn begin_pass(&mut self, now_us: u64, at_m: [f32; 2]) {
        let since_us = now_us.saturating_sub(self.pass.began_us);
        let mut moved = 1.0;
        let weight = match self.pass.at_m {
            None => 1.0,
            Some(_) if since_us < PASS_US => return,
            Some(last) => {
                let way = Real::sqrt((at_m[0] - last[0]).squared() + (at_m[1] - last[1]).squared());
                let seconds = f32::count(since_us.min(3_600_000_000) as usize) * 1.0e-6;
                moved = (way * (1.0 / SHADOW_M)).at_most(1.0);
                (moved + seconds * (1.0 / SHADOW_S)).at_most(1.0)
            }
        };
        self.due += weight;
        self.pass = Pass { began_us: now_us, at_m: Some(at_m), weight, moved, next: 0 };
    }

    /// Tests the next of the received beacons.
    #[inline(never)]
    fn rate_next(
        &mut self,
        histories: &mut [History<f32>],
        now_us: u64,
        window: &[BeaconRssi],
        site: &Site<'_>,
        known: Option<&Known>,
        belief: &PosteriorSettings<f32>,
    ) {
        let next = self.pass.next;
        let candidates = window.iter().enumerate().take(MAX_ANCHORS).filter(|(_, rssi)| rssi.beacon >= next);
        let Some((index, rssi)) = candidates.min_by_key(|(_, rssi)| rssi.beacon) else { return };
        self.pass.next = rssi.beacon.saturating_add(1);
        let one = self.corrected(rssi);
        // A test against anchors needs no other beacons. The uncertainty of the receiver's offset still counts.
        let off = match known {
            Some(known) => too_loud(&one, &[], &known.area(), site.walls, belief),
            None => {
                let others = self.believed(histories, window).filter(|(other, _, _)| *other != index);
                let others: Vec<RssiObservation<f32, 2>, MAX_ANCHORS> = others.map(|(_, _, one)| one).collect();
                if others.len() < JUDGES {
                    return;
                }
                // The test of one beacon does not depend on how many others share a shadow.
                too_loud(&one, &others, &site.area, site.walls, &PosteriorSettings { trust: 1.0, ..*belief })
            }
        };
        let (Some([excess, variance]), Some(record)) = (off, histories.get_mut(usize::from(rssi.beacon))) else {
            return;
        };
        // While a tag does not move, the RSSI values of three channels may differ as much as those of two senders.
        let weight = if rssi.is_torn { self.pass.moved } else { self.pass.weight };
        let weight = if known.is_some() { weight } else { weight * PEERS };
        let change = record.take(now_us, excess.squared() / variance, rssi.is_torn, weight);
        let Some((standing, seconds)) = change else { return };
        self.news = Some(HealthChange { beacon: rssi.beacon.into(), health: standing, seconds });
        if known.is_none() {
            // An error that this beacon caused does not count against the others.
            histories.iter_mut().for_each(History::clear_suspicion);
        }
    }
}
