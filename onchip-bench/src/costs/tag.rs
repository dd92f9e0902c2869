//! What a tag does beside ranging: a round in the engine, with its ranges' lines of sight judged, and a position told.

use core::future::Future;
use core::hint::black_box;
use core::pin::pin;
use core::task::{Context, Waker};

use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use firmware_common::Reporter;
use firmware_tag::{Epoch, Locator, Measured, Sink, Told, Tracker};
use oorandom::Rand32;
use positioning_core::Method;
use positioning_core::engine::{Settings, Solvers};
use ranging::exchange::{Range, Round};
use ranging::{Diagnostics, RadioInstant};

use super::{Mean, since};
use crate::instrument::stamp;
use crate::walk::{ROUNDS, WARM_UP, range};

/// The numbers of ranges that are measured.
pub const RANGES: [u16; 2] = [4, 8];
const MOST: usize = 8;
/// From one round to the next, microseconds.
const ROUND_US: u64 = 20_000;

/// A round in the engine, and what is told of it, out of the journal again; instructions.
#[derive(Default)]
pub struct Costs {
    /// The round.
    pub round: Mean,
    /// The position.
    pub publish: Mean,
    /// A range beside it.
    pub publish_range: Mean,
}

/// Range by range, as a tag has it that walks at a metre a second through a room of as many anchors; one in four is blocked, and its powers tell.
fn round(ranges: u16, number: u32, random: &mut Rand32) -> (u64, [Range; MOST]) {
    let poll_us = u64::from(number) * ROUND_US;
    let tag = [2.0 + 1.0e-6 * poll_us as f32, 3.0, 1.2];
    let made = core::array::from_fn(|anchor| {
        let measured = range(anchor as u16, ranges, tag, random.rand_float());
        let first_path_power_dbm = if measured.blocked > Some(0.5) { -96.0 } else { -81.0 };
        Range {
            peer: measured.anchor + 1,
            distance_m: measured.distance,
            deviation_m: measured.deviation,
            position_m: Some(measured.place),
            diagnostics: Diagnostics { rx_power_dbm: -80.0, first_path_power_dbm, ..Diagnostics::default() },
        }
    });
    (poll_us, made)
}

/// Measures rounds of so many ranges, tracked or each solved by itself, in the plane or in space.
pub fn measure(ranges: u16, tracks: bool, space: bool) -> Costs {
    let costs = Costs::default();
    let mut locator = Locator::new((!space).then_some(1.2), &[]);
    if !tracks {
        locator.settings = Settings::solve(locator.settings.dimensions, Solvers::of(Method::Robust));
    }
    let mut tracker = Tracker::new(locator);
    let reporter = Reporter::<NoopRawMutex, 1024>::new(|| 0);
    let mut random = Rand32::new(u64::from(ranges));
    for number in 0..WARM_UP + ROUNDS {
        let (poll_us, made) = round(ranges, number, &mut random);
        let ranges = &made[..usize::from(ranges).min(MOST)];
        let asked = ranges.len() as u8;
        let round = Round { number: number as u16, poll: RadioInstant::from_ticks(0), asked, ranges };
        let begun = stamp();
        let epoch = tracker.follow(Measured::Ranges(black_box(round)), None, poll_us);
        let instructions = since(begun);
        assert!(epoch.outcome.is_ok() || number < WARM_UP, "no position");
        let position = tell(&reporter, epoch.clone(), false);
        let with_ranges = tell(&reporter, epoch, true);
        if number >= WARM_UP {
            costs.round.add(instructions);
            costs.publish.add(position);
            costs.publish_range.add((with_ranges - position) / u32::from(asked));
        }
    }
    costs
}

/// What it takes to tell of a round, with its ranges or without, instructions.
fn tell(reporter: &Reporter<NoopRawMutex, 1024>, epoch: Epoch<'_>, report_ranges: bool) -> u32 {
    let sink = Told::new(reporter, report_ranges);
    let begun = stamp();
    let told = pin!(sink.publish(epoch)).poll(&mut Context::from_waker(Waker::noop()));
    reporter.journal.drain(|frame| {
        black_box(frame);
        true
    });
    let instructions = since(begun);
    assert!(told.is_ready());
    instructions
}
