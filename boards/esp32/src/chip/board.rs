//! The board, taken once at the start of a program.

use embassy_executor::Spawner;
use embassy_time::Delay;
use esp_hal::clock::CpuClock;
use esp_hal::efuse;
use esp_hal::rng::Rng;
use esp_hal::timer::timg::TimerGroup;
use esp_storage::FlashStorage;
use firmware_common::node::Start;
#[cfg(feature = "ble")]
use static_cell::ConstStaticCell;
use wire::config::{Invalid, Pins, Record};
#[cfg(feature = "ble")]
use wire::config::{LoadError, MODELS_BYTES, StoredSiteModels};

use super::log;
use super::spi::{Bus, Interrupt, Port, Reset};
use super::watchdog::{self, Watchdog};
use super::{BOARD, Care, cipher, crash, uptime_us};
use crate::{pins, reset_cause};

// The application descriptor that the second-stage bootloader and espflash look for.
esp_bootloader_esp_idf::esp_app_desc!();

/// The size of the heap, bytes: for threads' stacks, and for the drivers of Bluetooth and Wi-Fi.
const HEAP_BYTES: usize = if cfg!(feature = "ble") {
    80 << 10
} else if cfg!(feature = "wifi") {
    32 << 10
} else {
    16 << 10
};
/// What the driver of Wi-Fi has besides: the memory of the bootloader, which has ended.
#[cfg(feature = "wifi")]
const WIFI_HEAP_BYTES: usize = 64_000;

const DEFAULT_PINS: Pins = match BOARD.spec().pins {
    Some(choice) => choice.default,
    None => panic!("the user wires an ESP"),
};

/// The board after its start.
pub struct Board {
    /// The port that a DW1000 may be wired to.
    pub uwb: UwbPort,
    /// The parts of the supervisor.
    pub care: Care,
    /// The inputs of the node's start.
    pub start: Start,
    /// The flash with the record and the models beside it.
    pub flash: FlashStorage<'static>,
    /// The chip's factory address, the highest byte first.
    pub address: [u8; 6],
    /// The chip's radio.
    #[cfg(feature = "ble")]
    pub bluetooth: super::bluetooth::Parts,
    /// The chip's radio.
    #[cfg(feature = "wifi")]
    pub wifi: super::wifi::Parts,
}

/// The DW1000's parts.
pub type Uwb = baliza_dw1000::Parts<Bus, Interrupt, Reset, Delay>;

/// The SPI port before its pins are set.
pub struct UwbPort(Port);

impl UwbPort {
    /// Connects it to the pins of the record, or to the chip's default pins.
    ///
    /// # Errors
    /// The record is for another board, or is not valid.
    pub fn wire(self, record: &Record) -> Result<Uwb, Invalid> {
        record.validate_for(BOARD)?;
        let pins = record.pins.unwrap_or(DEFAULT_PINS);
        let (bus, interrupt, reset) = self.0.wire(&pins, pins::fast_mhz(&pins, &DEFAULT_PINS));
        Ok(Uwb { bus, interrupt, reset, delay: Delay })
    }
}

impl Board {
    /// Takes the board. May be called once in a program's run. From here on the log works and the watchdog runs.
    /// `spawner` is the main thread's.
    pub fn take(spawner: Spawner) -> Self {
        let p = esp_hal::init(esp_hal::Config::default().with_cpu_clock(CpuClock::max()));
        esp_alloc::heap_allocator!(size: HEAP_BYTES);
        #[cfg(feature = "wifi")]
        esp_alloc::heap_allocator!(#[esp_hal::ram(reclaimed)] size: WIFI_HEAP_BYTES);
        esp_rtos::start(TimerGroup::new(p.TIMG0).timer0, p.FROM_CPU_INTR0);
        #[cfg(not(feature = "log-serial"))]
        let (telemetry, _) = (log::start(), spawner);
        #[cfg(feature = "log-serial")]
        let telemetry = log::start(
            spawner,
            log::Port {
                #[cfg(not(feature = "esp32"))]
                usb: p.USB_DEVICE,
                uart: p.UART0,
            },
        );
        watchdog::reset_on_brown_out();
        let mut address = [0; 6];
        address.copy_from_slice(efuse::base_mac_address().as_bytes());
        #[cfg(not(feature = "esp32"))]
        let port = Port::new(p.SPI2);
        #[cfg(feature = "esp32")]
        let port = Port::new(p.SPI3);
        let mut flash = FlashStorage::new(p.FLASH);
        let start = Start {
            board: BOARD,
            clock: uptime_us,
            record: wire::config::load(&mut flash, BOARD.pages().offsets),
            eui: eui_of(address),
            reset: reset_cause::of(esp_hal::system::reset_reason().map_or(0, |reason| reason as u32)),
            crash: crash::take(),
            cipher: cipher::start(p.RNG, p.ADC1),
        };
        #[cfg(feature = "wifi")]
        let wifi = wire::config::load_wifi(&mut flash, BOARD.pages().offsets);
        Self {
            uwb: UwbPort(port),
            care: Care {
                watchdog: Watchdog::start(p.RTC_TIMER),
                telemetry,
                #[cfg(feature = "wifi")]
                gateway: None.into(),
            },
            start,
            flash,
            address,
            #[cfg(feature = "ble")]
            bluetooth: super::bluetooth::Parts(p.BT),
            #[cfg(feature = "wifi")]
            wifi: super::wifi::Parts { radio: p.WIFI, settings: wifi },
        }
    }
}

/// The survey's models of beacons. The flash is not in the processor's address space, so the bytes are copied. May be
/// called once in a program's run.
///
/// # Errors
/// There are no models, or they cannot be read.
#[cfg(feature = "ble")]
pub fn models(flash: &mut FlashStorage<'_>) -> Result<StoredSiteModels<'static>, LoadError> {
    static BYTES: ConstStaticCell<[u8; MODELS_BYTES]> = ConstStaticCell::new([0; MODELS_BYTES]);
    let at = const { BOARD.pages().models.unwrap() };
    wire::config::load_models(flash, at, BYTES.take())
}

/// Fills a slice with random bytes. They come from the radio's noise while Bluetooth or Wi-Fi is on. Without them they can
/// be guessed.
pub fn random(bytes: &mut [u8]) {
    Rng::new().read(bytes);
}

/// The EUI-64 of an address of 48 bits: FF FE is inserted in the middle (IEEE, "Guidelines for Use of EUI").
fn eui_of([a, b, c, d, e, f]: [u8; 6]) -> u64 {
    u64::from_be_bytes([a, b, c, 0xFF, 0xFE, d, e, f])
}
