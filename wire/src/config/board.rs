//! The boards: where each keeps its record in flash, and which of its pins a DW1000 may be wired to.

use crate::config::Pins;

/// A board that has an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
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
}

/// Where a board keeps its record: two pages of flash that nothing else uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Pages {
    /// Where the processor sees the flash's first byte, and where Intel HEX files and debug probes count from.
    pub base: u32,
    /// The pages, from the flash's beginning: what [`load`](crate::config::load) and [`store`](crate::config::store) take.
    pub offsets: [u32; 2],
    /// The size of each, which the flash erases as a whole, bytes.
    pub size: u32,
    /// Where [`SiteModels`](crate::config::SiteModels) are, from the flash's beginning, [`MODELS_BYTES`](crate::config::MODELS_BYTES) long: beside
    /// the pages, before or behind them. Boards without Bluetooth have none.
    pub models: Option<u32>,
}

impl Pages {
    /// DWM1001: the last two pages of 512 KiB, and the two before them.
    pub const DWM1001: Self = Self { base: 0, offsets: [0x7E000, 0x7F000], size: 4096, models: Some(0x7C000) };
    /// EVK1000: the last two pages of 256 KiB.
    pub const EVK1000: Self = Self { base: 0x0800_0000, offsets: [0x3F000, 0x3F800], size: 2048, models: None };
    /// ESP32, ESP32-C3, ESP32-C6: the first two sectors of the partition `nvs` of the default table, and the next two of its six.
    pub const ESP: Self = Self { base: 0, offsets: [0x9000, 0xA000], size: 4096, models: Some(0xB000) };

    /// Where debug probes find the pages.
    pub const fn addresses(&self) -> [u32; 2] {
        [self.base + self.offsets[0], self.base + self.offsets[1]]
    }

    /// Where debug probes find the models.
    pub const fn models_address(&self) -> Option<u32> {
        match self.models {
            Some(models) => Some(self.base + models),
            None => None,
        }
    }
}

impl Board {
    /// All boards.
    pub const ALL: [Self; 5] = [Self::Dwm1001, Self::Evk1000, Self::Esp32C3, Self::Esp32C6, Self::Esp32];

    /// Its name in commands, in files, and of its images.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Dwm1001 => "dwm1001",
            Self::Evk1000 => "evk1000",
            Self::Esp32C3 => "esp32c3",
            Self::Esp32C6 => "esp32c6",
            Self::Esp32 => "esp32",
        }
    }

    /// The board of a name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|board| board.name() == name)
    }

    /// Where it keeps its record.
    pub const fn pages(self) -> Pages {
        match self {
            Self::Dwm1001 => Pages::DWM1001,
            Self::Evk1000 => Pages::EVK1000,
            Self::Esp32C3 | Self::Esp32C6 | Self::Esp32 => Pages::ESP,
        }
    }

    /// Whether there is an image of a beacon for it.
    pub const fn advertises(self) -> bool {
        match self {
            Self::Dwm1001 | Self::Evk1000 => false,
            Self::Esp32C3 | Self::Esp32C6 | Self::Esp32 => true,
        }
    }

    /// Whether it has Bluetooth, so that a tag can scan.
    pub const fn has_bluetooth(self) -> bool {
        match self {
            Self::Evk1000 => false,
            Self::Dwm1001 | Self::Esp32C3 | Self::Esp32C6 | Self::Esp32 => true,
        }
    }

    /// Whether the DW1000's wires are the user's choice.
    pub const fn has_free_pins(self) -> bool {
        match self {
            Self::Dwm1001 | Self::Evk1000 => false,
            Self::Esp32C3 | Self::Esp32C6 | Self::Esp32 => true,
        }
    }

    /// Whether a pin of this number can be an input, and an output too where `output`. Left out are those that the
    /// flash, the USB port and, on the ESP32, the serial port hang on (the chips' datasheets, "Pin Overview").
    pub const fn has_pin(self, pin: u8, output: bool) -> bool {
        match self {
            Self::Dwm1001 | Self::Evk1000 => false,
            Self::Esp32C3 => matches!(pin, 0..=10 | 20..=21),
            Self::Esp32C6 => matches!(pin, 0..=11 | 14..=23),
            Self::Esp32 => {
                matches!(pin, 0 | 2 | 4..=5 | 12..=19 | 21..=23 | 25..=27 | 32..=33)
                    || (!output && matches!(pin, 34..=39))
            }
        }
    }
}

impl Pins {
    /// The pins with their names as the record's fields, and whether the processor drives them.
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
