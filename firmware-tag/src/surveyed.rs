//! What a survey of the place gave the tag: a map of RSSI values, by which it is found instead of by path losses, and a model of rooms, by
//! which it tells in which it is. Both lie in flash beside the record and are read where they lie; here they are bound to the record's
//! list of beacons. In flow the smoothed RSSI values of a window, out flow a position with its covariance, and rooms.

use heapless::Vec;
use positioning_core::ble::fingerprint::{self, MAX_NODE_POINTS, Map, Receiver, locate_on_node};
use positioning_core::ble::rooms::{self, Classifier, RoomEstimate, RoomHysteresis};
use positioning_core::engine::BeaconPosition;
use wire::config::{Beacon, BeaconModel, LoadError, SiteModels};
use wire::telemetry::{Condition, Room, RoomProbability, RssiModelError};

use crate::levels::{Scan, WINDOW_US};

/// Most beacons of a model: as many as a tag is told of.
const MOST: usize = wire::config::MAX_BEACONS;
/// What a map's RSSI values are off by where nothing was measured twice, dB²: recorded surveys have deviations of 3 to 5 dB. It stays with
/// the place; the noise of a window comes beside.
const LASTING_DB2: f32 = 16.0;
/// The receiver's offset is learnt from one window in so long, microseconds: those between are shadowed alike.
const LEARNT_US: u64 = 4 * WINDOW_US;
/// In which room the tag is, is told again after so long, microseconds.
const REPEATED_US: u64 = 5_000_000;

/// What a survey of the place gave the tag, for a `static`.
#[derive(Debug, Default)]
pub struct LoadedModels<'a> {
    map: Option<Fingerprints<'a>>,
    rooms: Option<Rooms<'a>>,
}

/// The place in the record's list of each beacon of a model, in its order.
type Places = Vec<u8, MOST>;

#[derive(Debug)]
struct Fingerprints<'a> {
    map: Map<'a>,
    places: Places,
}

#[derive(Debug)]
struct Rooms<'a> {
    model: rooms::NodeModel<'a>,
    places: Places,
}

/// What becomes of it from window to window.
#[derive(Clone, Debug)]
pub(crate) struct SiteTracker<'a> {
    surveyed: &'a LoadedModels<'a>,
    receiver: Receiver<f32>,
    /// When the receiver was learnt last.
    learnt_us: Option<u64>,
    presence: RoomHysteresis,
    /// What was told last of rooms, and when.
    told: Option<(RoomEstimate, u64)>,
    /// What there is to tell.
    pub(crate) news: Option<RoomReport>,
}

/// Word of a room.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RoomReport {
    /// In which the tag is.
    pub room: Room,
    /// It is another than before.
    pub is_news: bool,
}

impl<'a> LoadedModels<'a> {
    /// Of what flash has, for a tag that is told of these beacons. What cannot be used is left out, and `complain` hears of it once.
    pub fn of(models: Result<SiteModels<'a>, LoadError>, list: &[Beacon], mut complain: impl FnMut(Condition)) -> Self {
        let models = match models {
            Ok(models) => models,
            Err(fault) => {
                let told = match fault {
                    LoadError::Missing => None,
                    LoadError::Version(version) => Some(RssiModelError::Version(version)),
                    LoadError::Corrupt => Some(RssiModelError::Corrupt),
                    LoadError::Invalid(_) => Some(RssiModelError::Invalid),
                };
                told.into_iter().for_each(|fault| complain(Condition::Unused(wire::telemetry::Levels::All, fault)));
                return Self::default();
            }
        };
        let mut used = |part, fault| complain(Condition::Unused(part, fault));
        let map = models.map.and_then(|of| match Fingerprints::of(&of, list) {
            Ok(map) => Some(map),
            Err(fault) => {
                used(wire::telemetry::Levels::Map, fault);
                None
            }
        });
        let rooms = models.rooms.and_then(|of| match Rooms::of(&of, list) {
            Ok(rooms) => Some(rooms),
            Err(fault) => {
                used(wire::telemetry::Levels::Rooms, fault);
                None
            }
        });
        Self { map, rooms }
    }
}

impl<'a> SiteTracker<'a> {
    /// Nothing was heard yet.
    pub(crate) fn new(surveyed: &'a LoadedModels<'a>) -> Self {
        Self {
            surveyed,
            receiver: Receiver::default(),
            learnt_us: None,
            presence: RoomHysteresis::new(rooms::Settings::default()),
            told: None,
            news: None,
        }
    }

    /// Where the map has the tag by these RSSI values; `None` without a map, or where none of its beacons is heard.
    pub(crate) fn locate(&mut self, now_us: u64, scan: &Scan) -> Option<BeaconPosition<f32>> {
        let Fingerprints { map, places } = self.surveyed.map.as_ref()?;
        let believed = Receiver { noise_db2: scan.noise_db2, ..self.receiver };
        let posterior = locate_on_node(map, &of_places(places, scan), &believed).ok()?;
        if self.learnt_us.is_none_or(|before_us| now_us.saturating_sub(before_us) >= LEARNT_US) {
            self.receiver.learn(&posterior);
            self.learnt_us = Some(now_us);
        }
        let lasting = LASTING_DB2 / (LASTING_DB2 + scan.noise_db2);
        Some(BeaconPosition { position: posterior.position, covariance: posterior.covariance, lasting })
    }

    /// Whether the map knows the beacon at this place of the record's list.
    pub(crate) fn maps(&self, place: u16) -> bool {
        self.surveyed.map.as_ref().is_some_and(|map| map.places.iter().any(|known| u16::from(*known) == place))
    }

    /// Takes note of the room that these RSSI values are of, where there is a model of rooms: [`news`](Self::news) has what is to be told.
    pub(crate) fn note_room(&mut self, now_us: u64, scan: &Scan) {
        let Some(Rooms { model, places }) = &self.surveyed.rooms else { return };
        let probabilities = model.probabilities(&of_places(places, scan));
        let is = self.presence.step(now_us, probabilities.as_ref());
        let is_news = self.told.is_none_or(|(before, _)| before != is);
        if !is_news && self.told.is_none_or(|(_, told_us)| now_us.saturating_sub(told_us) < REPEATED_US) {
            return;
        }
        self.told = Some((is, now_us));
        let likely = |room| RoomProbability::new(room, self.presence.probability(room));
        let is = match is {
            RoomEstimate::Unknown => wire::telemetry::RoomEstimate::Unknown,
            RoomEstimate::Room(room) => wire::telemetry::RoomEstimate::Room(likely(room)),
            RoomEstimate::Between(one, other) => wire::telemetry::RoomEstimate::Between([likely(one), likely(other)]),
        };
        self.news = Some(RoomReport { room: Room { t_us: now_us, is }, is_news });
    }

    /// Whether it is in a room, as far as is known.
    pub(crate) fn is_in_a_room(&self) -> bool {
        self.presence.answer() != RoomEstimate::Unknown
    }
}

impl<'a> Fingerprints<'a> {
    fn of(of: &BeaconModel<'a>, list: &[Beacon]) -> Result<Self, RssiModelError> {
        let (map, _) = Map::decode(of.model).map_err(|fault| match fault {
            fingerprint::MapError::Version(version) => RssiModelError::Version(version),
            fingerprint::MapError::Missing | fingerprint::MapError::Corrupt => RssiModelError::Corrupt,
            fingerprint::MapError::Invalid | fingerprint::MapError::TooLong => RssiModelError::Invalid,
        })?;
        if !map.has_deviations() || map.points() > MAX_NODE_POINTS {
            return Err(RssiModelError::Invalid);
        }
        let places = places(of, list, map.beacons())?;
        Ok(Self { map, places })
    }
}

impl<'a> Rooms<'a> {
    fn of(of: &BeaconModel<'a>, list: &[Beacon]) -> Result<Self, RssiModelError> {
        let (model, _) = rooms::NodeModel::decode(of.model).map_err(|fault| match fault {
            rooms::StoredError::Version { found, read: _ } => RssiModelError::Version(found),
            rooms::StoredError::Missing | rooms::StoredError::Corrupt => RssiModelError::Corrupt,
            rooms::StoredError::Invalid | rooms::StoredError::TooLong => RssiModelError::Invalid,
        })?;
        let places = places(of, list, model.beacons())?;
        Ok(Self { model, places })
    }
}

/// Where the record lists the beacons of a model that has so many; one that it does not list makes it a model of other beacons.
fn places(of: &BeaconModel<'_>, list: &[Beacon], count: usize) -> Result<Places, RssiModelError> {
    let mut places = Places::new();
    for numbers in of.numbers() {
        let place = list.iter().position(|beacon| (beacon.major, beacon.minor) == numbers);
        let place = place.and_then(|place| u8::try_from(place).ok()).ok_or(RssiModelError::OtherBeacons)?;
        places.push(place).map_err(|_| RssiModelError::Invalid)?;
    }
    if places.len() == count { Ok(places) } else { Err(RssiModelError::Invalid) }
}

/// The RSSI values by a model's order of beacons.
fn of_places(places: &Places, scan: &Scan) -> Vec<Option<f32>, MOST> {
    places.iter().map(|place| scan.levels_dbm.get(usize::from(*place)).copied().flatten()).collect()
}

#[cfg(test)]
mod tests;
