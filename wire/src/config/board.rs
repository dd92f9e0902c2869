//! The boards: one table of the facts that firmware, host programs and builds share.
//!
//! To add a board, add a variant of [`Board`] and its row.

use core::ops::RangeInclusive;

use postcard::experimental::max_size::MaxSize;
use radio::Capabilities;
use radio::phy::{Channel, DataRate, PreambleLength, Prf};
use serde::{Deserialize, Serialize};

use crate::config::Pins;

/// The board of a node. Telemetry sends the variant's index, so a new variant goes to the end.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, MaxSize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Board {
    /// DWM1001 (nRF52832).
    Dwm1001,
    /// EVB1000, the board of the EVK1000 (STM32F105RC).
    Evk1000,
    /// ESP32-C3 with a DW1000 on SPI.
    Esp32C3,
    /// ESP32-C6 with a DW1000 on SPI.
    Esp32C6,
    /// ESP32 with a DW1000 on SPI.
    Esp32,
    /// QEMU with a simulated radio.
    Simulated,
}

/// A row of the table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BoardSpec {
    /// Its name in commands, in files, and in the names of its images.
    pub name: &'static str,
    /// The compiler's target.
    pub target: &'static str,
    /// The program that writes its flash.
    pub flasher: Flasher,
    /// Where its config record is.
    pub pages: Pages,
    /// Where its images may be.
    pub memory: Memory,
    /// Whether it has Bluetooth, so that a tag can scan.
    pub has_bluetooth: bool,
    /// Whether it has Wi-Fi, so that it can reach a station without a cable.
    pub has_wifi: bool,
    /// Whether there is a beacon image for it.
    pub advertises: bool,
    /// Whether the image of a tag can advertise its positions.
    pub tag_advertises: bool,
    /// What its radio can do.
    pub radio: Capabilities,
    /// Which pins the radio may be wired to; `None`: the board has fixed wiring.
    pub pins: Option<PinChoice>,
}

/// The program on the host that writes a board's flash.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flasher {
    /// probe-rs with a debug probe, which also reads the flash. The string is the chip's name in probe-rs.
    ProbeRs(&'static str),
    /// espflash over the serial port. The string is the chip's name in espflash and probe-rs. A probe does not read the
    /// flash.
    Espflash(&'static str),
    /// QEMU loads the image itself.
    Qemu,
}

/// Where a board keeps its config record: two pages of flash that nothing else uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Pages {
    /// The processor's address of the flash's first byte. Intel HEX files and debug probes count from it.
    pub base: u32,
    /// The offsets of the pages from the flash's beginning, as [`load`](crate::config::load) and
    /// [`store`](crate::config::store) take them.
    pub offsets: [u32; 2],
    /// The size of each page, bytes. The flash erases a page as a whole.
    pub size: u32,
    /// The offset of [`StoredSiteModels`](crate::config::StoredSiteModels) from the flash's beginning; they are
    /// [`MODELS_BYTES`](crate::config::MODELS_BYTES) long, directly before or after the pages. `None` for boards
    /// without Bluetooth.
    pub models: Option<u32>,
}

/// Where a chip's memories are. The linker's own map is in the board's crate; every image is checked against this one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Memory {
    /// Where an image begins; `None`: a bootloader loads it from anywhere.
    pub image_origin: Option<u32>,
    /// Flash that images may use, as the processor sees it: first address, bytes.
    pub flash: &'static [(u32, u32)],
    /// The RAM of variables and stack: first address, bytes.
    pub ram: (u32, u32),
    /// Other views of the RAM, and other RAM.
    pub other_ram: &'static [(u32, u32)],
}

/// The pins of a chip whose DW1000 is wired by the user.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PinChoice {
    /// The pins that are used if the config record names none.
    pub default: Pins,
    /// Pins that can be inputs and outputs.
    pub both_ways: &'static [RangeInclusive<u8>],
    /// Pins that can only be inputs.
    pub inputs: &'static [RangeInclusive<u8>],
}

/// The radio of all boards. A test compares the row with that of the driver, which is not known here.
const DW1000: Capabilities = Capabilities {
    channels: &[Channel::Ch1, Channel::Ch2, Channel::Ch3, Channel::Ch4, Channel::Ch5, Channel::Ch7],
    pulse_rates: &[Prf::Mhz16, Prf::Mhz64],
    data_rates: &[DataRate::Kbps110, DataRate::Kbps850, DataRate::Kbps6810],
    preambles: &[
        PreambleLength::Symbols64,
        PreambleLength::Symbols128,
        PreambleLength::Symbols256,
        PreambleLength::Symbols512,
        PreambleLength::Symbols1024,
        PreambleLength::Symbols1536,
        PreambleLength::Symbols2048,
        PreambleLength::Symbols4096,
    ],
    delayed_step: 512,
};

/// Of the 4 KiB pages in 512 KiB of flash, the last two are for the config record, the two before them for the models.
const DWM1001: BoardSpec = BoardSpec {
    name: "dwm1001",
    target: "thumbv7em-none-eabihf",
    flasher: Flasher::ProbeRs("nRF52832_xxAA"),
    pages: Pages { base: 0, offsets: [0x7E000, 0x7F000], size: 4096, models: Some(0x7C000) },
    memory: Memory { image_origin: Some(0), flash: &[(0, 496 << 10)], ram: (0x2000_0000, 64 << 10), other_ram: &[] },
    has_bluetooth: true,
    has_wifi: false,
    advertises: false,
    tag_advertises: true,
    radio: DW1000,
    pins: None,
};

/// Of the 2 KiB pages in 256 KiB of flash, the last two are for the config record.
const EVK1000: BoardSpec = BoardSpec {
    name: "evk1000",
    target: "thumbv7m-none-eabi",
    flasher: Flasher::ProbeRs("STM32F105RC"),
    pages: Pages { base: 0x0800_0000, offsets: [0x3F000, 0x3F800], size: 2048, models: None },
    memory: Memory {
        image_origin: Some(0x0800_0000),
        flash: &[(0x0800_0000, 252 << 10)],
        ram: (0x2000_0000, 64 << 10),
        other_ram: &[],
    },
    has_bluetooth: false,
    has_wifi: false,
    advertises: false,
    tag_advertises: false,
    radio: DW1000,
    pins: None,
};

/// Of the six sectors of the partition `nvs` in espflash's default table, the first two are for the config record, the
/// next two for the models.
const ESP_PAGES: Pages = Pages { base: 0, offsets: [0x9000, 0xA000], size: 4096, models: Some(0xB000) };

// Pins (the chips' data sheets, "Pin Overview"): the lists leave out the pins of the flash, of the USB port and, on the
// ESP32, of the serial port. The defaults also leave out the pins that the chip reads at reset, because the DW1000 or
// its reset line could make the chip start its loader. There is one exception: the ESP32-C3's own pin for MISO is
// GPIO2, which must not be low at reset. The modules and boards of this chip pull it up, and the DW1000 does not drive
// it while it is not selected.
//
// Memories (technical reference manuals, "System and Memory"): internal SRAM as data, 384 KiB after the cache's 16 on
// the C3, 512 KiB on the C6. The others are flash through the cache, as instructions and as data; SRAM as instructions;
// RTC memory.

/// GPIO2, 6, 7 and 10 are SPI2's own pins. Read at reset: 2, 8, 9.
const ESP32_C3: BoardSpec = BoardSpec {
    name: "esp32c3",
    target: "riscv32imc-unknown-none-elf",
    flasher: Flasher::Espflash("esp32c3"),
    pages: ESP_PAGES,
    memory: Memory {
        image_origin: None,
        flash: &[(0x4200_0000, 8 << 20), (0x3C00_0000, 8 << 20)],
        ram: (0x3FC8_0000, 384 << 10),
        other_ram: &[(0x4037_C000, 400 << 10), (0x5000_0000, 8 << 10)],
    },
    has_bluetooth: true,
    has_wifi: true,
    advertises: true,
    tag_advertises: false,
    radio: DW1000,
    pins: Some(PinChoice {
        default: Pins { sck: 6, mosi: 7, miso: 2, cs: 10, irq: 4, reset: 3 },
        both_ways: &[0..=10, 20..=21],
        inputs: &[],
    }),
};

/// GPIO2, 6 and 7 are SPI2's own pins. Read at reset: 4, 5, 8, 9, 15.
const ESP32_C6: BoardSpec = BoardSpec {
    name: "esp32c6",
    target: "riscv32imac-unknown-none-elf",
    flasher: Flasher::Espflash("esp32c6"),
    memory: Memory {
        image_origin: None,
        flash: &[(0x4200_0000, 16 << 20)],
        ram: (0x4080_0000, 512 << 10),
        other_ram: &[(0x5000_0000, 16 << 10)],
    },
    pins: Some(PinChoice {
        default: Pins { sck: 6, mosi: 7, miso: 2, cs: 18, irq: 19, reset: 3 },
        both_ways: &[0..=11, 14..=23],
        inputs: &[],
    }),
    ..ESP32_C3
};

/// GPIO18, 19 and 23 are SPI3's own pins; boards that carry both chips are wired in this way. Read at reset: 0, 2, 5,
/// 12, 15. From 34 on the pins have no pull resistors and cannot drive.
const ESP32: BoardSpec = BoardSpec {
    name: "esp32",
    target: "xtensa-esp32-none-elf",
    flasher: Flasher::Espflash("esp32"),
    memory: Memory {
        image_origin: None,
        flash: &[(0x400D_0000, 3 << 20), (0x3F40_0000, 4 << 20)],
        ram: (0x3FFA_E000, 328 << 10),
        other_ram: &[(0x4008_0000, 128 << 10), (0x400C_0000, 8 << 10), (0x3FF8_0000, 8 << 10), (0x5000_0000, 8 << 10)],
    },
    pins: Some(PinChoice {
        default: Pins { sck: 18, mosi: 23, miso: 19, cs: 4, irq: 34, reset: 27 },
        both_ways: &[0..=0, 2..=2, 4..=5, 12..=19, 21..=23, 25..=27, 32..=33],
        inputs: &[34..=39],
    }),
    ..ESP32_C3
};

/// QEMU's mps2-an386; two pages of memory represent the flash.
const SIMULATED: BoardSpec = BoardSpec {
    name: "simulated",
    target: "thumbv7em-none-eabihf",
    flasher: Flasher::Qemu,
    pages: Pages { base: 0, offsets: [0, 4096], size: 4096, models: None },
    memory: Memory { image_origin: Some(0), flash: &[(0, 4 << 20)], ram: (0x2000_0000, 4 << 20), other_ram: &[] },
    has_bluetooth: false,
    has_wifi: false,
    advertises: false,
    tag_advertises: true,
    radio: DW1000,
    pins: None,
};

impl Board {
    /// All boards that are hardware, whose flash holds a config record.
    pub const HARDWARE: [Self; 5] = [Self::Dwm1001, Self::Evk1000, Self::Esp32C3, Self::Esp32C6, Self::Esp32];

    /// Its row.
    #[inline(always)]
    pub const fn spec(self) -> BoardSpec {
        match self {
            Self::Dwm1001 => DWM1001,
            Self::Evk1000 => EVK1000,
            Self::Esp32C3 => ESP32_C3,
            Self::Esp32C6 => ESP32_C6,
            Self::Esp32 => ESP32,
            Self::Simulated => SIMULATED,
        }
    }

    /// Its name in commands, in files, and in the names of its images.
    pub const fn name(self) -> &'static str {
        self.spec().name
    }

    /// Where it keeps its config record.
    pub const fn pages(self) -> Pages {
        self.spec().pages
    }

    /// The hardware board with this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::HARDWARE.into_iter().find(|board| board.name() == name)
    }
}

impl Flasher {
    /// The chip's name in probe-rs.
    pub const fn probe_chip(self) -> Option<&'static str> {
        match self {
            Self::ProbeRs(chip) | Self::Espflash(chip) => Some(chip),
            Self::Qemu => None,
        }
    }

    /// Whether a debug probe reads the flash that contains the config record.
    pub const fn is_readable(self) -> bool {
        match self {
            Self::ProbeRs(_) => true,
            Self::Espflash(_) | Self::Qemu => false,
        }
    }
}

impl Memory {
    /// Whether this number of bytes from an address on lies in one of the memories.
    pub fn holds(&self, address: u64, bytes: u64) -> bool {
        let mut places = self.flash.iter().chain([&self.ram]).chain(self.other_ram);
        places.any(|&(origin, length)| {
            let end = u64::from(origin) + u64::from(length);
            address >= u64::from(origin) && address.checked_add(bytes).is_some_and(|after| after <= end)
        })
    }
}

impl Pages {
    /// The addresses of the pages for debug probes.
    pub const fn addresses(&self) -> [u32; 2] {
        [self.base + self.offsets[0], self.base + self.offsets[1]]
    }

    /// The address of the models for debug probes.
    pub const fn models_address(&self) -> Option<u32> {
        match self.models {
            Some(models) => Some(self.base + models),
            None => None,
        }
    }
}

impl PinChoice {
    /// Whether a pin of this number can be an input, and also an output if `output`.
    pub fn allows(&self, pin: u8, output: bool) -> bool {
        let among = |ranges: &[RangeInclusive<u8>]| ranges.iter().any(|range| range.contains(&pin));
        among(self.both_ways) || (!output && among(self.inputs))
    }
}

impl Pins {
    /// The pins with their names in the config record, and whether the processor drives them.
    pub const fn named(&self) -> [(&'static str, u8, bool); 6] {
        [
            ("pins.sck", self.sck, true),
            ("pins.mosi", self.mosi, true),
            ("pins.miso", self.miso, false),
            ("pins.cs", self.cs, true),
            ("pins.irq", self.irq, false),
            ("pins.reset", self.reset, true),
        ]
    }
}
