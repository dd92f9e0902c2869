//! Costs of the positioning methods on the chip: builds the images of `onchip-bench`, runs them in QEMU, compares
//! their results with the desktop's and their costs with the budgets, and makes the tables of
//! `qa/onchip-bench/README.md`.

mod budget;
mod costs;
mod desktop;
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
    /// The output of the image `methods`.
    printed: Printed,
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
    let measured = Chip::ALL.into_iter().map(measure).collect::<Result<Vec<_>>>()?;
    let (budgets, within) = tables::budgets(&measured)?;
    let tables = vec![
        ("cost on the chip", measured.iter().map(tables::costs).collect()),
        ("frames", measured.iter().map(tables::frames).collect::<Result<_>>()?),
        ("sight on the chip", tables::sight(&measured)?),
        ("beacons on the chip", tables::beacons(&measured)?),
        ("engine", measured.iter().map(tables::engine).collect()),
        ("libraries", measured.iter().map(tables::algebra).collect::<Result<_>>()?),
        ("budgets", budgets),
    ];
    Ok(Made::of(tables, (!within).then_some("a figure is over its budget: see the last table above")))
}

fn measure(chip: Chip) -> Result<Measured> {
    let toolchain = Toolchain::find(chip.target())?;
    let printed = run(&toolchain, chip, "methods", "image,methods")?;
    let disagreement_m = desktop::compare(&printed)?;
    let sizes = Sizes::measure(&toolchain)?;
    let compiler = toolchain.version().unwrap_or_default();
    Ok(Measured { chip, compiler, printed, sizes, disagreement_m })
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
