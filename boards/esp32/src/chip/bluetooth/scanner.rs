//! The scanner of a tag, or of a node that does nothing else. The scan is passive, and reports every advertisement,
//! duplicates too.

use core::convert::Infallible;

use bt_hci::cmd::le::{LeSetScanEnable, LeSetScanParams};
use bt_hci::param::{AddrKind, Duration, LeScanKind, ScanningFilterPolicy};
use esp_radio::ble::Config;
use firmware_tag::scan;

use super::{Advertisement, Controller, Error, Parts, StartError};

/// How long the scanner stays on a channel before the next, milliseconds. In a window of 90 ms each channel has a part.
/// A beacon sends its advertisement on all its channels within a millisecond or two.
const CHANNEL_MS: u32 = 30;
/// From one such stay to the next, milliseconds: Wi-Fi has the radio in between.
const INTERVAL_MS: u32 = if cfg!(feature = "coex") { 2 * CHANNEL_MS } else { CHANNEL_MS };

/// A scanner with a running controller.
pub struct Scanner(Controller);

impl Scanner {
    /// Starts the controller. May be called once in a program's run.
    ///
    /// # Errors
    /// The controller does not start.
    pub fn start(parts: Parts) -> Result<Self, StartError> {
        Controller::start(parts, Config::default()).map(Self)
    }

    /// Receives for ever, and calls `heard` for each advertisement. No command ends while this does not run.
    pub async fn listen(&self, heard: impl FnMut(Advertisement<'_>)) -> Infallible {
        self.0.listen(heard).await
    }

    /// Starts to scan, all the time.
    async fn start_scan(&self) -> Result<(), Error> {
        let (interval, window) = (Duration::from_millis(INTERVAL_MS), Duration::from_millis(CHANNEL_MS));
        let anybody = ScanningFilterPolicy::BasicUnfiltered;
        // A passive scanner sends nothing, so the kind of its address does not matter.
        self.0.command(LeSetScanParams::new(LeScanKind::Passive, interval, window, AddrKind::PUBLIC, anybody)).await?;
        // Duplicates are not filtered.
        self.0.command(LeSetScanEnable::new(true, false)).await
    }

    /// Stops scanning.
    async fn stop_scan(&self) -> Result<(), Error> {
        self.0.command(LeSetScanEnable::new(false, false)).await
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
