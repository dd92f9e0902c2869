//! All images that are built: role, board, variant, and size budget. Each board's crate lists its images in the table
//! `package.metadata.baliza` of its manifest.

use anyhow::{Context, Result};
use serde::Deserialize;
use wire::config::{Board, Flasher, Memory};

use crate::chip::Chip;
use crate::target::Target;
use crate::workspace::{self, Package};

/// The prefix of the names of the boards' crates.
pub const BOARDS: &str = "baliza-board-";

/// What an image runs on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Platform {
    /// A board.
    Board(Board),
    /// QEMU, as this chip.
    Qemu(Chip),
}

/// QEMU's virt machine, as the images are linked for it.
const VIRT: Memory = Memory { image_origin: None, flash: &[], ram: (0x8000_0000, 4 << 20), other_ram: &[] };

impl Platform {
    pub fn target(self) -> Target {
        match self {
            Self::Board(board) => Target(board.spec().target),
            Self::Qemu(chip) => chip.target(),
        }
    }

    /// The chip's name for espflash, if espflash flashes it.
    pub fn espflash_chip(self) -> Option<&'static str> {
        let Self::Board(board) = self else { return None };
        match board.spec().flasher {
            Flasher::Espflash(chip) => Some(chip),
            Flasher::ProbeRs(_) | Flasher::Qemu => None,
        }
    }

    pub fn memory(self) -> Memory {
        match self {
            Self::Board(board) => board.spec().memory,
            Self::Qemu(Chip::CortexM4F | Chip::CortexM3) => Board::Simulated.spec().memory,
            Self::Qemu(Chip::RiscV32) => VIRT,
        }
    }
}

/// One image.
#[derive(Clone, Debug)]
pub struct NodeImage {
    /// Role, board and variant: the file's name in `target/firmware`.
    pub name: String,
    /// The board's crate.
    pub package: String,
    /// The role.
    pub binary: String,
    pub platform: Platform,
    /// All features to be enabled, in cargo's format.
    pub features: String,
    pub budget: ImageBudget,
}

impl NodeImage {
    /// Whether it ranges: those of a beacon and of a scanner do not.
    pub fn ranges(&self) -> bool {
        !["beacon", "scanner"].contains(&&*self.binary)
    }
}

/// The greatest size of an image, bytes; a value without a budget is printed but not checked.
#[derive(Clone, Copy, Debug, Default)]
pub struct ImageBudget {
    /// Code, constants and initial values; for an ESP the image that espflash makes.
    pub flash: Option<u64>,
    /// Variables, without stack.
    pub ram: Option<u64>,
    /// The heap, which is a part of the variables.
    pub heap: Option<u64>,
    /// The intended limit of the flash, where it could not be met: then `flash` prevents further growth.
    pub missed: Option<u64>,
}

/// The table in a manifest.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Table {
    images: Vec<Row>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Row {
    bin: String,
    /// A board's name …
    board: Option<String>,
    /// … or the name of a chip that QEMU simulates.
    qemu: Option<String>,
    /// Features beside those that the binary and the board need.
    #[serde(default)]
    features: Vec<String>,
    flash_kib: Option<u64>,
    ram_kib: Option<u64>,
    heap_kib: Option<u64>,
    meant_kib: Option<u64>,
}

impl Row {
    fn image(self, package: &Package) -> Result<NodeImage> {
        let Self { bin, board, qemu, features, .. } = &self;
        let platform = match (board, qemu) {
            (Some(name), None) => Board::from_name(name).map(Platform::Board),
            (None, Some(name)) => Chip::SIMULATED.into_iter().find(|chip| chip.name() == name).map(Platform::Qemu),
            (Some(_), Some(_)) | (None, None) => None,
        };
        let platform = platform.with_context(|| format!("image {bin}: neither a board nor a chip in QEMU"))?;
        let (on, variant) = match (platform, qemu) {
            (Platform::Board(board), _) => (board.name(), None),
            (Platform::Qemu(_), chip) => (package.name.trim_start_matches(BOARDS), chip.as_ref()),
        };
        let product = package.targets.iter().find(|product| product.name == *bin);
        let required = &product.with_context(|| format!("there is no binary {bin}"))?.required_features;
        let own = package.features.contains_key(on).then(|| on.to_owned());
        let enabled: Vec<_> = required.iter().chain(&own).chain(features).map(String::as_str).collect();
        let bytes = |kib: Option<u64>| kib.map(|kib| kib << 10);
        Ok(NodeImage {
            name: variant.into_iter().chain(features).fold(format!("{bin}-{on}"), |name, it| format!("{name}-{it}")),
            package: package.name.clone(),
            binary: bin.clone(),
            platform,
            features: enabled.join(","),
            budget: ImageBudget {
                flash: bytes(self.flash_kib),
                ram: bytes(self.ram_kib),
                heap: bytes(self.heap_kib),
                missed: bytes(self.meant_kib),
            },
        })
    }
}

/// All images: those of boards first, by roles.
///
/// # Errors
/// Cargo cannot list the crates, or the table of a crate is wrong.
pub fn images() -> Result<Vec<NodeImage>> {
    let mut images = Vec::new();
    for package in workspace::packages()? {
        let Some(table) = package.metadata.as_ref().and_then(|metadata| metadata.get("baliza")) else { continue };
        let table = Table::deserialize(table).with_context(|| format!("images of {}", package.name))?;
        for row in table.images {
            images.push(row.image(&package).with_context(|| format!("images of {}", package.name))?);
        }
    }
    let rank = |image: &NodeImage| {
        let board = match image.platform {
            Platform::Board(board) => Board::HARDWARE.iter().position(|other| *other == board),
            Platform::Qemu(_) => None,
        };
        let role = ["anchor", "tag", "beacon", "scanner"].iter().position(|role| *role == image.binary);
        (board.is_none(), role, board)
    };
    images.sort_by_key(rank);
    Ok(images)
}
