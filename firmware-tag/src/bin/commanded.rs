//! A board's scanner under the commands of the scan: what goes wrong is logged.

#[cfg(feature = "dwm1001")]
use boards::dwm1001::bluetooth::Scanner;
#[cfg(not(feature = "dwm1001"))]
use boards::esp::bluetooth::Scanner;
use firmware_tag::scan;

pub struct Commanded<'s>(pub &'s Scanner);

impl scan::Scanner for Commanded<'_> {
    async fn start(&mut self) {
        if let Err(error) = self.0.start_scan().await {
            defmt::warn!("the scan does not start: {}", error);
        }
    }

    async fn stop(&mut self) {
        if let Err(error) = self.0.stop_scan().await {
            defmt::warn!("the scan does not stop: {}", error);
        }
    }
}
