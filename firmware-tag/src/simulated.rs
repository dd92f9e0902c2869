//! The run of a simulated tag in the small air's room, from its record to telemetry. The image for QEMU, its desktop
//! twin and tests use it.

use core::cell::RefCell;
use core::pin::pin;

use embassy_futures::join::join;
use embassy_sync::blocking_mutex::raw::RawMutex;
use firmware_common::{Reporter, Start, introduce};
use small_air::{AirRadio, World, room};
use wire::config::{LoadError, Record, Role};
use wire::telemetry::{Board, Condition, ResetCause};

use crate::{Digest, LocatorConfig, TaskChannels, anchor_positions, run_from_config};

/// Puts a tag into the room. Returns `None` if the world is full.
pub type TagIn = for<'w> fn(&'w World) -> Option<AirRadio<'w>>;

/// The results of a tag's run, beside its telemetry.
#[derive(Clone, Copy, Debug)]
pub struct Life {
    /// The digest of its positions.
    pub digest: Digest,
    /// How often its radio slept.
    pub naps: u32,
}

/// Runs a tag for `life_us` microseconds with the content of its flash. `take_out` may take telemetry out whenever the
/// time is about to advance. `None` means that the tag did not transmit and has reported the reason.
pub fn live<M: RawMutex, const BYTES: usize>(
    record: Result<Record, LoadError>,
    life_us: u64,
    tag_in: TagIn,
    (channels, reporter): (&TaskChannels<M>, &Reporter<M, BYTES>),
    take_out: impl FnMut(),
) -> Option<Life> {
    let start = Start { record, eui: room::TAG_EUI, reset: ResetCause::PowerOn, crash: None };
    let (hello, followed) = introduce(reporter, Board::Simulated, wire::telemetry::Role::Tag, start);
    let (record, settings) = followed?;
    let complain = |condition| reporter.event_log.state(reporter.now_us(), condition);
    let Role::Tag(tag) = settings.role else {
        complain(Condition::WrongRecord);
        return None;
    };
    let world = room::world(&settings.network);
    let Some(radio) = tag_in(&world) else {
        complain(Condition::RadioFailed(1));
        return None;
    };
    let anchors = anchor_positions(&record);
    let locator = LocatorConfig::of(&tag, &record, &anchors);
    let digest = RefCell::new(Digest::new());
    let app = run_from_config(radio, world.delay(), (&settings, &tag), locator, (channels, reporter), hello, &digest);
    let everything = pin!(join(app, room::anchors(&world, settings.network)));
    world.run(life_us, everything, take_out);
    Some(Life { digest: *digest.borrow(), naps: world.naps() })
}
