//! `cargo xtask firmware`: builds every image, checks that its board can start it, and compares its size with its
//! budget. The images are left in `target/firmware`.

pub mod expected;
mod fast_code;
mod hex;
pub mod inspect;
mod matrix;
mod stack;

use baliza_report::MarkdownTable;
use std::fmt::Display;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, ensure};
use espflash::flasher::{FlashData, FlashSettings};
use espflash::image_format::idf;
use espflash::target::Chip as EspChip;
use wire::config::Board;

use crate::promises::{self, Made};
use crate::toolchain::{self, Toolchain};
use crate::{succeed, target_directory};
use expected::Expected;
use inspect::Takes;
pub use matrix::BOARDS;
use matrix::{ImageBudget, NodeImage, Platform};

/// The arguments of `cargo xtask firmware`.
#[derive(clap::Args)]
pub struct Arguments {
    /// Only images whose names contain this, such as `tag`, `dwm1001` or `tag-esp32c3-ble`.
    filter: Option<String>,
    /// Only look for mistakes, with clippy; needs a compiler by rustup with the targets.
    #[arg(long)]
    lint: bool,
    /// Write the sizes of the images beside their boards, in boards/*/expected; of all images also the table of the
    /// document
    #[arg(long, conflicts_with = "lint")]
    document: bool,
}

/// Builds the images and checks their sizes.
///
/// # Errors
/// No image has the name, a build fails, a board cannot start an image, or an image is over its budget.
pub fn run(arguments: &Arguments) -> Result<()> {
    let all = matrix::images()?;
    let wanted = |image: &&NodeImage| arguments.filter.as_ref().is_none_or(|part| image.name.contains(part.as_str()));
    let images: Vec<&NodeImage> = all.iter().filter(wanted).collect();
    let names = || all.iter().map(|image| image.name.as_str()).collect::<Vec<_>>().join(", ");
    ensure!(!images.is_empty(), "no image has that in its name; there are {}", names());
    if arguments.lint {
        return images.into_iter().try_for_each(lint);
    }
    if !toolchain::is_installed("flip-link") {
        println!("no flip-link here: on a Cortex-M a stack overflow will go unnoticed; `cargo install flip-link`");
    }
    let rows = images.into_iter().map(built).collect::<Result<Vec<_>>>()?;
    println!("\n{}", table(&rows));
    if arguments.document {
        rows.iter().try_for_each(|row| expected::write(row.image, &row.expected))?;
        if arguments.filter.is_none() {
            promises::remake("firmware", &of_rows(&rows))?;
        }
    } else {
        expected::compare(rows.iter().map(|row| (row.image, &row.expected)))?;
    }
    let over = over(&rows);
    ensure!(over.is_empty(), "over their budgets: {}", over.join(", "));
    println!("{} images in {}", rows.len(), directory().display());
    Ok(())
}

/// The table of the document: all images.
///
/// # Errors
/// A build fails, or a board cannot start an image.
pub fn made() -> Result<Made> {
    let all = matrix::images()?;
    Ok(of_rows(&all.iter().map(built).collect::<Result<Vec<_>>>()?))
}

fn of_rows(rows: &[Row<'_>]) -> Made {
    let complaint = (!over(rows).is_empty()).then_some("an image is over its budget");
    Made::of(vec![("firmware", table(rows))], complaint)
}

/// Builds and inspects an image.
fn built(image: &NodeImage) -> Result<Row<'_>> {
    let toolchain = Toolchain::find(image.platform.target())?;
    let elf = build(image, &toolchain)?;
    let takes = inspect(image, &elf)?;
    let grant = if toolchain.is_rustups() { 0 } else { GRANT_OTHER_COMPILER };
    if let Some(needed) = takes.stack_needed {
        let (name, left) = (&image.name, takes.stack);
        ensure!(100 * needed <= (100 + grant) * left, "{name} needs {needed} bytes of stack, and {left} are left");
    }
    let compiler = toolchain.version().unwrap_or_default();
    let expected = Expected { compiler, sections: inspect::sections(&elf)? };
    Ok(Row { image, takes, grant, expected })
}

/// The names of images over their budgets.
fn over<'i>(rows: &[Row<'i>]) -> Vec<&'i str> {
    rows.iter().filter(|row| !row.is_within()).map(|row| row.image.name.as_str()).collect()
}

/// An image, built.
struct Row<'i> {
    image: &'i NodeImage,
    takes: Takes,
    expected: Expected,
    /// The tolerance for its compiler beyond the budgets, in percent.
    grant: u64,
}

/// The budgets are for rustup's compiler. A distribution's compiler may be another version, which makes slightly
/// different code.
const GRANT_OTHER_COMPILER: u64 = 5;

impl Row<'_> {
    fn is_within(&self) -> bool {
        let Takes { flash, ram, heap, .. } = self.takes;
        let budget = self.image.budget;
        let within = |value: u64, most: Option<u64>| most.is_none_or(|most| 100 * value <= (100 + self.grant) * most);
        within(flash, budget.flash) && within(ram, budget.ram) && heap.is_none_or(|heap| within(heap, budget.heap))
    }
}

/// The folder of the images.
fn directory() -> PathBuf {
    target_directory().join("firmware")
}

/// Builds the image of a name, and returns its ELF file.
///
/// # Errors
/// There is no such image, or its build fails.
pub fn elf(name: &str) -> Result<PathBuf> {
    let images = matrix::images()?;
    let image = images.iter().find(|image| image.name == name).with_context(|| format!("no image {name}"))?;
    build(image, &Toolchain::find(image.platform.target())?)
}

/// An image of a board, as it is given to users.
pub struct Released {
    /// With the symbols and the table of its log, for `baliza` and probe-rs.
    pub elf: PathBuf,
    /// For other flashers: Intel HEX; for an ESP the app as its bootloader loads it.
    pub flashable: PathBuf,
    /// The board's crate.
    pub package: String,
    /// The target's triple.
    pub target: &'static str,
}

/// Builds and checks the images of boards whose names contain `filter`.
///
/// # Errors
/// No image has the name, a build fails, a board cannot start an image, or a file cannot be written.
pub fn release(filter: Option<&str>) -> Result<Vec<Released>> {
    let all = matrix::images()?;
    let is_wanted = |image: &&NodeImage| filter.is_none_or(|part| image.name.contains(part));
    let is_hardware =
        |image: &&NodeImage| matches!(image.platform, Platform::Board(board) if Board::HARDWARE.contains(&board));
    let mut released = Vec::new();
    for image in all.iter().filter(is_wanted).filter(is_hardware) {
        let elf = build(image, &Toolchain::find(image.platform.target())?)?;
        inspect(image, &elf)?;
        let flashable = elf.with_extension(if image.platform.espflash_chip().is_some() { "bin" } else { "hex" });
        if image.platform.target().is_cortex_m() {
            let text = hex::intel_hex(&fs::read(&elf)?).with_context(|| image.name.clone())?;
            fs::write(&flashable, text).with_context(|| format!("cannot write {}", flashable.display()))?;
        }
        let (package, target) = (image.package.clone(), image.platform.target().triple());
        released.push(Released { elf, flashable, package, target });
    }
    ensure!(!released.is_empty(), "no image of a board has that in its name");
    Ok(released)
}

/// The board whose tag is an anchor, too, at a switch, in 252 KiB of flash: these packages are built for size there. With
/// the mathematics less so it takes half a KiB too many.
const SMALL_BOARD: &str = "baliza-board-evk1000";
const FOR_SIZE: [(&str, &str); 5] = [
    ("baliza-ranging", "z"),
    ("firmware-common", "z"),
    ("firmware-tag", "z"),
    ("positioning-core", "z"),
    (SMALL_BOARD, "z"),
];

/// Builds an image, and returns its ELF file.
fn build(image: &NodeImage, toolchain: &Toolchain) -> Result<PathBuf> {
    let name = &image.name;
    let mut cargo = match image.platform {
        Platform::Board(_) => toolchain.cargo_image("build")?,
        // Its stack is far from its variables.
        Platform::Qemu(_) => toolchain.cargo("build"),
    };
    cargo.args(["--package", &image.package, "--bin", &image.binary, "--features", &image.features]);
    if image.package == SMALL_BOARD {
        for (package, level) in FOR_SIZE {
            cargo.args(["--config", &format!("profile.firmware.package.{package}.opt-level=\"{level}\"")]);
        }
    }
    // A part of the build id, so that images of one source have different ids.
    cargo.env("BALIZA_IMAGE", name);
    println!("building {name}");
    succeed(cargo.arg("--quiet"))?;
    let file = directory().join(format!("{name}.elf"));
    fs::create_dir_all(directory())?;
    fs::copy(toolchain.binary(&image.binary), &file).with_context(|| format!("cannot write {}", file.display()))?;
    Ok(file)
}

/// Checks that the board can start the image, and returns its memory use.
fn inspect(image: &NodeImage, elf: &Path) -> Result<Takes> {
    let mut takes = inspect::inspect(elf, image)?;
    if let Some(chip) = image.platform.espflash_chip() {
        takes.flash = espflash_image(elf, chip)?;
    }
    Ok(takes)
}

/// Makes the image that the ESP's bootloader loads, as `espflash save-image` does, and returns its size.
fn espflash_image(elf: &Path, chip: &str) -> Result<u64> {
    let refused = |why: &dyn Display| anyhow!("espflash refuses {}: {why}", elf.display());
    let bytes = fs::read(elf).with_context(|| format!("cannot read {}", elf.display()))?;
    let chip: EspChip = chip.parse().with_context(|| format!("espflash has no chip {chip}"))?;
    idf::check_idf_bootloader(&bytes).map_err(|why| refused(&why))?;
    let flash = FlashData::new(FlashSettings::default(), 0, None, chip, chip.default_xtal_frequency());
    let image = idf::IdfBootloaderFormat::new(&bytes, &flash, None, None, None, None).map_err(|why| refused(&why))?;
    let app = image.ota_segments().next().ok_or_else(|| refused(&"it has no program"))?;
    let file = elf.with_extension("bin");
    fs::write(&file, &app.data).with_context(|| format!("cannot write {}", file.display()))?;
    Ok(app.data.len() as u64)
}

fn lint(image: &NodeImage) -> Result<()> {
    let toolchain = Toolchain::find(image.platform.target())?;
    if !toolchain.has_clippy() {
        println!("{}: no clippy for {}", image.name, image.platform.target().triple());
        return Ok(());
    }
    let mut cargo = toolchain.cargo("clippy");
    cargo.args(["--package", &image.package, "--bin", &image.binary, "--features", &image.features]);
    println!("looking at {}", image.name);
    succeed(cargo.args(["--quiet", "--", "-D", "warnings"]))
}

fn table(rows: &[Row<'_>]) -> String {
    let titles = ["image", "target", "flash:", "budget:", "RAM:", "budget:", "heap:", "stack left:", "needed:"];
    let mut table = MarkdownTable::new(titles);
    for row in rows {
        let Row { image, takes, .. } = row;
        table.row(format_args!(
            "{}{} | {} | {} | {} | {} | {} | {} | {} | {}",
            image.name,
            if row.is_within() { "" } else { " **over**" },
            image.platform.target().triple(),
            kib(Some(takes.flash)),
            flash_budget(&image.budget),
            kib(Some(takes.ram)),
            kib(image.budget.ram),
            kib(takes.heap),
            kib(Some(takes.stack)),
            kib(takes.stack_needed),
        ));
    }
    table.into_text()
}

fn flash_budget(budget: &ImageBudget) -> String {
    match budget.missed {
        Some(meant) => format!("{} (meant: {})", kib(budget.flash), kib(Some(meant))),
        None => kib(budget.flash),
    }
}

/// Binary kilobytes with one digit.
fn kib(bytes: Option<u64>) -> String {
    bytes.map_or(String::new(), |bytes| format!("{:.1}", bytes as f64 / 1024.0))
}
