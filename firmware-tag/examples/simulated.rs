//! The tag's app in the small air's room, on a desktop: what the image for QEMU does, and writes the same telemetry.
//!
//! `cargo run -p firmware-tag --example simulated -- FILE`

use std::error::Error;
use std::pin::pin;

use embassy_futures::join::join;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use firmware_common::{Reporter, Settings};
use firmware_tag::{Handover, Locator, places, run_as_told};
use node_record::{Record, Role};
use small_air::{AirRadio, World, room, uptime_us};
use telemetry::{Board, Reset, ResetCause};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [file] = arguments.as_slice() else { return Err("usage: simulated FILE".into()) };
    std::fs::write(file, live(&room::record(), room::LIFE_US, room::tag)?.0)?;
    Ok(())
}

/// Puts a tag into the room.
type TagIn = for<'w> fn(&'w World) -> Option<AirRadio<'w>>;

/// The telemetry of a tag's life in the room, of so many microseconds, by its record; and how often its radio slept.
pub fn live(record: &Record, life_us: u64, tag_in: TagIn) -> Result<(Vec<u8>, u32), Box<dyn Error>> {
    let settings = Settings::of(record, room::TAG_EUI).map_err(|invalid| invalid.to_string())?;
    let Role::Tag(tag) = settings.role else { return Err("the room's record is not a tag's".into()) };
    let anchors = places(record);
    let (handover, reporter) = (Handover::new(), Reporter::<NoopRawMutex, 4096>::new(uptime_us));
    let world = room::world(&settings.network);
    let radio = tag_in(&world).ok_or("the world is full")?;
    reporter.journal.reset(Reset { t_us: uptime_us(), cause: ResetCause::PowerOn, crash: None });
    let told = (&handover, &reporter);
    let app = run_as_told(
        radio,
        world.delay(),
        (&settings, &tag),
        Locator::of(&tag, record, &anchors),
        told,
        Board::Simulated,
    );

    let mut telemetry = Vec::new();
    let everything = pin!(join(app, room::anchors(&world, settings.network)));
    world.run(life_us, everything, || {
        reporter.journal.drain(|frame| {
            telemetry.extend_from_slice(frame);
            true
        });
    });
    Ok((telemetry, world.naps()))
}
