//! From advertisements of listed beacons to positions: once per window, the received RSSI values go into the track of
//! the tag's rounds.

use heapless::Vec;

use super::outcome::TagUpdate;
use super::site_models::SiteTracker;
use super::{Locator, RoomUpdate, Settings};
use crate::ble::beacon_monitor::{BeaconMonitor, HealthChange, Known, Site};
use crate::ble::rssi::BeaconRssi;
use crate::ble::signal::{BeaconList, BeaconSignals, NEAREST, Scan};
use crate::engine::{self, Dimensions, Measurement, Mode};

/// A tag that has received no beacon for this number of windows is reported as without beacons: a scan may pause for
/// a while.
const SILENT: u64 = 5;
/// A position by anchors with a smaller deviation, metres per axis, determines the errors of RSSI values: it is a
/// tenth of what these give.
const SURE_M: f32 = 0.3;

/// The beacon state of a locator.
#[derive(Clone)]
pub(super) struct Beacons<'a, const N: usize> {
    list: &'a dyn BeaconList,
    signals: BeaconSignals<N>,
    monitor: BeaconMonitor<N>,
    site: Option<Site<'a>>,
    models: Option<SiteTracker<'a>>,
    /// The RSSI values of the last window, the nearest beacon first.
    rssi: Vec<BeaconRssi, NEAREST>,
    window_us: u64,
    /// When the current window ends, microseconds; `None` before a listed beacon has been received.
    end_us: Option<u64>,
    /// When a listed beacon was last received, microseconds.
    heard_us: u64,
    /// Whether anchors have given a position since the last window.
    found_by_anchors: bool,
    /// The tag's position by anchors, if it was certain enough.
    by_anchors: Option<Known>,
    /// Whether the last update was by anchors.
    after_anchors: bool,
}

impl<'a, const N: usize> Beacons<'a, N> {
    pub(super) fn new(settings: &Settings<'a>) -> Self {
        Self {
            list: settings.beacons,
            signals: BeaconSignals::new(settings.window_us),
            monitor: BeaconMonitor::new(settings.receiver_db),
            site: settings.site,
            models: settings.site_models.filter(|_| N > 0).map(SiteTracker::new),
            rssi: Vec::new(),
            window_us: settings.window_us,
            end_us: None,
            heard_us: 0,
            found_by_anchors: false,
            by_anchors: None,
            after_anchors: false,
        }
    }

    /// Notes that anchors have given a position, or none.
    pub(super) fn note_anchors(&mut self, update: &TagUpdate) {
        self.after_anchors = true;
        let Ok(position) = update.position() else { return };
        self.found_by_anchors = true;
        let ([x, y, _], [[xx, ..], [_, yy, _], _]) = (position.position_m, position.covariance_m2);
        let variance_m2 = xx.max(yy);
        if variance_m2 <= SURE_M * SURE_M {
            self.by_anchors = Some(Known { position_m: [x, y], variance_m2 });
        }
    }
}

impl<const BEACONS: usize> Locator<'_, BEACONS> {
    /// Takes an advertisement of the listed beacon of this index. `measured_power_dbm` is the RSSI at one metre that
    /// the beacon advertises. A value that is no RSSI changes no position.
    pub fn advertisement(&mut self, t_us: u64, beacon: usize, rssi_dbm: f32, measured_power_dbm: i8) {
        if let engine::Settings { mode: Mode::Track, dimensions: Dimensions::Plane { .. }, .. } = self.engine.settings()
            && BEACONS > 0
        {
            let beacons = &mut self.beacons;
            beacons.signals.receive(t_us, beacon, rssi_dbm, measured_power_dbm);
            beacons.heard_us = beacons.heard_us.max(t_us);
            beacons.end_us.get_or_insert(t_us.saturating_add(beacons.window_us));
        }
    }

    /// When [`end_window`](Self::end_window) must be called next, microseconds.
    pub fn window_end_us(&self) -> Option<u64> {
        self.beacons.end_us
    }

    /// Ends a window: the received RSSI values of beacons go into the track. It gives an update if anchors gave no
    /// position in the meantime. It also gives one if nothing is received any more, until anchors answer.
    pub fn end_window(&mut self, now_us: u64) -> Option<TagUpdate> {
        let beacons = &mut self.beacons;
        if BEACONS == 0 || now_us < beacons.end_us? {
            return None;
        }
        beacons.end_us = Some(now_us.saturating_add(beacons.window_us));
        let Dimensions::Plane { height } = self.engine.settings().dimensions else { return None };
        let scan = beacons.signals.scan(now_us);
        if let Some(models) = &mut beacons.models {
            models.note_room(now_us, &scan.rssi_dbm);
        }
        beacons.rssi = beacons.signals.take(now_us, beacons.list, height);
        let found = core::mem::take(&mut beacons.found_by_anchors);
        if beacons.rssi.is_empty() {
            let is_silent = now_us.saturating_sub(beacons.heard_us) >= beacons.window_us.saturating_mul(SILENT);
            if beacons.after_anchors || !is_silent {
                // Anchors alone, or nothing yet.
                let is_in_a_room = beacons.models.as_ref().is_some_and(SiteTracker::is_in_a_room);
                beacons.end_us = beacons.end_us.filter(|_| !is_silent || is_in_a_room);
                return None;
            }
        }
        self.take_rssi(now_us, &scan);
        let update = self.conclude(now_us, self.beacons.rssi.len());
        if found {
            return None;
        }
        self.beacons.after_anchors = false;
        Some(update)
    }

    /// Gives the position by a window's RSSI values to the track: by the map if there is one, else by path losses.
    fn take_rssi(&mut self, now_us: u64, scan: &Scan<BEACONS>) {
        let Beacons { list, monitor, site, models, rssi, window_us, by_anchors, .. } = &mut self.beacons;
        let by_map =
            models.as_mut().and_then(|models| models.locate(now_us, *window_us, &scan.rssi_dbm, scan.noise_db2));
        let (position, used) = match by_map {
            Some(position) => {
                let mapped = |rssi: &BeaconRssi| models.as_ref().is_some_and(|models| models.maps(rssi.beacon));
                let used = (0..NEAREST as u16).zip(rssi.iter()).filter(|(_, rssi)| mapped(rssi));
                (position, used.fold(0, |set, (index, _)| set | 1 << index))
            }
            None => {
                let beacons_m = (0..BEACONS).map_while(|index| list.beacon(index)).map(|beacon| beacon.position_m);
                let all_m = beacons_m.chain(self.anchors.iter().map(|anchor| anchor.position_m));
                let Some(site) = site.or_else(|| Site::around(all_m.map(|[x, y, _]| [x, y]))) else { return };
                let Ok(located) = monitor.locate(now_us, rssi, &site, by_anchors.take().as_ref()) else { return };
                (located.position, located.used)
            }
        };
        let verdict = self.engine.step_on_node(now_us, &Measurement::BeaconPosition(position)).verdict;
        self.used.count(used, verdict);
    }

    /// The RSSI values of the last window, the nearest beacon first.
    pub fn rssi(&self) -> &[BeaconRssi] {
        &self.beacons.rssi
    }

    /// The room of the tag, if the last window has an update of it.
    pub fn take_room(&mut self) -> Option<RoomUpdate> {
        self.beacons.models.as_mut()?.take_room()
    }

    /// The latest change of a listed beacon's state since the last call: it was excluded, or accepted again.
    pub fn take_beacon_news(&mut self) -> Option<HealthChange> {
        self.beacons.monitor.take_news()
    }
}
