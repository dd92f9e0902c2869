//! The tag's app in the small air's room, on a desktop: what the image for QEMU does, and writes the same telemetry.
//!
//! `cargo run -p firmware-tag --example simulated -- FILE [SOLVER]`; it prints the positions' digest.

use std::cell::RefCell;
use std::error::Error;
use std::pin::pin;

use embassy_futures::join::join;
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use firmware_common::{Reporter, Start, introduce};
use firmware_tag::{Digest, LocatorConfig, TaskChannels, anchor_positions, run_from_config};
use small_air::{AirRadio, World, room, uptime_us};
use wire::config::{Record, Role, Solver};
use wire::telemetry::{Board, ResetCause};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (file, solver) = match arguments.as_slice() {
        [file] => (file, Solver::Track),
        [file, name] => (file, Solver::from_name(name).ok_or("there is no such solver")?),
        _ => return Err("usage: simulated FILE [SOLVER]".into()),
    };
    let life = live(&room::record(solver), room::LIFE_US, room::tag)?;
    std::fs::write(file, life.telemetry)?;
    println!("digest {:016x}", life.digest.value());
    Ok(())
}

/// Puts a tag into the room.
type TagIn = for<'w> fn(&'w World) -> Option<AirRadio<'w>>;

/// What became of a tag's life.
pub struct Life {
    /// All that it told.
    pub telemetry: Vec<u8>,
    /// Its positions'.
    pub digest: Digest,
    /// How often its radio slept.
    pub naps: u32,
}

/// A tag's life in the room, of so many microseconds, by its record.
pub fn live(record: &Record, life_us: u64, tag_in: TagIn) -> Result<Life, Box<dyn Error>> {
    let (channels, reporter) = (TaskChannels::new(), Reporter::<NoopRawMutex, 4096>::new(uptime_us));
    let start = Start { record: Ok(record.clone()), eui: room::TAG_EUI, reset: ResetCause::PowerOn, crash: None };
    let (hello, followed) = introduce(&reporter, Board::Simulated, wire::telemetry::Role::Tag, start);
    let (record, settings) = followed.ok_or("the room's record cannot be followed")?;
    let Role::Tag(tag) = settings.role else { return Err("the room's record is not a tag's".into()) };
    let anchors = anchor_positions(&record);
    let world = room::world(&settings.network);
    let radio = tag_in(&world).ok_or("the world is full")?;
    let digest = RefCell::new(Digest::new());
    let app = run_from_config(
        radio,
        world.delay(),
        (&settings, &tag),
        LocatorConfig::of(&tag, &record, &anchors),
        (&channels, &reporter),
        hello,
        &digest,
    );

    let mut telemetry = Vec::new();
    {
        let everything = pin!(join(app, room::anchors(&world, settings.network)));
        world.run(life_us, everything, || {
            reporter.event_log.drain(|frame| {
                telemetry.extend_from_slice(frame);
                true
            });
        });
    }
    Ok(Life { telemetry, digest: digest.into_inner(), naps: world.naps() })
}
