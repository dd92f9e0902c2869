//! Receives Bluetooth advertisements. The scan is passive, and reports each advertisement, duplicates too.
//!
//! HCI commands control the controller (Nordic's, in the nRF52832), without a host in between. A scanner needs five
//! commands. Switching it on or off between two ranging slots takes one command each.

use core::convert::Infallible;

use bt_hci::ControllerToHostPacket;
use bt_hci::cmd::SyncCmd;
use bt_hci::cmd::controller_baseband::{Reset, SetEventMask};
use bt_hci::cmd::le::{LeSetEventMask, LeSetScanEnable, LeSetScanParams};
use bt_hci::controller::Controller;
use bt_hci::event::le::LeEvent;
use bt_hci::event::{Event, EventKind};
use bt_hci::param::{AddrKind, Duration, EventMask, LeEventMask, LeScanKind, ScanningFilterPolicy};
use embassy_executor::Spawner;
use embassy_nrf::mode::Blocking;
use embassy_nrf::{Peri, bind_interrupts, peripherals, rng};
use firmware_tag::scan;
use nrf_sdc::mpsl::{self, MultiprotocolServiceLayer};
use nrf_sdc::{self as sdc, SoftdeviceController};
use static_cell::StaticCell;

bind_interrupts!(struct Interrupts {
    EGU0_SWI0 => mpsl::LowPrioInterruptHandler;
    CLOCK_POWER => mpsl::ClockInterruptHandler;
    RADIO => mpsl::HighPrioInterruptHandler;
    TIMER0 => mpsl::HighPrioInterruptHandler;
    RTC0 => mpsl::HighPrioInterruptHandler;
});

/// The peripherals of the chip that the controller uses.
pub struct Parts {
    pub(super) rtc0: Peri<'static, peripherals::RTC0>,
    pub(super) timer0: Peri<'static, peripherals::TIMER0>,
    pub(super) temp: Peri<'static, peripherals::TEMP>,
    pub(super) rng: Peri<'static, peripherals::RNG>,
    pub(super) ppi: Channels,
}

pub(super) struct Channels {
    pub ch17: Peri<'static, peripherals::PPI_CH17>,
    pub ch18: Peri<'static, peripherals::PPI_CH18>,
    pub ch19: Peri<'static, peripherals::PPI_CH19>,
    pub ch20: Peri<'static, peripherals::PPI_CH20>,
    pub ch21: Peri<'static, peripherals::PPI_CH21>,
    pub ch22: Peri<'static, peripherals::PPI_CH22>,
    pub ch23: Peri<'static, peripherals::PPI_CH23>,
    pub ch24: Peri<'static, peripherals::PPI_CH24>,
    pub ch25: Peri<'static, peripherals::PPI_CH25>,
    pub ch26: Peri<'static, peripherals::PPI_CH26>,
    pub ch27: Peri<'static, peripherals::PPI_CH27>,
    pub ch28: Peri<'static, peripherals::PPI_CH28>,
    pub ch29: Peri<'static, peripherals::PPI_CH29>,
    pub ch30: Peri<'static, peripherals::PPI_CH30>,
    pub ch31: Peri<'static, peripherals::PPI_CH31>,
}

/// A received advertisement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Advertisement<'a> {
    /// The sender's address, as on the air, lowest byte first.
    pub address: [u8; 6],
    /// The RSSI, dBm.
    pub rssi: i8,
    /// The advertising data: AD structures.
    pub data: &'a [u8],
}

/// The controller's memory. Its default configuration takes 3.2 kB: a link in each role, which nothing uses, an
/// advertising set, and 3 scan buffers. Three more scan buffers are for reports that wait while ranging has the
/// processor.
const MEMORY: usize = 4096;
const SCAN_BUFFERS: u8 = 6;

/// How long the controller listens on one of the three channels before the next, milliseconds. It listens all the time.
const CHANNEL_MS: u32 = 100;

/// A scanner with a running controller.
pub struct Scanner {
    controller: SoftdeviceController<'static>,
}

/// Why the controller does not carry out a command.
pub type ScanError = bt_hci::cmd::Error<sdc::Error>;

/// Why a scanner did not start.
#[derive(Clone, Copy, Debug, defmt::Format)]
pub enum StartError {
    /// The controller refused.
    Controller(sdc::Error),
    /// The layer below the controller refused.
    Layer(mpsl::Error),
}

impl From<sdc::Error> for StartError {
    fn from(error: sdc::Error) -> Self {
        Self::Controller(error)
    }
}

#[embassy_executor::task]
async fn serve(layer: &'static MultiprotocolServiceLayer<'static>) -> ! {
    layer.run().await
}

impl Scanner {
    /// Starts the controller. May be called once in a program's run. `spawner` is that of the thread, below all
    /// interrupts.
    ///
    /// # Errors
    /// The controller or the layer below it refuses.
    pub async fn start(parts: Parts, spawner: Spawner) -> Result<Self, StartError> {
        let Parts { rtc0, timer0, temp, rng, ppi } = parts;
        let clock = mpsl::raw::mpsl_clock_lfclk_cfg_t {
            // The clock as the board started it.
            source: mpsl::raw::MPSL_CLOCK_LF_SRC_SYNTH as u8,
            rc_ctiv: 0,
            rc_temp_ctiv: 0,
            accuracy_ppm: 50,
            skip_wait_lfclk_started: false,
        };
        static LAYER: StaticCell<MultiprotocolServiceLayer<'static>> = StaticCell::new();
        let peripherals = mpsl::Peripherals::new(rtc0, timer0, temp, ppi.ch19, ppi.ch30, ppi.ch31);
        let layer = MultiprotocolServiceLayer::new(peripherals, Interrupts, clock).map_err(StartError::Layer)?;
        let layer: &'static _ = LAYER.init(layer);
        // The crystal stays on: the 32 kHz clock and the ranging task's waits are derived from it.
        core::mem::forget(layer.request_hfclk().await.map_err(StartError::Layer)?);
        if let Ok(task) = serve(layer) {
            spawner.spawn(task);
        }

        let peripherals = sdc::Peripherals::new(
            ppi.ch17, ppi.ch18, ppi.ch20, ppi.ch21, ppi.ch22, ppi.ch23, ppi.ch24, ppi.ch25, ppi.ch26, ppi.ch27,
            ppi.ch28, ppi.ch29,
        );
        static RANDOM: StaticCell<rng::Rng<'static, Blocking>> = StaticCell::new();
        static CONTROLLER: StaticCell<sdc::Mem<MEMORY>> = StaticCell::new();
        let random = RANDOM.init(rng::Rng::new_blocking(rng));
        let memory = CONTROLLER.init(sdc::Mem::new());
        let builder = sdc::Builder::new()?.support_scan().scan_buffer_cfg(SCAN_BUFFERS)?;
        Ok(Self { controller: builder.build(peripherals, random, layer, memory)? })
    }

    /// Starts to scan, whatever the controller did before: it starts anew.
    async fn start_scan(&self) -> Result<(), ScanError> {
        let controller = &self.controller;
        Reset::new().exec(controller).await?;
        SetEventMask::new(EventMask::new().enable_le_meta(true)).exec(controller).await?;
        LeSetEventMask::new(LeEventMask::new().enable_le_adv_report(true)).exec(controller).await?;
        let duration = Duration::from_millis(CHANNEL_MS);
        let (kind, policy) = (LeScanKind::Passive, ScanningFilterPolicy::BasicUnfiltered);
        LeSetScanParams::new(kind, duration, duration, AddrKind::PUBLIC, policy).exec(controller).await?;
        let filter_duplicates = false;
        LeSetScanEnable::new(true, filter_duplicates).exec(controller).await
    }

    /// Stops scanning.
    async fn stop_scan(&self) -> Result<(), ScanError> {
        LeSetScanEnable::new(false, false).exec(&self.controller).await
    }

    /// Passes each advertisement to `heard`, for ever. It must run beside the commands.
    pub async fn listen(&self, mut heard: impl FnMut(Advertisement<'_>)) -> Infallible {
        let mut buffer = [0; sdc::raw::HCI_MSG_BUFFER_MAX_SIZE as usize];
        loop {
            match self.controller.read(&mut buffer).await {
                Ok(packet) => tell(packet, &mut heard),
                // A packet that cannot be parsed. The next one may be valid.
                Err(error) => defmt::warn!("Bluetooth: {}", error),
            }
        }
    }
}

impl scan::Scanner for &Scanner {
    async fn start(&mut self) {
        if let Err(error) = self.start_scan().await {
            defmt::warn!("the scan does not start: {}", error);
        }
    }

    async fn stop(&mut self) {
        if let Err(error) = self.stop_scan().await {
            defmt::warn!("the scan does not stop: {}", error);
        }
    }
}

fn tell(packet: ControllerToHostPacket<'_>, heard: &mut impl FnMut(Advertisement<'_>)) {
    let ControllerToHostPacket::Event(packet) = packet else { return };
    if packet.kind != EventKind::Le {
        return;
    }
    let Ok(Event::Le(LeEvent::LeAdvertisingReport(event))) = Event::try_from(packet) else { return };
    for report in event.reports.iter().flatten() {
        let mut address = [0; 6];
        address.copy_from_slice(report.addr.raw());
        heard(Advertisement { address, rssi: report.rssi, data: report.data });
    }
}
