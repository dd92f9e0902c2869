//! Turns a tag's rounds and the beacons that it receives into epochs: both go through the [`Locator`], and the result
//! is an [`RoundOutcome`].
//!
//! All measurements of a round have the time of its poll. Each has an estimate of its link's line of sight. It comes
//! from a trained classifier, which may ask for the impulse response, or from the received powers.

use positioning_core::SolveError;
use positioning_core::ble::beacon_monitor::{BeaconHealth, HealthChange};
use positioning_core::ble::rooms::RoomEstimate;
use positioning_core::engine::{Range, Tdoa};
use positioning_core::locator::{Locator, Position, Reception, Settings};
use positioning_core::nlos::{Feature, Features, first_path_to_noise_db};
use ranging::Diagnostics;
use ranging::exchange::{Differences, Round};
use wire::config::Solver;
use wire::telemetry::{BeaconEvidence, Condition, Room, RoomProbability, Sighting};

use crate::channels::{ReceivedAdvertisement, RssiWindow};
use crate::{KnownBeacons, Measured, Sounding};

/// The result of one round, or of a window of beacons.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoundOutcome<'a> {
    /// The round with its ranges or differences, or the RSSI values.
    pub measured: Measured<'a>,
    /// The time of the position, microseconds since the node started: when the round's poll was sent or received, or
    /// when the window ended.
    pub poll_us: u64,
    /// The position, or the reason why there is none.
    pub outcome: Result<Position, SolveError>,
    /// The impulse response of the round's last frame, if it was read.
    pub sounding: Option<&'a Sounding>,
    /// The solver that computed the position.
    pub solver: Solver,
}

/// The room estimate of a tag.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RoomReport {
    /// The room estimate.
    pub room: Room,
    /// Whether it differs from the one before.
    pub is_news: bool,
}

/// Follows one tag. It can follow `BEACONS` listed beacons; without any, it ignores all advertisements.
#[derive(Clone)]
pub struct Tracker<'a, const BEACONS: usize> {
    locator: Locator<'a, BEACONS>,
    solver: Solver,
    beacons: &'a KnownBeacons<'a>,
    /// The number of the last epoch.
    number: u16,
}

impl<'a, const BEACONS: usize> Tracker<'a, BEACONS> {
    /// A tracker without information about the tag, made of the parts of a [`LocatorConfig`](crate::LocatorConfig).
    pub fn new(settings: Settings<'a>, solver: Solver, beacons: &'a KnownBeacons<'a>) -> Self {
        let settings = if BEACONS > 0 { settings.with_beacons(beacons) } else { settings };
        Self { locator: Locator::new(settings), solver, beacons, number: 0 }
    }

    /// Whether the locator uses impulse responses of frames.
    pub fn wants_response(&self) -> bool {
        self.locator.wants_response()
    }

    /// The epoch at the end of a round, whose poll was sent or received at `poll_us`. A round without measurements, or
    /// without any that fits the track, gives no position: a mere prediction of the track is not reported. `sounding`
    /// is the impulse response of one of the round's frames.
    pub fn follow<'r>(
        &mut self,
        measured: Measured<'r>,
        sounding: Option<&'r Sounding>,
        poll_us: u64,
    ) -> RoundOutcome<'r> {
        match &measured {
            Measured::Ranges(round) => self.take_ranges(round, sounding, poll_us),
            Measured::Differences(round) => self.take_differences(round, poll_us),
            // The RSSI values went into the track when their window ended.
            Measured::RssiWindow(_) => {}
        }
        let outcome = self.locator.end_round(poll_us, measured.count()).position();
        self.number = measured.number();
        RoundOutcome { measured, poll_us, outcome, sounding, solver: self.solver }
    }

    fn take_ranges(&mut self, round: &Round<'_>, sounding: Option<&Sounding>, poll_us: u64) {
        for (index, range) in round.ranges.iter().enumerate() {
            let Some(position_m) = self.locator.anchor_m(range.peer, range.position_m) else { continue };
            let mut reception = self.reception(&range.diagnostics);
            if let Some(sounding) = sounding.filter(|sounding| sounding.peer == range.peer) {
                reception.features.set_shape(&sounding.shape);
            }
            let (anchor, distance_m, deviation_m) = (range.peer, range.distance_m, range.deviation_m);
            let range = Range { anchor, position_m, distance_m, deviation_m, p_nlos: None, excess_m: None };
            self.locator.range(poll_us, index, range, &reception);
        }
    }

    fn take_differences(&mut self, round: &Differences<'_>, poll_us: u64) {
        let of_reference = self.reception(&round.reference_diagnostics);
        for (index, difference) in round.differences.iter().enumerate() {
            let tdoa = Tdoa {
                anchor: difference.peer,
                position_m: difference.position_m,
                reference: round.reference,
                reference_m: round.reference_m,
                difference_m: difference.difference_m,
                deviations_m: [round.reference_deviation_m, difference.deviation_m],
                p_nlos: [None; 2],
            };
            let reception = self.reception(&difference.diagnostics);
            self.locator.tdoa(poll_us, index, tdoa, [&of_reference, &reception]);
        }
    }

    /// The features of one reception, from its diagnostics.
    fn reception(&self, diagnostics: &Diagnostics) -> Reception {
        let mut features = Features::default();
        features.set(Feature::PowerDifference, diagnostics.rx_power_dbm - diagnostics.first_path_power_dbm);
        if self.locator.asks(Feature::FirstPathToNoise) {
            let amplitudes = diagnostics.first_path_amplitudes.map(f32::from);
            let to_noise = first_path_to_noise_db(amplitudes, f32::from(diagnostics.noise_deviation));
            features.set_known(Feature::FirstPathToNoise, to_noise);
        }
        Reception { features, power_dbm: diagnostics.rx_power_dbm }
    }

    /// Takes a beacon's advertisement. Returns a sighting to report, if the tag knows the beacon.
    pub fn receive(&mut self, heard: &ReceivedAdvertisement) -> Option<Sighting> {
        if BEACONS == 0 {
            return None;
        }
        let known = self.beacons.identify(&heard.beacon)?;
        let (rssi, measured_power) = (heard.rssi_dbm, heard.beacon.rssi_1m_dbm());
        if let Some(index) = known.place {
            self.locator.advertisement(heard.t_us, index, rssi.into(), measured_power);
        }
        Some(Sighting { t_us: heard.t_us, beacon: known.id, rssi_dbm: rssi, measured_power_dbm: measured_power })
    }

    /// When [`window`](Self::window) is to be called next, microseconds since the node started.
    pub fn window_end_us(&self) -> Option<u64> {
        self.locator.window_end_us()
    }

    /// At a window's end, puts the RSSI values of beacons into the track. It returns an epoch if anchors gave no
    /// position meanwhile: the position, or the reason why there is none. It also returns an epoch if no beacon is
    /// received any more, until anchors answer.
    pub fn window(&mut self, now_us: u64) -> Option<RoundOutcome<'_>> {
        let outcome = self.locator.end_window(now_us)?.position();
        self.number = self.number.wrapping_add(1);
        let measured = Measured::RssiWindow(RssiWindow { number: self.number, rssis: self.locator.rssi() });
        Some(RoundOutcome { measured, poll_us: now_us, outcome, sounding: None, solver: self.solver })
    }

    /// The room estimate, if the last window has one to report.
    pub fn room(&mut self) -> Option<RoomReport> {
        let update = self.locator.take_room()?;
        let [first, second] = update.probabilities;
        let is = match update.rooms {
            RoomEstimate::Unknown => wire::telemetry::RoomEstimate::Unknown,
            RoomEstimate::Room(room) => wire::telemetry::RoomEstimate::Room(RoomProbability::new(room, first)),
            RoomEstimate::Between(one, other) => wire::telemetry::RoomEstimate::Between([
                RoomProbability::new(one, first),
                RoomProbability::new(other, second),
            ]),
        };
        Some(RoomReport { room: Room { t_us: update.t_us, is }, is_news: update.is_new })
    }

    /// The change of a listed beacon's condition since the last call: its RSSI contradicts its listed position, or
    /// agrees again.
    pub fn beacon_condition(&mut self) -> Option<Condition> {
        let HealthChange { beacon, health, seconds } = self.locator.take_beacon_news()?;
        let beacon = self.beacons.listed().get(beacon)?;
        let seconds = u16::try_from(seconds).unwrap_or(u16::MAX);
        let word = BeaconEvidence { major: beacon.major, minor: beacon.minor, seconds };
        Some(match health {
            BeaconHealth::Agrees => Condition::BeaconRestored(word),
            BeaconHealth::Elsewhere => Condition::BeaconMoved(word),
            BeaconHealth::TwoPlaces => Condition::BeaconDuplicated(word),
        })
    }
}

#[cfg(test)]
mod tests;
#[cfg(test)]
mod window_tests;
