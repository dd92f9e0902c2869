//! From sightings of beacons to epochs: once a window, what was heard goes into the track of the tag's rounds.

use heapless::Vec;
use positioning_core::ble::beacon_monitor::{self, BeaconHealth, Known, Site};
use positioning_core::ble::multilateration;
use positioning_core::engine::{Dimensions, Measurement, Mode, Settings};
use wire::telemetry::{BeaconEvidence, Condition, Sighting};

use crate::channels::{Heard, Level, Levels};
use crate::levels::{MOST, WINDOW_US};
use crate::surveyed::SiteTracker;
use crate::tracker::{Taken, outcome};
use crate::{Epoch, HEARS_BEACONS, Measured, RoomReport, Tracker};

/// A tag that has heard no beacon for so long is told to be without, microseconds: a scan may pause for a while.
const SILENT_US: u64 = 5 * WINDOW_US;

/// When positions are made of RSSI values.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Window {
    /// When the one under way ends, microseconds; none before a listed beacon has been heard.
    end_us: Option<u64>,
    /// When a listed beacon was heard last, microseconds.
    heard_us: u64,
    /// Anchors have given a position since the last window.
    pub(crate) found_by_anchors: bool,
    /// Where they had the tag, if they were sure of it.
    pub(crate) by_anchors: Option<Known<f32>>,
    /// The last epoch was one of anchors.
    pub(crate) after_anchors: bool,
}

impl Tracker<'_> {
    /// A beacon's advertisement was heard; what there is to tell of it, if it is one of ours.
    pub fn receive(&mut self, heard: &Heard) -> Option<Sighting> {
        let known = self.beacons.identify(&heard.beacon)?;
        let (rssi, measured_power) = (heard.rssi_dbm, heard.beacon.rssi_1m_dbm());
        if let (Some(place), Settings { mode: Mode::Track, dimensions: Dimensions::Plane { .. }, .. }) =
            (known.place, self.engine.settings())
        {
            self.signals.receive(heard.t_us, place, rssi, measured_power);
            self.window.heard_us = self.window.heard_us.max(heard.t_us);
            self.window.end_us.get_or_insert(heard.t_us.saturating_add(WINDOW_US));
        }
        Some(Sighting { t_us: heard.t_us, beacon: known.id, rssi, measured_power })
    }

    /// When [`window`](Self::window) is to be called next, microseconds since the node started.
    pub fn window_end_us(&self) -> Option<u64> {
        self.window.end_us
    }

    /// At a window's end, what was heard of beacons goes into the track. An epoch comes of it where anchors gave no position
    /// meanwhile: the position, or why there is none; also where nothing is heard any more, until anchors answer.
    pub fn window(&mut self, now_us: u64) -> Option<Epoch<'_>> {
        if now_us < self.window.end_us? {
            return None;
        }
        self.window.end_us = Some(now_us.saturating_add(WINDOW_US));
        let scan = self.signals.scan(now_us);
        if let Some(on_the_spot) = self.on_the_spot.first_mut() {
            on_the_spot.note_room(now_us, &scan);
        }
        self.rssis = self.signals.take(now_us, self.beacons.listed());
        let found = core::mem::take(&mut self.window.found_by_anchors);
        if self.rssis.is_empty() {
            let is_silent = now_us.saturating_sub(self.window.heard_us) >= SILENT_US;
            if self.window.after_anchors || !is_silent {
                // Anchors alone, or nothing yet.
                self.window.end_us =
                    self.window.end_us.filter(|_| !is_silent || self.on_the_spot.iter().any(SiteTracker::is_in_a_room));
                return None;
            }
        }
        let mut taken = Taken::default();
        let rssis = core::mem::take(&mut self.rssis);
        match self.on_the_spot.first_mut().and_then(|on_the_spot| on_the_spot.locate(now_us, &scan)) {
            Some(position) => {
                let verdict = self.engine.step_on_node(now_us, &Measurement::BeaconPosition(position)).verdict;
                let is_mapped = |rssi: &Level| self.on_the_spot.iter().any(|known| known.maps(rssi.beacon));
                let mapped = (0..MOST as u16).zip(&rssis).filter(|(_, rssi)| is_mapped(rssi));
                taken.count(mapped.fold(0, |set, (place, _)| set | 1 << place), verdict);
            }
            None => self.take_levels(&rssis, now_us, &mut taken),
        }
        self.rssis = rssis;
        let end = self.engine.step_on_node(now_us, &Measurement::RoundEnd);
        self.last_m = end.fix.as_ref().ok().map(|fix| fix.position);
        if found {
            return None;
        }
        self.window.after_anchors = false;
        self.number = self.number.wrapping_add(1);
        let outcome = outcome(&end, taken, self.rssis.len());
        let measured = Measured::Levels(Levels { number: self.number, rssis: &self.rssis });
        Some(Epoch { measured, poll_us: now_us, outcome, sounding: None, solver: self.solver })
    }

    /// In which room the tag is, where the last window had something to tell of that.
    pub fn room(&mut self) -> Option<RoomReport> {
        self.on_the_spot.first_mut()?.news.take()
    }

    /// What is new of a listed beacon since it was asked last: it is doubted, or believed again.
    pub fn word(&mut self) -> Option<Condition> {
        let news = self.surroundings.take_news()?;
        let beacon = self.beacons.listed().get(news.beacon)?;
        let seconds = u16::try_from(news.seconds).unwrap_or(u16::MAX);
        let word = BeaconEvidence { major: beacon.major, minor: beacon.minor, seconds };
        Some(match news.health {
            BeaconHealth::Agrees => Condition::BeaconRestored(word),
            BeaconHealth::Elsewhere => Condition::BeaconMoved(word),
            BeaconHealth::TwoPlaces => Condition::BeaconDuplicated(word),
        })
    }

    /// Lets where the RSSI values have the tag into the track.
    pub(crate) fn take_levels(&mut self, rssis: &[Level], now_us: u64, taken: &mut Taken) {
        let (Dimensions::Plane { height }, true) = (self.engine.settings().dimensions, HEARS_BEACONS) else { return };
        let list = self.beacons.listed();
        let rssi = |rssi: &Level| {
            let [x, y, z] = list.get(usize::from(rssi.beacon))?.position_m;
            let Level { rssi_dbm, path_loss, noise_db, is_torn, .. } = *rssi;
            let heard = multilateration::Heard { place: [x, y], above: z - height, rssi: rssi_dbm, path_loss };
            Some(beacon_monitor::Level { beacon: rssi.beacon.into(), heard, noise: noise_db, is_torn })
        };
        let rssis: Vec<beacon_monitor::Level<f32>, MOST> = rssis.iter().filter_map(rssi).collect();
        let flat = |[x, y, _]: [f32; 3]| [x, y];
        let beacons = list.iter().map(|beacon| flat(beacon.position_m));
        let Some(site) = Site::around(beacons.chain(self.anchors.iter().map(|anchor| flat(anchor.position_m)))) else {
            return;
        };
        let known = self.window.by_anchors.take();
        let Ok(located) = self.surroundings.locate_on_node(now_us, &rssis, &site, known.as_ref()) else { return };
        let verdict = self.engine.step_on_node(now_us, &Measurement::BeaconPosition(located.position)).verdict;
        taken.count(located.used, verdict);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{KnownBeacons, Locator};
    use positioning_core::SolveError;
    use wire::ble::{Advertised, IBeacon};
    use wire::config::Beacon;

    /// In the corners of a square of 6 m, at the tag's height.
    fn corners() -> [Beacon; 4] {
        [[0.0, 0.0, 1.0], [6.0, 0.0, 1.0], [6.0, 6.0, 1.0], [0.0, 6.0, 1.0]].map(|position_m: [f32; 3]| Beacon {
            major: 1,
            minor: (position_m[0] + 2.0 * position_m[1]) as u16,
            position_m,
            rssi_1m_dbm: Some(-60.0),
            path_loss_exponent: None,
        })
    }

    fn heard(beacon: &Beacon, t_us: u64, rssi_dbm: i8) -> Heard {
        let ibeacon = IBeacon { uuid: [1; 16], major: beacon.major, minor: beacon.minor, measured_power_dbm: -60 };
        Heard { t_us, beacon: Advertised::IBeacon(ibeacon), rssi_dbm }
    }

    /// What the window after ten advertisements of each beacon brings.
    fn after(
        tracker: &mut Tracker<'_>,
        list: &[Beacon],
        from_us: u64,
        rssi_dbm: impl Fn(usize) -> i8,
    ) -> Option<Result<[f32; 3], SolveError>> {
        for k in 0..10 {
            for (place, beacon) in list.iter().enumerate() {
                assert!(tracker.receive(&heard(beacon, from_us + 50_000 * k, rssi_dbm(place))).is_some());
            }
        }
        let end_us = tracker.window_end_us()?;
        tracker.window(end_us).map(|epoch| epoch.outcome.map(|position| position.position_m))
    }

    #[test]
    fn levels_of_the_middle_are_found_there() {
        let list = corners();
        let mut tracker = Tracker::new(Locator::new(Some(1.0), &[]).with_beacons(KnownBeacons::new(&list, None)));
        // √18 m from each: −60 − 20 lg 4.243 = −72.55 dBm.
        let found = after(&mut tracker, &list, 0, |_| -73).expect("an epoch").expect("a position");
        assert!((found[0] - 3.0).abs() < 0.1 && (found[1] - 3.0).abs() < 0.1, "{found:?}");
        assert_eq!(found[2], 1.0);
    }

    #[test]
    fn an_rssi_that_is_none_makes_no_position() {
        let list = corners();
        for rssi_dbm in [127, 0] {
            let mut tracker = Tracker::new(Locator::new(Some(1.0), &[]).with_beacons(KnownBeacons::new(&list, None)));
            assert_eq!(after(&mut tracker, &list, 0, |_| rssi_dbm), None);
            // Good ones in between are not spoilt.
            let mixed = |place| if place == 3 { rssi_dbm } else { -73 };
            let found = after(&mut tracker, &list, 1_000_000, mixed).expect("an epoch").expect("a position");
            assert!((found[0] - 3.0).abs() < 1.0 && (found[1] - 3.0).abs() < 1.0, "{found:?}");
        }
    }

    #[test]
    fn a_tag_that_hears_nothing_any_more_says_so_and_one_that_never_did_is_silent() {
        let list = corners();
        let mut tracker = Tracker::new(Locator::new(Some(1.0), &[]).with_beacons(KnownBeacons::new(&list, None)));
        assert!(tracker.window_end_us().is_none() && tracker.window(1_000_000).is_none());
        after(&mut tracker, &list, 0, |_| -73);
        let mut told = std::vec::Vec::new();
        for _ in 0..10 {
            let end_us = tracker.window_end_us().expect("windows go on");
            told.extend(tracker.window(end_us).map(|epoch| (end_us, epoch.outcome.err())));
        }
        // A scan may pause: two and a half seconds after the last advertisement, of 0.45 s.
        assert!(
            told.iter().all(|(end_us, reason)| *end_us >= 2_950_000 && *reason == Some(SolveError::TooFewAnchors)),
            "{told:?}"
        );
        assert!(told.len() >= 4, "{told:?}");
    }

    #[test]
    fn in_space_beacons_are_told_and_make_no_positions() {
        let list = corners();
        let mut tracker = Tracker::new(Locator::new(None, &[]).with_beacons(KnownBeacons::new(&list, None)));
        assert_eq!(after(&mut tracker, &list, 0, |_| -73), None);
    }
}
