//! A tag's scanner: passive, every advertisement told as often as it is heard.

use core::convert::Infallible;

use bt_hci::cmd::le::{LeSetScanEnable, LeSetScanParams};
use bt_hci::param::{AddrKind, Duration, LeScanKind, ScanningFilterPolicy};
use esp_radio::ble::Config;
use firmware_tag::scan;

use super::{Advertisement, Controller, Error, Parts, StartError};

/// How long the scanner stays on a channel before it goes to the next, milliseconds: of a window of 90, each gets a part. A beacon's
/// advertisement is on all its channels within a millisecond or two.
const CHANNEL_MS: u32 = 30;

/// A scanner, its controller running.
pub struct Scanner(Controller);

impl Scanner {
    /// Starts the controller; once a program.
    pub fn start(parts: Parts) -> Result<Self, StartError> {
        Controller::start(parts, Config::default()).map(Self)
    }

    /// Listens for ever; without it no command ends. `heard` is called for each advertisement.
    pub async fn listen(&self, heard: impl FnMut(Advertisement<'_>)) -> Infallible {
        self.0.listen(heard).await
    }

    /// Scans from now on, all the time.
    async fn start_scan(&self) -> Result<(), Error> {
        let time = Duration::from_millis(CHANNEL_MS);
        let anybody = ScanningFilterPolicy::BasicUnfiltered;
        // A passive scanner sends nothing: the kind of its address does not matter.
        self.0.command(LeSetScanParams::new(LeScanKind::Passive, time, time, AddrKind::PUBLIC, anybody)).await?;
        // Without a filter of duplicates.
        self.0.command(LeSetScanEnable::new(true, false)).await
    }

    /// Scans no more.
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
