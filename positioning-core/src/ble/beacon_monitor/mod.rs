//! What a tag knows of the listed beacons around it, learnt as it goes: what its receiver reads too loud, and whether each beacon is
//! where it is listed. The tag, its simulation and the replays find themselves by this one.
//!
//! The RSSI values of a window flow in, with the tag's position where anchors give one; out flows the position by the RSSI values
//! ([`posterior`]), as the engine wants it, and now and then [`HealthChange`] of a beacon. A beacon is judged by the position without it, one of them a
//! window, since that takes a lattice of its own; what is doubted makes no position until it agrees again.

mod history;

pub use history::BeaconHealth;

use heapless::Vec;

use super::multilateration::Heard;
use super::offset::ReceiverOffset;
use super::path_loss::Wall;
use super::posterior::{Posterior, PosteriorSettings, posterior, too_loud};
use crate::engine::BeaconPosition;
use crate::{Area, MAX_ANCHORS, Real, SolveError};
use history::History;

/// Beacons are judged no sooner again, microseconds.
const PASS_US: u64 = 3_000_000;
/// After so many metres of way the shadows are others …
const SHADOW_M: f64 = 2.0;
/// … and after so many seconds: people move.
const SHADOW_S: f64 = 60.0;
/// A tag may be so far outside of the box around all that stands, metres.
const MARGIN_M: f64 = 0.5;
/// A position that so few others give judges nobody.
const JUDGES: usize = 3;
/// What others say of a beacon counts so much beside what anchors say: their own path losses are not quite right either. Over two
/// recordings with calibrated beacons none is named by it, two of thirteen would be by 1.
const PEERS: f64 = 0.5;

/// The RSSI of a beacon in a window.
#[derive(Clone, Copy, Debug)]
pub struct Level<T> {
    /// Its place in the list.
    pub beacon: usize,
    /// The RSSI, and the beacon's path loss; its deviation is of what stays with the place.
    pub heard: Heard<T, 2>,
    /// The deviation of the RSSI by noise, dB.
    pub noise: T,
    /// It jumps about as the RSSI values of two senders do.
    pub is_torn: bool,
}

/// Where a tag can be.
#[derive(Clone, Copy, Debug)]
pub struct Site<'a, T> {
    /// The box around it.
    pub area: Area<T, 2>,
    /// What takes something from a signal.
    pub walls: &'a [Wall<T>],
}

impl<T: Real> Site<'_, T> {
    /// The box around all that stands in a place of which nothing else is known: beacons hang on the walls of what they cover.
    pub fn around(places: impl Iterator<Item = [T; 2]>) -> Option<Self> {
        let of_one = |place| Area { min: place, max: place };
        let boxed = places.fold(None, |area: Option<Area<T, 2>>, place| {
            Some(area.map_or(of_one(place), |area| both(&area, &of_one(place))))
        })?;
        let margin = T::of(MARGIN_M);
        let area = Area { min: boxed.min.map(|least| least - margin), max: boxed.max.map(|most| most + margin) };
        Some(Self { area, walls: &[] })
    }
}

/// The box around two.
fn both<T: Real>(one: &Area<T, 2>, other: &Area<T, 2>) -> Area<T, 2> {
    Area {
        min: core::array::from_fn(|axis| one.min[axis].at_most(other.min[axis])),
        max: core::array::from_fn(|axis| one.max[axis].at_least(other.max[axis])),
    }
}

/// A position that beacons have not made.
#[derive(Clone, Copy, Debug)]
pub struct Known<T> {
    /// Metres.
    pub position: [T; 2],
    /// Variance of an axis, m².
    pub variance: T,
}

impl<T: Real> Known<T> {
    /// As a box of the same variance.
    fn area(&self) -> Area<T, 2> {
        let half = (T::of(3.0) * self.variance).sqrt();
        Area { min: self.position.map(|middle| middle - half), max: self.position.map(|middle| middle + half) }
    }
}

/// Where the RSSI values have a tag.
#[derive(Clone, Copy, Debug)]
pub struct Located<T> {
    /// For the engine.
    pub position: BeaconPosition<T>,
    /// What made it: bit i is the window's i-th RSSI.
    pub used: u16,
}

/// Something else is believed of a beacon from now on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct HealthChange {
    /// Its place in the list.
    pub beacon: usize,
    /// What is believed.
    pub health: BeaconHealth,
    /// For how long its RSSI values have told so, seconds.
    pub seconds: u32,
}

/// What is known of up to `N` listed beacons.
#[derive(Clone, Debug)]
pub struct BeaconMonitor<T, const N: usize> {
    receiver: ReceiverOffset<T>,
    histories: [History<T>; N],
    pass: Pass<T>,
    /// Places that the receiver's offset has not been learnt at.
    due: T,
    /// The box around all places that anchors have had the tag at: where it was, it can be.
    been: Option<Area<T, 2>>,
    news: Option<HealthChange>,
}

/// Once through all beacons.
#[derive(Clone, Copy, Debug)]
struct Pass<T> {
    began_us: u64,
    /// Where it began, metres.
    at: Option<[T; 2]>,
    /// How much of what is heard was not heard in the last one.
    weight: T,
    /// The same for what only another place changes: how channels fade.
    moved: T,
    /// The next beacon to be judged is this one, or one after it.
    next: usize,
}

/// Listed beacons of a node.
pub const ON_NODE: usize = 24;

impl BeaconMonitor<f32, ON_NODE> {
    /// [`locate`](Self::locate), compiled in this crate, as [`Engine::step_on_node`](crate::engine::Engine::step_on_node) is.
    ///
    /// # Errors
    /// The same.
    #[inline(never)]
    pub fn locate_on_node(
        &mut self,
        now_us: u64,
        rssis: &[Level<f32>],
        site: &Site<'_, f32>,
        known: Option<&Known<f32>>,
    ) -> Result<Located<f32>, SolveError> {
        self.locate(now_us, rssis, site, known)
    }
}

impl<T: Real, const N: usize> BeaconMonitor<T, N> {
    /// All are where they are listed, and the receiver is as the calibration's, give or take `deviation` dB; 0: it is.
    pub fn new(deviation: T) -> Self {
        Self {
            receiver: ReceiverOffset::new(deviation),
            histories: [History::default(); N],
            pass: Pass { began_us: 0, at: None, weight: T::ONE, moved: T::ONE, next: 0 },
            due: T::ONE,
            been: None,
            news: None,
        }
    }

    /// What the receiver reads too loud.
    pub fn receiver(&self) -> &ReceiverOffset<T> {
        &self.receiver
    }

    /// What is believed of a beacon; nothing bad of one that is not listed.
    pub fn health(&self, beacon: usize) -> BeaconHealth {
        self.histories.get(beacon).map_or(BeaconHealth::Agrees, |record| record.health)
    }

    /// What is new of a beacon since it was asked last.
    pub fn take_news(&mut self) -> Option<HealthChange> {
        self.news.take()
    }

    /// The position by the RSSI values of a window, of which the first [`MAX_ANCHORS`] count. `known` is where anchors have the tag.
    ///
    /// # Errors
    /// As [`posterior`]; [`SolveError::TooFewAnchors`] also where all that are heard are doubted.
    #[inline(never)]
    pub fn locate(
        &mut self,
        now_us: u64,
        rssis: &[Level<T>],
        site: &Site<'_, T>,
        known: Option<&Known<T>>,
    ) -> Result<Located<T>, SolveError> {
        let belief = PosteriorSettings { offset_deviation: self.receiver.deviation(), ..PosteriorSettings::default() };
        let mut heard: Vec<Heard<T, 2>, MAX_ANCHORS> = Vec::new();
        let (mut lasting, mut all, mut used) = (T::ZERO, T::ZERO, 0_u16);
        for (place, rssi, one) in self.believed(rssis) {
            let stays = rssi.heard.path_loss.deviation.squared();
            lasting += stays;
            all += stays + rssi.noise.squared();
            used |= 1 << place;
            // There is room for all.
            let _ = heard.push(one);
        }
        if let Some(Known { position, .. }) = known {
            let here = Area { min: *position, max: *position };
            self.been = Some(self.been.map_or(here, |been| both(&been, &here)));
        }
        let site = &Site { area: self.been.map_or(site.area, |been| both(&been, &site.area)), ..*site };
        let found = posterior(&heard, &site.area, site.walls, &belief);
        let at = known.map(|known| known.position).or(found.as_ref().ok().map(|found| found.fix.position));
        if let Some(at) = at {
            self.update_track(now_us, at);
        }
        self.judge_next(now_us, rssis, site, known, &belief);
        if self.due >= T::ONE && self.receiver.deviation() > T::ZERO {
            let there = known.map(|known| posterior(&heard, &known.area(), site.walls, &belief));
            if let Ok(Posterior { offset, offset_variance, .. }) = there.unwrap_or(found) {
                self.receiver.learn(offset, offset_variance);
                self.due = T::ZERO;
            }
        }
        let fix = found?.fix;
        let [[xx, xy], [_, yy]] = fix.covariance;
        let lasting = (lasting / all.at_least(T::EPSILON)).at_most(T::ONE);
        Ok(Located { position: BeaconPosition { position: fix.position, covariance: [xx, xy, yy], lasting }, used })
    }

    /// The RSSI values that make positions, with their places in the window and as [`corrected`](Self::corrected): sane ones, of beacons that
    /// agree.
    fn believed<'l>(&'l self, rssis: &'l [Level<T>]) -> impl Iterator<Item = (usize, &'l Level<T>, Heard<T, 2>)> {
        let agrees = |(_, rssi): &(usize, &Level<T>)| self.health(rssi.beacon) == BeaconHealth::Agrees;
        let counted = rssis.iter().enumerate().take(MAX_ANCHORS).filter(agrees);
        counted.map(|(place, rssi)| (place, rssi, self.corrected(rssi))).filter(|(_, _, one)| one.is_sane())
    }

    /// An RSSI as the calibration's receiver would have it, with all of its deviation.
    #[inline(never)]
    fn corrected(&self, rssi: &Level<T>) -> Heard<T, 2> {
        let mut heard = rssi.heard;
        heard.rssi = self.receiver.correct(heard.rssi);
        heard.path_loss.deviation = (heard.path_loss.deviation.squared() + rssi.noise.squared()).sqrt();
        heard
    }

    /// Begins the next pass where the last one has ended.
    fn update_track(&mut self, now_us: u64, at: [T; 2]) {
        let since_us = now_us.saturating_sub(self.pass.began_us);
        let mut moved = T::ONE;
        let weight = match self.pass.at {
            None => T::ONE,
            Some(_) if since_us < PASS_US => return,
            Some(last) => {
                let way = ((at[0] - last[0]).squared() + (at[1] - last[1]).squared()).sqrt();
                let seconds = T::count(since_us.min(3_600_000_000) as usize) * T::of(1.0e-6);
                moved = (way * T::of(1.0 / SHADOW_M)).at_most(T::ONE);
                (moved + seconds * T::of(1.0 / SHADOW_S)).at_most(T::ONE)
            }
        };
        self.due += weight;
        self.pass = Pass { began_us: now_us, at: Some(at), weight, moved, next: 0 };
    }

    /// Judges the next of the beacons that are heard.
    #[inline(never)]
    fn judge_next(
        &mut self,
        now_us: u64,
        rssis: &[Level<T>],
        site: &Site<'_, T>,
        known: Option<&Known<T>>,
        belief: &PosteriorSettings<T>,
    ) {
        let next = self.pass.next;
        let candidates = rssis.iter().enumerate().take(MAX_ANCHORS).filter(|(_, rssi)| rssi.beacon >= next);
        let Some((place, rssi)) = candidates.min_by_key(|(_, rssi)| rssi.beacon) else { return };
        self.pass.next = rssi.beacon.saturating_add(1);
        let one = self.corrected(rssi);
        // Anchors need no others, and the receiver's offset is doubted as far as it is known.
        let off = match known {
            Some(known) => too_loud(&one, &[], &known.area(), site.walls, belief),
            None => {
                let others = self.believed(rssis).filter(|(other, _, _)| *other != place).map(|(_, _, one)| one);
                let others: Vec<Heard<T, 2>, MAX_ANCHORS> = others.collect();
                if others.len() < JUDGES {
                    return;
                }
                // Where one beacon is does not hang on how many others share a shadow.
                too_loud(&one, &others, &site.area, site.walls, &PosteriorSettings { trust: T::ONE, ..*belief })
            }
        };
        let (Some([excess, variance]), Some(record)) = (off, self.histories.get_mut(rssi.beacon)) else { return };
        // Where a tag stands, the RSSI values of three channels may be as far apart as those of two senders.
        let weight = if rssi.is_torn { self.pass.moved } else { self.pass.weight };
        let weight = if known.is_some() { weight } else { weight * T::of(PEERS) };
        let change = record.take(now_us, excess.squared() / variance, rssi.is_torn, weight);
        let Some((standing, seconds)) = change else { return };
        self.news = Some(HealthChange { beacon: rssi.beacon, health: standing, seconds });
        if known.is_none() {
            // What it has spoilt is no sign against the others.
            self.histories.iter_mut().for_each(History::clear_suspicion);
        }
    }
}
