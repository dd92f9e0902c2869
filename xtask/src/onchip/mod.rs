//! Costs of the positioning methods on the chip: builds the images of `onchip-bench`, runs them in QEMU, compares
//! their results with the desktop's and their costs with the budgets, and makes the tables of
//! `qa/onchip-bench/README.md`.

mod budget;
mod costs;
mod desktop;
mod engine;
mod printed;
mod size;
mod tables;

use anyhow::{Result, ensure};

use crate::chip::Chip;
use crate::promises::Made;
use crate::toolchain::Toolchain;
use crate::{qemu, succeed};
use printed::Printed;
use size::Sizes;

/// All measurements on one chip.
struct Measured {
    chip: Chip,
    compiler: String,
    /// The output of the image `solvers`.
    solvers: Printed,
    /// The output of the image `algebra`.
    algebra: Printed,
    /// The output of the image `exchange`.
    exchange: Printed,
    /// The output of the image `nlos`.
    sight: Printed,
    /// The output of the image `beacons`.
    beacons: Printed,
    /// The output of the image `engine`.
    engine: Printed,
    sizes: Sizes,
    /// The greatest distance between a position of the chip and the desktop's, metres.
    disagreement_m: f32,
}

pub use costs::made as costs;
pub use tables::grouped;

/// The tables of the document.
///
/// # Errors
/// A measurement fails.
pub fn made() -> Result<Made> {
    let Tables { costs, budgets, algebra, frames, sight, beacons, engine, within } = Tables::measure()?;
    let tables = vec![
        ("cost on the chip", costs),
        ("frames", frames),
        ("sight on the chip", sight),
        ("beacons on the chip", beacons),
        ("engine", engine),
        ("libraries", algebra),
        ("budgets", budgets),
    ];
    Ok(Made::of(tables, (!within).then_some("a figure is over its budget: see the last table above")))
}

/// The tables, and whether all budgets are kept.
struct Tables {
    costs: String,
    budgets: String,
    algebra: String,
    frames: String,
    sight: String,
    beacons: String,
    engine: String,
    within: bool,
}

impl Tables {
    fn measure() -> Result<Self> {
        let measured = Chip::ALL.into_iter().map(measure).collect::<Result<Vec<_>>>()?;
        let costs = measured.iter().map(tables::costs).collect::<String>();
        let (budgets, within) = tables::budgets(&measured)?;
        let algebra = measured.iter().map(tables::algebra).collect::<Result<String>>()?;
        let frames = measured.iter().map(tables::frames).collect::<Result<String>>()?;
        let sight = tables::sight(&measured)?;
        let beacons = tables::beacons(&measured)?;
        let engine = measured.iter().map(engine::table).collect::<String>();
        Ok(Self { costs, budgets, algebra, frames, sight, beacons, engine, within })
    }
}

fn measure(chip: Chip) -> Result<Measured> {
    let toolchain = Toolchain::find(chip.target())?;
    let solvers = run(&toolchain, chip, "solvers", "image")?;
    let disagreement_m = desktop::compare(&solvers)?;
    let algebra = run(&toolchain, chip, "algebra", "image,libraries")?;
    let exchange = run(&toolchain, chip, "exchange", "image,exchange")?;
    let sight = run(&toolchain, chip, "nlos", "image")?;
    desktop::compare_sight(&sight)?;
    let beacons = run(&toolchain, chip, "beacons", "image")?;
    desktop::compare_beacons(&beacons)?;
    let engine = run(&toolchain, chip, "engine", "image")?;
    engine::compare(&engine.engine)?;
    let sizes = Sizes::measure(&toolchain)?;
    let compiler = toolchain.version().unwrap_or_default();
    Ok(Measured { chip, compiler, solvers, algebra, exchange, sight, beacons, engine, sizes, disagreement_m })
}

/// Builds and runs an image.
fn run(toolchain: &Toolchain, chip: Chip, name: &str, features: &str) -> Result<Printed> {
    let mut cargo = toolchain.cargo("build");
    succeed(cargo.args(["--quiet", "--package", "baliza-onchip-bench", "--bin", name, "--features", features]))?;
    let printed = Printed::parse(&qemu::run(chip, &toolchain.binary(name))?)?;
    let counted = printed.calibration;
    ensure!(counted.abs_diff(1000) <= 2, "{}: 1000 instructions were counted as {counted}", chip.title());
    Ok(printed)
}
