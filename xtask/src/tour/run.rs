//! The round that the tour shows: a simulated tag, seen at its protocol, with the engine's steps made again beside it.

use std::cell::RefCell;
use std::rc::Rc;

use anyhow::{Context, Result, ensure};
use positioning_core::engine::{self, Range};
use positioning_core::locator::{Locator, Reception, Settings};
use positioning_core::nlos::{Feature, Features};
use ranging::exchange::{self, Action, Event, Report};
use ranging::{Diagnostics, RadioInstant};
use sim::scenario::{Inspection, Scenario, SimulatedEpoch, Simulation, What};
use wire::uwb::native::{self, Frame, Message};

/// The tag of [`Scenario::rooms`].
const TAG: u16 = 0x1001;
/// The number of its anchors, its rounds a second, and the simulated time, seconds: the round shown is the first one
/// after [`AFTER_US`] in which all anchors answered. `baliza simulate` with these as arguments runs the same.
pub const ANCHORS: usize = 6;
pub const RATE_HZ: f64 = 10.0;
pub const SECONDS: f64 = 4.0;
const AFTER_US: u64 = 3_000_000;

/// A response, as the tag received it.
#[derive(Clone, Debug)]
pub struct TourAnswer {
    pub bytes: Vec<u8>,
    /// Its sender.
    pub anchor: u16,
    pub rx_time: RadioInstant,
    pub diagnostics: Diagnostics,
    /// What it says.
    pub response: native::Response,
}

/// A round, as the tag's protocol has seen it.
#[derive(Clone, Debug)]
pub struct Exchange {
    pub number: u16,
    pub poll: Vec<u8>,
    pub poll_tx: Option<RadioInstant>,
    pub answers: Vec<TourAnswer>,
    pub ranges: Vec<exchange::Range>,
}

/// What one range does to the track.
#[derive(Clone, Copy, Debug)]
pub struct TourStep {
    pub anchor: u16,
    pub range_m: f32,
    /// The distance from the track to the anchor, before the range.
    pub expected_m: f32,
    /// The received power less that of the first path.
    pub power_difference_db: f32,
    /// The position if the round ended here.
    pub position_m: [f32; 3],
}

/// The round with all that the page shows.
#[derive(Clone, Debug)]
pub struct Tour {
    pub scenario: Scenario,
    /// The exchange before it, by which the tag knows the anchors' clocks.
    pub before: Exchange,
    pub exchange: Exchange,
    pub epoch: SimulatedEpoch,
    /// The track at the time of the poll, before any range.
    pub predicted_m: [f32; 3],
    pub steps: Vec<TourStep>,
}

/// Runs it. `tune` changes the engine's settings: of the simulated tag and of the engine beside it.
///
/// # Errors
/// No round fits, or the engine beside the tag finds another position than the tag.
pub fn run(tune: fn(&mut engine::Settings<f32>)) -> Result<Tour> {
    let mut scenario = Scenario::rooms(ANCHORS, 1);
    scenario.seconds = SECONDS;
    // Config records count rounds in 100 s.
    scenario.change_tags(|tag| tag.rate_chz = Some((100.0 * RATE_HZ) as u32));
    let exchanges: Rc<RefCell<Vec<Exchange>>> = Rc::default();
    let seen = exchanges.clone();
    let step = move |tag: u16, event: &Event<'_>, action: &Action<'_>| {
        if tag == TAG {
            see(&mut seen.borrow_mut(), event, action);
        }
    };
    let mut simulation = Simulation::inspected(scenario.clone(), &Inspection { tune, step: Rc::new(step) });
    let records = simulation.run_until(SECONDS);
    let epochs: Vec<SimulatedEpoch> = records
        .into_iter()
        .filter_map(|record| match record.what {
            What::Epoch(epoch) => Some(epoch),
            What::Message(_) | What::Fault(_) => None,
        })
        .collect();
    let exchanges = exchanges.borrow();
    let of = |epoch: &SimulatedEpoch| exchanges.iter().position(|exchange| exchange.number == epoch.fix.round);
    let mut settings = Settings::tag(scenario.height_m());
    tune(&mut settings.engine);
    let mut locator: Locator<'_, 0> = Locator::new(settings);
    for epoch in epochs {
        let place = of(&epoch).context("a position of a round that was not seen")?;
        let exchange = &exchanges[place];
        let poll_us = epoch.fix.t_us - u64::from(epoch.fix.age_us);
        let predicted = locator.clone().end_round(poll_us, 0).fix.map(|fix| fix.position);
        let steps = follow(&mut locator, poll_us, exchange, predicted.ok());
        let found = locator.end_round(poll_us, exchange.ranges.len());
        let is_whole = exchange.ranges.len() == ANCHORS && exchange.answers.len() == ANCHORS;
        let (true, true, Ok(predicted_m), Some(before)) =
            (poll_us >= AFTER_US, is_whole, predicted, place.checked_sub(1).map(|before| exchanges[before].clone()))
        else {
            continue;
        };
        let (here, there) = (found.position().ok().context("no position")?, epoch.fix.position_m().context("no fix")?);
        let same = here.position_m.iter().zip(there).all(|(here, there)| (f64::from(*here) - there).abs() < 1e-4);
        ensure!(same, "the tag found {there:?}, the engine beside it {:?}", here.position_m);
        return Ok(Tour { scenario, before, exchange: exchange.clone(), epoch, predicted_m, steps });
    }
    anyhow::bail!("no round with {ANCHORS} answers after {AFTER_US} µs")
}

/// Takes a step of the tag's protocol into the list of rounds.
fn see(exchanges: &mut Vec<Exchange>, event: &Event<'_>, action: &Action<'_>) {
    if let (Event::Sent(instant), Some(exchange)) = (event, exchanges.last_mut()) {
        exchange.poll_tx.get_or_insert(*instant);
    }
    if let (Event::Received(frame), Some(exchange)) = (event, exchanges.last_mut())
        && let Ok(Frame { source, message: Message::Response(response), .. }) = Frame::parse(frame.bytes)
        && response.round == exchange.number as u8
    {
        let (bytes, rx_time, diagnostics) = (frame.bytes.to_vec(), frame.rx_time, frame.diagnostics);
        exchange.answers.push(TourAnswer { bytes, anchor: source, rx_time, diagnostics, response });
    }
    match action {
        Action::Transmit { frame, .. } => {
            if let Ok(Frame { message: Message::Poll(poll), .. }) = Frame::parse(frame) {
                let (number, poll) = (poll.round, frame.to_vec());
                exchanges.push(Exchange { number, poll, poll_tx: None, answers: Vec::new(), ranges: Vec::new() });
            }
        }
        Action::Report(Report::Round(round)) => {
            if let Some(exchange) = exchanges.last_mut().filter(|exchange| exchange.number == round.number) {
                exchange.ranges = round.ranges.to_vec();
            }
        }
        Action::Receive { .. }
        | Action::WaitUntil(_)
        | Action::Sleep { .. }
        | Action::Compensate
        | Action::Report(
            Report::Differences(_) | Report::Polled(_) | Report::Arrival(_) | Report::Downlink(_) | Report::Link(_),
        ) => {}
    }
}

/// Gives a round's ranges to the engine, as the tag does.
fn follow(
    locator: &mut Locator<'_, 0>,
    poll_us: u64,
    exchange: &Exchange,
    mut track_m: Option<[f32; 3]>,
) -> Vec<TourStep> {
    let mut steps = Vec::new();
    for (index, range) in exchange.ranges.iter().enumerate() {
        let Some(position_m) = range.position_m else { continue };
        let power_difference_db = range.diagnostics.rx_power_dbm - range.diagnostics.first_path_power_dbm;
        let mut features = Features::default();
        features.set(Feature::PowerDifference, power_difference_db);
        let reception = Reception { features, power_dbm: range.diagnostics.rx_power_dbm };
        let (anchor, distance_m, deviation_m) = (range.peer, range.distance_m, range.deviation_m);
        let measured = Range { anchor, position_m, distance_m, deviation_m, p_nlos: None, excess_m: None };
        locator.range(poll_us, index, measured, &reception);
        let after = locator.clone().end_round(poll_us, index + 1).fix.map(|fix| fix.position).ok();
        if let (Some(from), Some(after)) = (track_m, after) {
            let expected_m = from.iter().zip(position_m).map(|(a, b)| (a - b).powi(2)).sum::<f32>().sqrt();
            steps.push(TourStep { anchor, range_m: distance_m, expected_m, power_difference_db, position_m: after });
        }
        track_m = after;
    }
    steps
}
