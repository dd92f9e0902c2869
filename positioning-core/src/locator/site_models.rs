//! The models from a survey of the beacons' RSSI: a fingerprint map, which locates a tag instead of path losses, and
//! a classifier of rooms. Input: the smoothed RSSI values of a window. Output: a position with its covariance, and
//! room estimates.

use heapless::Vec;

use crate::ble::fingerprint::{Map, OffsetFilter, Receiver, locate_on_node};
use crate::ble::rooms::{self, Classifier as _, MAX_BEACONS, RoomEstimate, RoomHysteresis, Svm};
use crate::measurement::BeaconPosition;

/// The variance of a map's RSSI values where nothing was measured twice, dB²: recorded surveys have deviations of 3
/// to 5 dB. This error stays while the tag does not move. The noise of a window is added.
const LASTING_DB2: f32 = 16.0;
/// The receiver's offset is learnt from one window in this number: those between have the same fading.
const LEARNT: u64 = 4;
/// The room estimate is reported again after this time, microseconds.
const REPEATED_US: u64 = 5_000_000;

/// A model of beacons, and the index in the list of each of its beacons, in the model's order.
#[derive(Clone, Debug)]
pub struct ForBeacons<M> {
    /// The model.
    pub model: M,
    /// The indices in the list.
    pub beacons: Vec<u8, MAX_BEACONS>,
}

/// The models that a survey of the site gives a tag.
#[derive(Clone, Debug, Default)]
pub struct SiteModels<'a> {
    /// The fingerprint map.
    pub map: Option<ForBeacons<Map<'a>>>,
    /// The classifier of rooms.
    pub rooms: Option<ForBeacons<Svm<'a>>>,
}

/// The room that the tag is in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoomUpdate {
    /// The time since the clock's zero, microseconds.
    pub t_us: u64,
    /// The room estimate.
    pub rooms: RoomEstimate,
    /// The smoothed probabilities of the rooms, in the order of `rooms`; 0 where there are fewer.
    pub probabilities: [f32; 2],
    /// Whether it differs from the one before.
    pub is_new: bool,
}

/// The state of the models from window to window.
#[derive(Clone, Debug)]
pub(super) struct SiteTracker<'a> {
    models: &'a SiteModels<'a>,
    offset: OffsetFilter<f32>,
    /// When the receiver's offset was last learnt.
    learnt_us: Option<u64>,
    presence: RoomHysteresis,
    /// The last reported room estimate, and its time.
    told: Option<(RoomEstimate, u64)>,
    /// The room estimate to be reported.
    update: Option<RoomUpdate>,
}

impl<M> ForBeacons<M> {
    /// The RSSI values in the model's order of beacons.
    fn ordered(&self, rssi_dbm: &[Option<f32>]) -> Vec<Option<f32>, MAX_BEACONS> {
        self.beacons.iter().map(|index| rssi_dbm.get(usize::from(*index)).copied().flatten()).collect()
    }
}

impl<'a> SiteTracker<'a> {
    /// Nothing has been received yet.
    pub(super) fn new(models: &'a SiteModels<'a>) -> Self {
        Self {
            models,
            offset: OffsetFilter::default(),
            learnt_us: None,
            presence: RoomHysteresis::new(rooms::Settings::default()),
            told: None,
            update: None,
        }
    }

    /// The position by the map; `None` without a map, or where none of its beacons is received.
    pub(super) fn locate(
        &mut self,
        now_us: u64,
        window_us: u64,
        rssi_dbm: &[Option<f32>],
        noise_db2: f32,
    ) -> Option<BeaconPosition<f32>> {
        let map = self.models.map.as_ref()?;
        let believed = Receiver { noise_db2, ..*self.offset.receiver() };
        let scan = map.ordered(rssi_dbm);
        let posterior = locate_on_node(&map.model, &scan, &believed).ok()?;
        let pause_us = window_us.saturating_mul(LEARNT);
        if self.learnt_us.is_none_or(|before_us| now_us.saturating_sub(before_us) >= pause_us) {
            self.offset.learn_on_node(&map.model, &scan, noise_db2, now_us).ok()?;
            self.learnt_us = Some(now_us);
        }
        let lasting = LASTING_DB2 / (LASTING_DB2 + noise_db2);
        Some(BeaconPosition { position_m: posterior.position, covariance_m2: posterior.covariance, lasting })
    }

    /// Whether the map has the beacon of this index in the list.
    pub(super) fn maps(&self, beacon: u16) -> bool {
        self.models.map.as_ref().is_some_and(|map| map.beacons.iter().any(|known| u16::from(*known) == beacon))
    }

    /// Updates the room estimate with these RSSI values, if there is a classifier. [`take_room`](Self::take_room) has
    /// the estimate to be reported.
    pub(super) fn note_room(&mut self, now_us: u64, rssi_dbm: &[Option<f32>]) {
        let Some(rooms) = &self.models.rooms else { return };
        let probabilities = rooms.model.probabilities(&rooms.ordered(rssi_dbm));
        let rooms = self.presence.step(now_us, probabilities.as_ref());
        let is_new = self.told.is_none_or(|(before, _)| before != rooms);
        if !is_new && self.told.is_none_or(|(_, told_us)| now_us.saturating_sub(told_us) < REPEATED_US) {
            return;
        }
        self.told = Some((rooms, now_us));
        let p = |room| self.presence.probability(room);
        let probabilities = match rooms {
            RoomEstimate::Unknown => [0.0; 2],
            RoomEstimate::Room(room) => [p(room), 0.0],
            RoomEstimate::Between(one, other) => [p(one), p(other)],
        };
        self.update = Some(RoomUpdate { t_us: now_us, rooms, probabilities, is_new });
    }

    /// The room estimate to be reported, if there is one.
    pub(super) fn take_room(&mut self) -> Option<RoomUpdate> {
        self.update.take()
    }

    /// Whether the tag has a room estimate.
    pub(super) fn is_in_a_room(&self) -> bool {
        self.presence.answer() != RoomEstimate::Unknown
    }
}
