//! Listening to Bluetooth advertisements: passive, each report told, duplicates too.
//!
//! The controller (Nordic's, in the nRF52832) is told what to do by HCI commands, without a host in between: a scanner needs five of
//! them, and switching one on and off between two ranging slots is one command each.

use core::convert::Infallible;

use bt_hci_nrf::ControllerToHostPacket;
use bt_hci_nrf::cmd::SyncCmd;
use bt_hci_nrf::cmd::controller_baseband::{Reset, SetEventMask};
use bt_hci_nrf::cmd::le::{LeSetEventMask, LeSetScanEnable, LeSetScanParams};
use bt_hci_nrf::controller::Controller;
use bt_hci_nrf::event::le::LeEvent;
use bt_hci_nrf::event::{Event, EventKind};
use bt_hci_nrf::param::{AddrKind, Duration, EventMask, LeEventMask, LeScanKind, ScanningFilterPolicy};
use embassy_executor::Spawner;
use embassy_futures::select::{Either3, select3};
use embassy_nrf::mode::Blocking;
use embassy_nrf::{Peri, bind_interrupts, peripherals, rng};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Instant, Timer};
use node_record::Scan;
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

/// What the controller takes of the chip.
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

/// An advertisement heard.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Advertisement<'a> {
    /// The sender's address, as on the air, lowest byte first.
    pub address: [u8; 6],
    /// dBm.
    pub rssi: i8,
    /// The advertising data: AD structures.
    pub data: &'a [u8],
}

/// What the scanner is to do from now on, for a `static`: scan so, or not at all.
pub type Orders = Signal<CriticalSectionRawMutex, Option<Scan>>;

/// The controller's memory: what its defaults ask for (3.2 kB: a link in each role, which nothing uses, an advertising set, 3 scan
/// buffers) and three scan buffers more, for reports that wait while ranging has the processor.
const MEMORY: usize = 4096;
const SCAN_BUFFERS: u8 = 6;

/// A scanner that hears nothing for so long is started anew, milliseconds; the time doubles while that does not help, because the place
/// may be without beacons.
const PATIENCE_MS: u64 = 10_000;
const MOST_PATIENCE_MS: u64 = 320_000;

/// A scanner, its controller running.
pub struct Scanner {
    controller: SoftdeviceController<'static>,
}

/// Why a scanner did not start.
#[derive(Clone, Copy, Debug, defmt::Format)]
pub enum StartError {
    /// The controller refused.
    Controller(sdc::Error),
    /// The layer below it did.
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
    /// Starts the controller; once a program. `spawner` is the thread's, below all interrupts.
    pub async fn start(parts: Parts, spawner: Spawner) -> Result<Self, StartError> {
        let Parts { rtc0, timer0, temp, rng, ppi } = parts;
        let clock = mpsl::raw::mpsl_clock_lfclk_cfg_t {
            // As the board started it.
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
        // The crystal stays on: the 32 kHz clock and the ranging task's waits are made from it.
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

    /// Scans as ordered, for ever; until the first order, not at all. `heard` is called for each advertisement, `restarted` after each
    /// restart of a scanner that was silent or failed, with their number.
    pub async fn run(
        &self,
        orders: &Orders,
        mut heard: impl FnMut(Advertisement<'_>),
        mut restarted: impl FnMut(u32),
    ) -> Infallible {
        let mut wanted = None;
        let mut patience_ms = PATIENCE_MS;
        let mut restarts = 0_u32;
        loop {
            let mut silent = true;
            let heard = |advertisement: Advertisement<'_>| {
                silent = false;
                heard(advertisement);
            };
            if self.scan(orders, &mut wanted, patience_ms, heard).await.is_err() {
                // The controller itself: not in a busy loop.
                Timer::after_millis(100).await;
            }
            patience_ms = if silent { (2 * patience_ms).min(MOST_PATIENCE_MS) } else { PATIENCE_MS };
            restarts = restarts.wrapping_add(1);
            restarted(restarts);
        }
    }

    /// Resets the controller and scans as ordered, until it is silent for too long.
    async fn scan(
        &self,
        orders: &Orders,
        wanted: &mut Option<Scan>,
        patience_ms: u64,
        mut heard: impl FnMut(Advertisement<'_>),
    ) -> Result<(), bt_hci_nrf::cmd::Error<sdc::Error>> {
        let controller = &self.controller;
        Reset::new().exec(controller).await?;
        SetEventMask::new(EventMask::new().enable_le_meta(true)).exec(controller).await?;
        LeSetEventMask::new(LeEventMask::new().enable_le_adv_report(true)).exec(controller).await?;

        let mut scanning = None;
        // The time of the last advertisement, moved on by pauses.
        let (mut last, mut paused) = (Instant::now(), Instant::now());
        let mut buffer = controller.alloc_buf().map_err(bt_hci_nrf::cmd::Error::Io)?;
        loop {
            if scanning != *wanted {
                if scanning.is_some() {
                    LeSetScanEnable::new(false, false).exec(controller).await?;
                    paused = Instant::now();
                }
                if let Some(scan) = *wanted {
                    parameters(scan).exec(controller).await?;
                    // Without a filter of duplicates.
                    LeSetScanEnable::new(true, false).exec(controller).await?;
                    last += paused.elapsed();
                }
                scanning = *wanted;
            }
            let silent_at = last + embassy_time::Duration::from_millis(patience_ms);
            let silence = async {
                match scanning {
                    Some(_) => Timer::at(silent_at).await,
                    None => core::future::pending().await,
                }
            };
            match select3(orders.wait(), controller.read(&mut buffer), silence).await {
                Either3::First(order) => *wanted = order,
                Either3::Second(packet) => {
                    if reports(packet.map_err(bt_hci_nrf::cmd::Error::Io)?, &mut heard) {
                        last = Instant::now();
                    }
                }
                Either3::Third(()) => return Ok(()),
            }
        }
    }
}

fn parameters(scan: Scan) -> LeSetScanParams {
    LeSetScanParams::new(
        LeScanKind::Passive,
        Duration::from_millis(scan.interval_ms.into()),
        Duration::from_millis(scan.window_ms.into()),
        AddrKind::PUBLIC,
        ScanningFilterPolicy::BasicUnfiltered,
    )
}

/// Whether the packet told of advertisements; they are handed over.
fn reports(packet: ControllerToHostPacket<'_>, heard: &mut impl FnMut(Advertisement<'_>)) -> bool {
    let ControllerToHostPacket::Event(packet) = packet else { return false };
    if packet.kind != EventKind::Le {
        return false;
    }
    let Ok(Event::Le(LeEvent::LeAdvertisingReport(event))) = Event::try_from(packet) else { return false };
    for report in event.reports.iter().flatten() {
        let mut address = [0; 6];
        address.copy_from_slice(report.addr.raw());
        heard(Advertisement { address, rssi: report.rssi, data: report.data });
    }
    true
}
