//! Measures what a tag does beside ranging: a round in the engine's task, in which its links are classified and the
//! position is published, and a line of the log.

use core::convert::Infallible;
use core::future::{Future, pending};
use core::hint::black_box;
use core::pin::{Pin, pin};
use core::task::{Context, Waker};

use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embedded_hal_async::delay::DelayNs;
use firmware_common::{EventLog, Reporter};
use firmware_tag::{LISTED, LocatorConfig, RateControl, TaskChannels, TelemetrySink};
use oorandom::Rand32;
use positioning_core::Method;
use positioning_core::engine::{Settings, Solvers};
use ranging::exchange::{Range, Round};
use ranging::native::Rate;
use ranging::{Diagnostics, RadioInstant};
use wire::telemetry::{Doubt, Fix, Outcome, Solver};

use super::{Mean, since};
use crate::instrument::stamp;
use crate::walk::{ROUNDS, WARM_UP, range};

/// The numbers of ranges in the measurements.
pub const RANGES: [u16; 2] = [4, 8];
const MOST: usize = 8;
/// From one round to the next, microseconds.
const ROUND_US: u64 = 20_000;
/// The capacity of the event log, bytes of frames.
const BYTES: usize = 1024;

type Guard = NoopRawMutex;

/// The costs of a round in the engine's task, and of the frames that it publishes, taken out of the event log again;
/// instructions.
#[derive(Default)]
pub struct TagCosts {
    /// A round with its published position.
    pub round: Mean,
    /// A range that is published with the position.
    pub publish_range: Mean,
}

/// The ranges of a tag that walks at a metre a second through a room with `ranges` anchors. One link in four is
/// blocked, and its received powers indicate this.
fn round(ranges: u16, number: u32, random: &mut Rand32) -> (u64, [Range; MOST]) {
    let poll_us = u64::from(number) * ROUND_US;
    let tag = [2.0 + 1.0e-6 * poll_us as f32, 3.0, 1.2];
    let made = core::array::from_fn(|anchor| {
        let measured = range(anchor as u16, ranges, tag, random.rand_float());
        let first_path_power_dbm = if measured.p_nlos > Some(0.5) { -96.0 } else { -81.0 };
        Range {
            peer: measured.anchor + 1,
            distance_m: measured.distance_m,
            deviation_m: measured.deviation_m,
            position_m: Some(measured.position_m),
            diagnostics: Diagnostics { rx_power_dbm: -80.0, first_path_power_dbm, ..Diagnostics::default() },
        }
    });
    (poll_us, made)
}

/// Measures rounds of `ranges` ranges, tracked or each solved by itself, in the plane or in space.
pub fn measure(ranges: u16, tracks: bool, space: bool) -> TagCosts {
    let costs = TagCosts::default();
    let channels = [TaskChannels::<Guard>::new(), TaskChannels::new()];
    // The time is constant, so that the log has a line for the first round only.
    let reporters = [Reporter::<Guard, BYTES>::new(|| 0), Reporter::new(|| 0)];
    let sinks =
        [false, true].map(|report_ranges| TelemetrySink::new(&reporters[usize::from(report_ranges)], report_ranges));
    let engine = |tag: usize| {
        let mut locator = LocatorConfig::new((!space).then_some(1.2), &[]);
        if !tracks {
            locator.settings.engine = Settings::solve(locator.settings.engine.dimensions, Solvers::of(Method::Robust));
        }
        firmware_tag::engine::<LISTED, _>(
            &channels[tag],
            Never,
            locator,
            RateControl::new(Rate::Greedy, None),
            &sinks[tag],
        )
    };
    let (mut silent, mut telling) = (pin!(engine(0)), pin!(engine(1)));
    run(silent.as_mut(), &reporters[0]);
    run(telling.as_mut(), &reporters[1]);
    let mut random = Rand32::new(u64::from(ranges));
    for number in 0..WARM_UP + ROUNDS {
        let (poll_us, made) = round(ranges, number, &mut random);
        let ranges = &made[..usize::from(ranges).min(MOST)];
        let asked = ranges.len() as u8;
        let round = Round { number: number as u16, poll: RadioInstant::from_ticks(0), asked, ranges };
        channels.iter().for_each(|channel| assert_eq!(channel.put_ranges(black_box(&round), poll_us, None), 0));
        let (alone, _) = run(silent.as_mut(), &reporters[0]);
        let (with_ranges, frames) = run(telling.as_mut(), &reporters[1]);
        assert_eq!(frames, 1 + u32::from(asked), "a position and its ranges are published");
        if number >= WARM_UP {
            costs.round.add(alone);
            costs.publish_range.add((with_ranges - alone) / u32::from(asked));
        }
    }
    costs
}

/// Lets the engine take the waiting rounds, and takes the frames out of the event log. Returns the instructions and the
/// number of frames.
fn run(engine: Pin<&mut impl Future<Output = Infallible>>, reporter: &Reporter<Guard, BYTES>) -> (u32, u32) {
    let begun = stamp();
    let ended = engine.poll(&mut Context::from_waker(Waker::noop()));
    let mut frames = 0;
    reporter.event_log.drain(|frame| {
        black_box(frame);
        frames += 1;
        true
    });
    let instructions = since(begun);
    assert!(ended.is_pending());
    (instructions, frames)
}

/// A delay that never ends: the engine then waits for rounds alone.
#[derive(Clone)]
struct Never;

impl DelayNs for Never {
    async fn delay_ns(&mut self, _: u32) {
        pending().await
    }
}

/// The cost of the log line of a position, instructions.
pub fn measure_line() -> u32 {
    let event_log = EventLog::<Guard, BYTES>::new();
    let outcome = Outcome::position([3.21, 4.05, 1.5], [[0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0; 3]], 0b1111, 0.9);
    let fix =
        Fix { t_us: 1_000_000, round: 7, age_us: 2_400, asked: 4, outcome, solver: Solver::Track, doubt: Doubt::None };
    // The first gets a line, the second of the same instant none.
    let [with_line, without] = [(); 2].map(|()| {
        let begun = stamp();
        event_log.fix(black_box(fix), 4);
        since(begun)
    });
    with_line - without
}
