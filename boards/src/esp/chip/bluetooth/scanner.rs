//! A tag's scanner: passive, every advertisement told, as often as it is heard.

use core::cell::{Cell, RefCell};
use core::convert::Infallible;

use bt_hci_esp::param::{FilterDuplicates, LeAdvReportsIter};
use embassy_executor::Spawner;
use embassy_futures::select::{Either, select};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Instant, Timer};
use esp_radio::ble::Config;
use node_record::Scan;
use trouble_host_esp::prelude::{EventHandler, ScanConfig, Scanner as Session};

use super::{Host, Parts, StartError};

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

/// A scanner that hears nothing for so long is started anew; the time doubles while that does not help, because the place may be
/// without beacons.
const PATIENCE: Duration = Duration::from_secs(10);
const MOST_PATIENCE: Duration = Duration::from_secs(320);
/// After a command that failed.
const PAUSE: Duration = Duration::from_millis(100);

/// A scanner, its controller running.
pub struct Scanner {
    host: &'static Host,
}

/// Why a scan ended.
enum End {
    Ordered(Option<Scan>),
    Silent,
    Failed,
}

impl Scanner {
    /// Starts the controller; once a program. `spawner` is the main thread's.
    pub async fn start(parts: Parts, _spawner: Spawner) -> Result<Self, StartError> {
        // A passive scanner sends nothing: nobody sees the address.
        Ok(Self { host: super::start(parts, Config::default(), [1, 0, 0, 0, 0, 0xC0])? })
    }

    /// Scans as ordered, for ever; until the first order, not at all. `heard` is called for each advertisement, `restarted` after each
    /// restart of a scanner that was silent or failed, with their number.
    pub async fn run(
        &self,
        orders: &Orders,
        heard: impl FnMut(Advertisement<'_>),
        restarted: impl FnMut(u32),
    ) -> Infallible {
        let listener = Listener { heard: RefCell::new(heard), last: Cell::new(Instant::now()) };
        let mut runner = self.host.runner();
        let serve = async {
            loop {
                if let Err(error) = runner.run_with_handler(&listener).await {
                    defmt::warn!("Bluetooth host: {}", error);
                }
                Timer::after(PAUSE).await;
            }
        };
        match select(serve, self.obey(orders, &listener.last, restarted)).await {
            Either::First(never) | Either::Second(never) => never,
        }
    }

    /// `last` is the time of the last advertisement, moved on by pauses.
    async fn obey(&self, orders: &Orders, last: &Cell<Instant>, mut restarted: impl FnMut(u32)) -> Infallible {
        let mut patience = PATIENCE;
        let mut restarts = 0_u32;
        let mut wanted = None;
        loop {
            let Some(scan) = wanted else {
                let paused = Instant::now();
                wanted = orders.wait().await;
                last.set(last.get() + paused.elapsed());
                continue;
            };
            let end = self.scan(scan, orders, last, &mut patience).await;
            match end {
                End::Ordered(order) => wanted = order,
                End::Silent => patience = (patience * 2).min(MOST_PATIENCE),
                End::Failed => Timer::after(PAUSE).await,
            }
            if !matches!(end, End::Ordered(_)) {
                restarts = restarts.wrapping_add(1);
                restarted(restarts);
                last.set(Instant::now());
            }
        }
    }

    /// Scans until there is another order, or nothing is heard for too long.
    async fn scan(&self, scan: Scan, orders: &Orders, last: &Cell<Instant>, patience: &mut Duration) -> End {
        let mut session = Session::new(self.host.central());
        let config = ScanConfig {
            active: false,
            interval: Duration::from_millis(scan.interval_ms.into()),
            window: Duration::from_millis(scan.window_ms.into()),
            filter_duplicates: FilterDuplicates::Disabled,
            ..Default::default()
        };
        // Dropped, it stops.
        let Ok(_scanning) = session.scan(&config).await else { return End::Failed };
        loop {
            let heard = last.get();
            match select(orders.wait(), Timer::at(heard + *patience)).await {
                Either::First(order) => return End::Ordered(order),
                Either::Second(()) if last.get() == heard => return End::Silent,
                Either::Second(()) => *patience = PATIENCE,
            }
        }
    }
}

/// Hands advertisements over.
struct Listener<F> {
    heard: RefCell<F>,
    last: Cell<Instant>,
}

impl<F: FnMut(Advertisement<'_>)> EventHandler for Listener<F> {
    fn on_adv_reports(&self, reports: LeAdvReportsIter<'_>) {
        // The host calls this from one place, never within itself.
        let Ok(mut heard) = self.heard.try_borrow_mut() else { return };
        for report in reports.flatten() {
            self.last.set(Instant::now());
            let mut address = [0; 6];
            address.copy_from_slice(report.addr.raw());
            heard(Advertisement { address, rssi: report.rssi, data: report.data });
        }
    }
}
