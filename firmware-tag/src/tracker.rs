//! From rounds to positions: in flow the ranges or differences of a round, through the engine, out flows an [`Epoch`]. Beside them flow
//! in the sightings of beacons; what was heard of them goes into the same track once a window.
//!
//! All that a round measured is of the time of its poll. What is known of a link's line of sight goes along: by a trained classifier,
//! which may ask for the impulse response, or by the received powers.

use heapless::Vec;
use positioning_core::ble::beacon_monitor::{BeaconMonitor, ON_NODE};
use positioning_core::engine::{Engine, Measurement, Missing, Output, Tdoa, Verdict};
use positioning_core::nlos::{Feature, Features, NlosDetector, Reception, first_path_to_noise_db};
use positioning_core::{Real, SolveError, engine};
use ranging::Diagnostics;
use ranging::exchange::{Difference, Differences, Range, Round};
use ranging::native::MAX_ROUND;
use wire::config::Solver;

use crate::channels::Level;
use crate::levels::{MOST, Signals};
use crate::surveyed::SiteTracker;
use crate::windows::Window;
use crate::{AnchorPlace, Epoch, HEARS_BEACONS, KnownBeacons, Locator, Measured, Position, Sounding};

/// How far a tag's receiver, and the body that carries it, may be off from what beacons are told to be, all alike, dB.
const RECEIVER_DB: f32 = 5.0;

/// Follows one tag.
#[derive(Clone)]
pub struct Tracker<'a> {
    pub(crate) engine: Engine<f32>,
    pub(crate) solver: Solver,
    pub(crate) anchors: &'a [AnchorPlace],
    judge: NlosDetector<'a>,
    /// Where the tag was at the end of the last round, metres, where that is known.
    pub(crate) last_m: Option<[f32; 3]>,
    pub(crate) beacons: KnownBeacons<'a>,
    pub(crate) signals: Signals,
    /// What it knows of the receiver and of the beacons.
    pub(crate) surroundings: BeaconMonitor<f32, ON_NODE>,
    /// What it knows of their RSSI values on the spot, if anything.
    pub(crate) on_the_spot: Vec<SiteTracker<'a>, { HEARS_BEACONS as usize }>,
    /// What the last window had.
    pub(crate) rssis: Vec<Level, MOST>,
    pub(crate) window: Window,
    /// The number of the last epoch.
    pub(crate) number: u16,
}

/// What the engine has taken of a round.
#[derive(Default)]
pub(crate) struct Taken {
    /// Which of the round each range is that the engine counts.
    places: Vec<u8, MAX_ROUND>,
    /// The differences or RSSI values that were used: bit i is the round's i-th.
    used: u16,
    /// Those that wait for the round's end.
    held: u16,
}

impl<'a> Tracker<'a> {
    /// Knows nothing of the tag yet.
    pub fn new(locator: Locator<'a>) -> Self {
        let Locator { settings, solver, anchors, model, beacons, surveyed } = locator;
        Self {
            engine: Engine::new(settings),
            solver,
            anchors,
            judge: NlosDetector::new(model),
            last_m: None,
            beacons,
            signals: Signals::new(),
            surroundings: BeaconMonitor::new(RECEIVER_DB),
            on_the_spot: surveyed.map(SiteTracker::new).into_iter().take(HEARS_BEACONS.into()).collect(),
            rssis: Vec::new(),
            window: Window::default(),
            number: 0,
        }
    }

    /// Whether the impulse responses of frames are of use.
    pub fn wants_response(&self) -> bool {
        self.judge.wants_response()
    }

    /// The position at the end of a round, whose poll left or came at `poll_us`. A round that measured nothing, or nothing that
    /// could belong to the track, has none: where the track would be by itself is no news. `sounding` is the impulse response of
    /// one of its frames.
    pub fn follow<'r>(&mut self, measured: Measured<'r>, sounding: Option<&'r Sounding>, poll_us: u64) -> Epoch<'r> {
        let mut taken = Taken::default();
        match &measured {
            Measured::Ranges(round) => self.take_ranges(round, sounding, poll_us, &mut taken),
            Measured::Differences(round) => self.take_differences(round, poll_us, &mut taken),
            Measured::Levels(window) => self.take_levels(window.rssis, poll_us, &mut taken),
        }
        let end = self.engine.step_on_node(poll_us, &Measurement::RoundEnd);
        self.last_m = end.fix.as_ref().ok().map(|fix| fix.position);
        let outcome = outcome(&end, taken, measured.count());
        self.number = measured.number();
        self.window.after_anchors = true;
        self.window.found_by_anchors |= outcome.is_ok();
        self.window.by_anchors = outcome.as_ref().ok().and_then(Position::sure).or(self.window.by_anchors);
        Epoch { measured, poll_us, outcome, sounding, solver: self.solver }
    }

    fn take_ranges(&mut self, round: &Round<'_>, sounding: Option<&Sounding>, poll_us: u64, taken: &mut Taken) {
        for (place, range) in (0..MAX_ROUND as u8).zip(round.ranges) {
            let Some(at) = self.place_of(range) else { continue };
            let mut features = self.features(&range.diagnostics);
            if let Some(sounding) = sounding.filter(|sounding| sounding.peer == range.peer) {
                features.set_shape(&sounding.shape);
            }
            let reception = Reception {
                features,
                range_m: range.distance_m,
                power_dbm: range.diagnostics.rx_power_dbm,
                ends_m: self.last_m.map(|last| [last, at]),
            };
            let range = engine::Range {
                anchor: range.peer,
                place: at,
                distance: range.distance_m,
                deviation: range.deviation_m,
                blocked: self.judge.blocked(poll_us, range.peer, &reception),
                excess: None,
            };
            let verdict = self.engine.step_on_node(poll_us, &Measurement::Range(range)).verdict;
            if verdict != Verdict::NotSane {
                // A place each: it fits.
                let _ = taken.places.push(place);
            }
        }
    }

    fn take_differences(&mut self, round: &Differences<'_>, poll_us: u64, taken: &mut Taken) {
        let reference = self.configured(round.reference).unwrap_or(round.reference_m);
        let of_reference = self.overheard(poll_us, round.reference, &round.reference_diagnostics);
        for (place, difference) in (0..MAX_ROUND as u16).zip(round.differences) {
            let at = self.configured(difference.peer).unwrap_or(difference.position_m);
            let tdoa = Tdoa {
                anchor: difference.peer,
                place: at,
                reference: round.reference,
                reference_place: reference,
                difference: between(round, difference, [reference, at]),
                deviations: [round.reference_deviation_m, difference.deviation_m],
                blocked: [of_reference, self.overheard(poll_us, difference.peer, &difference.diagnostics)],
            };
            taken.count(1 << place, self.engine.step_on_node(poll_us, &Measurement::Tdoa(tdoa)).verdict);
        }
    }

    /// What the diagnostics of one reception tell.
    fn features(&self, diagnostics: &Diagnostics) -> Features {
        let mut features = Features::default();
        features.set(Feature::PowerDifference, diagnostics.rx_power_dbm - diagnostics.first_path_power_dbm);
        if self.judge.asks(Feature::FirstPathToNoise) {
            let amplitudes = diagnostics.first_path_amplitudes.map(f32::from);
            let to_noise = first_path_to_noise_db(amplitudes, f32::from(diagnostics.noise_deviation));
            features.set_known(Feature::FirstPathToNoise, to_noise);
        }
        features
    }

    /// The probability that an anchor that was overheard has no line of sight.
    fn overheard(&mut self, poll_us: u64, anchor: u16, diagnostics: &Diagnostics) -> Option<f32> {
        let reception = Reception {
            features: self.features(diagnostics),
            range_m: f32::NAN,
            power_dbm: diagnostics.rx_power_dbm,
            ends_m: None,
        };
        self.judge.blocked(poll_us, anchor, &reception)
    }

    fn configured(&self, anchor: u16) -> Option<[f32; 3]> {
        self.anchors.iter().find(|known| known.address == anchor).map(|known| known.position_m)
    }

    fn place_of(&self, range: &Range) -> Option<[f32; 3]> {
        self.configured(range.peer).or(range.position_m)
    }
}

impl Taken {
    /// Counts differences or RSSI values of the round, by the bits of their places.
    pub(crate) fn count(&mut self, places: u16, verdict: Verdict) {
        match verdict {
            Verdict::Used | Verdict::Readmitted => self.used |= places,
            Verdict::Held => self.held |= places,
            Verdict::Refused
            | Verdict::Ignored
            | Verdict::NotSane
            | Verdict::NoTrack
            | Verdict::Concluded
            | Verdict::Started(_) => {}
        }
    }
}

/// What the end of a round that measured so much has brought.
pub(crate) fn outcome(end: &Output<f32>, taken: Taken, measured: usize) -> Result<Position, SolveError> {
    match end.fix {
        Ok(fix) if fix.age_us == 0 => {
            let ranges = taken.places.iter().enumerate().filter(|(bit, _)| fix.used.contains(*bit));
            Ok(Position {
                position_m: fix.position,
                covariance_m2: fix.covariance,
                used: ranges.fold(taken.used | taken.held, |set, (_, place)| set | 1 << place),
                quality: fix.quality,
            })
        }
        Ok(_) if measured > 0 => Err(SolveError::RangesDisjoint),
        // A round that has ended has a position or a solver's word.
        Ok(_) | Err(Missing::RoundOpen | Missing::Lost(_)) => Err(SolveError::TooFewAnchors),
        Err(Missing::SolveError(reason)) => Err(reason),
    }
}

/// A difference between anchors at these places, metres: it was found with the distance between those that they tell of themselves.
fn between(round: &Differences<'_>, difference: &Difference, places: [[f32; 3]; 2]) -> f32 {
    let told = [round.reference_m, difference.position_m];
    if told == places {
        return difference.difference_m;
    }
    let apart = |[a, b]: [[f32; 3]; 2]| Real::sqrt(a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f32>());
    difference.difference_m + apart(told) - apart(places)
}

#[cfg(test)]
mod tests {
    use super::*;
    use positioning_core::nlos::{Kind, Model, Platt, Shape, Skewness};
    use ranging::RadioInstant;
    use std::vec::Vec;

    /// Four anchors at the corners of a room of 3 m × 4 m, 2 m up; their order is their address, 1 to 4.
    const CORNERS: [[f32; 3]; 4] = [[0.0, 0.0, 2.0], [3.0, 0.0, 2.0], [3.0, 4.0, 2.0], [0.0, 4.0, 2.0]];
    /// From the tag the corners are √(1+1+4), √(4+1+4), √(4+9+4), √(1+9+4) m away.
    const TAG: [f32; 3] = [1.0, 1.0, 0.0];
    const FROM_TAG: [f32; 4] = [2.449_489_7, 3.0, 4.123_105_6, 3.741_657_4];

    fn ranges(positions: impl Fn(usize) -> Option<[f32; 3]>) -> [Range; 4] {
        core::array::from_fn(|i| Range {
            peer: i as u16 + 1,
            distance_m: FROM_TAG[i],
            deviation_m: 0.03,
            position_m: positions(i),
            diagnostics: Diagnostics::default(),
        })
    }

    fn round(ranges: &[Range]) -> Measured<'_> {
        Measured::Ranges(Round { number: 1, poll: RadioInstant::default(), asked: 4, ranges })
    }

    /// To the others from the first.
    fn differences(places: [[f32; 3]; 4]) -> Vec<Difference> {
        let of = |i: usize| Difference {
            peer: i as u16 + 1,
            difference_m: FROM_TAG[i] - FROM_TAG[0],
            deviation_m: 0.04,
            position_m: places[i],
            diagnostics: Diagnostics::default(),
        };
        (1..4).map(of).collect()
    }

    fn heard(reference_m: [f32; 3], differences: &[Difference]) -> Measured<'_> {
        Measured::Differences(Differences {
            number: 1,
            poll: RadioInstant::default(),
            asked: 3,
            reference: 1,
            reference_m,
            reference_deviation_m: 0.03,
            reference_diagnostics: Diagnostics::default(),
            differences,
        })
    }

    fn table() -> [AnchorPlace; 4] {
        core::array::from_fn(|i| AnchorPlace { address: i as u16 + 1, position_m: CORNERS[i] })
    }

    fn at_floor(anchors: &[AnchorPlace]) -> Tracker<'_> {
        Tracker::new(Locator::new(Some(0.0), anchors))
    }

    /// After twenty rounds, 50 ms each.
    fn settled(mut tracker: Tracker<'_>, measured: Measured<'_>) -> Position {
        let outcomes: Vec<_> = (1..=20).map(|k| tracker.follow(measured, None, 50_000 * k).outcome).collect();
        outcomes.last().copied().unwrap().unwrap()
    }

    fn near(found: [f32; 3], expected: [f32; 3]) -> bool {
        found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 0.01)
    }

    #[test]
    fn a_tag_at_a_known_height_is_found_in_the_plane() {
        let heard = ranges(|i| Some(CORNERS[i]));
        let position = settled(at_floor(&[]), round(&heard));
        assert!(near(position.position_m, TAG), "{position:?}");
        assert_eq!((position.used, position.covariance_m2[2]), (0b1111, [0.0; 3]));
        assert!(position.covariance_m2[0][0] > 0.0);
    }

    #[test]
    fn configured_places_count_more_than_those_from_the_air() {
        let heard = ranges(|_| Some([9.0, 9.0, 9.0]));
        let table = table();
        assert!(near(settled(at_floor(&table), round(&heard)).position_m, TAG));
    }

    #[test]
    fn a_range_to_an_anchor_of_unknown_place_is_left_out_and_the_others_keep_their_bits() {
        let heard = ranges(|i| (i != 1).then_some(CORNERS[i]));
        let position = settled(at_floor(&[]), round(&heard));
        assert_eq!(position.used, 0b1101);
        assert!(near(position.position_m, TAG), "{position:?}");
    }

    #[test]
    fn too_few_ranges_give_a_reason_until_there_is_a_track() {
        let heard = ranges(|i| Some(CORNERS[i]));
        let mut tracker = at_floor(&[]);
        assert_eq!(tracker.follow(round(&heard[..2]), None, 10_000).outcome, Err(SolveError::TooFewAnchors));
        assert!(tracker.follow(round(&heard), None, 60_000).outcome.is_ok());
        let one = tracker.follow(round(&heard[2..3]), None, 110_000).outcome.unwrap();
        assert_eq!(one.used, 0b1);
        assert_eq!(tracker.follow(round(&[]), None, 160_000).outcome, Err(SolveError::TooFewAnchors));
    }

    #[test]
    fn a_tag_that_solves_each_round_by_itself_needs_three_ranges_in_each() {
        let heard = ranges(|i| Some(CORNERS[i]));
        for solver in Solver::ALL {
            let mut tracker = Tracker::new(Locator::new(Some(0.0), &[]).by(solver));
            for k in 1..=20 {
                let epoch = tracker.follow(round(&heard), None, 50_000 * k);
                let found = epoch.outcome.unwrap().position_m;
                // Squares meet where circles do not: the box knows the tag to a metre.
                let [x, y, _] = [0, 1, 2].map(|axis| (found[axis] - TAG[axis]).abs());
                assert!(
                    near(found, TAG) || solver == Solver::BoundingBox && x < 1.0 && y < 1.0,
                    "{solver:?}: {found:?}"
                );
                assert_eq!(epoch.solver, solver);
            }
            let two = tracker.follow(round(&heard[..2]), None, 1_050_000).outcome;
            match solver {
                Solver::Track => assert!(two.is_ok(), "{two:?}"),
                Solver::Robust | Solver::BWls | Solver::BWlsR | Solver::BoundingBox => {
                    assert_eq!(two, Err(SolveError::TooFewAnchors), "{solver:?}");
                }
            }
        }
    }

    #[test]
    fn a_solver_is_the_method_of_its_name() {
        for solver in Solver::ALL {
            let name = crate::method(solver).map_or("track", |method| method.method().as_str());
            assert_eq!(name, solver.name());
        }
    }

    #[test]
    fn ranges_that_cannot_belong_to_the_track_are_no_position() {
        let heard = ranges(|i| Some(CORNERS[i]));
        let mut tracker = at_floor(&[]);
        for k in 1..=20 {
            tracker.follow(round(&heard), None, 50_000 * k).outcome.unwrap();
        }
        let wild = heard.map(|range| Range { distance_m: 60.0, ..range });
        assert_eq!(tracker.follow(round(&wild), None, 1_050_000).outcome, Err(SolveError::RangesDisjoint));
    }

    #[test]
    fn differences_find_a_tag_that_only_listens() {
        let all = differences(CORNERS);
        let position = settled(at_floor(&[]), heard(CORNERS[0], &all));
        assert!(near(position.position_m, TAG), "{position:?}");
        assert_eq!(position.used, 0b111);
        let first = at_floor(&[]).follow(heard(CORNERS[0], &all), None, 10_000).outcome.unwrap();
        assert_eq!(first.used, 0b111);
        let two = &all[..1];
        assert_eq!(at_floor(&[]).follow(heard(CORNERS[0], two), None, 10_000).outcome, Err(SolveError::TooFewAnchors));
    }

    #[test]
    fn differences_between_anchors_that_tell_wrong_places_are_put_right() {
        // The second says that it is 1 m farther off than it is, 4 m instead of 3 m: 1 m too much was taken off.
        let mut told = CORNERS;
        told[1] = [4.0, 0.0, 2.0];
        let mut all = differences(told);
        all[0].difference_m -= 1.0;
        let table = table();
        let position = settled(at_floor(&table), heard(told[0], &all));
        assert!(near(position.position_m, TAG), "{position:?}");
    }

    #[test]
    fn a_weak_first_path_is_a_doubt() {
        // 10 dB are even odds, 20 dB 1/(1 + e^-3) = 0.953.
        let of = |rx_power_dbm, first_path_power_dbm| {
            let told = Diagnostics { rx_power_dbm, first_path_power_dbm, ..Diagnostics::default() };
            let features = at_floor(&[]).features(&told);
            let reception = Reception { features, range_m: 3.0, power_dbm: rx_power_dbm, ends_m: None };
            NlosDetector::new(None).blocked(0, 1, &reception)
        };
        assert!((of(-80.0, -90.0).unwrap() - 0.5).abs() < 1e-5);
        assert!((of(-75.0, -95.0).unwrap() - 0.953).abs() < 1e-3);
        assert_eq!(of(f32::NAN, -80.0), None);
    }

    #[test]
    fn what_the_impulse_response_tells_weighs_its_range() {
        let skewness =
            |los_mean, nlos_mean| Skewness { feature: Feature::Skewness, los_mean, nlos_mean, deviation: 0.5 };
        let model = Model { kind: Kind::Skewness(skewness(5.0, 0.0)), calibration: Platt::NONE };
        let mut tracker = Tracker::new(Locator::new(Some(0.0), &[]).with_model(Some(&model)));
        assert!(tracker.wants_response());
        // A single peak among 29 zeros: skewness (1 - 2/30)/√(1/30·29/30) = 5.2; its mirror image −5.2.
        let shape = |peak: bool| {
            let window: [u16; 30] = core::array::from_fn(|at| if (at == 16) == peak { 900 } else { 0 });
            Shape::of(&window, 16.0).unwrap()
        };
        // Four anchors, the first of them half a metre too far: the same ranges, but its response says direct or blocked.
        let mut heard = ranges(|i| Some(CORNERS[i]));
        heard[0].distance_m += 0.5;
        let mut error_m = |direct| {
            let sounding = Sounding { peer: 1, shape: shape(direct) };
            let mut outcome = Err(SolveError::TooFewAnchors);
            for k in 1..=20 {
                outcome = tracker.follow(round(&heard), Some(&sounding), 50_000 * k).outcome;
            }
            tracker = Tracker::new(Locator::new(Some(0.0), &[]).with_model(Some(&model)));
            let [x, y, _] = outcome.unwrap().position_m;
            (x - TAG[0]).hypot(y - TAG[1])
        };
        let (believed, doubted) = (error_m(true), error_m(false));
        assert!(doubted < 0.7 * believed, "{believed} m with it, {doubted} m doubting it");
    }
}
