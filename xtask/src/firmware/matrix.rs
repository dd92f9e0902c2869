//! Every image that is built: role, board, variant, and what it may take.

use crate::chip::Chip;
use crate::target::Target;

/// A board, as far as its images differ in building.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Board {
    Dwm1001,
    Evk1000,
    Esp32C3,
    Esp32C6,
    /// QEMU with a radio and its air within the image.
    Simulated(Chip),
    /// QEMU with a simulated DW1000 behind a pipe.
    Wired(Chip),
}

/// Where a chip's memories are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Memory {
    /// Where the image begins; an ESP's bootloader loads it from anywhere.
    pub flash_origin: Option<u64>,
    /// Where flash is seen: first address, bytes.
    pub flash: &'static [(u64, u64)],
    pub ram_origin: u64,
    pub ram_bytes: u64,
    /// Other views of the RAM, and other RAM.
    pub other_ram: &'static [(u64, u64)],
}

impl Board {
    /// As features and images call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Dwm1001 => "dwm1001",
            Self::Evk1000 => "evk1000",
            Self::Esp32C3 => "esp32c3",
            Self::Esp32C6 => "esp32c6",
            Self::Simulated(_) => "simulated",
            Self::Wired(_) => "wired",
        }
    }

    pub fn target(self) -> Target {
        match self {
            Self::Dwm1001 => Target::CortexM4F,
            Self::Evk1000 => Target::CortexM3,
            Self::Esp32C3 => Target::RiscV32Imc,
            Self::Esp32C6 => Target::RiscV32Imac,
            Self::Simulated(chip) | Self::Wired(chip) => chip.target(),
        }
    }

    /// The chip's name to espflash, where that flashes it.
    pub fn espflash_chip(self) -> Option<&'static str> {
        match self {
            Self::Esp32C3 | Self::Esp32C6 => Some(self.name()),
            Self::Dwm1001 | Self::Evk1000 | Self::Simulated(_) | Self::Wired(_) => None,
        }
    }

    /// The kind of chip that QEMU stands in for.
    pub fn in_qemu(self) -> Option<Chip> {
        match self {
            Self::Simulated(chip) | Self::Wired(chip) => Some(chip),
            Self::Dwm1001 | Self::Evk1000 | Self::Esp32C3 | Self::Esp32C6 => None,
        }
    }

    pub fn memory(self) -> Memory {
        match self {
            // nRF52832: 512 KiB, of which the last four pages are the node's; 64 KiB.
            Self::Dwm1001 => Memory {
                flash_origin: Some(0),
                flash: &[(0, 496 << 10)],
                ram_origin: 0x2000_0000,
                ram_bytes: 64 << 10,
                other_ram: &[],
            },
            // STM32F105RC: 256 KiB, of which the last two pages are the node's; 64 KiB.
            Self::Evk1000 => Memory {
                flash_origin: Some(0x0800_0000),
                flash: &[(0x0800_0000, 252 << 10)],
                ram_origin: 0x2000_0000,
                ram_bytes: 64 << 10,
                other_ram: &[],
            },
            // Internal SRAM as data (technical reference manuals, "System and Memory"): 384 KiB after the cache's 16; 512 KiB. Flash by
            // the cache, as instructions and as data; SRAM as instructions; RTC memory.
            Self::Esp32C3 => Memory {
                flash_origin: None,
                flash: &[(0x4200_0000, 8 << 20), (0x3C00_0000, 8 << 20)],
                ram_origin: 0x3FC8_0000,
                ram_bytes: 384 << 10,
                other_ram: &[(0x4037_C000, 400 << 10), (0x5000_0000, 8 << 10)],
            },
            Self::Esp32C6 => Memory {
                flash_origin: None,
                flash: &[(0x4200_0000, 16 << 20)],
                ram_origin: 0x4080_0000,
                ram_bytes: 512 << 10,
                other_ram: &[(0x5000_0000, 16 << 10)],
            },
            // QEMU's mps2-an386 and virt, as the images are linked.
            Self::Simulated(Chip::CortexM4F | Chip::CortexM3) | Self::Wired(Chip::CortexM4F | Chip::CortexM3) => {
                Memory {
                    flash_origin: Some(0),
                    flash: &[(0, 4 << 20)],
                    ram_origin: 0x2000_0000,
                    ram_bytes: 4096 << 10,
                    other_ram: &[],
                }
            }
            Self::Simulated(Chip::RiscV32) | Self::Wired(Chip::RiscV32) => Memory {
                flash_origin: None,
                flash: &[],
                ram_origin: 0x8000_0000,
                ram_bytes: 4096 << 10,
                other_ram: &[],
            },
        }
    }
}

impl Memory {
    /// Whether so many bytes from an address on lie in one of the memories.
    pub fn holds(&self, address: u64, bytes: u64) -> bool {
        let ram = [(self.ram_origin, self.ram_bytes)];
        let mut places = self.flash.iter().chain(&ram).chain(self.other_ram);
        places.any(|&(origin, length)| address >= origin && address + bytes <= origin + length)
    }
}

/// One image.
#[derive(Clone, Copy, Debug)]
pub struct Image {
    pub role: &'static str,
    pub board: Board,
    /// Features beside the board's.
    pub features: &'static [&'static str],
    pub budget: Budget,
}

/// The most that an image may take, bytes; what has no budget is printed and not judged.
#[derive(Clone, Copy, Debug, Default)]
pub struct Budget {
    /// Code, constants and initial values; of an ESP the image that espflash makes.
    pub flash: Option<u64>,
    /// Variables, without stack.
    pub ram: Option<u64>,
    /// Of the variables, the heap.
    pub heap: Option<u64>,
    /// What the flash was meant to be at most, where it could not be reached: then `flash` keeps it from growing further.
    pub missed: Option<u64>,
}

impl Image {
    const fn new(role: &'static str, board: Board, features: &'static [&'static str], budget: Budget) -> Self {
        Self { role, board, features, budget }
    }

    /// The crate that it is a binary of.
    pub fn package(&self) -> String {
        format!("firmware-{}", self.role)
    }

    /// The binary: each role's crate has one by the name of the board.
    pub fn binary(&self) -> &'static str {
        self.board.name()
    }

    /// Role, board and variant: the file's name in `target/firmware`.
    pub fn name(&self) -> String {
        let mut name = format!("{}-{}", self.role, self.board.name());
        match self.board.in_qemu() {
            Some(Chip::CortexM4F) => name += "-arm",
            Some(Chip::CortexM3) => name += "-arm-m3",
            Some(Chip::RiscV32) => name += "-riscv",
            None => {}
        }
        self.features.iter().fold(name, |name, feature| format!("{name}-{feature}"))
    }

    /// Everything to be enabled, as cargo wants it.
    pub fn feature_list(&self) -> String {
        [self.board.name()].iter().chain(self.features).copied().collect::<Vec<_>>().join(",")
    }
}

const fn kib(flash: u64, ram: u64) -> Budget {
    Budget { flash: Some(flash << 10), ram: Some(ram << 10), heap: None, missed: None }
}

/// Meant to take `meant` kilobytes of flash, and taking more: at most `flash`.
const fn missed(meant: u64, flash: u64, ram: u64) -> Budget {
    Budget { missed: Some(meant << 10), ..kib(flash, ram) }
}

const NONE: Budget = Budget { flash: None, ram: None, heap: None, missed: None };
const ESP_BLE: Budget = Budget { flash: Some(504 << 10), ram: None, heap: Some(80 << 10), missed: Some(420 << 10) };

/// The whole matrix.
pub const IMAGES: [Image; 22] = [
    // State machines and buses optimised for speed take 3 KiB (EVK1000: 6) more of an image than for size, the driver, with the apps that it
    // is compiled with, 9 (7) KiB more. Layouts told in beacons, naps and rules against one radio without a key take 14 to 27 KiB of an image. The
    // budgets were raised for these, to what the images take.
    Image::new("anchor", Board::Dwm1001, &[], missed(64, 102, 14)),
    Image::new("anchor", Board::Evk1000, &[], missed(64, 112, 14)),
    Image::new("anchor", Board::Esp32C3, &[], NONE),
    Image::new("anchor", Board::Esp32C6, &[], NONE),
    // What they are spent on: `cargo xtask sizes`.
    Image::new("tag", Board::Dwm1001, &[], missed(96, 192, 24)),
    // Some 6 KiB are a map of levels and a model of rooms.
    Image::new("tag", Board::Dwm1001, &["ble"], missed(208, 282, 34)),
    Image::new("tag", Board::Evk1000, &[], NONE),
    Image::new("tag", Board::Esp32C3, &[], NONE),
    Image::new("tag", Board::Esp32C3, &["ble"], ESP_BLE),
    Image::new("tag", Board::Esp32C3, &["ble", "log-serial"], ESP_BLE),
    Image::new("tag", Board::Esp32C6, &[], NONE),
    Image::new("tag", Board::Esp32C6, &["ble"], NONE),
    Image::new("beacon", Board::Esp32C3, &[], NONE),
    Image::new("beacon", Board::Esp32C6, &[], NONE),
    Image::new("tag", Board::Simulated(Chip::CortexM4F), &[], NONE),
    Image::new("tag", Board::Simulated(Chip::RiscV32), &[], NONE),
    Image::new("anchor", Board::Wired(Chip::CortexM4F), &[], NONE),
    Image::new("anchor", Board::Wired(Chip::CortexM3), &[], NONE),
    Image::new("anchor", Board::Wired(Chip::RiscV32), &[], NONE),
    Image::new("tag", Board::Wired(Chip::CortexM4F), &[], NONE),
    Image::new("tag", Board::Wired(Chip::CortexM3), &[], NONE),
    Image::new("tag", Board::Wired(Chip::RiscV32), &[], NONE),
];
