//! The room of `baliza simulate`, with images in QEMU as its nodes.

use std::cell::RefCell;
use std::path::PathBuf;
use std::rc::Rc;
use std::sync::mpsc;
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use dw1000_sim::{AirStatistics, ChipConfig, ClockConfig, NodeConfig, Path, TrueTime, World};
use rand::Rng;
use sim::scenario::Scenario;
use wire::config::{Identity, MAX_BYTES, Record};

use super::guest::Guest;
use super::node::{Life, SimulatedNode};
use crate::chip::Chip;

/// The images of a chip.
pub struct Images {
    /// The image of tags.
    pub tag: PathBuf,
    /// The image of anchors.
    pub anchor: PathBuf,
}

/// The result of a run.
pub struct NetworkRun {
    /// The tags.
    pub tags: Vec<Lived>,
    /// The anchors.
    pub anchors: Vec<Lived>,
    /// Statistics of the air.
    pub air: AirStatistics,
    /// The run's duration.
    pub took: Duration,
}

/// A node at the end of a run.
pub struct Lived {
    /// Its chip and its processor.
    pub node: dw1000_sim::Node,
    /// The record of its run.
    pub life: Life,
}

/// Limit of the images' run time for a second of simulated time.
const PATIENCE_A_SECOND: Duration = Duration::from_secs(120);

/// A node, and the record of its run.
type Running = (dw1000_sim::Node, Rc<RefCell<Life>>);

/// Runs the scenario: a world as [`sim::scenario::Simulation`] makes it, with other processors.
///
/// # Errors
/// QEMU cannot be started, or an image fails or takes too long.
pub fn run(chip: Chip, images: &Images, scenario: &Scenario) -> Result<NetworkRun> {
    let world = World::new(scenario.seed, scenario.air_config());
    let end = TrueTime::from_secs_f64(scenario.seconds);
    let mut machines = Vec::new();
    let mut add = |address: u16, path: Path, record: Record, image: &PathBuf| -> Result<Running> {
        let offset_ppm = world.random(u64::from(address)).random_range(-1.0..=1.0) * scenario.clock_ppm;
        let config = ChipConfig { clock: ClockConfig::crystal(offset_ppm), ..ChipConfig::default() };
        let guest = Guest::start(chip, image)?;
        machines.push(guest.process());
        let life = Rc::new(RefCell::new(Life::new()));
        // All processors are the same chip.
        let record = Record { identity: Identity { eui: None, address: Some(address) }, ..record };
        let record = wire::config::encode(&record, 0, &mut [0; MAX_BYTES]).to_vec();
        let node = RefCell::new(Some(SimulatedNode { guest, record, end, life: life.clone() }));
        let hardware = world.add_node(NodeConfig { path, chip: config, board: scenario.board });
        hardware.boot(move |peripherals| {
            let node = node.take();
            async {
                if let Some(node) = node {
                    node.run(peripherals).await;
                }
            }
        });
        Ok((hardware, life))
    };
    let mut anchors = Vec::new();
    for anchor in &scenario.anchors {
        anchors.push(add(anchor.address, Path::Fixed(anchor.at), scenario.anchor_record(anchor), &images.anchor)?);
    }
    let mut tags = Vec::new();
    for tag in &scenario.tags {
        let walk = tag.walk.clone();
        let path = Path::Function(Rc::new(move |seconds| walk.at(seconds)));
        tags.push(add(tag.address, path, scenario.tag_record(tag), &images.tag)?);
    }
    let start = Instant::now();
    let (done, watch) = mpsc::channel::<()>();
    let patience = PATIENCE_A_SECOND.mul_f64(scenario.seconds.max(1.0));
    let watchdog = thread::spawn(move || {
        let hung = watch.recv_timeout(patience) == Err(mpsc::RecvTimeoutError::Timeout);
        if hung {
            machines.iter().for_each(super::guest::Process::kill);
        }
        hung
    });
    // The last messages are sent at the end.
    world.run_until(end + Duration::from_millis(1));
    drop(done);
    if watchdog.join().ok().context("the watchdog panicked")? {
        bail!("the images did not end in {} s", patience.as_secs());
    }
    let lived = |running: Vec<Running>| -> Result<Vec<Lived>> {
        let each = running.into_iter().map(|(node, life)| (node, life.replace(Life::new())));
        each.map(|(node, mut life)| life.failure.take().map_or(Ok(Lived { node, life }), Err)).collect()
    };
    Ok(NetworkRun { tags: lived(tags)?, anchors: lived(anchors)?, air: world.statistics(), took: start.elapsed() })
}
